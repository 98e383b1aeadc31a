"""Computed torque: the model's own demand fed forward in time, and feedback on what is left."""

from __future__ import annotations

import warnings
from math import ceil

import numpy as np
from numba import njit

from controllers import error_feedback
from controllers.error_feedback import JUMP, correction, estimate, exert
from controllers.interface import Array, Loop, Observation, Reference
from controllers.lookahead import follow, invent_past, reference_at, take
from youbot_env import dynamics
from youbot_env.dynamics import Instant
from youbot_env.effects import WORLD
from youbot_env.errors import InputError
from youbot_env.inverse import MOTION
from youbot_env.kernels import inverse_kernel
from youbot_env.model import Model
from youbot_env.validation import finite

LOAD_TOLERANCE = 1e-6
"""[N m] to which torques are found where friction depends on them."""

CONTRADICTION = 0.05
"""Share of the torque limit by which a measured torque may differ from the one expected."""

TIME, TWIST, POSE, TORQUE, WANTED = 0, slice(1, 4), slice(4, 7), slice(7, 11), slice(11, 17)
"""Places in the array in which a call's inputs are handed to compiled code."""


class ComputedTorque:
    """Wheel torques that the model demands for the reference, and feedback on the error.

    A command issued at t is held for ``loop.sample_time`` and acts from t + ``loop.delay`` +
    ``model.delay`` on, so the feed-forward is the mean demand over just that time, along the
    reference and, for effects that read them, along the pose, wheel angles and time that will be
    then. A drive's lag is inverted for the reference alone, never for noise. The feedback is
    described in :mod:`controllers.error_feedback`.

    The reference must show its next ``preview_needed`` samples; what it lacks is guessed from its
    last acceleration (a warning at the first call says so).

    Parameters
    ----------
    model : what the controller believes, with all its effects
    loop : times, limit and noise of the loop that it runs in
    bandwidth : [rad/s] of the feedback; None chooses by noise and delay

    Attributes
    ----------
    preview_needed : coming samples of the reference that the feed-forward reads
    design : the feedback's gains
    share : part of the wanted force that the last command exerts, 1 unless it saturates

    Raises
    ------
    InputError
        If the bandwidth is not positive.
    """

    def __init__(self, model: Model, loop: Loop | None = None, bandwidth: float | None = None):
        self.model, self.loop = model, loop or Loop()
        if bandwidth is not None:
            bandwidth = finite("bandwidth [rad/s]", bandwidth, positive=True)
        # A log's torques may be late, so that its delay is negative; a loop's never are.
        period, delay = self.loop.sample_time, self.loop.delay + max(model.delay, 0.0)
        self.preview_needed = ceil(delay / period - 1e-9) + 1
        self._past = int(self.loop.measurement_delay / period) + 2
        self._lead = delay / period
        self._kernel = inverse_kernel(model.structure)
        self._lengths, self._theta = model.lengths, model.theta.copy()
        self._jacobian = np.ascontiguousarray(model.geometry.wheel_jacobian)
        self._slope = channel_slope(model)
        self._follows = bool(model.structure.at(WORLD)) or model.structure.depends_on_angle
        self._use_mass(model)
        most = np.abs(self._to_acceleration).sum(axis=1) * self.loop.torque_limit
        per_wheel = np.sqrt((model.geometry.body_twist(np.eye(4)) ** 2).sum(axis=0))
        self.design = error_feedback.design(
            decay_rates(model),
            period=period,
            delay=delay,
            lag=drive_lag(model),
            age=self.loop.measurement_delay,
            most=most,
            noise=self.loop.speed_noise * per_wheel,
            torque_tolerance=CONTRADICTION * self.loop.torque_limit,
            bandwidth=bandwidth,
        )
        self._warm_up()

    def _warm_up(self) -> None:
        """Compile, or load what is compiled, before the first tick of a loop needs it."""
        still = np.zeros((self.preview_needed, 3))
        self.reset()
        observation = Observation(0.0, np.zeros(4), np.zeros(3))
        self(observation, Reference(still[0], still[0], still, still))
        self.reset()

    def _use_mass(self, model: Model) -> None:
        """Maps between wheel torques and accelerations of the body."""
        mass = model.mass_matrix()
        self._to_acceleration = np.ascontiguousarray(np.linalg.solve(mass, self._jacobian.T))
        self._to_torque = np.ascontiguousarray(model.geometry.wheel_torque(mass.T).T)

    def reset(self) -> None:
        """Forgets all estimates, commands on their way, and where the platform is."""
        self.share = 1.0
        self._begun = False
        self._inputs = np.zeros(17)
        self._nodes = np.zeros((self._past + 1 + self.preview_needed, 6))
        self._state = np.zeros((4 + self._past, 3))
        self._queue = np.zeros((self.design.slots, 10))
        self._drive = np.zeros(10)
        # Time, pose, wheel angles, and the twist that the pose was moved on with last.
        self._place = np.zeros(11)
        self._motion = np.zeros((3, len(MOTION)))
        self._torque, self._mean = np.zeros((3, 4)), np.zeros(4)
        self._forward, self._wanted = np.zeros(4), np.zeros(3)

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) fl, fr, bl, br [N m], within the limit.

        Uses the measured body twist; the pose where the model reads it (without one the platform
        is dead-reckoned from (0, 0, 0)); the acting torque where it is known, to notice that the
        drives are off. What is NaN in an observation is done without.
        """
        coming, has_slopes = self._read(observation, reference)
        design, inputs = self.design, self._inputs
        predict(
            inputs,
            self._nodes,
            (self._past, coming, has_slopes, self._begun, self._follows),
            self._state,
            self._queue,
            self._drive,
            design.axes,
            design.timing,
            (self._jacobian, self._to_acceleration),
            self._lead,
            self._place,
            self._motion,
        )
        self._kernel.held(
            self._motion,
            self.loop.sample_time,
            self._lengths,
            self._theta,
            LOAD_TOLERANCE,
            self._torque,
            self._mean,
            self._forward,
        )
        if not self._begun:
            self._begin()
        torque = np.empty(4)
        self.share = act(
            self._state,
            self._queue,
            self._drive,
            design.axes,
            design.timing,
            self._forward,
            self._mean,
            (self._slope, self.loop.torque_limit),
            (self._to_acceleration, self._to_torque),
            self._wanted,
            torque,
        )
        return torque

    def _begin(self) -> None:
        """Until the first command acts, what acts now goes on; nothing does unless it is known."""
        acting = np.nan_to_num(self._inputs[TORQUE], posinf=0.0, neginf=0.0)
        demanded = self._to_acceleration @ self._mean
        exerted = self._to_acceleration @ acting - demanded
        before = np.concatenate([exerted, acting, demanded])
        self._queue[:], self._drive[:] = before, before
        self._begun = True

    def _read(self, observation: Observation, reference: Reference) -> tuple[int, bool]:
        """Copy a call's inputs; how many coming samples there are, and whether with slopes."""
        inputs = self._inputs
        inputs[TIME] = observation.time
        inputs[TWIST] = observation.body_twist
        inputs[POSE] = np.nan if observation.pose is None else observation.pose
        inputs[TORQUE] = np.nan if observation.wheel_torque is None else observation.wheel_torque
        inputs[11:14], inputs[14:17] = reference.twist, reference.acceleration
        ahead, slopes = reference.preview, reference.preview_acceleration
        coming = 0 if ahead is None else min(len(ahead), self.preview_needed)
        if not self._begun and coming < self.preview_needed:
            warnings.warn(
                f"computed torque: the reference shows {coming} of the next {self.preview_needed} "
                "samples that the feed-forward needs; it goes on along the last acceleration",
                stacklevel=3,
            )
        if ahead is not None and coming:
            rows = slice(self._past + 1, self._past + 1 + coming)
            self._nodes[rows, :3] = ahead[:coming]
            if slopes is not None:
                self._nodes[rows, 3:] = slopes[:coming]
        return coming, slopes is not None


