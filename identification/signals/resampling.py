"""Sampled signals between and around their samples: moved in time, and smoothed for their rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def smoothed(signal: Array, sigma: float) -> Array:
    """Gaussian mean (N,) of a signal, in samples, without a phase; straight on at its ends."""
    reach = min(int(np.ceil(4 * sigma)), len(signal) - 1)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    # Reflected through its end point a signal keeps its value and slope there.
    padded = np.pad(signal, reach, mode="reflect", reflect_type="odd")
    return np.asarray(np.convolve(padded, weight / weight.sum(), mode="valid"), np.float64)


def moved(ends: Array, shift: float) -> Array:
    """Values (2, N - 1, A) at both ends of each interval, ``shift`` intervals later; ends held.

    Cubic (Keys, IEEE Trans. ASSP 29(6), 1981), since a line between samples would attenuate the
    force by (omega dt)^2/8; smooth in the shift, so that a search can follow it.
    """
    if shift == 0.0:
        return ends
    whole = int(np.floor(shift))
    x = shift - whole
    weights = (
        0.5 * x * (-1 + x * (2 - x)),
        1 + 0.5 * x * x * (3 * x - 5),
        0.5 * x * (1 + x * (4 - 3 * x)),
        0.5 * x * x * (x - 1),
    )
    last = ends.shape[1] - 1
    at = np.arange(last + 1) + whole
    return sum(
        (w * ends[:, np.clip(at + k, 0, last)] for k, w in enumerate(weights, -1)),
        start=np.zeros_like(ends),
    )
