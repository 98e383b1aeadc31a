"""Whether a model fits logs so badly that its intervals say nothing: the only place that judges it.

The covariance takes the model's structure for exact. Where something is missing, parameters are off
by more than it says, so no interval is stated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from identification.fitting.settings import FitSettings
from identification.mechanisms.physical_parameters import StatedParameters
from youbot_env.model.model import Model

NEXT_COMMAND = "youbot diagnose MODEL LOG..."
"""What to do about a misfit; a command puts in the names that it knows."""


def force_floor_of(model: Model[Any] | StatedParameters) -> float | None:
    """The relative noise floor of the forces on the logs that a model was made of; None if its file
    does not hold it."""
    floor = model.errors.get("noise_floor")
    found = floor.get("force_error") if isinstance(floor, Mapping) else None
    return found if isinstance(found, (int, float)) and math.isfinite(found) else None


def misfit_of(
    model: Model[Any] | StatedParameters, settings: FitSettings = FitSettings()
) -> float | None:
    """How many times its noise floor the force error of a model was on the logs that it was made
    of, if that was a misfit; None if it was not, or is not known."""
    error, floor = model.errors.get("force_error"), force_floor_of(model)
    if not isinstance(error, (int, float)) or floor is None or not misfit(error, floor, settings):
        return None
    return error / max(floor, 1e-300)


def misfit(force_error: float, floor: float, settings: FitSettings = FitSettings()) -> bool:
    """Whether more of a force error's squares is above its noise floor than noise may leave."""
    if not (math.isfinite(force_error) and math.isfinite(floor)) or force_error <= 0:
        return False
    above = 1.0 - (floor / force_error) ** 2
    return above > settings.predictability.max_noise_share


def stated_estimates(
    model: Model[Any] | StatedParameters,
    *,
    fits: bool | None = None,
    settings: FitSettings = FitSettings(),
) -> dict[str, dict[str, Any]]:
    """A model's parameters, and those of its effects as EFFECT.PARAMETER, as they are told.

    By name value, std, unit and 95 % interval, in SI units; no interval (None) where the model did
    not fit the logs that it was fitted on.

    Parameters
    ----------
    fits : whether it did, where that is known; else judged by the errors that it holds
    """
    holds = misfit_of(model, settings) is None if fits is None else fits
    entries = dict(model.parameters) | {
        f"{effect}.{name}": entry
        for effect, inner in model.effects.items()
        for name, entry in inner.items()
    }
    found: dict[str, dict[str, Any]] = {}
    for name, entry in entries.items():
        interval = None
        if holds and entry.std is not None:
            reach = settings.interval_deviations * entry.std
            interval = [entry.value - reach, entry.value + reach]
        found[name] = {
            "value": entry.value,
            "std": entry.std,
            "interval": interval,
            "unit": entry.unit,
        }
    return found


def misfit_warning(
    force_error: float,
    floor: float,
    *,
    real: bool | None = None,
    next_command: str = NEXT_COMMAND,
    settings: FitSettings = FitSettings(),
) -> str | None:
    """The sentence that a misfit deserves; None where what is left may be noise.

    ``real``: whether the residual of the fit itself can be predicted, where that is known.
    """
    if not (misfit(force_error, floor, settings) if real is None else real):
        return None
    size = f"the force error is {force_error / max(floor, 1e-300):.3g} times the noise floor"
    if not misfit(force_error, floor, settings):
        size = "the motion predicts a part of what the model leaves, small beside the noise"
    return f"{size}: the model lacks something, so no 95 % interval is stated; next: {next_command}"
