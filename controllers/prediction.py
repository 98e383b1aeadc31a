"""From a call's inputs to the motion that its command will drive, as compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit

from controllers.error_feedback import AGE, JUMP, PERIOD, estimate
from controllers.lookahead import follow, invent_past, reference_at, take

TIME, TWIST, POSE, TORQUE, WANTED = 0, slice(1, 4), slice(4, 7), slice(7, 11), slice(11, 17)
"""Places in the array in which a call's inputs are handed to compiled code."""


@njit(cache=True, error_model="numpy")
def predict(
    inputs, nodes, counts, state, queue, drive, acted, axes, timing, maps, lead, place, motion
):
    """Estimate where the platform is, and fill ``motion`` (3, 14) with the reference at the start,
    the middle and the end of the hold in which the command will act."""
    past, coming, has_slopes, begun, follows = counts
    jacobian, to_acceleration = maps
    period = timing[PERIOD]
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
    reference_at(nodes, past - timing[AGE] / period, period, at)
    error = inputs[TWIST] - at[:3]
    change = nodes[past, :3] - nodes[past - 1, :3]
    measured = inputs[TORQUE]
    estimate(state, queue, drive, acted, axes, timing, to_acceleration, change, error, measured)
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
