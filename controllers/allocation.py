"""Four wheel torques for three generalised forces, within the torques that the drives can give.

Torques along the fourth direction, (1, 1, -1, -1) where all rollers stand at one angle, exert no
force on the platform: the wheels push against each other. A shift along it can bring the largest
torque within its limit without a change of the force.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.caching import njit
from youbot_env.physics.geometry import Geometry

Array = NDArray[np.float64]


def allocate(geometry: Geometry, force: ArrayLike, limit: ArrayLike) -> tuple[Array, float]:
    """Wheel torques for a force, and the share of it that they exert.

    Least norm where that is within the limits; else shifted along ``geometry.internal`` by as
    little as needed; else the largest force of the same direction.

    Parameters
    ----------
    force : (3,) F_X, F_Y [N], M_W [N m] about O in the body frame
    limit : [N m], one number or one a wheel (4,)

    Returns
    -------
    torque (4,) [N m] fl, fr, bl, br; share in (0, 1]: ``geometry.body_force(torque)`` is
    ``share * force``.
    """
    out = np.empty(4)
    limits = np.broadcast_to(np.asarray(limit, float), (4,)).copy()
    share = within_limits(geometry.wheel_torque(force), limits, np.array(geometry.internal), out)
    return out, share


@njit(cache=True, error_model="numpy")
def within_limits(torque, limit, internal, out):
    """Fill ``out`` (4,) with torques within +-``limit`` (4,) that exert ``share`` of the force of
    ``torque`` (4,), and return the share: 1 where a shift along ``internal`` (4,), torques that
    exert no force, is enough.

    In w = torque / internal the shift adds one number to all four, so the limits leave an
    interval for it. Where the interval is empty, the two values of w that are furthest apart,
    relative to the sum of their limits, give the share of the force that is left.
    """
    low, high, share = -np.inf, np.inf, 1.0
    for i in range(4):
        for j in range(4):
            apart = torque[i] / internal[i] - torque[j] / internal[j]
            most = limit[i] / abs(internal[i]) + limit[j] / abs(internal[j])
            if share * apart > most:
                share = most / apart
    for i in range(4):
        value, most = share * torque[i] / internal[i], limit[i] / abs(internal[i])
        low = max(low, -most - value)
        high = min(high, most - value)
    if share < 1.0:
        # The interval is one point; rounding may have made its lower end the larger one.
        low = high = 0.5 * (low + high)
    # The shift in the interval that is nearest to 0, which keeps the norm least.
    shift = min(max(0.0, low), high)
    for i in range(4):
        # Cut once more, because rounding may exceed the limit by a last digit.
        out[i] = min(max(share * torque[i] + internal[i] * shift, -limit[i]), limit[i])
    return share