@njit(cache=True, error_model="numpy")
def predict(inputs, nodes, counts, state, queue, drive, axes, timing, maps, lead, place, motion):
    """Estimate where the platform is, and fill ``motion`` (3, 14) with the reference at the start,
    the middle and the end of the hold in which the command will act."""
    past, coming, has_slopes, begun, follows = counts
    jacobian, to_acceleration = maps
    period = timing[error_feedback.PERIOD]
    for i in range(11, 17):
        if not abs(inputs[i]) < np.inf:
            slope = nodes[past, i - 8] if i < 14 else 0.0
            inputs[i] = nodes[past, i - 11] + period * slope
    for row in range(past + 1, past + 1 + coming):
        if not np.isfinite(nodes[row]).all():
            coming = row - past - 1
            break
    take(nodes, past, inputs[WANTED], coming, has_slopes, period)
    if not begun:
        invent_past(nodes, past, period)
    at = np.empty(6)
    reference_at(nodes, past - timing[error_feedback.AGE] / period, period, at)
    error = inputs[TWIST] - at[:3]
    estimate(state, queue, drive, axes, timing, to_acceleration, error, inputs[TORQUE])
    if not begun:
        for axis in range(3):
            if abs(error[axis]) > axes[axis, JUMP] and abs(error[axis]) < np.inf:
                state[0, axis] = error[axis]
                state[1, axis] = 0.0
    locate(inputs, nodes[past], state, period, jacobian, begun, place)
    ends = np.array([0.0, 0.5, 1.0])
    pose, angle, here = place[1:4].copy(), place[4:8].copy(), float(past)
    for k in range(3):
        there = past + lead + ends[k]
        reference_at(nodes, there, period, motion[k, :6])
        if follows:
            follow(nodes, here, there, period, jacobian, pose, angle)
            here = there
        motion[k, 6:9] = pose
        motion[k, 9:13] = angle
        motion[k, 13] = place[0] + (lead + ends[k]) * period


