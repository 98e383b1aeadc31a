"""Gains of the feedback on the twist's error, from the model's inertia and the loop's times, and
the stability margins that they leave.

The margins are those of the code that runs, on the exact sampled plant. Estimator and regulator of
:mod:`controllers.computed_torque.feedback` are linear as long as nothing saturates, so calls with
unit vectors give their matrices, and the law need not be written a second time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from controllers.computed_torque.feedback import (
    COMMAND,
    CONSTANTS,
    DRIVES,
    ESTIMATE,
    correction,
    estimate,
)
from controllers.interface import Array, Loop
from controllers.linear.linear_system import (
    DriveSettings,
    LinearSystem,
    acting_delay,
    closed,
    drive_lag,
    sampled_platform,
    split_delay,
)
from controllers.linear.margins import Margins, frequency_grid, margins
from youbot_env.errors import InputError, check_settings
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant


@dataclass(frozen=True)
class FeedbackSettings:
    """What the bandwidth of the feedback is chosen by, and what its estimator believes."""

    max_bandwidth: float = field(
        default=15.0,
        metadata={
            "unit": "rad/s",
            "reason": "faster, wheels that slip and bend are no part of the model",
        },
    )
    max_bandwidth_times_period: float = field(
        default=0.1,
        metadata={
            "unit": "1",
            "reason": "about sqrt(0.1), a third, of the speeds' noise gets into the twist at any "
            "rate",
        },
    )
    max_bandwidth_times_delay: float = field(
        default=0.7,
        metadata={
            "unit": "1",
            "reason": "with it and max_bandwidth the paper's platform keeps a gain margin of 10 "
            "dB and a phase margin of 45 degrees at 20 Hz to 1 kHz with delays up to "
            "0.1 s",
        },
    )
    max_disturbance_share: float = field(
        default=0.7,
        metadata={
            "unit": "of the acceleration that the torque limit allows",
            "reason": "a larger disturbance is not believed: it would leave too little torque to "
            "drive with",
        },
    )
    first_error_deviations: float = field(
        default=8.0,
        metadata={
            "unit": "standard deviations of a measured speed",
            "reason": "beyond them the first error is no noise: it is taken as it is measured, "
            "for a loop that begins while the platform moves",
        },
    )
    contradiction_share: float = field(
        default=DriveSettings.contradiction_share,
        metadata={"unit": "of the torque limit", "reason": "see DriveSettings"},
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, eq=False)
class FeedbackDesign:
    """Numbers of the feedback.

    Attributes
    ----------
    bandwidth : [rad/s] of the estimator and of the regulator
    constants : (1,) of ``feedback.CONSTANTS``: transitions, gains, times, limits and force maps
    slots : commands that are kept: those on their way, and two for a part of a sample
    past : past samples that are kept, so that the measurement's instant lies among them
    mass : (3, 3) mass matrix that the force maps stand for
    """

    bandwidth: float
    constants: NDArray[np.void]
    slots: int
    past: int
    mass: Array


def design(
    model: Model,
    loop: Loop,
    bandwidth: float | None = None,
    settings: FeedbackSettings = FeedbackSettings(),
) -> FeedbackDesign:
    """Gains for a model in a loop.

    The estimator is the Kalman filter, the regulator the linear quadratic one, of the sampled
    model of :mod:`controllers.computed_torque.feedback`; both with weights that give an axis
    without friction the poles of a Butterworth filter (of a first-order lag) of ``bandwidth``
    [rad/s]. None is the largest that noise, delay and ``settings`` allow.
    """
    period, age, lag = loop.sample_time, loop.measurement_delay, drive_lag(model)
    if bandwidth is None:
        total = acting_delay(model, loop) + lag + age + 0.5 * period
        bandwidth = min(
            settings.max_bandwidth,
            settings.max_bandwidth_times_period / period,
            settings.max_bandwidth_times_delay / total,
        )
    constants = np.zeros(1, CONSTANTS)
    _fill_times(constants[0], model, loop)
    _fill_limits(constants[0], model, loop, settings)
    _fill_gains(constants[0], model, loop, bandwidth)
    return FeedbackDesign(
        bandwidth=float(bandwidth),
        constants=constants,
        slots=int(constants["whole_samples"][0]) + 2,
        past=int(age / period) + 2,
        mass=model.mass_matrix(),
    )


def _fill_times(constants: np.void, model: Model, loop: Loop) -> None:
    """The loop's times, and the drives' lag as transitions over them."""
    period, delay, lag = loop.sample_time, acting_delay(model, loop), drive_lag(model)
    # The estimator steps by whole samples of the delay, then by the part that is left.
    whole, part = split_delay(delay, period)
    constants["period"], constants["age"] = period, loop.measurement_delay
    constants["lead"], constants["whole_samples"] = delay / period, whole
    constants["newer_share"] = 1.0 - part / period
    if lag > 0.0:
        stays = np.exp(-period / lag)
        constants["lag_stays"], constants["lag_stays_part"] = stays, np.exp(-part / lag)
        constants["lag_mean"] = lag / period * (1.0 - stays)


def _fill_limits(constants: np.void, model: Model, loop: Loop, settings: FeedbackSettings) -> None:
    """The force maps, and what is believed of torques, disturbances and errors."""
    to_acceleration, constants["to_torque"] = force_maps(model)
    constants["to_acceleration"] = to_acceleration
    constants["jacobian"], constants["slope"] = model.joint_jacobian, channel_slope(model)
    constants["internal"] = model.internal
    constants["torque_limit"] = loop.torque_limit
    constants["torque_tolerance"] = settings.contradiction_share * loop.torque_limit
    most = settings.max_disturbance_share * loop.torque_limit * np.abs(to_acceleration).sum(axis=1)
    constants["max_disturbance"] = most
    # A twist is a weighted sum of four wheels' speeds, each with its own noise.
    per_wheel = np.sqrt((velocity_map(model) ** 2).sum(axis=0))
    constants["max_first_error"] = settings.first_error_deviations * loop.speed_noise * per_wheel


def _fill_gains(constants: np.void, model: Model, loop: Loop, bandwidth: float) -> None:
    """Each axis' transitions over a sample and over the part of one, and the gains on them."""
    period, lag = loop.sample_time, drive_lag(model)
    _, part = split_delay(acting_delay(model, loop), period)
    # Never zero: (1 - exp(-rate T)) / rate is 0 / 0 for a platform without friction.
    for axis, rate in enumerate(np.maximum(decay_rates(model), 1e-6)):
        keep, keep_part = np.exp(-rate * period), np.exp(-rate * part)
        gain, gain_part = (1.0 - keep) / rate, (1.0 - keep_part) / rate
        constants["transition"][axis], constants["input_gain"][axis] = keep, gain
        constants["transition_part"][axis] = keep_part
        constants["input_gain_part"][axis] = gain_part
        error, disturbance = _estimator(keep, gain, period, bandwidth)
        constants["error_correction"][axis] = error
        constants["disturbance_correction"][axis] = disturbance
        error, drive = _regulator(rate, lag, period, bandwidth)
        constants["error_feedback"][axis], constants["drive_feedback"][axis] = error, drive


