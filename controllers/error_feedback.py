"""Feedback on what the feed-forward leaves: an estimator that knows delay, lag and hold.

In units of acceleration each axis is the same: an error e of the twist, a disturbance d that
wanders slowly, and a correction a that acts ``delay`` late through a drive's lag::

    e' = -decay e + a + d,        T m' = u - m,   a(t) = m(t - delay)

The estimator runs this model on the corrections that were really exerted, so a saturated or missing
torque winds nothing up, and compares with the measurement of the instant that it belongs to. The
command cancels d and drives the error, as it will be when the command acts, to zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from controllers.allocation import within_limits

Array = NDArray[np.float64]

PERIOD, SLOTS, SHARE, STAYS, MEAN, STAYS_PART, AGE, CONTRADICTION = range(8)
"""Places in ``Design.timing``."""

KEEP, GAIN, KEEP_PART, GAIN_PART, SEE_ERROR, SEE_LOAD, ON_ERROR, ON_DRIVE, MOST, JUMP = range(10)
"""Columns of ``Design.axes``."""

CORRECTION, TORQUE, DEMAND = slice(0, 3), slice(3, 7), slice(7, 10)
"""Columns of the queue of commands and of the drives' state: correction [m/s^2, rad/s^2], torque
behind the channel [N m], acceleration that the feed-forward stands for."""

TRUSTED = 0.7
"""Largest disturbance that is believed, as a share of the acceleration that the limit allows."""

SURPRISE = 8.0
"""Deviations of the measured speed beyond which the first error is taken as it is measured."""

NOISE_SHARE = 0.1
"""Bandwidth times sample time: about sqrt(0.1), a third, of the speeds' noise gets into the twist
at any rate."""

DELAY_SHARE = 0.7
"""Bandwidth times total delay. With it and ``FASTEST`` the paper's platform keeps a gain margin of
10 dB and a phase margin of 50 degrees at 20 Hz to 1 kHz with delays up to 0.1 s."""

FASTEST = 20.0
"""Bandwidth [rad/s] beyond which wheels that slip and bend are no part of the model."""


@dataclass(frozen=True)
class Design:
    """Numbers of the feedback.

    Attributes
    ----------
    bandwidth : [rad/s] of the estimator and of the regulator
    axes : (3, 10) transitions and gains of VX, VY, W, see ``KEEP`` ... ``JUMP``
    timing : (8,) see ``PERIOD`` ...
    slots : commands that are kept: those on their way, and one more for a part of a sample
    """

    bandwidth: float
    axes: Array
    timing: Array
    slots: int


def design(
    decay: Array,
    *,
    period: float,
    delay: float,
    lag: float,
    age: float,
    most: Array,
    noise: Array,
    torque_tolerance: float,
    bandwidth: float | None = None,
) -> Design:
    """Gains from the platform's decay rates (3,) [1/s] and the loop's times [s].

    The estimator is the Kalman filter, the regulator the linear quadratic one, of the sampled
    model above; both with weights that give an undamped axis the poles of a Butterworth filter
    (of a first-order lag) of ``bandwidth``.

    Parameters
    ----------
    delay, lag, age : of the commands, of the drives, of a measured speed
    most : (3,) accelerations that the torque limit allows
    noise : (3,) standard deviation of the measured twist
    torque_tolerance : [N m] by which a measured torque may differ from the expected one
    bandwidth : [rad/s]; None is the largest that noise, delay and ``FASTEST`` allow
    """
    total = delay + lag + age + 0.5 * period
    if bandwidth is None:
        bandwidth = min(FASTEST, NOISE_SHARE / period, DELAY_SHARE / total)
    slots = int(delay / period + 1e-9)
    part = max(delay - slots * period, 0.0)
    part = 0.0 if part < 1e-9 * period else part
    stays = np.exp(-period / lag) if lag > 0.0 else 0.0
    mean = lag / period * (1.0 - stays) if lag > 0.0 else 0.0
    stays_part = np.exp(-part / lag) if lag > 0.0 else 0.0
    timing = np.array(
        [period, slots, 1.0 - part / period, stays, mean, stays_part, age, torque_tolerance]
    )
    axes = np.empty((3, 10))
    for axis, rate in enumerate(np.maximum(decay, 1e-6)):
        keep, keep_part = np.exp(-rate * period), np.exp(-rate * part)
        gain, gain_part = (1.0 - keep) / rate, (1.0 - keep_part) / rate
        see = _estimator(keep, gain, period, bandwidth)
        act = _regulator(rate, lag, period, bandwidth)
        jump = SURPRISE * noise[axis]
        limit = TRUSTED * most[axis]
        axes[axis] = (keep, gain, keep_part, gain_part, *see, *act, limit, jump)
    return Design(float(bandwidth), axes, timing, slots + 2)


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


@njit(cache=True, error_model="numpy")
def estimate(state, queue, drive, axes, timing, to_acceleration, error, measured_torque):
    """One sample of the estimator.

    ``state`` (2 + h, 3): error and disturbance now, then the errors of the last h samples; moves on
    by the corrections that acted since, and by ``error`` (3,), measured twist minus the reference
    of the measurement's instant (NaN: not measured). ``queue`` (slots, 10) holds the commands,
    newest first, ``drive`` (10,) the torques behind the lag. A ``measured_torque`` (4,) that is
    neither the one expected at the wheels nor the one commanded last is believed instead.
    """
    slots, share = int(timing[SLOTS]), timing[SHARE]
    stays, mean = timing[STAYS], timing[MEAN]
    for row in range(state.shape[0] - 1, 1, -1):
        state[row] = state[row - 1] if row > 2 else state[0]
    acted = np.empty(10)
    for i in range(10):
        late = queue[slots, i]
        mixed = share * late + (1.0 - share) * queue[slots + 1, i]
        if stays > 0.0 and i < 7:
            acted[i] = mixed + (drive[i] - mixed) * mean
            drive[i] = mixed + (drive[i] - mixed) * stays
        else:
            acted[i], drive[i] = mixed, late
    if _contradicts(measured_torque, drive, queue, timing[CONTRADICTION]):
        for axis in range(3):
            value = -acted[7 + axis]
            for wheel in range(4):
                value += to_acceleration[axis, wheel] * measured_torque[wheel]
            acted[axis] = drive[axis] = value
        drive[3:7] = measured_torque
    behind = timing[AGE] / timing[PERIOD]
    whole = int(behind)
    part = behind - whole
    for axis in range(3):
        before, load = state[0, axis], state[1, axis]
        prior = axes[axis, KEEP] * before + axes[axis, GAIN] * (acted[axis] + load)
        newer = prior if whole == 0 else state[1 + whole, axis]
        found = error[axis] - ((1.0 - part) * newer + part * state[2 + whole, axis])
        if not abs(found) < np.inf:
            found = 0.0
        most = axes[axis, MOST]
        state[0, axis] = prior + axes[axis, SEE_ERROR] * found
        state[1, axis] = min(max(load + axes[axis, SEE_LOAD] * found, -most), most)


@njit(cache=True, error_model="numpy")
def _contradicts(measured, drive, queue, tolerance):
    """Whether the wheels' torque is known and not what the commands make of it."""
    expected, commanded = 0.0, 0.0
    for wheel in range(4):
        if not abs(measured[wheel]) < np.inf:
            return False
        expected = max(expected, abs(measured[wheel] - drive[3 + wheel]))
        commanded = max(commanded, abs(measured[wheel] - queue[0, 3 + wheel]))
    return expected > tolerance and commanded > tolerance


