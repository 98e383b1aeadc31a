"""Feedback on the error that the feed-forward leaves, by an estimator with delay, lag and hold.

In units of acceleration all axes have one model: an error e of the twist, a slowly changing
disturbance d, and a correction a that acts ``delay`` late through a drive's lag::

    e' = -decay e + a + d,        T m' = u - m,   a(t) = m(t - delay)

The estimator runs this model with the corrections that were really exerted, so a saturated or
missing torque causes no windup. It compares a measurement with the estimate of the instant at which
it was taken. The command cancels d, and drives the error that is predicted for the instant at which
the command acts to zero.

What the functions work on are structured arrays, whose fields compiled code reads by name. Axes are
VX, VY, W, so that three numbers in "m/s^2" are m/s^2, m/s^2, rad/s^2; wheels are fl, fr, bl, br.
"""

from __future__ import annotations

import numpy as np

from controllers.allocation import within_limits
from youbot_env.caching import njit

# Structured arrays, because a call of compiled code takes one in 0.1 us. A NamedTuple of ten arrays
# takes 1.1 us, a fifth of a whole step of the controller.
CONSTANTS = np.dtype(
    [
        # An error e becomes transition e + input_gain (a + d) after a sample, and with ``_part``
        # after the part of a sample that the delay has beside its whole ones.
        ("transition", np.float64, 3),  # [1]
        ("input_gain", np.float64, 3),  # [s]
        ("transition_part", np.float64, 3),  # [1]
        ("input_gain_part", np.float64, 3),  # [s]
        # Estimator: per error found, how much the estimates of error and disturbance move.
        ("error_correction", np.float64, 3),  # [1]
        ("disturbance_correction", np.float64, 3),  # [1/s]
        # Regulator: acceleration per error, and per acceleration that the drives exert.
        ("error_feedback", np.float64, 3),  # [1/s]
        ("drive_feedback", np.float64, 3),  # [1]
        ("max_disturbance", np.float64, 3),  # [m/s^2] that is believed
        ("max_first_error", np.float64, 3),  # [m/s] that may be noise
        ("period", np.float64),  # [s] of a sample
        ("age", np.float64),  # [s] of a measurement
        ("lead", np.float64),  # [samples] from now to the instant at which a command acts
        ("whole_samples", np.int64),  # of the lead
        ("newer_share", np.float64),  # of a sample in which the newer of two commands acts
        # Of what the drives exert beside the command's: what stays after a sample, what acts during
        # it on average, and what stays after the part of a sample. All 0 without a lag.
        ("lag_stays", np.float64),
        ("lag_mean", np.float64),
        ("lag_stays_part", np.float64),
        ("slope", np.float64, 4),  # true torque per commanded one
        ("torque_limit", np.float64),  # [N m] of a command
        ("torque_tolerance", np.float64),  # [N m] beyond which a measured torque is believed
        ("to_acceleration", np.float64, (3, 4)),  # [m/s^2 per N m] of the body, per wheel torque
        ("to_torque", np.float64, (4, 3)),  # [N m per m/s^2] the least-norm way back
        ("jacobian", np.float64, (4, 3)),  # [rad/s per m/s] wheel speeds per twist
        ("internal", np.float64, 4),  # [N m] torques that exert no force
    ],
    align=True,
)
"""What the feedback is given by its design, an array (1,)."""

ESTIMATE = np.dtype(
    [
        ("error", np.float64, 3),  # [m/s] measured twist minus reference
        ("disturbance", np.float64, 3),  # [m/s^2]
    ],
    align=True,
)
"""An array (1 + h,) holds the estimates of now and of the last h samples, newest first."""

COMMAND = np.dtype(
    [
        ("correction", np.float64, 3),  # [m/s^2] that it exerts beside the feed-forward's
        ("torque", np.float64, 4),  # [N m] true ones, behind the channel
        ("demand", np.float64, 3),  # [m/s^2] that the feed-forward stands for
        ("command", np.float64, 4),  # [N m] as they are sent
        ("planned", np.float64, 3),  # [m/s] change of the reference that it was planned for
    ],
    align=True,
)
"""An array (slots,), the queue, holds the commands that were sent last, newest first.

It is not a ``youbot_env.simulation.delay_line.DelayLine``, which holds torques of any duration and
returns those that arrive. Here all commands last one sample, and the estimator, in compiled code,
reads all of them to predict the error at the end of the delay.
"""

