"""Rollers in X or in O: how the log of one robot is that of the other.

The wheels of a robot in O turn as those of one in X would with front and back wheels exchanged and
an arm of l - h (where l > h), or with left and right wheels exchanged and an arm of h - l (where
h > l): in  R phi' = VX + t VY + (t x - y) W  the exchange turns the signs of t, and the arm is what
is left. So a log is brought into X by its columns' order, and all estimates are made there. A pose
shows the arrangement only together with the arm: exchanged columns look like it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.kinematics.motion import Motion
from identification.kinematics.orientation import Orientation
from youbot_env.errors import InputError
from youbot_env.physics.geometry import SIGN_LATERAL, SIGN_Y, WHEELS, Geometry

FRONT_AND_BACK, LEFT_AND_RIGHT = (2, 3, 0, 1), (1, 0, 3, 2)
AS_LOGGED = tuple(range(len(WHEELS)))


def _signs(order: tuple[int, ...]) -> tuple[int, int]:
    """Signs of VY and W that an order of the columns turns."""
    first = order[0]
    return int(SIGN_LATERAL[first] * SIGN_LATERAL[0]), int(SIGN_Y[first] * SIGN_Y[0])


_SIGNS = {
    order: _signs(order)
    for order in (AS_LOGGED, FRONT_AND_BACK, LEFT_AND_RIGHT, tuple(reversed(AS_LOGGED)))
}


def partners(geometry: Geometry) -> tuple[int, ...]:
    """The order (4,) of columns that makes a log of one arrangement one of the other."""
    return FRONT_AND_BACK if geometry.l > geometry.h else LEFT_AND_RIGHT


def order_in_x(geometry: Geometry) -> tuple[int, ...]:
    """The order (4,) of columns in which a log reads as one of a robot in X."""
    return AS_LOGGED if geometry.arrangement == "X" else partners(geometry)


def in_x(motion: Motion, geometry: Geometry) -> Motion:
    """The motion with its columns in the order in which it reads as one of a robot in X."""
    order = list(order_in_x(geometry))
    position = None if motion.position is None else motion.position[:, order]
    return replace(motion, velocity=motion.velocity[:, order], position=position)


def other(geometry: Geometry) -> Geometry | None:
    """The geometry with the other arrangement; None where such a robot could not turn."""
    try:
        return replace(geometry, arrangement="O" if geometry.arrangement == "X" else "X")
    except InputError:
        return None


def exchange_of(found: Orientation) -> tuple[int, ...] | None:
    """Which pairs of wheels an orientation exchanges, a mirrored world taken for one too; None
    where it is something else."""
    if min(found.signs) < 0 or found.order not in _SIGNS:
        return None
    across, turning = _SIGNS[found.order]
    seen = across * (-1 if found.mirrored else 1), turning * (1 if found.yaw_sign > 0 else -1)
    return next(order for order, signs in _SIGNS.items() if signs == seen)


def may_be_other(found: Orientation, geometry: Geometry, known: bool) -> bool:
    """Whether what was found is also what the other arrangement would look like."""
    possible = (partners(geometry),) if known else (FRONT_AND_BACK, LEFT_AND_RIGHT)
    return exchange_of(found) in possible


def is_other(arm: float, geometry: Geometry) -> bool:
    """Whether an arm [m], of wheels that look exchanged, is nearer to the other arrangement's."""
    of_other = other(geometry)
    if of_other is None or not arm > 0:
        return False
    far, near = (abs(float(np.log(arm / one.L))) for one in (geometry, of_other))
    return near < far