@njit(cache=True, error_model="numpy")
def correction(state, queue, drive, axes, timing, out):
    """Fill ``out`` (3,) with the acceleration to command: the error is moved on to the instant at
    which it acts by what is on its way."""
    slots, share = int(timing[SLOTS]), timing[SHARE]
    stays, mean, stays_part = timing[STAYS], timing[MEAN], timing[STAYS_PART]
    for axis in range(3):
        keep, gain = axes[axis, KEEP], axes[axis, GAIN]
        error, load, torque = state[0, axis], state[1, axis], drive[axis]
        for ahead in range(slots):
            mixed = share * queue[slots - 1 - ahead, axis]
            mixed += (1.0 - share) * queue[slots - ahead, axis]
            acts = mixed + (torque - mixed) * mean
            torque = mixed + (torque - mixed) * stays
            error = keep * error + gain * (acts + load)
        if share < 1.0:
            mixed = queue[0, axis]
            acts = mixed + (torque - mixed) * (0.5 + 0.5 * stays_part) * (stays > 0.0)
            torque = mixed + (torque - mixed) * stays_part
            error = axes[axis, KEEP_PART] * error + axes[axis, GAIN_PART] * (acts + load)
        out[axis] = -load - axes[axis, ON_ERROR] * error - axes[axis, ON_DRIVE] * (torque + load)


@njit(cache=True, error_model="numpy")
def exert(queue, wanted, forward, mean, slope, limit, to_acceleration, to_torque, out):
    """Fill ``out`` (4,) with commands [N m]: feed-forward ``forward`` (4,) plus the acceleration
    ``wanted`` (3,), within the limit; and remember what they will exert.

    ``mean`` (4,): acting torques that the feed-forward stands for; ``slope`` (4,): true torque per
    commanded one.
    """
    torque, limits, kept = np.empty(4), np.empty(4), np.empty(4)
    for wheel in range(4):
        torque[wheel] = slope[wheel] * forward[wheel]
        limits[wheel] = limit * abs(slope[wheel])
        for axis in range(3):
            torque[wheel] += to_torque[wheel, axis] * wanted[axis]
    share = within_limits(torque, limits, kept)
    for row in range(queue.shape[0] - 1, 0, -1):
        queue[row] = queue[row - 1]
    for axis in range(3):
        exerted, demanded = 0.0, 0.0
        for wheel in range(4):
            extra = kept[wheel] - slope[wheel] * forward[wheel]
            exerted += to_acceleration[axis, wheel] * extra
            demanded += to_acceleration[axis, wheel] * mean[wheel]
        queue[0, axis] = exerted
        queue[0, 7 + axis] = demanded
    for wheel in range(4):
        queue[0, 3 + wheel] = kept[wheel]
        out[wheel] = kept[wheel] / slope[wheel]
    return share
