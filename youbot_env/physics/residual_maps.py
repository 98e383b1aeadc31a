"""Smooth maps of what a model leaves: forces that stand in for a law that nobody knows yet.

``residual:heading`` is an effect like any other, of many coefficients: a smooth function of one
variable at each component of the force, linear in them. Fitted jointly with the model it takes away
whatever depends on that variable. It explains nothing: where the logs have not been it knows
nothing, so it carries the range that they have passed (``low``, ``high``), and whoever evaluates it
outside is refused (:func:`refuse_unseen`). Inside a simulation, which cannot stop, it stays at its
value at the edge until the run's end is checked.

Bounded variables have cubic B-splines on even knots (de Boor, A Practical Guide to Splines, 1978),
angles humps around the turn. All are local: what one part of the range shows says nothing of
another, so a range that some logs alone have passed can be judged. On a speed what is proportional
to it is left out: the model's own viscous friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.physics.effect import (
    BODY,
    WHEEL,
    WORLD,
    Body,
    Effect,
    Parameter,
    Place,
    with_unit,
)
from youbot_env.physics.namespaces import Namespace, Number

Array = NDArray[np.float64]

PREFIX = "residual:"
"""Before the variable in the name of such an effect."""

KNOTS = 9
"""Coefficients of a spline: six pieces over the range, about as fine as a residual map's curves."""

HUMPS = {"heading": 12, "wheel_angle": 12}
"""Of angles: coefficients a turn. A finer ripple has a law of its own, `torque_ripple`."""

SLACK = 0.02
"""Share of the range by which it may be left: noise, and the last moment of a run."""

TURN = 2.0 * math.pi

TRACE = 1e-12
"""Of any unit, beside a range."""

FULL_GAP = TURN / 12
"""[rad] A gap between the angles that are passed that is no gap: that from one hump to the next."""


class Places(NamedTuple):
    """Where a motion has been: twist (..., 3), pose (..., 3), wheel_angle and wheel_speed (..., 4),
    time (...), SI units; None where it is not known."""

    twist: Array | None = None
    pose: Array | None = None
    wheel_angle: Array | None = None
    wheel_speed: Array | None = None
    time: Array | None = None


@dataclass(frozen=True)
class Variable:
    """What a map is drawn over.

    Attributes
    ----------
    place : where its force acts
    read : its value at the point of an effect; of : its values along a motion, None: not known
    unit; is_speed : whether a part that is proportional to it is the model's own
    """

    name: str
    place: Place
    read: Callable[..., Number]
    of: Callable[[Places], Array | None]
    unit: str
    is_speed: bool = False

    @property
    def humps(self) -> int:
        """Of an angle, how many a turn; 0 for what is no angle."""
        return HUMPS.get(self.name, 0)


def _pose(k: int) -> Callable[[Places], Array | None]:
    return lambda at: None if at.pose is None else at.pose[..., k]


def _twist(k: int) -> Callable[[Places], Array | None]:
    return lambda at: None if at.twist is None else at.twist[..., k]


def _read_twist(k: int) -> Callable[[Body], Number]:
    def read(body: Body) -> Number:
        return body.twist[k]

    return read


VARIABLES = {
    item.name: item
    for item in (
        Variable("heading", WORLD, attrgetter("yaw"), _pose(2), "rad"),
        Variable("position_x", WORLD, attrgetter("x"), _pose(0), "m"),
        Variable("position_y", WORLD, attrgetter("y"), _pose(1), "m"),
        Variable("time", WORLD, attrgetter("time"), lambda at: at.time, "s"),
        Variable("forward_speed", BODY, _read_twist(0), _twist(0), "m/s", True),
        Variable("sideways_speed", BODY, _read_twist(1), _twist(1), "m/s", True),
        Variable("yaw_rate", BODY, _read_twist(2), _twist(2), "rad/s", True),
        Variable(
            "wheel_speed", WHEEL, attrgetter("rate"), lambda at: at.wheel_speed, "rad/s", True
        ),
        Variable("wheel_angle", WHEEL, attrgetter("angle"), lambda at: at.wheel_angle, "rad"),
    )
}
"""What a map can be drawn over. Not over torques and accelerations: their noise is the residual's
own."""

