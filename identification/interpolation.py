"""Local cubic interpolation, for samples that are missing or off the grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SIDE = 4


def interpolate_at(
    at: NDArray[np.float64], time: NDArray[np.float64], data: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cubic through the four samples around each instant.

    Parameters
    ----------
    at : (m,) instants within the range of time [s]
    time : (n,) increasing, n >= 4 [s]
    data : (n, k)

    Returns
    -------
    (m, k), NaN wherever one of the four samples is NaN and has a weight.
    """
    first = np.clip(np.searchsorted(time, at, side="right") - 2, 0, len(time) - 4)
    nodes = time[first[:, None] + np.arange(4)]
    result = np.zeros((len(at), data.shape[1]))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod([(at - nodes[:, j]) / (nodes[:, i] - nodes[:, j]) for j in others], axis=0)
        contribution = weight[:, None] * data[first + i]
        result += np.where(weight[:, None] == 0, 0, contribution)
    return result


def bridge(signal: NDArray[np.float64], start: int, stop: int) -> None:
    """Replace signal[start:stop] (n,) in place by a cubic fitted to the samples around it.

    The least-squares fit takes up to four finite samples a side, which averages their noise and
    leaves no kink; with fewer than four it is a straight line.
    """
    before = np.arange(max(start - 3 * _SIDE, 0), start)
    after = np.arange(stop, min(stop + 3 * _SIDE, len(signal)))
    before = before[np.isfinite(signal[before])][-_SIDE:]
    after = after[np.isfinite(signal[after])][:_SIDE]
    around = np.r_[before, after]
    degree = 3 if min(before.size, after.size) >= 2 else 1 if around.size >= 2 else 0
    centre, scale = (start + stop - 1) / 2, float(np.ptp(around)) or 1.0
    powers = np.arange(degree + 1)
    basis = ((around - centre) / scale)[:, None] ** powers
    weights = np.linalg.lstsq(basis, signal[around], rcond=None)[0]
    wanted = (np.arange(start, stop) - centre) / scale
    signal[start:stop] = (wanted[:, None] ** powers) @ weights


def runs_of(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges (start, stop) in which a mask (n,) holds."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