def velocity_map(model: Model) -> Array:
    """(4, 3) twist per measured wheel speed, of wheels that roll and are measured as modelled.

    How late a filtered speed comes, and creep under load, are no part of it.
    """
    none, one = [0.0] * 4, [1.0] * 4
    zero, unit = (
        dynamics.true_speed(np, model.structure, model.theta, speed, none, none, 0.0)
        for speed in (none, one)
    )
    return (np.array(unit) - np.array(zero))[:, None] * model.twist_map


def force_maps(model: Model) -> tuple[Array, Array]:
    """(3, 4) body accelerations per wheel torque, and (4, 3) the least-norm way back."""
    mass, jacobian = model.mass_matrix(), model.joint_jacobian
    to_acceleration = np.linalg.solve(mass, jacobian.T)
    to_torque = model.twist_map @ mass
    return np.array(to_acceleration, np.float64, order="C"), np.array(to_torque, order="C")


def _estimator(keep: float, gain: float, period: float, bandwidth: float) -> tuple[float, float]:
    """Kalman gains on error and disturbance. In continuous time, without decay, a disturbance of
    intensity bandwidth^4 times the noise's gives the poles of s^2 + sqrt(2) b s + b^2."""
    transition, seen = np.array([[keep, gain], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    # Over a sample: the intensity of the disturbance times T, that of the noise divided by T.
    wander = np.diag([0.0, bandwidth**4 * period**2])
    # The filter's Riccati equation is the regulator's of the transposed system.
    spread = solve_discrete_are(transition.T, seen.T, wander, np.eye(1))
    gains = spread[:, 0] / (spread[0, 0] + 1.0)
    return float(gains[0]), float(gains[1])


def _regulator(rate: float, lag: float, period: float, bandwidth: float) -> tuple[float, float]:
    """Gains on the error and on the drive's torque that minimise e^2 + (a / bandwidth)^2."""
    size = 2 if lag > 0.0 else 1
    plant = np.zeros((size + 1, size + 1))
    plant[0, :2] = -rate, 1.0
    if lag > 0.0:
        plant[1, 1:] = -1.0 / lag, 1.0 / lag
    # The last column is the held input, so one exponential gives transition and input together.
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

    Of the base model: near rest dry friction has a slope that feedback must not rely on.
    """
    base, step = model.without_effects(), 1e-3
    force = base.wrench(step * np.eye(3), np.zeros((3, 3)))
    opposite = base.wrench(-step * np.eye(3), np.zeros((3, 3)))
    return np.diag(force - opposite) / (2 * step) / np.diag(base.mass_matrix())


def channel_slope(model: Model) -> Array:
    """(4,) true torque per unit of the commanded one at each wheel.

    Raises
    ------
    InputError
        If a channel does not pass the command on.
    """
    # Of small torques: below any limit of the drives, and beyond what a dead zone takes.
    torques = (2.0**-10, 2.0**-9)
    commands = [
        dynamics.interface_torque(
            np,
            model.structure,
            model.geometry,
            model.theta,
            Instant((0.0,) * 3, torque=(torque,) * 4),
        )
        for torque in torques
    ]
    rise = np.array([float(b) - float(a) for a, b in zip(*commands, strict=True)])
    slope = (torques[1] - torques[0]) / rise
    if not (np.isfinite(slope).all() and np.abs(slope).min() > 0.0):
        raise InputError(f"model {model.name}: a wheel's torque does not follow its command")
    return slope


def feedback_system(design: FeedbackDesign) -> LinearSystem:
    """Body force (3,) [N, N, N m] per error (3,), reference minus measured twist."""
    # A copy, since the design is used on. Without the bound on the disturbance the code is linear.
    constants = design.constants.copy()
    constants["max_disturbance"] = np.inf
    # Error and disturbance of now, errors of before, corrections of the queue and of the drives.
    shapes = ((1, 3), (1, 3), (design.past, 3), (design.slots, 3), (1, 3))
    sizes = [rows * columns for rows, columns in shapes]
    ends = np.cumsum(sizes)[:-1]

    def step(values: Array, error: Array) -> tuple[Array, Array]:
        now, disturbance, before, commands, drive = (
            part.reshape(shape) for part, shape in zip(np.split(values, ends), shapes, strict=True)
        )
        estimates, out = np.zeros(1 + design.past, ESTIMATE), np.empty(3)
        estimates["error"], estimates["disturbance"][:1] = np.vstack([now, before]), disturbance
        queue, drives = np.zeros(design.slots, COMMAND), np.zeros(1, DRIVES)
        queue["correction"], drives["correction"] = commands, drive
        # The reference changes as planned, and torques are not measured.
        smooth, unknown = np.zeros(3), np.full(4, np.nan)
        estimate(estimates, queue, drives, constants, smooth, error, unknown)
        correction(estimates, queue, drives, constants, smooth, out)
        errors, disturbance = estimates["error"], estimates["disturbance"][0]
        commands = np.vstack([out, queue["correction"][:-1]])
        parts = (errors[0], disturbance, errors[1:], commands, drives["correction"])
        return np.concatenate([np.ravel(part) for part in parts]), out

    columns = [step(unit, np.zeros(3)) for unit in np.eye(sum(sizes))]
    # The estimator takes measured minus reference; a controller's input is the opposite.
    drives = [step(np.zeros(sum(sizes)), -unit) for unit in np.eye(3)]
    (a, c), (b, d) = (
        [np.stack(part, axis=1) for part in zip(*rows, strict=True)] for rows in (columns, drives)
    )
    period = float(design.constants["period"][0])
    return LinearSystem(a, b, design.mass @ c, design.mass @ d, period)


def closed_loop(design: FeedbackDesign, plant: Model, loop: Loop) -> LinearSystem:
    """The loop on a plant that need not be the controller's model.

    From a change of the reference that the feed-forward does not know to the twist.
    """
    return closed(sampled_platform(plant, loop), feedback_system(design))


def feedback_margins(design: FeedbackDesign, plant: Model, loop: Loop) -> Margins:
    """Gain and phase margin at each axis' force command (the other axes closed)."""
    frequency = frequency_grid(loop.sample_time)
    platform = sampled_platform(plant, loop).response(frequency)
    return margins(feedback_system(design).response(frequency) @ platform)