@njit(cache=True, error_model="numpy")
def locate(inputs, wanted, state, period, jacobian, begun, place):
    """Move ``place`` (11,) on to now: time, pose and wheel angles by the estimated twist, and by
    what is measured of them."""
    twist = wanted[:3] + state[0]
    if begun:
        mean = 0.5 * (twist + place[8:11])
        yaw = place[3] + 0.5 * period * mean[2]
        c, s = np.cos(yaw), np.sin(yaw)
        place[0] += period
        place[1] += period * (c * mean[0] - s * mean[1])
        place[2] += period * (s * mean[0] + c * mean[1])
        place[3] += period * mean[2]
        for wheel in range(4):
            for axis in range(3):
                place[4 + wheel] += period * jacobian[wheel, axis] * mean[axis]
    place[8:11] = twist
    for i in range(4):
        value = inputs[TIME] if i == 0 else inputs[3 + i]
        if abs(value) < np.inf:
            place[i] = value


@njit(cache=True, error_model="numpy")
def act(state, queue, drive, axes, timing, forward, mean, limits, maps, wanted, torque):
    """Fill ``torque`` (4,) with feed-forward and feedback; returns the share within the limit."""
    slope, limit = limits
    to_acceleration, to_torque = maps
    correction(state, queue, drive, axes, timing, wanted)
    return exert(queue, wanted, forward, mean, slope, limit, to_acceleration, to_torque, torque)


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
    ends = [
        np.array(dynamics.channel_torque(np, model.structure, model.theta, (t,) * 4, 0.0), float)
        for t in (0.0, 1.0)
    ]
    slope = ends[1] - ends[0]
    if not (np.isfinite(slope).all() and np.abs(slope).min() > 0.0):
        raise InputError(f"model {model.name}: a wheel's torque does not follow its command")
    return slope
