"""Sentences on effects of kinematics, each with an action at the robot that can confirm it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from youbot_env.physics.hardware import WHEEL_WORDS

Values = Mapping[str, float]


def _odd_wheel(values: Values) -> tuple[str, float] | None:
    """The wheel that differs from three like ones, and by how much; None if more than one does."""
    for name, value in values.items():
        others = [other for key, other in values.items() if key != name]
        apart = value - sum(others) / len(others)
        # Others that are as like as that: one wheel is to blame.
        if max(others) - min(others) < 0.3 * abs(apart):
            return WHEEL_WORDS[name.rsplit("_", 1)[1]], apart
    return None


def _each(values: Values) -> str:
    return ", ".join(
        f"{WHEEL_WORDS[name.rsplit('_', 1)[1]]} {value:+.1%}" for name, value in values.items()
    )


def _radius(values: Values, base: Values) -> str:
    odd = _odd_wheel(values)
    if odd is None:
        found = f"the wheels' radii differ (relative to their mean: {_each(values)})"
    else:
        found = f"the {odd[0]} wheel is {abs(odd[1]):.1%} {'larger' if odd[1] > 0 else 'smaller'}"
        found += " than the others"
    return (
        f"{found}: no rigid motion explains the four wheel speeds otherwise; to confirm, measure "
        "the wheels, or roll each ten turns along a rule"
    )


def _gain(values: Values, base: Values) -> str:
    odd = _odd_wheel(values)
    if odd is None:
        found = f"the speed channels' scales differ (true over logged: {_each(values)})"
    else:
        kind = "more" if odd[1] > 0 else "less"
        found = f"the {odd[0]} wheel truly turns {abs(odd[1]):.1%} {kind} than its speed says"
        found += ", beside the others"
    return f"{found}; to confirm, count ten turns of each wheel, or swap two encoders"


def _angle(values: Values, base: Values) -> str:
    degrees = {name: 45 + math.degrees(value) for name, value in values.items()}
    mean = sum(degrees.values()) / len(degrees)
    if max(degrees.values()) - min(degrees.values()) < 0.3 * abs(mean - 45):
        found = f"the rollers stand at {mean:.1f} degrees to the wheels' planes, not at 45"
    else:
        parts = ", ".join(
            f"{WHEEL_WORDS[name.rsplit('_', 1)[1]]} {value:.1f}" for name, value in degrees.items()
        )
        found = f"the rollers do not stand at 45 degrees ({parts})"
    return f"{found}; to confirm, drive sideways along a rule: the way is not what the wheels say"


def _filter(values: Values, base: Values) -> str:
    return (
        f"the logged speeds are low-passed by {1e3 * values['time_constant']:.0f} ms, or the "
        "drives lag by as much; to confirm, log positions or a pose beside them, or look for a "
        "filter in the driver"
    )


def _creep(values: Values, base: Values) -> str:
    return (
        f"the wheels turn {values['slip']:.3g} rad/s faster than they roll for each N m of "
        "torque; to confirm, hold the robot against a spring scale and look for wheels that turn"
    )


KINEMATIC_WORDS: dict[str, Callable[[Values, Values], str]] = {
    "wheel_radius_error": _radius,
    "speed_gain_error": _gain,
    "roller_angle_error": _angle,
    "speed_filter": _filter,
    "wheel_creep": _creep,
}
"""What each effect of kinematics says at its fitted size, from its values and the base model's."""


def contradiction_warning(names: Sequence[str]) -> str:
    """What a reader must know where wheels and forces disagree on effects of kinematics."""
    listed = " and ".join(name.replace("_", " ") for name in names)
    return (
        f"wheel speeds (and a pose, if there is one) speak for {listed}, but with it the forces "
        "fit worse than without it: it is left out. Wheels and floor differ in another way than "
        "that, so the way that the model predicts is a little off"
    )
