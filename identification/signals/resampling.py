"""Sampled signals between and around their samples: moved in time, and smoothed for their rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def smoothed(signal: Array, sigma: float) -> Array:
    """Gaussian mean (N,) of a signal, in samples, without a phase; straight on at its ends."""
    reach = min(int(np.ceil(4 * sigma)), len(signal) - 1)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    # Reflected through its end point a signal keeps its value and slope there. The numbers of
    # np.pad's odd reflection, which takes longer than the mean itself.
    before = 2 * signal[:1] - signal[reach:0:-1]
    behind = 2 * signal[-1:] - signal[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, signal, behind])
    return np.asarray(np.convolve(padded, weight / weight.sum(), mode="valid"), np.float64)


def low_passed(signal: Array, cutoff: float, dt: float) -> Array:
    """A signal (N, ...) without what is faster than ``cutoff`` [Hz], and without a phase.

    The gain is that of a Butterworth filter of order 3 run forwards and backwards, taken from the
    spectrum; at its ends the signal goes straight on.
    """
    reach = min(round(2.0 / (cutoff * dt)), len(signal) - 1)
    width = [(reach, reach)] + [(0, 0)] * (signal.ndim - 1)
    padded = np.pad(signal, width, mode="reflect", reflect_type="odd")
    size = _quick_length(len(padded))
    # What fills up to a quick length leads from the end back to the start: a Fourier sum is
    # periodic, and a leap would ring.
    across = [-1] + [1] * (signal.ndim - 1)
    share = np.linspace(0.0, 1.0, size - len(padded) + 2)[1:-1].reshape(across)
    filled = np.concatenate([padded, (1 - share) * padded[-1] + share * padded[0]])
    gain = 1.0 / (1.0 + (np.fft.rfftfreq(size, dt) / cutoff) ** 6)
    spectrum = np.fft.rfft(filled, axis=0) * gain.reshape(across)
    return np.fft.irfft(spectrum, size, axis=0)[reach : reach + len(signal)]


def _quick_length(least: int) -> int:
    """A length of a Fourier transform that has small factors only."""
    power = 2 ** int(np.ceil(np.log2(max(least, 8))))
    return next(size for size in (power * 5 // 8, power * 3 // 4, power) if size >= least)


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