COMPONENTS = {
    "world": (("x", "N", 5.0), ("y", "N", 5.0), ("turn", "N m", 1.0)),
    "body": (("x", "N", 5.0), ("y", "N", 5.0), ("turn", "N m", 1.0)),
    "wheel joint": (("torque", "N m", 0.1),),
}
"""Of the force at each place: prefix of its coefficients, unit, size where it matters."""


def is_map(name: str) -> bool:
    """Whether an effect's name is one of a map."""
    return name.startswith(PREFIX)


@cache
def residual_map_effect(name: str) -> Effect:
    """The effect behind a name such as ``residual:heading``.

    Raises
    ------
    InputError
        If there is no such variable.
    """
    word = name.removeprefix(PREFIX)
    if word not in VARIABLES:
        raise InputError(
            f"{name}: no map is drawn over {word or 'nothing'!r}; there are "
            f"{', '.join(PREFIX + known for known in VARIABLES)}"
        )
    variable = VARIABLES[word]
    count = variable.humps or KNOTS - variable.is_speed
    each_wheel = variable.name == "wheel_angle"  # their phases have nothing in common
    coefficients = [
        Parameter(f"{part}_{k + 1}", unit, size=size, each_wheel=each_wheel)
        for part, unit, size in COMPONENTS[variable.place.name]
        for k in range(count)
    ]
    limits = [
        Parameter("low", variable.unit, -math.pi if variable.humps else -1.0),
        Parameter("high", variable.unit, math.pi if variable.humps else 1.0),
    ]
    return Effect(
        *(name, variable.place, _function(variable, count), (*coefficients, *limits)),
        f"Smooth map of the residual over {word}; stands for no law",
        f"What the model leaves depends on {word} in a way that no effect of the catalogue has.",
    )


def _function(variable: Variable, count: int) -> Callable[..., Number | tuple[Number, ...]]:
    # The compiled code's key holds what a function refers to: functions and numbers, no objects.
    read, turn, is_torque = variable.read, variable.humps, variable.place is WHEEL
    slopes = _slopes()[:-1] if variable.is_speed else (0.0,) * KNOTS

    def map_over_variable(
        xp: Namespace, point: object, *values: Number
    ) -> Number | tuple[Number, ...]:
        *coefficients, low, high = values
        x = read(point)
        shapes = humps(xp, x, turn) if turn else splines(xp, x, low, high, slopes)
        parts = [coefficients[k : k + count] for k in range(0, len(coefficients), count)]
        sums = tuple(weighted(part, shapes) for part in parts)
        return sums[0] if is_torque else sums

    return map_over_variable


def weighted(coefficients: Sequence[Number], shapes: Sequence[Number]) -> Number:
    """Sum of the functions of a basis, each times its coefficient."""
    total = coefficients[0] * shapes[0]
    for coefficient, shape in zip(coefficients[1:], shapes[1:], strict=True):
        total = total + coefficient * shape
    return total


def humps(xp: Namespace, x: Number, count: int) -> list[Number]:
    """Smooth humps around the turn of an angle, each zero beyond its second neighbour."""
    found: list[Number] = []
    edge = math.cos(2.0 * TURN / count)
    for k in range(count):
        height = xp.maximum(xp.cos(x - k * TURN / count) - edge, 0.0) / (1.0 - edge)
        found.append(height * height)
    return found


def splines(
    xp: Namespace, x: Number, low: Number, high: Number, slopes: Sequence[float]
) -> list[Number]:
    """Cubic B-splines over low to high, each less its slope times the place there, -1 to 1."""
    # Beside the range a trace, so that a range of nothing divides by no zero.
    share = xp.minimum(xp.maximum((x - low) / (high - low + TRACE), 0.0), 1.0)
    found: list[Number] = []
    for k, slope in enumerate(slopes):
        away = xp.abs((KNOTS - 3) * share - (k - 1.0))
        wide, narrow = xp.maximum(2.0 - away, 0.0), xp.maximum(1.0 - away, 0.0)
        found.append((wide**3 - 4.0 * narrow**3) / 6.0 - slope * (2.0 * share - 1.0))
    return found


