"""Noise without a model: what does not repeat from one period of a motion to the next.

A motion that repeats asks the same force in each period, and whatever a model misses of it repeats
too. The difference between two periods holds the noise twice, of whatever colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import PredictabilitySettings
from identification.signals.filters import add_up_from, pieces

Array = NDArray[np.float64]


def repeated_noise(
    time: Array,
    speed: Array,
    forces: tuple[Array, Array],
    parts: Sequence[tuple[float, float]],
    settings: PredictabilitySettings,
) -> tuple[Array, int]:
    """Sum of squares (A,) of the noise in a residual, and the number of differences behind it.

    Parameters
    ----------
    time : (n,) uniform [s]; speed : (n, A) of the motion
    forces : (n, A) each, measured and predicted: their difference is the residual
    parts : stretches [s] in which a motion may repeat
    """
    (measured, predicted), step = forces, float(time[1] - time[0])
    total, count = np.zeros(speed.shape[1]), 0
    for start, end in parts:
        first, last = np.searchsorted(time, [start, end]).tolist()
        lag, earlier = _period(speed[first:last], step, settings)
        if lag:
            at = first + earlier.start
            rows = earlier.stop - earlier.start
            for some in pieces(rows):
                begin, end = at + some.start, at + some.stop
                before, later = (
                    measured[begin + late : end + late] - predicted[begin + late : end + late]
                    for late in (0, lag)
                )
                # Half: each difference holds the noise of two periods.
                total += 0.5 * ((later - before) ** 2).sum(axis=0)
            count += rows
    return total, count


def _period(speed: Array, step: float, settings: PredictabilitySettings) -> tuple[int, slice]:
    """Samples of the period of a motion (n, A), and the rows that come again so much later.

    The period is 0 where the motion does not repeat.
    """
    # Lags are searched on rows that are this coarse, then between them.
    coarse = max(1, round(settings.period_search_step / step))
    thinned = speed[::coarse]
    least = round(settings.min_period / step / coarse)
    lags = range(least, len(thinned) // 2)
    if not lags or not thinned.any():
        return 0, slice(0, 0)
    # The least difference at lags of equal differences, to rounding, is looked for among these.
    nearly = _all_differences(thinned)[least : len(thinned) // 2]
    among = least + np.flatnonzero(nearly <= nearly.min() + 1e-9)
    lag = min(among.tolist(), key=lambda lag: _difference(thinned, lag))
    # Between coarse lags the root of the difference falls by no more than from one to the next.
    most = settings.max_period_difference
    within = (np.sqrt(_difference(thinned, 1)) + np.sqrt(most)) ** 2
    nearly = _repeated_rows(thinned, lag, within, least)
    best, rows = coarse * lag, slice(coarse * nearly.start, coarse * nearly.stop)
    near = range(max(best - coarse, 1), min(best + coarse, len(speed) - 1) + 1)
    lag = min(near, key=lambda lag: _difference(speed, lag, rows))
    # Noise of the speeds is not even: what is too much is judged over the whole stretch.
    rows = _repeated_rows(speed, lag, 2.0 * most, round(settings.min_period / step))
    return (lag, rows) if _difference(speed, lag, rows) < most else (0, slice(0, 0))


def _repeated_rows(speed: Array, lag: int, within: float, width: int) -> slice:
    """The longest stretch of rows that differ little from those ``lag`` later; empty if none do.

    A motion that repeats has a start and an end that do not: ramps, a wait.

    Parameters
    ----------
    within : largest difference, as a share of the motion's squares, over ``width`` rows
    """
    if len(speed) - lag < width:
        return slice(0, 0)
    square = np.concatenate([(speed[some] ** 2).sum(axis=1) for some in pieces(len(speed))])
    later, before, usual = speed[lag:], speed[:-lag], 2.0 * float(square.mean())
    # How much more than allowed each row differs, summed from the first row on.
    excess = np.zeros(len(later) + 1)
    for some in pieces(len(later)):
        difference = ((later[some] - before[some]) ** 2).sum(axis=1)
        # A short rest within the motion has no squares of its own: it is judged by the whole
        # motion's.
        allowed = within * np.maximum(square[lag:][some] + square[:-lag][some], usual)
        add_up_from(excess, some.start, difference - allowed)
    fits = excess[width:] <= excess[:-width]
    changes = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    if not len(changes):
        return slice(0, 0)
    starts, stops = changes[::2], changes[1::2] + width - 1
    longest = int((stops - starts).argmax())
    # Two stretches may resemble each other by chance; half of a period does not.
    few = stops[longest] - starts[longest] < lag / 2
    return slice(0, 0) if few else slice(int(starts[longest]), int(stops[longest]))


def _all_differences(speed: Array) -> Array:
    """(n,) :func:`_difference` at each lag, to rounding: by Fourier transforms, not one by one."""
    squares = np.concatenate([[0.0], np.cumsum((speed**2).sum(axis=1))])
    power = np.abs(np.fft.rfft(speed, 2 * len(speed), axis=0)) ** 2
    products = np.fft.irfft(power.sum(axis=1), 2 * len(speed))[: len(speed)]
    # What the later and the earlier ones of all pairs hold; of next to nothing no share is known.
    whole = squares[-1] - squares[:-1] + squares[:0:-1]
    share = np.zeros(len(speed))
    return 1.0 - np.divide(2.0 * products, whole, out=share, where=whole > 1e-9 * squares[-1])


def _difference(speed: Array, lag: int, earlier: slice = slice(None)) -> float:
    """Squares of the difference between a motion and itself ``lag`` later, over its own squares."""
    later, before = speed[lag:][earlier], speed[:-lag][earlier]
    apart = whole = 0.0
    for some in pieces(len(later)):
        whole += float((later[some] ** 2).sum() + (before[some] ** 2).sum())
        apart += float(((later[some] - before[some]) ** 2).sum())
    return apart / whole if whole > 0 else 1.0
