"""White measurement noise of a log's channels."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

ORDER = 6
"""Differences of order 6 pass a motion of 3 Hz sampled at 50 Hz with a gain below 1e-4."""


ENOUGH = 20_000
"""Samples after which a statistic of a long log is settled to better than 2 %."""


def white_noise(
    signal: NDArray[np.float64], valid: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Standard deviation (k,) of white noise in the channels (n, k), from differences of order 6.

    Parameters
    ----------
    signal : (n, k) uniformly sampled, n > 6
    valid : (n,) samples to take; differences that touch another are left out

    Notes
    -----
    A difference of order p of white noise has the variance C(2p, p) sigma^2, and a smooth signal
    hardly enters it. The largest differences (beyond four deviations by the median) are left
    out, so steps, spikes and contacts do not count. What is not white is not noise here, and what
    a sensor adds at high frequency (the ripple of rollers, the beat of an encoder) counts
    as noise.
    """
    starts = thinned(np.arange(len(signal) - ORDER))
    if valid is not None and not valid.all():
        touched = np.r_[0, np.cumsum(~valid)]
        whole = starts[touched[starts + ORDER + 1] == touched[starts]]
        starts = whole if whole.size > 10 * ORDER else starts
    weights = [(-1) ** i * comb(ORDER, i) for i in range(ORDER + 1)]
    differences = np.zeros((len(starts), signal.shape[1]))
    for i, weight in enumerate(weights):
        differences += weight * signal[starts + i]
    scale = 1.4826 * np.median(np.abs(differences), axis=0)
    usual = (np.abs(differences) <= 4 * scale) | (scale == 0)
    mean_square = (differences**2).sum(axis=0, where=usual) / usual.sum(axis=0)
    return np.sqrt(mean_square / comb(2 * ORDER, ORDER))


def thinned(samples: NDArray) -> NDArray:
    """Every so many of the samples (n,), for a statistic to which some ten thousand suffice."""
    return samples[:: max(len(samples) // ENOUGH, 1)]
