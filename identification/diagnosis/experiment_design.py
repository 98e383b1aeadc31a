"""The motion that best tells tied effects apart: T-optimal discrimination within limits.

Atkinson and Fedorov, Biometrika 62(1), 1975: of all motions choose the one in which even the best
fit of the rival model deviates most from the prediction of the favourite model.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.regression import regression
from identification.mechanisms.mechanism import Experiment, Mechanism
from identification.mechanisms.samples import Samples

Array = NDArray[np.float64]


def separation(
    favourite: tuple[Mechanism, Array], rival: tuple[Mechanism, Array], samples: Samples
) -> float:
    """Root mean square [N m] of what the rival's best fit leaves of the favourite's prediction."""
    mechanism, theta = favourite
    other, start = rival
    free = np.flatnonzero(other.free)
    # Minus the residual is the demanded force less the measured one, which is the same in both and
    # cancels below. One column is enough, since only the residual is used.
    wanted = -regression(mechanism, theta, samples, free[:1]).residual
    rows = regression(other, start, samples, free)
    offered = -rows.residual
    columns = (rows.columns / other.scale[free]).reshape(-1, len(free))
    columns = columns @ gauge_basis(other)
    target = (wanted - offered).ravel()
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=1e-10)[0]
    return float(np.sqrt(np.mean(left**2)))


def best_experiment(
    motions: Sequence[Experiment],
    favourite: tuple[str, Mechanism, Array],
    rivals: Sequence[tuple[str, Mechanism, Array]],
    noise: float,
) -> dict[str, Any]:
    """The motion of those offered whose least separated rival is separated best.

    ``noise`` [N m]: what measurement noise alone leaves in the filtered forces (rms).
    """
    name, mechanism, best = favourite
    found = []
    for motion in motions:
        samples = motion.samples(best)
        apart = {
            rival: separation((mechanism, best), (other, theta), samples)
            for rival, other, theta in rivals
        }
        found.append((min(apart.values()), apart, motion))
    least, apart, motion = max(found, key=lambda row: row[0])
    return {
        "motion": motion.content,
        "name": motion.name,
        "separates": [name, *apart],
        "signal_to_noise": least / noise,
        "instruction": f"save `motion` as a JSON file and run: youbot record OUT_DIR --motions "
        f"{motion.name}.json, or drive it on the robot; then diagnose all logs together",
    }