DRIVES = np.dtype(
    [
        ("correction", np.float64, 3),  # [m/s^2] now
        ("torque", np.float64, 4),  # [N m] now
        # Over the last sample, as in ``COMMAND``.
        ("mean_correction", np.float64, 3),
        ("mean_torque", np.float64, 4),
        ("mean_demand", np.float64, 3),
        ("mean_planned", np.float64, 3),
    ],
    align=True,
)
"""What the drives exert behind delay and lag, an array (1,)."""


@njit(cache=True, error_model="numpy")
def estimate(estimates, queue, drives, constants, change, error, measured_torque):
    """One sample of the estimator.

    ``estimates`` moves on by the corrections that acted since, by what the reference's ``change``
    (3,) [m/s] since then differs from the planned one, and by ``error`` (3,) [m/s], measured twist
    minus the reference of the measurement's instant (NaN: not measured). A ``measured_torque`` (4,)
    [N m] that is neither the one expected at the wheels nor the one commanded last is believed
    instead. Moves ``drives`` on, too.
    """
    given, acting = constants[0], drives[0]
    # From the end, so that no row is overwritten before it is copied.
    for row in range(estimates.size - 1, 0, -1):
        estimates[row] = estimates[row - 1]
    _move_drives(queue, acting, given)
    # Drives that do not obey: what they exert is taken from the measurement.
    if _contradicts(measured_torque, acting, queue[0], given.torque_tolerance):
        for axis in range(3):
            value = -acting.mean_demand[axis]
            for wheel in range(4):
                value += given.to_acceleration[axis, wheel] * measured_torque[wheel]
            acting.mean_correction[axis] = acting.correction[axis] = value
        for wheel in range(4):
            acting.mean_torque[wheel] = acting.torque[wheel] = measured_torque[wheel]
    # The measurement's instant lies between two samples of the past.
    behind = given.age / given.period
    whole = int(behind)
    part = behind - whole
    now = estimates[0]
    for axis in range(3):
        disturbance = now.disturbance[axis]
        prior = given.transition[axis] * now.error[axis]
        prior += given.input_gain[axis] * (acting.mean_correction[axis] + disturbance)
        prior += acting.mean_planned[axis] - change[axis]
        newer = prior if whole == 0 else estimates[whole].error[axis]
        older = estimates[1 + whole].error[axis]
        found = error[axis] - ((1.0 - part) * newer + part * older)
        # NaN (not measured) or infinity: the prediction stands alone.
        if not abs(found) < np.inf:
            found = 0.0
        most = given.max_disturbance[axis]
        now.error[axis] = prior + given.error_correction[axis] * found
        disturbance += given.disturbance_correction[axis] * found
        now.disturbance[axis] = min(max(disturbance, -most), most)


@njit(cache=True, error_model="numpy")
def _move_drives(queue, acting, given):
    """One sample of the drives, under the two commands that acted during it."""
    newer, older = queue[given.whole_samples], queue[given.whole_samples + 1]
    share = given.newer_share
    for axis in range(3):
        mixed = share * newer.correction[axis] + (1.0 - share) * older.correction[axis]
        mean, now = _lagged(mixed, newer.correction[axis], acting.correction[axis], given)
        acting.mean_correction[axis], acting.correction[axis] = mean, now
        acting.mean_demand[axis] = share * newer.demand[axis] + (1.0 - share) * older.demand[axis]
        mixed = share * newer.planned[axis] + (1.0 - share) * older.planned[axis]
        acting.mean_planned[axis] = mixed
    for wheel in range(4):
        mixed = share * newer.torque[wheel] + (1.0 - share) * older.torque[wheel]
        mean, now = _lagged(mixed, newer.torque[wheel], acting.torque[wheel], given)
        acting.mean_torque[wheel], acting.torque[wheel] = mean, now


@njit(cache=True, error_model="numpy")
def _lagged(mixed, newer, before, given):
    """What a drive exerts on average during a sample, and at its end."""
    # Without a lag the newer command alone acts at the end.
    if not given.lag_stays > 0.0:
        return mixed, newer
    rest = before - mixed
    return mixed + rest * given.lag_mean, mixed + rest * given.lag_stays


@njit(cache=True, error_model="numpy")
def _contradicts(measured, acting, last, tolerance):
    """Whether the wheels' torque is known and not what the commands make of it."""
    expected, commanded = 0.0, 0.0
    for wheel in range(4):
        if not abs(measured[wheel]) < np.inf:
            return False
        expected = max(expected, abs(measured[wheel] - acting.torque[wheel]))
        commanded = max(commanded, abs(measured[wheel] - last.command[wheel]))
    return expected > tolerance and commanded > tolerance


