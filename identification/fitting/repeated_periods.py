"""Noise without a model: what does not repeat from one period of a motion to the next.

A motion that repeats asks the same force in each period, and whatever a model misses of it repeats
too. The difference between two periods holds the noise twice, of whatever colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import PredictabilitySettings

Array = NDArray[np.float64]


def repeated_noise(
    time: Array,
    speed: Array,
    residual: Array,
    parts: Sequence[tuple[float, float]],
    settings: PredictabilitySettings,
) -> tuple[Array, int]:
    """Sum of squares (A,) of the noise in a residual, and the number of differences behind it.

    Parameters
    ----------
    time : (n,) uniform [s]; speed : (n, A) of the motion; residual : (n, A) of the forces
    parts : stretches [s] in which a motion may repeat
    """
    step = float(time[1] - time[0])
    total, count = np.zeros(residual.shape[1]), 0
    for start, end in parts:
        inside = slice(*np.searchsorted(time, [start, end]))
        lag = _period(speed[inside], step, settings)
        if lag:
            of_part = residual[inside]
            # Half: each difference holds the noise of two periods.
            total += 0.5 * ((of_part[lag:] - of_part[:-lag]) ** 2).sum(axis=0)
            count += len(of_part) - lag
    return total, count


def _period(speed: Array, step: float, settings: PredictabilitySettings) -> int:
    """Samples of the period of a motion (n, A); 0 where it does not repeat."""
    # Lags are searched on rows that are this coarse, then between them.
    coarse = max(1, round(settings.period_search_step / step))
    thinned = speed[::coarse]
    least = round(settings.min_period / step / coarse)
    lags = range(least, len(thinned) // 2)
    if not lags:
        return 0
    best = coarse * min(lags, key=lambda lag: _difference(thinned, lag))
    near = range(max(best - coarse, 1), min(best + coarse, len(speed) - 1) + 1)
    lag = min(near, key=lambda lag: _difference(speed, lag))
    return lag if _difference(speed, lag) < settings.max_period_difference else 0


def _difference(speed: Array, lag: int) -> float:
    """Squares of the difference between a motion and itself ``lag`` later, over its own squares."""
    later, earlier = speed[lag:], speed[:-lag]
    whole = float((later**2).sum() + (earlier**2).sum())
    return float(((later - earlier) ** 2).sum()) / whole if whole > 0 else 1.0
