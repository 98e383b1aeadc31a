"""The motion that best tells tied effects apart: T-optimal discrimination within limits.

Atkinson and Fedorov, Biometrika 62(1), 1975: of all motions take the one for which the best fit of
the rival to the favourite's prediction is worst.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from identification.fitting.least_squares import gauge_basis
from identification.fitting.regression_rows import regression_rows
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.mecanum_samples import MecanumSamples
from youbot_env.motions.base import Motion
from youbot_env.motions.calibration import CALIBRATION
from youbot_env.motions.multisine import multisine
from youbot_env.motions.steps import steps
from youbot_env.physics.hardware import STOCK_INTEGRAL, STOCK_PROPORTIONAL

Array = NDArray[np.float64]

DT = 0.02
"""Sample time [s] of the motions that are weighed."""


def library(mechanism: Mecanum, seed: int) -> list[Motion]:
    """Motions to choose from, all within the platform's limits."""
    geometry = mechanism.geometry
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


def followed(twist: Array, mechanism: Mecanum, theta: Array) -> Array:
    """What the stock loop makes of a reference twist (N, 3): each wheel a mass with friction.

    A loop that lags takes the fast part away, and with it what a fast motion was to show.
    """
    values = dict(zip(mechanism.parameter_names, theta, strict=True))
    radius = mechanism.geometry.R
    inertia = values["m0"] * radius**2 / 4 + values["I1"]
    loop = (
        [STOCK_PROPORTIONAL, STOCK_INTEGRAL],
        [inertia, values["mu1"] + STOCK_PROPORTIONAL, STOCK_INTEGRAL],
    )
    return np.asarray(lfilter(*bilinear(*loop, fs=1 / DT), twist, axis=0))


def expected_samples(motion: Motion, mechanism: Mecanum, theta: Array) -> MecanumSamples:
    """What a log of a motion would hold, without noise; torques are left at zero."""
    time = np.arange(0.0, motion.duration, DT)
    twist = followed(motion.twist(time), mechanism, theta)
    yaw = _integrate(twist[:, 2])
    c, s = np.cos(yaw), np.sin(yaw)
    x = _integrate(c * twist[:, 0] - s * twist[:, 1])
    y = _integrate(s * twist[:, 0] + c * twist[:, 1])
    speed = mechanism.geometry.wheel_speeds(twist)
    angle = np.column_stack([_integrate(speed[:, k]) for k in range(4)])
    pose = np.column_stack([x, y, yaw])
    return MecanumSamples(motion.name, time, DT, twist, pose, angle, speed, np.zeros_like(speed))


def _integrate(rate: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * DT * (rate[1:] + rate[:-1]))])


def separation(
    favourite: tuple[Mecanum, Array], rival: tuple[Mecanum, Array], samples: MecanumSamples
) -> float:
    """Root mean square [N m] of what the rival's best fit leaves of the favourite's prediction."""
    mechanism, theta = favourite
    other, start = rival
    free = np.flatnonzero(other.free)
    wanted = -regression_rows(mechanism, theta, samples, free[:1]).residual
    rows = regression_rows(other, start, samples, free)
    offered = -rows.residual
    columns = (rows.columns / other.scale[free]).reshape(-1, len(free))
    columns = columns @ gauge_basis(other)
    target = (wanted - offered).ravel()
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=1e-10)[0]
    return float(np.sqrt(np.mean(left**2)))


def best_experiment(
    favourite: tuple[str, Mecanum, Array],
    rivals: list[tuple[str, Mecanum, Array]],
    noise: float,
    seed: int,
) -> dict[str, Any]:
    """The motion whose least separated rival is separated best.

    ``noise`` [N m]: what measurement noise alone leaves in the filtered forces (rms).
    """
    name, mechanism, best = favourite
    found = []
    for motion in library(mechanism, seed):
        samples = expected_samples(motion, mechanism, best)
        apart = {
            rival: separation((mechanism, best), (other, theta), samples)
            for rival, other, theta in rivals
        }
        found.append((min(apart.values()), apart, motion))
    least, apart, motion = max(found, key=lambda row: row[0])
    return {
        "motion": motion.to_dict(),
        "name": motion.name,
        "separates": [name, *apart],
        "signal_to_noise": least / noise,
        "instruction": f"save `motion` as a JSON file and run: youbot record OUT_DIR --motions "
        f"{motion.name}.json, or drive it on the robot; then diagnose all logs together",
    }