@njit(cache=True, error_model="numpy")
def correction(estimates, queue, drives, constants, change, out):
    """Fill ``out`` (3,) [m/s^2] with the acceleration to command. The error is predicted for the
    instant at which the command acts, with the commands that are on their way. ``change`` (3,)
    [m/s] is the reference's change until then, as it is known now."""
    given, now = constants[0], estimates[0]
    whole, share, stays = given.whole_samples, given.newer_share, given.lag_stays
    for axis in range(3):
        error, disturbance = now.error[axis], now.disturbance[axis]
        torque = drives[0].correction[axis]
        # Change of the reference that was not planned: no command on its way accounts for it.
        surprise = -change[axis]
        for row in range(whole, 0, -1):
            newer, older = queue[row - 1], queue[row]
            mixed = share * newer.correction[axis] + (1.0 - share) * older.correction[axis]
            acts = mixed + (torque - mixed) * given.lag_mean
            torque = mixed + (torque - mixed) * stays
            error = given.transition[axis] * error + given.input_gain[axis] * (acts + disturbance)
            surprise += share * newer.planned[axis]
            surprise += (1.0 - share) * older.planned[axis]
        if share < 1.0:
            mixed = queue[0].correction[axis]
            # Mean of the lag over the part of a sample, by its two ends; 0 without a lag.
            acts = mixed + (torque - mixed) * (0.5 + 0.5 * given.lag_stays_part) * (stays > 0.0)
            torque = mixed + (torque - mixed) * given.lag_stays_part
            error = given.transition_part[axis] * error
            error += given.input_gain_part[axis] * (acts + disturbance)
            surprise += (1.0 - share) * queue[0].planned[axis]
        error += surprise
        wanted = -disturbance - given.error_feedback[axis] * error
        # A steady drive exerts -disturbance, so only the difference from it is fed back.
        out[axis] = wanted - given.drive_feedback[axis] * (torque + disturbance)


@njit(cache=True, error_model="numpy")
def exert(queue, constants, wanted, forward, mean, planned, out):
    """Fill ``out`` (4,) with commands [N m]: feed-forward ``forward`` (4,) [N m] plus the
    acceleration ``wanted`` (3,) [m/s^2], within the limit; and remember what they will exert.
    Returns the share of the force that is within the limit.

    ``mean`` (4,) [N m]: acting torques that the feed-forward stands for; ``planned`` (3,) [m/s]:
    change of the reference during the hold.
    """
    given = constants[0]
    torque, limits, kept = np.empty(4), np.empty(4), np.empty(4)
    for wheel in range(4):
        torque[wheel] = given.slope[wheel] * forward[wheel]
        # The limit is one of commands; here torques are those behind the channel.
        limits[wheel] = given.torque_limit * abs(given.slope[wheel])
        for axis in range(3):
            torque[wheel] += given.to_torque[wheel, axis] * wanted[axis]
    share = within_limits(torque, limits, given.internal, kept)
    for row in range(queue.size - 1, 0, -1):
        queue[row] = queue[row - 1]
    sent = queue[0]
    for axis in range(3):
        exerted, demanded = 0.0, 0.0
        for wheel in range(4):
            extra = kept[wheel] - given.slope[wheel] * forward[wheel]
            exerted += given.to_acceleration[axis, wheel] * extra
            demanded += given.to_acceleration[axis, wheel] * mean[wheel]
        sent.correction[axis] = exerted
        sent.demand[axis] = demanded
        sent.planned[axis] = planned[axis]
    for wheel in range(4):
        sent.torque[wheel] = kept[wheel]
        out[wheel] = kept[wheel] / given.slope[wheel]
        sent.command[wheel] = out[wheel]
    return share


@njit(cache=True, error_model="numpy")
def act(estimates, queue, drives, constants, now, motion, forward, mean, torque):
    """Fill ``torque`` (4,) [N m] with feed-forward and feedback; returns the share within the
    limit.

    ``now`` (6,) is the reference at this instant, ``motion`` (3, 14) that at the start, middle and
    end of the command's hold; ``forward`` and ``mean`` as for :func:`exert`.
    """
    wanted = np.empty(3)
    correction(estimates, queue, drives, constants, motion[0, :3] - now[:3], wanted)
    planned = motion[2, :3] - motion[0, :3]
    return exert(queue, constants, wanted, forward, mean, planned, torque)
