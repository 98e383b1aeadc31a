"""Torques of motions, by a compiled demand and a compiled command that are called by address.

The same for all effects, so it is compiled once on a machine. ``demand`` is the address of a
function that fills torques from (motion, torque, lengths, theta), ``command`` of one that does from
(torque, rate, second, motion, lengths, theta). Their use stands in ``compiled.InverseKernel``.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_calls import call_command, call_demand, copied

ROUNDS = 400
"""Most iterations for torques that depend on themselves. Each reduces the error by the share of the
loss: the largest share is 0.9, and 0.9^400 is below rounding. A share of 0.3 takes 30."""

SANE = 1e6
"""Sum of torques [N m] above which a first guess is replaced by 0, as is NaN: an iteration from NaN
would stay there."""


@njit(cache=True, error_model="numpy")
def acting(demand, rounds, motion, lengths, theta, tolerance, torque):
    """``rounds``: 1 where the demand reads no torque, so that the first is exact; or ``ROUNDS``."""
    known, own, now = np.empty(len(lengths)), np.empty(len(theta)), np.empty(motion.shape[1])
    last, found = np.empty(4), np.empty(4)
    copied(lengths, known)
    copied(theta, own)
    for k in range(motion.shape[0]):
        copied(motion[k], now)
        copied(torque[k], last)
        if not abs(last[0]) + abs(last[1]) + abs(last[2]) + abs(last[3]) < SANE:
            for i in range(4):
                last[i] = 0.0
        for _ in range(rounds):
            call_demand(demand, now, last, known, own, found)
            moved = 0.0
            for i in range(4):
                moved += abs(found[i] - last[i])
                last[i] = found[i]
            if moved <= tolerance:
                break
        copied(last, torque[k])


@njit(cache=True, error_model="numpy")
def several(demand, rounds, motion, lengths, thetas, tolerance, torque):
    """``acting`` at each of several parameters."""
    for j in range(thetas.shape[0]):
        acting(demand, rounds, motion, lengths, thetas[j], tolerance, torque[j])


@njit(cache=True, error_model="numpy")
def interface(command, torque, rate, second, motion, lengths, theta, out):
    """All arrays are contiguous."""
    call_command(command, torque, rate, second, motion, lengths, theta, out)


@njit(cache=True, error_model="numpy")
def held(demand, command, rounds, motion, hold, lengths, theta, tolerance, torque, mean, out):
    """All arrays are contiguous."""
    acting(demand, rounds, motion, lengths, theta, tolerance, torque)
    second, rate = np.empty(4), np.empty(4)
    for i in range(4):
        second[i] = 4.0 * (torque[0, i] - 2.0 * torque[1, i] + torque[2, i]) / hold**2
        mean[i] = (torque[0, i] + 4.0 * torque[1, i] + torque[2, i]) / 6.0
        rate[i] = (torque[2, i] - torque[0, i]) / hold
    call_command(command, mean, rate, second, motion[1], lengths, theta, out)
