"""Symbols and units of what a mechanism measures, as figures show them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from youbot_env.physics.geometry import Geometry

Quantity = tuple[str, str]
"""Symbol (mathtext) and unit."""

FORCES = ((r"$L\,F_X$", "N m"), (r"$L\,F_Y$", "N m"), ("$M_W$", "N m"))
VELOCITIES = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$W$", "rad/s"))
"""Of a platform, axis by axis."""


class Quantities(NamedTuple):
    """Forces and speeds of a mechanism, axis by axis.

    speed_scale : (A,) from the engine's speeds to those that are shown
    """

    forces: tuple[Quantity, ...]
    speeds: tuple[Quantity, ...]
    speed_scale: NDArray[np.float64]


class Turning(Protocol):
    """What tells whether an axis turns."""

    @property
    def turns(self) -> bool: ...


def of_platform(geometry: Geometry) -> Quantities:
    """(L F_X, L F_Y, M_W) and (VX, VY, W); the engine divides VX and VY by L."""
    return Quantities(FORCES, VELOCITIES, np.array([geometry.L, geometry.L, 1.0]))


def of_axis(scales: Turning) -> Quantities:
    """One axis: it slides (N, m/s) or turns (N m, rad/s)."""
    turns = scales.turns
    force = ("torque", "N m") if turns else ("force", "N")
    return Quantities((force,), (("speed", "rad/s" if turns else "m/s"),), np.ones(1))
