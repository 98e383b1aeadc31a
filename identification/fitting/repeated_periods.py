"""Noise without a model: what does not repeat from one period of a motion to the next.

A motion that repeats asks the same force in each period, and whatever a model misses of it repeats
too. The difference between two periods holds the noise twice, of whatever colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import PredictabilitySettings
from identification.signals.filters import pieces

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
            later, earlier = of_part[lag:], of_part[:-lag]
            # Half: each difference holds the noise of two periods.
            for some in pieces(len(later)):
                total += 0.5 * ((later[some] - earlier[some]) ** 2).sum(axis=0)
            count += len(later)
    return total, count


def _period(speed: Array, step: float, settings: PredictabilitySettings) -> int:
    """Samples of the period of a motion (n, A); 0 where it does not repeat."""
    # Lags are searched on rows that are this coarse, then between them.
    coarse = max(1, round(settings.period_search_step / step))
    thinned = speed[::coarse]
    least = round(settings.min_period / step / coarse)
    lags = range(least, len(thinned) // 2)
    if not lags or not thinned.any():
        return 0
    # The least difference at lags of equal differences, to rounding, is looked for among these.
    nearly = _all_differences(thinned)[least : len(thinned) // 2]
    among = least + np.flatnonzero(nearly <= nearly.min() + 1e-9)
    lag = min(among.tolist(), key=lambda lag: _difference(thinned, lag))
    # Between coarse lags the root of the difference falls by no more than from one to the next.
    within = np.sqrt(_difference(thinned, lag)) - np.sqrt(_difference(thinned, 1))
    if within > np.sqrt(settings.max_period_difference):
        return 0
    best = coarse * lag
    near = range(max(best - coarse, 1), min(best + coarse, len(speed) - 1) + 1)
    lag = min(near, key=lambda lag: _difference(speed, lag))
    return lag if _difference(speed, lag) < settings.max_period_difference else 0


def _all_differences(speed: Array) -> Array:
    """(n,) :func:`_difference` at each lag, to rounding: by Fourier transforms, not one by one."""
    squares = np.concatenate([[0.0], np.cumsum((speed**2).sum(axis=1))])
    power = np.abs(np.fft.rfft(speed, 2 * len(speed), axis=0)) ** 2
    products = np.fft.irfft(power.sum(axis=1), 2 * len(speed))[: len(speed)]
    # What the later and the earlier ones of all pairs hold; of next to nothing no share is known.
    whole = squares[-1] - squares[:-1] + squares[:0:-1]
    share = np.zeros(len(speed))
    return 1.0 - np.divide(2.0 * products, whole, out=share, where=whole > 1e-9 * squares[-1])


def _difference(speed: Array, lag: int) -> float:
    """Squares of the difference between a motion and itself ``lag`` later, over its own squares."""
    later, earlier = speed[lag:], speed[:-lag]
    apart = whole = 0.0
    for some in pieces(len(later)):
        whole += float((later[some] ** 2).sum() + (earlier[some] ** 2).sum())
        apart += float(((later[some] - earlier[some]) ** 2).sum())
    return apart / whole if whole > 0 else 1.0
