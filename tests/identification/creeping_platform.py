"""A platform whose wheels creep: a third simulator, for tests.

No constraint forbids slip. Each roller pushes along its axis in proportion to the speed at which
its wheel slips there, as in engines whose contacts have a slip per force (and as rubber does at
small slip). The body moves in its own frame, and four wheels turn by themselves; semi-implicit
Euler steps of 0.08 ms. Nothing of it is shared with the models that are fitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from youbot_env.caching import njit
from youbot_env.physics.hardware import WHEELS
from youbot_scripts.blind_bench.motions import calibration, multisine, wheel_speeds

Array = NDArray[np.float64]

R, ROLLER = 0.0475, 0.014
X = np.array([0.2355, 0.2355, -0.2355, -0.2355])
Y = np.array([0.15, -0.15, 0.15, -0.15])
ROLLER_AXIS = np.radians([-45.0, 45.0, 45.0, -45.0])
MASS, YAW_INERTIA, SPIN_INERTIA, MU1, MU2 = 35.3, 4.4, 6e-3, 0.11, 5.78e-3
MOMENT_X, MOMENT_Y = MASS * 0.012, MASS * -0.02
TICK, STEPS = 0.002, 25


@njit(cache=True)
def _driven(reference: Array, grip: float, coulomb: float) -> tuple[Array, Array, Array]:
    """Wheel speeds (N, 4), torques (N, 4) and poses (N, 3) under a PI loop of wheel speeds.

    grip : [N s/m] force along a roller's axis by the speed of slip; coulomb : dry friction [N m] of
        each wheel joint
    """
    inertia = np.array(
        [[MASS, 0.0, -MOMENT_Y], [0.0, MASS, MOMENT_X], [-MOMENT_Y, MOMENT_X, YAW_INERTIA]]
    )
    solve, dt = np.linalg.inv(inertia), TICK / STEPS
    v, pose, rate, sums, torque = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros(4), np.zeros(4)
    count = len(reference)
    rates, torques, poses = np.zeros((count, 4)), np.zeros((count, 4)), np.zeros((count, 3))
    for row in range(count):
        rates[row], poses[row] = rate, pose
        for i in range(4):
            error = reference[row, i] - rate[i]
            sums[i] += error * TICK
            torque[i] = 0.12 * error + 0.30 * sums[i]
        torques[row] = torque
        for _ in range(STEPS):
            w = v[2]
            force = np.array(
                [
                    MASS * v[1] * w + MOMENT_X * w * w,
                    -MASS * v[0] * w + MOMENT_Y * w * w,
                    -w * (MOMENT_X * v[0] + MOMENT_Y * v[1]),
                ]
            )
            for i in range(4):
                c, s = np.cos(ROLLER_AXIS[i]), np.sin(ROLLER_AXIS[i])
                at_x, at_y = v[0] - w * Y[i] - R * rate[i], v[1] + w * X[i]
                along = -grip * (c * at_x + s * at_y)
                across = -MU2 / ROLLER**2 * (c * at_y - s * at_x)
                fx, fy = along * c - across * s, along * s + across * c
                force += np.array([fx, fy, X[i] * fy - Y[i] * fx])
                friction = MU1 * rate[i] + coulomb * np.tanh(rate[i] / 0.03)
                rate[i] += dt * (torque[i] - friction - R * fx) / SPIN_INERTIA
            v += dt * (solve @ force)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            pose += dt * np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])
    return rates, torques, poses


def creeping_logs(grip: float, coulomb: float = 0.0, seed: int = 0) -> list[Log]:
    """Calibration motion and a multisine at 50 Hz, with poses and white noise."""
    rng = np.random.default_rng(seed)
    logs = []
    for name, twist in (("calibration", calibration(TICK)), ("multisine", multisine(rng, TICK))):
        rates, torques, poses = _driven(np.ascontiguousarray(wheel_speeds(twist)), grip, coulomb)
        # The mean of the two commands that meet at a row.
        torques[1:] = 0.5 * (torques[1:] + torques[:-1])
        rows = slice(0, None, 10)
        velocity = rates[rows] + 0.01 * rng.standard_normal(rates[rows].shape)
        effort = torques[rows] + 0.03 * rng.standard_normal(velocity.shape)
        time = TICK * 10 * np.arange(len(velocity), dtype=np.float64)
        logs.append(Log(name, WHEELS, time, velocity, effort, pose=poses[rows]))
    return logs
