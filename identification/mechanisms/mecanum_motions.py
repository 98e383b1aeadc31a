"""Motions that a platform can be asked to drive, and what a log of one would hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.samples import Samples
from identification.signals.filters import integral_of
from youbot_env.motions.base import Motion
from youbot_env.motions.calibration import CALIBRATION
from youbot_env.motions.multisine import multisine
from youbot_env.motions.steps import steps
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.hardware import STOCK_INTEGRAL, STOCK_PROPORTIONAL

Array = NDArray[np.float64]

DT = 0.02
"""Sample time [s] of the motions that are weighed."""


def library(geometry: Geometry, seed: int) -> list[Motion]:
    """Motions to choose from, all within the platform's limits."""
    motions = [make(geometry) for make in CALIBRATION.values()]
    bands = {"slow": (0.2, 0.8), "usual": (0.5, 3.0), "fast": (2.0, 6.0)}
    sizes = {"small": 0.25, "large": 1.0}
    for band, limits in bands.items():
        for size, factor in sizes.items():
            motions.append(
                multisine(
                    np.random.default_rng(seed),
                    band=limits,
                    tones=4,
                    amplitude=(0.25 * factor, 0.2 * factor, 0.7 * factor),
                    duration=60.0,
                    geometry=geometry,
                    name=f"multisine_{band}_{size}",
                )
            )
    for size, factor in {"small": 0.4, "large": 1.0}.items():
        motions.append(
            steps(
                np.random.default_rng(seed),
                amplitude=(0.35 * factor, 0.3 * factor, 1.0 * factor),
                geometry=geometry,
                name=f"steps_{size}",
            )
        )
    return motions


def followed(twist: Array, geometry: Geometry, values: Mapping[str, float]) -> Array:
    """What the stock loop makes of a reference twist (N, 3): each wheel a mass with friction.

    A loop that lags takes the fast part away, and with it what a fast motion was to show.

    Parameters
    ----------
    values : of theta's base parameters, by name
    """
    # Its import takes 1.5 s of processor time, which every command would wait for.
    from scipy.signal import bilinear, lfilter

    radius = geometry.R
    inertia = values["m0"] * radius**2 / 4 + values["I1"]
    loop = (
        [STOCK_PROPORTIONAL, STOCK_INTEGRAL],
        [inertia, values["mu1"] + STOCK_PROPORTIONAL, STOCK_INTEGRAL],
    )
    return np.asarray(lfilter(*bilinear(*loop, fs=1 / DT), twist, axis=0))


def expected_samples(motion: Motion, geometry: Geometry, values: Mapping[str, float]) -> Samples:
    """What a log of a motion would hold, without noise; torques are left at zero."""
    time = np.arange(0.0, motion.duration, DT)
    twist = followed(motion.twist(time), geometry, values)
    yaw = integral_of(twist[:, 2], DT)
    c, s = np.cos(yaw), np.sin(yaw)
    x = integral_of(c * twist[:, 0] - s * twist[:, 1], DT)
    y = integral_of(s * twist[:, 0] + c * twist[:, 1], DT)
    speed = geometry.wheel_speeds(twist)
    angle = integral_of(speed, DT)
    pose = np.column_stack([x, y, yaw])
    return Samples(motion.name, time, DT, twist, pose, angle, speed, np.zeros_like(speed))
