"""One axis, which slides or turns: its physics and how it is identified.

Units are those of the log: m, m/s, N of an axis that slides, rad, rad/s, N m of one that turns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import AXIS as AXIS_JOINTS, Log
from identification.mechanisms.axis_effects import (
    AXIS_BASE,
    AXIS_CATALOGUE,
    BOTH_WAYS,
    JOINT,
    TURNING,
    Base,
    Joint,
    Scales,
    fitted_to,
)
from identification.mechanisms.mechanism import Conventions, Mechanism, Variables
from identification.mechanisms.quantities import of_axis
from identification.mechanisms.samples import Samples
from identification.mechanisms.settings import MechanismSettings
from identification.mechanisms.standstill import moving_rows
from identification.signals.filters import FilterSettings, block_mean, integral_of
from identification.signals.noise import white_noise
from youbot_env.errors import InputError
from youbot_env.physics.effect import Effect
from youbot_env.physics.mechanism import (
    Components,
    EffectPoints,
    MechanismKind,
    ModelStructure,
    Site,
)
from youbot_env.physics.namespaces import N, Number

Array = NDArray[np.float64]

# --- physics ----------------------------------------------------------------------------------


def _joint(points: EffectPoints[Scales, Number]) -> list[Joint]:
    at = points.at
    return [Joint(at.twist[0], at.acceleration[0], at.pose[0], at.torque[0], at.time, points.base)]


def _same(_: object, values: Sequence[N]) -> Components[N]:
    """Of one axis its joint's rate and torque are its own."""
    return tuple(values)


SITE = Site(_joint, _same)


def _fault(scales: Scales, values: Mapping[str, float]) -> str:
    return "inertia must be positive" if values["inertia"] == 0 else ""


def _holds(item: Effect, scales: Scales) -> bool:
    if scales.one_way and item.name in BOTH_WAYS:
        return False
    return scales.turns or item.acts_at is not TURNING


AXIS = MechanismKind(
    name="axis",
    home="identification.mechanisms.axis:AXIS",
    axes=("speed",),
    joints=AXIS_JOINTS,
    base=AXIS_BASE,
    catalogue=AXIS_CATALOGUE,
    velocity_state=("speed",),
    pose_state=("position",),
    angle_state=(),
    drive_state=("force",),
    lengths=(),
    geometry=Scales(True, 1.0, 1.0, 1.0, 1.0),
    sites={JOINT: SITE, TURNING: SITE},
    base_of=lambda points: Base(*points.theta[: len(Base._fields)]),
    joint_rates=_same,
    force_of=_same,
    torque_of=_same,
    pose_rates=lambda xp, pose, twist: tuple(twist),
    full_speed=lambda scales: (scales.speed,),
    full_torque=lambda scales: scales.force,
    declared=fitted_to,
    holds=_holds,
    fault=_fault,
)
"""One axis that slides or turns."""

# --- logs -------------------------------------------------------------------------------------


def axis_samples(log: Log) -> Samples:
    """Motion and effort of a log; without a position column the position starts at 0.

    Raises
    ------
    InputError
        If the log is not that of one axis.
    """
    if tuple(log.joints) != AXIS_JOINTS:
        raise InputError(f"{log.source or log.name}: not the log of one axis")
    time = log.time - log.time[0]
    known = log.position is not None
    position = log.position if log.position is not None else integral_of(log.velocity, log.dt)
    none = np.empty((len(time), 0))
    return Samples(
        log.name, time, log.dt, log.velocity, position, none, log.velocity, log.effort, known
    )


def typical(
    logs: Sequence[Log], *, turns: bool, settings: MechanismSettings = MechanismSettings()
) -> Scales:
    """What is typical for the axis that some logs are of.

    Raises
    ------
    InputError
        If the axis never moves or no effort is ever made.
    """
    samples = [axis_samples(log) for log in logs]
    speed = _rms([item.twist[:, 0] for item in samples])
    force = _rms([item.torque[:, 0] for item in samples])
    if not speed or not force:
        raise InputError("the axis never moves in these logs: record a motion that excites it")
    average = settings.acceleration_averaging_time
    width = [max(1, round(average / item.dt)) for item in samples]
    means = [block_mean(item.twist[:, 0], n) for item, n in zip(samples, width, strict=True)]
    rates = [
        np.diff(mean) / (n * item.dt) for mean, item, n in zip(means, samples, width, strict=True)
    ]
    travel = max(float(np.ptp(item.pose[:, 0])) for item in samples)
    numbers = (speed, _rms(rates), force, travel)
    # Three digits: the scales stand in the model file, and nothing depends on more.
    rounded = [float(f"{value:.3g}") for value in numbers]
    return Scales(
        *(turns, *rounded),
        bandwidth=_bandwidth(samples, rounded[1], settings),
        one_way=_is_one_way(np.concatenate(means), speed, settings),
    )


