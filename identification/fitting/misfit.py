"""Whether a model fits logs so badly that its intervals say nothing: the only place that judges it.

The covariance takes the model's structure for exact. Where something is missing, parameters are off
by more than it says, so no interval is stated.
"""

from __future__ import annotations

import math

from identification.fitting.settings import FitSettings

NEXT_COMMAND = "youbot diagnose MODEL LOG..."
"""What to do about a misfit; a command puts in the names that it knows."""


def misfit(force_error: float, floor: float, settings: FitSettings = FitSettings()) -> float | None:
    """Force error over its noise floor, where the misfit is real; else None."""
    if not (math.isfinite(force_error) and math.isfinite(floor)) or floor <= 0:
        return None
    ratio = force_error / floor
    return ratio if ratio > settings.max_error_over_floor else None


def misfit_warning(
    force_error: float,
    floor: float,
    *,
    next_command: str = NEXT_COMMAND,
    settings: FitSettings = FitSettings(),
) -> str | None:
    """The sentence that a misfit deserves; None where what is left may be noise."""
    ratio = misfit(force_error, floor, settings)
    if ratio is None:
        return None
    return (
        f"the force error is {ratio:.3g} times the noise floor: the model lacks something, so no "
        f"95 % interval is stated; next: {next_command}"
    )
