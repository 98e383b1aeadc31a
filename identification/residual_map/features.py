"""Flexible functions of each variable that a force residual may depend on.

A feature is a function of the motion at the samples. It passes through the same filter as the
residual before the two are compared. Otherwise a sharp function, such as a friction that changes
sign, would not match the filtered residual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.variables import MotionVariables

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FeatureScales:
    """What features are measured in, pooled over all logs.

    Attributes
    ----------
    sizes : root mean squares of each variable's components, by its name
    places : (2, D) range of each coordinate; duration: of the longest log [s]
    place_means, time_means : of the ramps, so that what is constant stays out of them
    """

    settings: ResidualMapSettings
    sizes: dict[str, Array]
    places: Array
    duration: float
    place_means: Array
    time_means: Array

    @classmethod
    def of(cls, logs: Sequence[MotionVariables], settings: ResidualMapSettings) -> FeatureScales:
        """Pooled over logs."""
        names = ["twist", "rates", "acceleration", "jerk", "torque", "load", "torque_rate"]
        names += [name for name in ("speed", "departure") if getattr(logs[0], name) is not None]
        sizes = {name: _rms(np.concatenate([getattr(log, name) for log in logs])) for name in names}
        where = np.concatenate([log.position for log in logs])
        places = np.quantile(where, settings.usual_places, axis=0)
        duration = max(float(log.time[-1]) for log in logs)
        when = np.concatenate([log.time for log in logs]) / duration
        place_means = np.stack(
            [
                place_shape(where[:, k], places[:, k], settings.position_knots).mean(axis=0)
                for k in range(where.shape[1])
            ]
        )
        time_means = ramps(when, np.array(settings.time_knots)).mean(axis=0)
        return cls(settings, sizes, places, duration, place_means, time_means)

    def scaled(self, variables: MotionVariables, name: str) -> Array:
        """A variable over its usual size."""
        return getattr(variables, name) / self.sizes[name]


def _rms(values: Array) -> Array:
    size = np.sqrt((values**2).mean(axis=0))
    # A component that never moves must not cause a division by zero, nor its rounding be scaled up.
    return np.maximum(size, 1e-6 * size.max(initial=0.0) + 1e-12)


@dataclass(frozen=True)
class FeatureGroup:
    """One variable's flexible function: features of a log's variables, (N, Q) at its samples or
    (2, N - 1, Q) at the ends of its intervals.

    pairs: features are cosine and sine of one order after another, of which only a few are used.
    may_lie_elsewhere: whether one log may have it in another range than the others
    follows_twist: whether the twist and the model determine it
    """

    variable: str
    features: Callable[[MotionVariables, FeatureScales], Array]
    pairs: bool = False
    may_lie_elsewhere: bool = False
    follows_twist: bool = False


def feature_groups(variables: MotionVariables) -> list[FeatureGroup]:
    """A group for every variable that these logs have; the first is the twist."""
    groups = [FeatureGroup("twist", _of_twist)]
    for k, joint in enumerate(variables.joints):
        if variables.departure is not None:
            speed = partial(_of_speed, k=k)
            groups.append(FeatureGroup(_named("wheel_speed", joint), speed, follows_twist=True))
        if variables.angle is not None:
            angle = partial(_of_angle, k=k)
            groups.append(FeatureGroup(_named("wheel_angle", joint), angle, pairs=True))
        torque = partial(_of_torque, k=k)
        groups.append(FeatureGroup(_named("torque", joint), torque, follows_twist=True))
    for k, axis in enumerate(variables.axes):
        groups.append(FeatureGroup(_named("acceleration", axis), partial(_of_acceleration, k=k)))
    if variables.heading is not None:
        groups.append(FeatureGroup("heading", _of_heading, may_lie_elsewhere=True))
    for k, place in enumerate(variables.places):
        where = partial(_of_position, k=k)
        groups.append(FeatureGroup(_named("position", place), where, may_lie_elsewhere=True))
    return [*groups, FeatureGroup("time", _of_time, may_lie_elsewhere=True)]


def _named(kind: str, which: str) -> str:
    return f"{kind}_{which}" if which else kind


def _of_twist(variables: MotionVariables, scales: FeatureScales) -> Array:
    """Powers up to the third; dry, asymmetric and quadratic friction wherever surfaces slide."""
    u, rates = scales.scaled(variables, "twist"), scales.scaled(variables, "rates")
    powers = [
        np.prod(u[:, list(chosen)], axis=1)
        for degree in range(4)
        for chosen in combinations_with_replacement(range(u.shape[1]), degree)
    ]
    signs = [np.tanh(rates / width) for width in scales.settings.step_widths]
    return np.column_stack([*powers, *signs, np.abs(rates), rates * np.abs(rates)])


def _of_speed(variables: MotionVariables, scales: FeatureScales, k: int) -> Array:
    speed = scales.scaled(variables, "speed")[:, k]
    slip = scales.scaled(variables, "departure")[:, k]
    signs = [np.tanh(speed / width) for width in scales.settings.step_widths]
    # Even ones and a constant: of a friction that acts one way alone.
    even = [np.ones_like(speed), np.abs(speed), speed**2]
    return np.column_stack([*signs, speed, speed**3, *even, slip, slip * speed])


def _of_angle(variables: MotionVariables, scales: FeatureScales, k: int) -> Array:
    assert variables.angle is not None
    turn = np.exp(1j * variables.angle[:, k])
    orders = scales.settings.max_wheel_order
    powers = np.cumprod(np.broadcast_to(turn[:, None], (len(turn), orders)), axis=1)
    # A view of complex numbers as floats is cosine, sine, cosine, ... of each order. Powers of one
    # number are much cheaper than a cosine and a sine of each order. sqrt(2) makes the rms one.
    waves = np.sqrt(2.0) * powers.view(float)
    if variables.speed is None:
        return waves
    # Times the sign of its speed: it rubs over a part of its turn.
    speed = scales.scaled(variables, "speed")[:, [k]]
    rubbing = np.tanh(speed / scales.settings.step_widths[0])
    return np.column_stack([waves, rubbing * waves[:, : 2 * scales.settings.rubbing_wheel_orders]])


def _of_torque(variables: MotionVariables, scales: FeatureScales, k: int) -> Array:
    """Of the predicted torque: noise of the measured torque is in the residual as well."""
    torque = variables.torque_ends[..., k] / scales.sizes["torque"][k]
    rate = scales.scaled(variables, "torque_rate")[:, k]
    name = "twist" if variables.speed is None else "speed"
    speed = scales.scaled(variables, name)[:, k]
    load = scales.scaled(variables, "load")[:, k]
    signed = [load * np.tanh(speed / width) for width in scales.settings.step_widths[:2]]
    # Even ones and a constant: of a drive that is weak one way alone.
    even = [np.ones_like(load), load, load**2]
    smooth_ones = at_ends(np.column_stack([rate, *signed, *even]))
    return np.concatenate([torque[..., None], smooth_ones], axis=-1)


def _of_acceleration(variables: MotionVariables, scales: FeatureScales, k: int) -> Array:
    jerk = scales.scaled(variables, "jerk")[:, [k]]
    return np.concatenate([_faster(variables, scales)[..., [k]], at_ends(jerk)], axis=-1)


def _faster(variables: MotionVariables, scales: FeatureScales) -> Array:
    """(2, N - 1, A) the acceleration over its usual size."""
    return variables.acceleration_ends / scales.sizes["acceleration"]


def at_ends(signal: Array) -> Array:
    """(2, N - 1, ...) a signal (N, ...) at the start and the end of each interval."""
    return np.stack([signal[:-1], signal[1:]])


def _of_heading(variables: MotionVariables, scales: FeatureScales) -> Array:
    """Forces fixed in the world, alone and in proportion to speed, and dry ones along a line."""
    assert variables.heading is not None
    settings = scales.settings
    c, s = np.cos(variables.heading), np.sin(variables.heading)
    harmonics = range(1, settings.max_heading_harmonic + 1)
    waves = np.column_stack(
        [wave(n * variables.heading) for n in harmonics for wave in (np.cos, np.sin)]
    )
    vx, vy = variables.twist[:, 0], variables.twist[:, 1]
    along, across = c * vx - s * vy, s * vx + c * vy
    speed = np.sqrt((scales.sizes["twist"][:2] ** 2).mean())
    dry = []
    for angle in np.pi / settings.friction_directions * np.arange(settings.friction_directions):
        toward = (np.cos(angle) * along + np.sin(angle) * across) / speed
        for width in settings.step_widths[1:]:
            step = np.tanh(toward / width)
            dry += [step * c, step * s]
    return np.column_stack([waves, _products(waves, scales.scaled(variables, "twist")), *dry])


def _of_position(variables: MotionVariables, scales: FeatureScales, k: int) -> Array:
    """Forces along the body or the world, and friction, that change from place to place."""
    knots = scales.settings.position_knots
    shape = place_shape(variables.position[:, k], scales.places[:, k], knots)
    shape = shape - scales.place_means[k]
    partners = [scales.scaled(variables, "twist")]
    if variables.heading is not None:
        partners += [np.cos(variables.heading), np.sin(variables.heading)]
    return np.column_stack([shape, _products(shape, np.column_stack(partners))])


def _of_time(variables: MotionVariables, scales: FeatureScales) -> Array:
    """Offsets, frictions and masses that change with the time from the log's start."""
    knots = np.array(scales.settings.time_knots)
    shape = ramps(variables.time / scales.duration, knots) - scales.time_means
    moving = at_ends(np.column_stack([shape, _products(shape, scales.scaled(variables, "twist"))]))
    faster = _faster(variables, scales)
    ends = [_products(s, a) for s, a in zip(at_ends(shape), faster, strict=True)]
    return np.concatenate([moving, np.stack(ends)], axis=-1)


def place_shape(place: Array, edges: Array, knots: int) -> Array:
    """A line and ramps (N, knots) over a coordinate (N,) between its usual edges (2,)."""
    share = (place - edges[0]) / max(edges[1] - edges[0], 1e-9)
    line = np.clip(2 * share - 1, -2.0, 2.0)
    return np.column_stack([line, ramps(share, np.linspace(0.0, 1.0, knots))])


def ramps(values: Array, knots: Array) -> Array:
    """(N, knots - 1) rising from 0 to 1 between two knots: constant outside,
    so that nothing is extrapolated."""
    return np.clip((values[:, None] - knots[:-1]) / np.diff(knots), 0.0, 1.0)


def _products(left: Array, right: Array) -> Array:
    """(N, P Q) every column of (N, P) times every column of (N, Q)."""
    return (left[:, :, None] * right[:, None, :]).reshape(len(left), -1)