def _is_one_way(speeds: Array, typical_speed: float, settings: MechanismSettings) -> bool:
    """Whether speeds (N,), averaged over a moment each, have one sign wherever the axis moves."""
    moving = speeds[np.abs(speeds) > settings.min_moving_speed_share * typical_speed]
    return bool(np.abs(np.sign(moving).mean()) > 1 - 2 * settings.max_other_way_share)


def _bandwidth(
    samples: Sequence[Samples], acceleration: float, settings: MechanismSettings
) -> float:
    """How fast a filter all logs bear: noise in the acceleration attenuates the inertia.

    White noise s of the speed leaves 2 a^3 s^2 dt of variance in the acceleration that has passed
    a filter of the rate a and the mean over a row of 1/(2 a).
    """
    most = settings.max_inertia_attenuation * acceleration**2
    for band in settings.axis_bandwidths:
        noise = [2 * band**3 * white_noise(s.twist)[0] ** 2 * s.dt for s in samples]
        fine = all(band * s.dt <= settings.max_bandwidth_times_sample_time for s in samples)
        if fine and max(noise) <= most:
            return band
    return FilterSettings.rate


def _rms(parts: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


# --- identification ---------------------------------------------------------------------------


def _samples(log: Log, scales: Scales, settings: MechanismSettings) -> Samples:
    samples = axis_samples(log)
    speed = samples.twist[:, 0]
    means = block_mean(speed, max(1, round(settings.acceleration_averaging_time / log.dt)))
    if not scales.one_way and _is_one_way(means, _rms([speed]), settings):
        # Rest alone tells dry friction and offset apart here: it stays, and `identify` warns.
        return samples
    return replace(samples, moves=moving_rows(samples.twist, log.dt, settings))


def _variables(samples: Samples, scales: Scales) -> Variables:
    return Variables(
        axes=("",),
        joints=("",),
        places=("",),
        twist=samples.twist,
        rates=samples.twist,
        position=samples.pose,
        turns=scales.turns,
    )


def _force_scale(scales: Scales) -> Array:
    return np.ones(1)


def _filter_rate(scales: Scales) -> float:
    return scales.bandwidth


def _advice(scales: Scales, direction: Array) -> str:
    return (
        "record a motion both ways with several speeds and accelerations "
        "(trapezoids of different height, a multisine) and give it too"
    )


def _least_inertia(scales: Scales, settings: MechanismSettings) -> float:
    return settings.min_axis_inertia_share * scales.force / scales.acceleration


def _limits(scales: Scales, theta: Array, settings: MechanismSettings) -> dict[str, float]:
    """How far the inertia is above the least, as a share of what is typical."""
    typical_inertia = scales.force / scales.acceleration
    return {"inertia": (theta[0] - _least_inertia(scales, settings)) / typical_inertia}


def _inside(scales: Scales, theta: Array, settings: MechanismSettings) -> Array:
    return np.concatenate([[max(theta[0], 2 * _least_inertia(scales, settings))], theta[1:]])


CONVENTIONS: Conventions[Scales] = Conventions(
    kind=AXIS,
    axes=("axis",),
    force_scale=_force_scale,
    samples=_samples,
    variables=_variables,
    quantities=of_axis,
    advice=_advice,
    scaling="by what is typical for the axis",
    filter_rate=_filter_rate,
    limits=_limits,
    inside=_inside,
)
"""Of one axis."""


class Axis(Mechanism[Scales]):
    """One axis with given effects, as its logs show it; ``geometry`` holds its scales."""

    def __init__(
        self,
        scales: Scales,
        structure: ModelStructure[Scales] | None = None,
        settings: MechanismSettings = MechanismSettings(),
    ) -> None:
        super().__init__(scales, structure or ModelStructure((), AXIS), CONVENTIONS, settings)


def default_theta(axis: Mechanism[Scales]) -> Array:
    """(P,) typical inertia, no friction, no effect; shape constants at their defaults."""
    values = [label.parameter.default or 0.0 for label in axis.labels]
    values[0] = axis.labels[0].parameter.size
    return np.array(values)
