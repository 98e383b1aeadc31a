"""What a tool should say unasked: estimates that can hardly be, or that the data hardly show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from identification.mechanisms.settings import MechanismSettings
from youbot_env.model.model import Estimate, Model
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import Parameter, with_unit
from youbot_env.physics.geometry import Geometry


def warnings_of(
    model: Model[Geometry], settings: MechanismSettings = MechanismSettings()
) -> list[str]:
    """Plain sentences on implausible or barely observable parameters."""
    # A centre of mass may well lie at O: it is judged by the footprint.
    footprint = {"aX": model.geometry.l, "aY": model.geometry.l}
    barely = barely_observable(model, settings, footprint)
    implausible = [*_inertia(model, settings), *_wheel(model, settings), *_centre_of_mass(model)]
    return [*implausible, *barely]


def _inertia(model: Model[Geometry], settings: MechanismSettings) -> list[str]:
    g, value = model.geometry, model.values
    radius = float(np.sqrt(value["I0"] / value["m0"]))
    corner = float(np.hypot(g.l, g.h))
    if radius > corner and not _is_published(model, settings):
        return [
            f"I0 = {value['I0']:.3g} kg m^2 with m0 = {value['m0']:.3g} kg is a gyration radius of "
            f"{radius:.2f} m, beyond the wheels' {corner:.2f} m from the centre: hardly possible "
            "for mass inside the footprint; did an arm reach out, or is another effect in it?"
        ]
    if radius < settings.min_gyration_radius_share * corner:
        return [
            f"I0 = {value['I0']:.3g} kg m^2 with m0 = {value['m0']:.3g} kg is a gyration radius of "
            f"only {radius:.2f} m: the four wheels alone make more than that; check the units"
        ]
    return []


def _is_published(model: Model[Geometry], settings: MechanismSettings) -> bool:
    """Whether mass and inertia are those that the paper gives for the youBot.

    They are odd together (README says so), and every log of such a platform would be warned of.
    """
    paper, near = load_model("paper"), settings.max_published_difference
    return model.geometry == paper.geometry and all(
        abs(model.values[name] / paper.values[name] - 1) < near for name in ("m0", "I0")
    )


def _wheel(model: Model[Geometry], settings: MechanismSettings) -> list[str]:
    found = model.parameters["I1"]
    solid = 0.5 * model.geometry.m1 * model.geometry.R**2
    if not solid > 0 or _may_be_zero(found, model.base_parameters["I1"], settings):
        return []  # a ratio of a value that means nothing
    ratio = found.value / solid
    if ratio > settings.max_wheel_inertia_ratio:
        return [
            f"I1 = {found.value:.2g} kg m^2 is {ratio:.1f} times a solid wheel's "
            f"{solid:.2g} kg m^2: the motor's rotor, seen through the gear, may explain it"
        ]
    if ratio < settings.min_wheel_inertia_ratio:
        return [
            f"I1 = {found.value:.2g} kg m^2 is only {ratio:.2f} of a solid wheel's "
            f"{solid:.2g} kg m^2: hardly possible; m0 and I1 may be mixed up"
        ]
    return []


def _may_be_zero(found: Estimate, declared: Parameter, settings: MechanismSettings) -> bool:
    """Whether a parameter that cannot be negative stands at zero, or its interval reaches it."""
    if declared.lower != 0:
        return False
    least = settings.negligible_value_share * declared.size
    return found.value <= max(least, settings.interval_deviations * (found.std or 0.0))


def _centre_of_mass(model: Model[Geometry]) -> list[str]:
    g, value = model.geometry, model.values
    if abs(value["aX"]) > g.h or abs(value["aY"]) > g.l:
        return [
            f"the centre of mass ({value['aX']:.3f}, {value['aY']:.3f}) m lies outside the wheels: "
            "the robot would tip over; check wheel order and signs"
        ]
    return []


def barely_observable(
    model: Model[Any],
    settings: MechanismSettings = MechanismSettings(),
    sizes: Mapping[str, float] | None = None,
) -> list[str]:
    """A sentence on each parameter that the logs hardly show, of any mechanism.

    Parameters
    ----------
    sizes : of parameters that may well be zero: by these they are judged, not by their values
    """
    sizes = sizes or {}
    found: list[str] = []
    estimates = dict(model.parameters) | {
        f"{effect}.{name}": estimate
        for effect, parameters in model.effects.items()
        for name, estimate in parameters.items()
        if model.effect(effect).public_parameter(name).relative_to is None
    }
    for name, estimate in estimates.items():
        size = sizes.get(name, abs(estimate.value))
        effect, _, key = name.partition(".")
        declared = (
            model.effect(effect).public_parameter(key) if key else model.base_parameters[name]
        )
        if key and model.effect(effect).public is not None:
            # A place or a phase may well be zero: judged by its catalogue size.
            size = max(size, declared.size)
        if estimate.std is None or estimate.std <= settings.max_deviation_share * size:
            continue
        if _may_be_zero(estimate, declared, settings):
            most = estimate.value + settings.interval_deviations * estimate.std
            bound = with_unit(f"{most:.2g}", estimate.unit)
            found.append(f"{name} is not shown by these logs (below {bound})")
        else:
            size = with_unit(f"{estimate.value:.3g} +- {estimate.std:.2g}", estimate.unit)
            found.append(f"{name} = {size} is barely observable in these logs")
    return found
