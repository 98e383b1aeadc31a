"""Feedback on what the feed-forward leaves: an estimator that knows delay, lag and hold.

In units of acceleration each axis is the same: an error e of the twist, a disturbance d that
wanders slowly, and a correction a that acts ``delay`` late through a drive's lag::

    e' = -decay e + a + d,        T m' = u - m,   a(t) = m(t - delay)

The estimator runs this model on the corrections that were really exerted, so a saturated or missing
torque winds nothing up, and compares with the measurement of the instant that it belongs to. The
command cancels d and drives the error, as it will be when the command acts, to zero.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from controllers.allocation import within_limits

PERIOD, SLOTS, SHARE, STAYS, MEAN, STAYS_PART, AGE, CONTRADICTION = range(8)
"""Places in ``feedback_design.FeedbackDesign.timing``."""

KEEP, GAIN, KEEP_PART, GAIN_PART, SEE_ERROR, SEE_LOAD, ON_ERROR, ON_DRIVE, MOST, JUMP = range(10)
"""Columns of ``feedback_design.FeedbackDesign.axes``."""

CORRECTION, TORQUE, DEMAND, COMMAND = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 14)
PLANNED = slice(14, 17)
"""Columns of the queue of commands and of the drives' state: correction [m/s^2, rad/s^2], torque
behind the channel [N m], acceleration that the feed-forward stands for, command [N m], and the
change of the reference that it was planned for."""

WIDTH = PLANNED.stop


@njit(cache=True, error_model="numpy")
def estimate(
    state, queue, drive, acted, axes, timing, to_acceleration, change, error, measured_torque
):
    """One sample of the estimator.

    ``state`` (2 + h, 3): error and disturbance now, then the errors of the last h samples; moves on
    by the corrections that acted since, by what the reference's ``change`` (3,) since then differs
    from the planned one, and by ``error`` (3,), measured twist minus the reference of the
    measurement's instant (NaN: not measured). ``queue`` (slots, 17) holds the commands, newest
    first, ``drive`` (17,) the torques behind the lag. A ``measured_torque`` (4,) that is
    neither the one expected at the wheels nor the one commanded last is believed instead. Fills
    ``acted`` (17,): the means over the last sample.
    """
    slots, share = int(timing[SLOTS]), timing[SHARE]
    stays, mean = timing[STAYS], timing[MEAN]
    for row in range(state.shape[0] - 1, 1, -1):
        state[row] = state[row - 1] if row > 2 else state[0]
    for i in range(WIDTH):
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
        acted[3:7] = measured_torque
        drive[3:7] = measured_torque
    behind = timing[AGE] / timing[PERIOD]
    whole = int(behind)
    part = behind - whole
    for axis in range(3):
        before, load = state[0, axis], state[1, axis]
        prior = axes[axis, KEEP] * before + axes[axis, GAIN] * (acted[axis] + load)
        prior += acted[14 + axis] - change[axis]
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
        commanded = max(commanded, abs(measured[wheel] - queue[0, 10 + wheel]))
    return expected > tolerance and commanded > tolerance


@njit(cache=True, error_model="numpy")
def correction(state, queue, drive, axes, timing, change, out):
    """Fill ``out`` (3,) with the acceleration to command: the error is moved on to the instant at
    which it acts by what is on its way. ``change`` (3,) of the reference until then, as it is known
    now."""
    slots, share = int(timing[SLOTS]), timing[SHARE]
    stays, mean, stays_part = timing[STAYS], timing[MEAN], timing[STAYS_PART]
    for axis in range(3):
        keep, gain = axes[axis, KEEP], axes[axis, GAIN]
        error, load, torque = state[0, axis], state[1, axis], drive[axis]
        surprise = -change[axis]
        for ahead in range(slots):
            mixed = share * queue[slots - 1 - ahead, axis]
            mixed += (1.0 - share) * queue[slots - ahead, axis]
            acts = mixed + (torque - mixed) * mean
            torque = mixed + (torque - mixed) * stays
            error = keep * error + gain * (acts + load)
            surprise += share * queue[slots - 1 - ahead, 14 + axis]
            surprise += (1.0 - share) * queue[slots - ahead, 14 + axis]
        if share < 1.0:
            mixed = queue[0, axis]
            acts = mixed + (torque - mixed) * (0.5 + 0.5 * stays_part) * (stays > 0.0)
            torque = mixed + (torque - mixed) * stays_part
            error = axes[axis, KEEP_PART] * error + axes[axis, GAIN_PART] * (acts + load)
            surprise += (1.0 - share) * queue[0, 14 + axis]
        error += surprise
        out[axis] = -load - axes[axis, ON_ERROR] * error - axes[axis, ON_DRIVE] * (torque + load)


@njit(cache=True, error_model="numpy")
def exert(queue, wanted, forward, mean, motion, slope, limit, to_acceleration, to_torque, out):
    """Fill ``out`` (4,) with commands [N m]: feed-forward ``forward`` (4,) plus the acceleration
    ``wanted`` (3,), within the limit; and remember what they will exert.

    ``mean`` (4,): acting torques that the feed-forward stands for; ``motion`` (3, 14) at the start,
    middle and end of its hold; ``slope`` (4,): true torque per commanded one.
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
        queue[0, 14 + axis] = motion[2, axis] - motion[0, axis]
    for wheel in range(4):
        queue[0, 3 + wheel] = kept[wheel]
        out[wheel] = kept[wheel] / slope[wheel]
        queue[0, 10 + wheel] = out[wheel]
    return share


@njit(cache=True, error_model="numpy")
def act(state, queue, drive, axes, timing, now, motion, forward, mean, limits, maps, torque):
    """Fill ``torque`` (4,) with feed-forward and feedback; returns the share within the limit.

    ``now`` (6,) is the reference at this instant.
    """
    slope, limit = limits
    to_acceleration, to_torque = maps
    wanted = np.empty(3)
    correction(state, queue, drive, axes, timing, motion[0, :3] - now[:3], wanted)
    return exert(
        queue, wanted, forward, mean, motion, slope, limit, to_acceleration, to_torque, torque
    )
