"""Gains of the feedback on the twist's error, from the model's inertia and the loop's times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.interface import Array, Loop
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant

TRUSTED = 0.7
"""Largest disturbance that is believed, as a share of the acceleration that the limit allows."""

SURPRISE = 8.0
"""Deviations of the measured speed beyond which the first error is taken as it is measured."""

NOISE_SHARE = 0.1
"""Bandwidth times sample time: about sqrt(0.1), a third, of the speeds' noise gets into the twist
at any rate."""

DELAY_SHARE = 0.7
"""Bandwidth times total delay. With it and ``FASTEST`` the paper's platform keeps a gain margin of
10 dB and a phase margin of 45 degrees at 20 Hz to 1 kHz with delays up to 0.1 s."""

FASTEST = 15.0
"""Bandwidth [rad/s] beyond which wheels that slip and bend are no part of the model."""

CONTRADICTION = 0.05
"""Share of the torque limit by which a measured torque may differ from the one expected."""

ROUNDING = 1e-9
"""Share of a sample below which a part of a delay is rounding."""


@dataclass(frozen=True, eq=False)
class FeedbackDesign:
    """Numbers of the feedback.

    Attributes
    ----------
    bandwidth : [rad/s] of the estimator and of the regulator
    axes : (3, 10) transitions and gains of VX, VY, W in the order of ``error_feedback.KEEP`` ...
    timing : (8,) in the order of ``error_feedback.PERIOD`` ...
    slots : commands that are kept: those on their way, and two for a part of a sample
    past : past samples that are kept, so that the measurement's instant lies among them
    slope : (4,) true torque per commanded one
    to_acceleration : (3, 4) body acceleration per wheel torque
    to_torque : (4, 3) least-norm wheel torques per body acceleration
    mass : (3, 3) mass matrix that the two stand for
    """

    bandwidth: float
    axes: Array
    timing: Array
    slots: int
    past: int
    slope: Array
    to_acceleration: Array
    to_torque: Array
    mass: Array


def design(model: Model, loop: Loop, bandwidth: float | None = None) -> FeedbackDesign:
    """Gains for a model in a loop.

    The estimator is the Kalman filter, the regulator the linear quadratic one, of the sampled
    model of :mod:`controllers.computed_torque.feedback`; both with weights that give an axis
    without friction the poles of a Butterworth filter (of a first-order lag) of ``bandwidth``
    [rad/s]. None is the largest that noise, delay and ``FASTEST`` allow.
    """
    period, age, lag = loop.sample_time, loop.measurement_delay, drive_lag(model)
    if bandwidth is None:
        total = acting_delay(model, loop) + lag + age + 0.5 * period
        bandwidth = min(FASTEST, NOISE_SHARE / period, DELAY_SHARE / total)
    slots, part = _whole_and_part(acting_delay(model, loop), period)
    to_acceleration, to_torque = force_maps(model)
    most = TRUSTED * loop.torque_limit * np.abs(to_acceleration).sum(axis=1)
    per_wheel = np.sqrt((model.geometry.body_twist(np.eye(4)) ** 2).sum(axis=0))
    jump = SURPRISE * loop.speed_noise * per_wheel
    axes = np.empty((3, 10))
    for axis, rate in enumerate(np.maximum(decay_rates(model), 1e-6)):
        keep, keep_part = np.exp(-rate * period), np.exp(-rate * part)
        gain, gain_part = (1.0 - keep) / rate, (1.0 - keep_part) / rate
        see = _estimator(keep, gain, period, bandwidth)
        on = _regulator(rate, lag, period, bandwidth)
        axes[axis] = (keep, gain, keep_part, gain_part, *see, *on, most[axis], jump[axis])
    return FeedbackDesign(
        bandwidth=float(bandwidth),
        axes=axes,
        timing=_timing(period, slots, part, lag, age, CONTRADICTION * loop.torque_limit),
        slots=slots + 2,
        past=int(age / period) + 2,
        slope=channel_slope(model),
        to_acceleration=to_acceleration,
        to_torque=to_torque,
        mass=model.mass_matrix(),
    )


def acting_delay(model: Model, loop: Loop) -> float:
    """[s] from a command to the start of its hold at the drives.

    A model's own delay may be negative, where it was fitted on a log whose torques are late; what
    a loop commands never acts before.
    """
    return loop.delay + max(model.delay, 0.0)


def _whole_and_part(delay: float, period: float) -> tuple[int, float]:
    """Whole samples in a delay, and the rest [s]."""
    whole = int(delay / period + ROUNDING)
    part = delay - whole * period
    return whole, part if part > ROUNDING * period else 0.0


def _timing(
    period: float, slots: int, part: float, lag: float, age: float, tolerance: float
) -> Array:
    """The times as the estimator's transitions: ``stays`` of a drive's torque stays after a sample,
    on average ``mean`` of it acts meanwhile."""
    stays, mean, stays_part = 0.0, 0.0, 0.0
    if lag > 0.0:
        stays, stays_part = np.exp(-period / lag), np.exp(-part / lag)
        mean = lag / period * (1.0 - stays)
    return np.array([period, slots, 1.0 - part / period, stays, mean, stays_part, age, tolerance])


def force_maps(model: Model) -> tuple[Array, Array]:
    """(3, 4) body accelerations per wheel torque, and (4, 3) the least-norm way back."""
    mass, jacobian = model.mass_matrix(), model.geometry.wheel_jacobian
    to_acceleration = np.linalg.solve(mass, jacobian.T)
    to_torque = model.geometry.wheel_torque(mass.T).T
    return np.array(to_acceleration, np.float64, order="C"), np.array(to_torque, order="C")


def _estimator(keep: float, gain: float, period: float, bandwidth: float) -> tuple[float, float]:
    """Kalman gains on error and disturbance. In continuous time, without decay, a disturbance of
    intensity bandwidth^4 times the noise's gives the poles of s^2 + sqrt(2) b s + b^2."""
    from scipy.linalg import solve_discrete_are

    transition, seen = np.array([[keep, gain], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    wander = np.diag([0.0, bandwidth**4 * period**2])
    spread = solve_discrete_are(transition.T, seen.T, wander, np.eye(1))
    gains = spread[:, 0] / (spread[0, 0] + 1.0)
    return float(gains[0]), float(gains[1])


def _regulator(rate: float, lag: float, period: float, bandwidth: float) -> tuple[float, float]:
    """Gains on the error and on the drive's torque that minimise e^2 + (a / bandwidth)^2."""
    from scipy.linalg import expm, solve_discrete_are

    size = 2 if lag > 0.0 else 1
    plant = np.zeros((size + 1, size + 1))
    plant[0, :2] = -rate, 1.0
    if lag > 0.0:
        plant[1, 1:] = -1.0 / lag, 1.0 / lag
    moved = expm(plant * period)
    transition, drive = moved[:size, :size], moved[:size, size:]
    cost = np.zeros((size, size))
    cost[0, 0] = 1.0
    effort = np.eye(1) / bandwidth**2
    future = solve_discrete_are(transition, drive, cost, effort)
    gains = np.linalg.solve(effort + drive.T @ future @ drive, drive.T @ future @ transition)[0]
    return float(gains[0]), float(gains[1]) if lag > 0.0 else 0.0


def decay_rates(model: Model) -> Array:
    """(3,) rates [1/s] at which viscous friction slows VX, VY and W, each alone.

    Of the base model: near rest dry friction is steeper than any feedback should count on.
    """
    base, step = model.without_effects(), 1e-3
    force = base.wrench(step * np.eye(3), np.zeros((3, 3)))
    opposite = base.wrench(-step * np.eye(3), np.zeros((3, 3)))
    return np.diag(force - opposite) / (2 * step) / np.diag(base.mass_matrix())


def drive_lag(model: Model) -> float:
    """Time constant [s] of the model's drives, 0 without any."""
    if not model.structure.has_actuator:
        return 0.0
    rows = []
    for torque, rate in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        at = Instant((0.0, 0.0, 0.0), torque=(torque,) * 4, torque_rate=(rate,) * 4)
        rows.append(dynamics.actuator_command(np, model.structure, model.theta, at)[0])
    still, torque, rate = (float(value) for value in rows)
    return max(0.0, (rate - still) / (torque - still))


def channel_slope(model: Model) -> Array:
    """(4,) true torque per unit of the commanded one at each wheel.

    Raises
    ------
    InputError
        If a channel does not pass the command on.
    """
    zero, one = (
        dynamics.channel_torque(np, model.structure, model.theta, (torque,) * 4, 0.0)
        for torque in (0.0, 1.0)
    )
    slope = np.array([float(b) - float(a) for a, b in zip(zero, one, strict=True)])
    if not (np.isfinite(slope).all() and np.abs(slope).min() > 0.0):
        raise InputError(f"model {model.name}: a wheel's torque does not follow its command")
    return slope
