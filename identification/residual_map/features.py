"""Flexible functions of each variable that a force residual may depend on.

A feature is a function of the motion at the samples. It passes through the filter of the residual
before it is compared with it: a sharp function, such as friction that changes sign, would not
match otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from identification.residual_map.variables import Signals

Array = NDArray[np.float64]

SHARP = (0.006, 0.04, 0.25)
"""Widths of steps over the usual rate: with 5 rad/s at the wheels 0.03, 0.2 and 1.25 rad/s."""

ORDERS = np.arange(1, 25)
"""Cycles per turn that a wheel's angle is searched for."""

HARMONICS = (1, 2, 3)
DIRECTIONS = 8
"""World directions, over half a turn, along which a dry force may act."""

POSITION_KNOTS = np.linspace(0.0, 1.0, 6)
TIME_KNOTS = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
"""Shares of the longest log: dense at the start, where something warms up."""


@dataclass(frozen=True)
class Scales:
    """Usual sizes (root mean squares) over all logs by a signal's name; ranges of place and time.

    place_means, time_means: of the ramps, so that what is constant stays out of them.
    """

    sizes: dict[str, Array]
    places: Array
    duration: float
    place_means: Array
    time_means: Array

    @classmethod
    def of(cls, logs: Sequence[Signals]) -> Scales:
        """Pooled over logs."""
        sizes = {
            name: _rms(np.concatenate([getattr(log, name) for log in logs]))
            for name in ("twist", "rates", "acceleration", "jerk", "torque", "load", "torque_rate")
        }
        for name in ("speed", "departure"):
            if getattr(logs[0], name) is not None:
                sizes[name] = _rms(np.concatenate([getattr(log, name) for log in logs]))
        where = np.concatenate([log.position for log in logs])
        places = np.quantile(where, [0.02, 0.98], axis=0)
        duration = max(float(log.time[-1]) for log in logs)
        when = np.concatenate([log.time for log in logs]) / duration
        place_means = np.stack(
            [place_shape(where[:, k], places[:, k]).mean(axis=0) for k in range(where.shape[1])]
        )
        return cls(sizes, places, duration, place_means, ramps(when, TIME_KNOTS).mean(axis=0))

    def scaled(self, signals: Signals, name: str) -> Array:
        """A signal over its usual size."""
        return getattr(signals, name) / self.sizes[name]


def _rms(values: Array) -> Array:
    size = np.sqrt((values**2).mean(axis=0))
    return np.maximum(size, 1e-6 * size.max(initial=0.0) + 1e-12)


@dataclass(frozen=True)
class Group:
    """One variable's flexible function: features (N, Q) of the signals.

    pairs: features are cosine and sine of one order after another, few of which matter.
    """

    variable: str
    features: Callable[[Signals, Scales], Array]
    pairs: bool = False


def groups(signals: Signals) -> list[Group]:
    """Every variable that these signals have; the first is the twist."""
    found = [Group("twist", _of_twist)]
    for k, joint in enumerate(signals.joints):
        if signals.departure is not None:
            found.append(Group(_named("wheel_speed", joint), _at(_of_speed, k)))
        if signals.angle is not None:
            found.append(Group(_named("wheel_angle", joint), _at(_of_angle, k), pairs=True))
        found.append(Group(_named("torque", joint), _at(_of_torque, k)))
    for k, axis in enumerate(signals.axes):
        found.append(Group(_named("acceleration", axis), _at(_of_acceleration, k)))
    if signals.heading is not None:
        found.append(Group("heading", _of_heading))
    for k, place in enumerate(signals.places):
        found.append(Group(_named("position", place), _at(_of_position, k)))
    return [*found, Group("time", _of_time)]


def _named(kind: str, which: str) -> str:
    return f"{kind}_{which}" if which else kind


def _at(
    function: Callable[[Signals, Scales, int], Array], k: int
) -> Callable[[Signals, Scales], Array]:
    return lambda signals, scales: function(signals, scales, k)


def _of_twist(signals: Signals, scales: Scales) -> Array:
    """Powers up to the third; dry, asymmetric and quadratic friction wherever surfaces slide."""
    u, rates = scales.scaled(signals, "twist"), scales.scaled(signals, "rates")
    powers = [
        np.prod(u[:, list(chosen)], axis=1)
        for degree in range(4)
        for chosen in combinations_with_replacement(range(u.shape[1]), degree)
    ]
    steps = [np.tanh(rates / width) for width in SHARP]
    return np.column_stack([*powers, *steps, np.abs(rates), rates * np.abs(rates)])


