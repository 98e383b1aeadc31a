"""The paper's regressor of the base model: scaled parameters x1 ... x7 and their columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from youbot_env.motions.calibration import CALIBRATION
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.inverse_dynamics import wrench
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.physics.mechanism import Instant

Array = NDArray[np.float64]

PAPER_ORDER = (0, 1, 4, 2, 3, 5, 6)
"""theta's base parameters (m0, I0, m_aX, m_aY, I1, mu1, mu2) in the order of x1 ... x7."""

BASE = mecanum_structure()


def paper_scale(geometry: Geometry) -> dict[str, float]:
    """Factors from theta's base parameters, by name, to x = (m0 L^2, I0, 4 I1 L^2/R^2, ...)."""
    g = geometry
    return {
        "m0": g.L**2,
        "I0": 1.0,
        "I1": 4 * g.L**2 / g.R**2,
        "m_aX": g.L,
        "m_aY": g.L,
        "mu1": 4 * g.L**2 / g.R**2,
        "mu2": 8 * g.h**2 / g.r**2,
    }


def force_scale(geometry: Geometry) -> Array:
    """(3,) factors that turn (F_X, F_Y, M_W) into (L F_X, L F_Y, M_W)."""
    return np.array([geometry.L, geometry.L, 1.0])


def ideal_columns(geometry: Geometry, twist: Array, acceleration: Array) -> Array:
    """Regressor columns (n, 3, 7) of x1 ... x7 for a known motion (n, 3), unfiltered."""
    at = Instant(tuple(twist.T), tuple(acceleration.T))
    scale = paper_scale(geometry)
    columns = []
    for k in PAPER_ORDER:
        unit = np.zeros(7)
        unit[k] = 1.0 / scale[BASE.parameter_names[k]]
        force = wrench(np, BASE, geometry, unit, at)
        force = np.stack(np.broadcast_arrays(*force, twist[:, 0])[:3], axis=-1)
        columns.append(force * force_scale(geometry))
    return np.stack(columns, axis=-1)


def motion_that_shows(geometry: Geometry, direction: Array) -> str:
    """Name of the calibration motion that sees a direction (F,) in x best, for its length.

    What lies in ``direction`` beyond x1 ... x7 (effects) is left out.
    """
    dt = 0.02
    seen = {}
    for name, make in CALIBRATION.items():
        motion = make(geometry)
        time = np.arange(0.0, motion.duration - 0.5 * dt, dt)
        columns = ideal_columns(geometry, motion.twist(time), motion.acceleration(time))
        flat = columns.reshape(-1, columns.shape[-1])
        base = direction[: flat.shape[1]]
        seen[name] = float(base @ (flat.T @ flat * dt) @ base) / motion.duration
    return max(seen, key=lambda name: seen[name])
