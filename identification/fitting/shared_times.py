"""What logs have in common at the same time since each began: a push that sets in, no wander.

An offset that wanders in one log knows nothing of another. Slow signals are alike by chance too,
so the likeness at equal times is compared with that at all shifts of one log against the other:
two drifts that last for hours are alike whatever the shift, two steps at one time are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import PredictabilitySettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Likeness:
    """How alike some logs are at equal times.

    size : 2 x y over x^2 + y^2, summed over times, axes and pairs of logs: 1 if they are equal, 0
        if they know nothing of each other
    p_value : share of the shifts of one log against the other at which they are no less alike
    """

    size: float
    p_value: float

    def is_shared(self, settings: PredictabilitySettings) -> bool:
        """Whether this is no chance."""
        return self.size >= settings.min_likeness and self.p_value <= settings.max_shift_p_value


def likeness(
    residual: Sequence[Array], time: Sequence[Array], settings: PredictabilitySettings
) -> Likeness:
    """Of what varies slowly within each log; nothing is alike in a single one.

    Parameters
    ----------
    residual : per log (n, A); time : per log (n,) since it began [s]
    """
    slow = [_slow(rows, at, settings) for rows, at in zip(residual, time, strict=True)]
    pairs = list(combinations(slow, 2))
    # Half of the shorter log is seen at each shift at least.
    most = max((min(map(len, pair)) // 2 for pair in pairs), default=0)
    shifts = range(-most, most + 1)
    sizes = np.array([_size(pairs, shift) for shift in shifts])
    return Likeness(float(sizes[most]), float((sizes >= sizes[most]).mean()))


def _slow(rows: Array, time: Array, settings: PredictabilitySettings) -> Array:
    """(steps, A) running means of rows (n, A), a step of time each; not finite where none is."""
    step = (time / settings.likeness_step).astype(np.intp)
    steps = int(step.max(initial=-1)) + 1
    window = np.ones(settings.likeness_mean)
    columns = [np.ones(len(rows)), *rows.T]
    count, *sums = (
        np.convolve(np.bincount(step, column, steps), window, "same")[:steps] for column in columns
    )
    means = np.stack(sums, axis=1) / np.maximum(count, 1.0)[:, None]
    means[count == 0] = np.nan
    return means


def _size(pairs: Sequence[tuple[Array, Array]], shift: int) -> float:
    """Likeness of the first of each pair with the second so many steps later."""
    product = square = 0.0
    for first, second in pairs:
        count = min(len(first), len(second))
        early, late = max(-shift, 0), max(shift, 0)
        x, y = first[early:], second[late:]
        both = min(len(x), len(y))
        if both < count // 2 or both < 2:
            continue
        x, y = x[:both], y[:both]
        known = np.isfinite(x[:, 0]) & np.isfinite(y[:, 0])
        if known.sum() < 2:
            continue
        x, y = (part[known] - part[known].mean(axis=0) for part in (x, y))
        product += 2.0 * float((x * y).sum())
        square += float((x**2).sum() + (y**2).sum())
    return product / square if square > 0 else 0.0