@cache
def _slopes() -> tuple[float, ...]:
    """Of each spline its part that is proportional to the place in the range, -1 to 1.

    All splines together hold one function that is such a part alone, so one is left out of a basis.
    """
    # Symmetric numbers of one kind: numpy is a namespace of its own.
    grid = np.linspace(-1.0, 1.0, 2001)
    shapes = splines(cast(Namespace, np), cast(Number, grid), -1.0, 1.0, (0.0,) * KNOTS)
    return tuple(float(np.asarray(shape) @ grid / (grid @ grid)) for shape in shapes)


def variable_of(name: str) -> Variable:
    """What a map is drawn over."""
    return VARIABLES[name.removeprefix(PREFIX)]


def components_of(name: str) -> tuple[tuple[str, str, float], ...]:
    """Of its force: prefix of the coefficients, unit, size where it matters."""
    return COMPONENTS[variable_of(name).place.name]


def basis_at(name: str, at: Array, limits: tuple[float, float]) -> Array:
    """(n, k) the functions that each component of a map is made of, at values (n,) of its
    variable."""
    variable = variable_of(name)
    xp, x = cast(Namespace, np), cast(Number, np.asarray(at, float))
    if variable.humps:
        return np.stack(cast("list[Array]", humps(xp, x, variable.humps)), axis=1)
    slopes = _slopes()[:-1] if variable.is_speed else (0.0,) * KNOTS
    low, high = (cast(Number, limit) for limit in limits)
    return np.stack(cast("list[Array]", splines(xp, x, low, high, slopes)), axis=1)


# --- what it has seen --------------------------------------------------------------------------


def seen_range(name: str, motions: Iterable[Places]) -> dict[str, float]:
    """``low`` and ``high`` of a map: the range that motions pass.

    Of an angle that goes all around: a whole turn. Of a speed: as far one way as the other.

    Raises
    ------
    InputError
        If the variable hardly changes.
    """
    variable = variable_of(name)
    parts = [part for at in motions if (part := variable.of(at)) is not None]
    values = np.concatenate([part.ravel() for part in parts]) if parts else np.zeros(1)
    if variable.humps:
        low, high = _arc(values)
    else:
        low, high = float(values.min()), float(values.max())
    if variable.is_speed:
        low, high = -max(-low, high), max(-low, high)
    if not high - low > 1e-6:
        raise InputError(
            f"{name}: {variable.name.replace('_', ' ')} does not change in these logs, so no map "
            "can be drawn over it: give logs in which it does"
        )
    return {"low": low, "high": high}


def _arc(angles: Array) -> tuple[float, float]:
    """The arc that angles pass, from where to where; -pi, pi for all around."""
    passed = np.sort(np.mod(angles, TURN))
    gaps = np.diff(np.append(passed, passed[0] + TURN))
    widest = int(np.argmax(gaps))
    if gaps[widest] < FULL_GAP:
        return -math.pi, math.pi
    low = float(passed[(widest + 1) % len(passed)])
    low -= TURN * (low > math.pi)
    return low, low + TURN - float(gaps[widest])


def refuse_unseen(
    limits: Mapping[str, tuple[float, float]], at: Places, where: str = "the motion"
) -> None:
    """Refuse a motion that leaves what the maps of a model have seen.

    Parameters
    ----------
    limits : low and high of each map, by its effect's name
    where : what goes there, for the sentence

    Raises
    ------
    InputError
        One line: map, value, range, and what to do.
    """
    for name, (low, high) in limits.items():
        variable = variable_of(name)
        values = variable.of(at)
        if values is None:
            continue
        values = values[np.isfinite(values)]
        slack = SLACK * (high - low)
        if variable.humps:
            if high - low >= TURN - 1e-9:
                continue
            values = low - slack + np.mod(values - low + slack, TURN)
        beyond = values[(values < low - slack) | (values > high + slack)]
        if beyond.size:
            there = with_unit(f"{beyond.flat[0]:.3g}", variable.unit)
            raise InputError(
                f"{name}: {where} goes to {there}, and the map has seen "
                f"{low:.3g} to {high:.3g}: fit it again with logs that go there "
                f"(`youbot add MODEL {name} LOG...`), or use a model without it"
            )


def map_limits(names: Sequence[str], values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Low and high of each map among a model's effects, by name, from its values by full name."""
    return {name: (values[f"{name}.low"], values[f"{name}.high"]) for name in names if is_map(name)}
