"""Covariance of a least-squares estimate whose residuals are correlated in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import FitSettings
from identification.signals.filters import accumulate

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def hac_covariance(
    residuals: Sequence[Array],
    columns: Sequence[Array],
    steps: Sequence[float],
    basis: Array,
    scale: Array,
    settings: FitSettings = FitSettings(),
) -> Array:
    """Covariance (F, F) of a least-squares estimate whose residuals are correlated in time.

    Newey and West (Econometrica 55(3), 1987): the scores' long-run covariance by Bartlett weights,
    between the inverses of the information matrix; prewhitened, since the filter's memory alone
    would cost a plain window a tenth of the standard deviation.

    Parameters
    ----------
    residuals, columns : per log (n, A) and (n, A, F)
    steps : per log, from one row to the next [s]
    basis : (F, Q) directions of the scaled parameters that data can see
    scale : (F,) factors from the parameters to numbers of one size
    """
    directions = scale[:, None] * basis
    # Of unit length, so that the cut-off of the pseudo-inverse means the same for each.
    directions = directions / np.linalg.norm(directions, axis=0)
    size = directions.shape[1]
    information, middle = np.zeros((size, size)), np.zeros((size, size))
    count = 0
    for residual, column, step in zip(residuals, columns, steps, strict=True):
        scaled = (column / scale) @ directions
        information += np.einsum("nap,naq->pq", scaled, scaled)
        scores = innovation_scores(residual, scaled, settings.max_residual_memory)
        lags = automatic_lags(scores, settings.max_score_memory)
        middle += long_run(scores, max(lags, round(settings.min_correlation_time / step)))
        count += residual.size
    rounding = settings.min_information_share
    inverse = np.linalg.pinv(information, rcond=rounding, hermitian=True)
    # A fit makes its own residuals too small: the usual correction for its parameters.
    covariance = inverse @ middle @ inverse * count / max(count - size, 1)
    to_theta = directions / scale[:, None]
    return to_theta @ covariance @ to_theta.T


def innovation_scores(residual: Array, columns: Array, most: float) -> Array:
    """Scores (n, P) that sum up as residual * column does, without the residual's AR(1) memory.

    residual (n, A), columns (n, A, P). Prewhitening of Andrews and Monahan (Econometrica 60(4),
    1992), moved to the columns: with the innovations e = A r, X' r = (A^-T X)' e. ``most``: bound
    of the memory.
    """
    total = np.zeros((len(columns), columns.shape[2]))
    # Each axis has a memory of its own.
    for axis in range(residual.shape[1]):
        r = residual[:, axis]
        memory = float(np.clip(r[1:] @ r[:-1] / max(r @ r, 1e-300), 0.0, most))
        innovation = r - memory * np.concatenate([[0.0], r[:-1]])
        # Backwards in time: an innovation acts on all later rows through the memory.
        carried = accumulate(columns[::-1, axis], memory)[:0:-1]
        total += innovation[:, None] * carried
    return total


def automatic_lags(scores: Array, most: float) -> int:
    """Bartlett bandwidth [rows] by Andrews' AR(1) plug-in (Econometrica 59(3), 1991, eq. 6.4).

    ``most``: bound of the memory, either side of zero.
    """
    power = np.maximum((scores**2).sum(axis=0), 1e-300)
    memory = np.clip((scores[1:] * scores[:-1]).sum(axis=0) / power, -most, most)
    noise = ((scores[1:] - memory * scores[:-1]) ** 2).mean(axis=0)
    bend = (4 * memory**2 * noise**2 / ((1 - memory) ** 6 * (1 + memory) ** 2)).sum()
    level = (noise**2 / (1 - memory) ** 4).sum()
    # 1.1447 is the constant of Bartlett's kernel.
    return max(1, int(np.ceil(1.1447 * (bend / max(level, 1e-300) * len(scores)) ** (1 / 3))))


def long_run(scores: Array, lags: int) -> Array:
    """Sum (P, P) of the scores' (n, P) autocovariances under Bartlett weights."""
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1)):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / lags) * (cross + cross.T)
    return total
