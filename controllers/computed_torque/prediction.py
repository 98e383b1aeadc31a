"""From the inputs of a call to the motion during which its command acts, as compiled code.

:func:`predict` does one sample: it moves the window of the reference on, runs the estimator of the
tracking error, updates the platform's pose, and reads the reference at the instants at which the
command will act.
"""

from __future__ import annotations

import numpy as np

from controllers.computed_torque.feedback import estimate
from controllers.linear.reference_window import extend_to_past, reference_at, take_sample
from youbot_env.caching import njit

TIME, TWIST, POSE, TORQUE, WANTED = 0, slice(1, 4), slice(4, 7), slice(7, 11), slice(11, 17)
"""Places in the array in which a call's inputs are handed to compiled code."""


@njit(cache=True, error_model="numpy")
def predict(inputs, nodes, counts, estimates, queue, drives, constants, place, motion):
    """Estimate where the platform is, and fill ``motion`` (3, 14) with the reference at the start,
    the middle and the end of the hold in which the command will act.

    ``estimates``, ``queue``, ``drives`` and ``constants`` are the structured arrays of
    :mod:`controllers.computed_torque.feedback`.
    """
    past, coming, has_slopes, begun, follows = counts
    given, now = constants[0], estimates[0]
    period, lead, jacobian = given.period, given.lead, given.jacobian
    # NaN in the reference is replaced: the twist goes on with the last acceleration.
    for i in range(11, 17):
        if not abs(inputs[i]) < np.inf:
            slope = nodes[past, i - 8] if i < 14 else 0.0
            inputs[i] = nodes[past, i - 11] + period * slope
    # A preview ends before its first sample that is no number.
    for row in range(past + 1, past + 1 + coming):
        if not np.isfinite(nodes[row]).all():
            coming = row - past - 1
            break
    take_sample(nodes, past, inputs[WANTED], coming, has_slopes, period)
    if not begun:
        extend_to_past(nodes, past, period)
    # The measurement is of ``age`` ago, so it is compared with the reference of that instant.
    at = np.empty(6)
    reference_at(nodes, past - given.age / period, period, at)
    error = inputs[TWIST] - at[:3]
    change = nodes[past, :3] - nodes[past - 1, :3]
    estimate(estimates, queue, drives, constants, change, error, inputs[TORQUE])
    if not begun:
        # Far beyond noise the platform moves already: the estimator starts at the measured error,
        # for it would take its first miss for a disturbance.
        for axis in range(3):
            if abs(error[axis]) > given.max_first_error[axis] and abs(error[axis]) < np.inf:
                now.error[axis] = error[axis]
                now.disturbance[axis] = 0.0
    locate(inputs, nodes[past], now.error, period, jacobian, begun, place)
    # Start, middle and end of the hold: the nodes of Simpson's rule for the mean demand.
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
def locate(inputs, wanted, error, period, jacobian, begun, place):
    """Move ``place`` (11,) on to now: time, pose and wheel angles by the estimated twist
    (``wanted`` plus ``error``), and by what is measured of them."""
    twist = wanted[:3] + error
    if begun:
        # Trapezoidal rule for the twist, midpoint rule for the yaw. Both are of second order; more
        # would be useless, because the twist is known at samples alone.
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
    # Measured values replace reckoned ones; NaN fails the comparison and changes nothing.
    for i in range(4):
        value = inputs[TIME] if i == 0 else inputs[3 + i]
        if abs(value) < np.inf:
            place[i] = value


@njit(cache=True, error_model="numpy")
def follow(nodes, start, end, period, jacobian, pose, angle):
    """Move ``pose`` (3,) and wheel angles (4,) on along the reference from one place to another.

    Simpson's rule for each piece of at most one sample; yaw at the middle from the middle twist.
    """
    at = np.empty((3, 6))
    while start < end - 1e-9:
        stop = min(end, np.floor(start + 1e-9) + 1.0)
        span = (stop - start) * period
        for k in range(3):
            reference_at(nodes, start + 0.5 * k * (stop - start), period, at[k])
        turned = span * (at[0, 2] + 4.0 * at[1, 2] + at[2, 2]) / 6.0
        # To a half of the span, by the parabola through the three.
        half = span * (5.0 * at[0, 2] + 8.0 * at[1, 2] - at[2, 2]) / 24.0
        x, y = 0.0, 0.0
        for k in range(3):
            yaw = pose[2] + (0.0 if k == 0 else half if k == 1 else turned)
            weight = span * (4.0 if k == 1 else 1.0) / 6.0
            c, s = np.cos(yaw), np.sin(yaw)
            x += weight * (c * at[k, 0] - s * at[k, 1])
            y += weight * (s * at[k, 0] + c * at[k, 1])
        for wheel in range(4):
            for axis in range(3):
                mean = (at[0, axis] + 4.0 * at[1, axis] + at[2, axis]) / 6.0
                angle[wheel] += jacobian[wheel, axis] * span * mean
        pose[0] += x
        pose[1] += y
        pose[2] += turned
        start = stop