def _of_speed(signals: Signals, scales: Scales, k: int) -> Array:
    speed = scales.scaled(signals, "speed")[:, k]
    slip = scales.scaled(signals, "departure")[:, k]
    steps = [np.tanh(speed / width) for width in SHARP]
    return np.column_stack([*steps, speed, speed**3, slip, slip * speed])


def _of_angle(signals: Signals, scales: Scales, k: int) -> Array:
    assert signals.angle is not None
    turns = np.exp(1j * signals.angle[:, k])
    powers = np.cumprod(np.broadcast_to(turns[:, None], (len(turns), len(ORDERS))), axis=1)
    return np.sqrt(2.0) * powers.view(float)


def _of_torque(signals: Signals, scales: Scales, k: int) -> Array:
    """The predicted torque's: the measured one would share its noise with the residual."""
    torque = scales.scaled(signals, "torque")[:, k]
    rate = scales.scaled(signals, "torque_rate")[:, k]
    moving = signals.twist if signals.speed is None else signals.speed
    speed = moving[:, k] / scales.sizes["twist" if signals.speed is None else "speed"][k]
    load = scales.scaled(signals, "load")[:, k]
    signed = [load * np.tanh(speed / width) for width in SHARP[:2]]
    return np.column_stack([torque, rate, *signed])


def _of_acceleration(signals: Signals, scales: Scales, k: int) -> Array:
    names = ("acceleration", "jerk")
    return np.column_stack([scales.scaled(signals, name)[:, k] for name in names])


def _of_heading(signals: Signals, scales: Scales) -> Array:
    """Forces fixed in the world, alone and in proportion to speed, and dry ones along a line."""
    assert signals.heading is not None
    c, s = np.cos(signals.heading), np.sin(signals.heading)
    waves = np.column_stack(
        [wave(n * signals.heading) for n in HARMONICS for wave in (np.cos, np.sin)]
    )
    vx, vy = signals.twist[:, 0], signals.twist[:, 1]
    along, across = c * vx - s * vy, s * vx + c * vy
    speed = np.sqrt((scales.sizes["twist"][:2] ** 2).mean())
    dry = []
    for angle in np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        toward = (np.cos(angle) * along + np.sin(angle) * across) / speed
        for width in SHARP[1:]:
            step = np.tanh(toward / width)
            dry += [step * c, step * s]
    return np.column_stack([waves, _products(waves, scales.scaled(signals, "twist")), *dry])


def _of_position(signals: Signals, scales: Scales, k: int) -> Array:
    """Forces along the body or the world, and friction, that change from place to place."""
    shape = place_shape(signals.position[:, k], scales.places[:, k]) - scales.place_means[k]
    partners = [scales.scaled(signals, "twist")]
    if signals.heading is not None:
        partners += [np.cos(signals.heading), np.sin(signals.heading)]
    return np.column_stack([shape, _products(shape, np.column_stack(partners))])


def _of_time(signals: Signals, scales: Scales) -> Array:
    """Offsets, frictions and masses that change with the time from the log's start."""
    shape = ramps(signals.time / scales.duration, TIME_KNOTS) - scales.time_means
    moving, faster = (scales.scaled(signals, name) for name in ("twist", "acceleration"))
    return np.column_stack([shape, _products(shape, moving), _products(shape, faster)])


def place_shape(place: Array, edges: Array) -> Array:
    """A line and ramps (N, Q) over a coordinate (N,) between its usual edges (2,)."""
    share = (place - edges[0]) / max(edges[1] - edges[0], 1e-9)
    return np.column_stack([np.clip(2 * share - 1, -2.0, 2.0), ramps(share, POSITION_KNOTS)])


def ramps(values: Array, knots: Array) -> Array:
    """(N, knots - 1) rising from 0 to 1 between two knots: constant where no log has been."""
    return np.clip((values[:, None] - knots[:-1]) / np.diff(knots), 0.0, 1.0)


def _products(left: Array, right: Array) -> Array:
    return (left[:, :, None] * right[:, None, :]).reshape(len(left), -1)
