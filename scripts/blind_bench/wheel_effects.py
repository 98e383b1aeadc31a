"""Kinematics that a blind test plants: wheels that roll unevenly, speed channels that mislead.

Speeds are changed here as a log would hold them; radii and roller angles are the simulator's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from youbot_scripts.blind_bench.draws import WHEELS, Values

Array = NDArray[np.float64]


def uneven_errors(name: str) -> Callable[[np.random.Generator, float, Array], Values]:
    """Of mean zero: one odd wheel by ``size``, or all four within it, half of the cases each."""

    def drawn(rng: np.random.Generator, size: float, path: Array) -> Values:
        odd = np.eye(4)[rng.integers(4)] * rng.choice([-1.0, 1.0])
        worn = rng.uniform(-1.0, 1.0, 4)
        share = odd if rng.random() < 0.5 else worn
        # What all wheels share cannot be told from another nominal radius.
        share = share - share.mean()
        share = share / np.ptp(share)
        return {f"{name}_{wheel}": size * s for wheel, s in zip(WHEELS, share, strict=True)}

    return drawn


def roller_angles(rng: np.random.Generator, size: float, path: Array) -> Values:
    """All four by as much, or, in a third of the cases, one wheel alone."""
    share = np.full(4, rng.choice([-1.0, 1.0]))
    if rng.random() < 1 / 3:
        share = share * np.eye(4)[rng.integers(4)]
    return {f"error_{wheel}": size * s for wheel, s in zip(WHEELS, share, strict=True)}


def per_wheel(values: Values, prefix: str) -> Array:
    return np.array([values[f"{prefix}_{wheel}"] for wheel in WHEELS])


def logged_speeds(name: str, values: Values, speed: Array, effort: Array, dt: float) -> Array:
    """Speeds (N, 4) as a log holds them where one effect misleads its speed channels.

    ``speed``, ``effort`` (N, 4): true ones, every ``dt`` [s].
    """
    if name == "speed_gain_error":
        return speed / (1.0 + per_wheel(values, "gain"))
    if name == "wheel_creep":
        return speed + values["slip"] * effort
    if name == "speed_filter":
        # Exact for a speed that is held between ticks of 2 ms.
        decay = np.exp(-dt / values["time_constant"])
        return np.asarray(lfilter([1.0 - decay], [1.0, -decay], speed, axis=0), float)
    return speed
