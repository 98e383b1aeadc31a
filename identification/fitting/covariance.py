"""Covariance of a least-squares estimate whose residuals are correlated in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

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

    Newey and West (Econometrica 55(3), 1987): the long-run covariance of the scores by Bartlett
    weights, multiplied from both sides by the inverse information matrix. The scores are
    prewhitened: because of the filter's memory, a plain window would make standard deviations a
    tenth too small.

    Where the spread of the scores between long stretches (a sandwich over clusters: Liang and
    Zeger, Biometrika 73(1), 1986) is larger than chance makes it, it is the variance. What a model
    lacks, and an offset that wanders, acts for as long as a motion lasts, and no short memory tells
    of it.

    Parameters
    ----------
    residuals, columns : per log (n, A) and (n, A, F)
    steps : per log, from one row to the next [s]
    basis : (F, Q) directions of the scaled parameters that data can see
    scale : (F,) factors from the parameters to numbers of one size
    """
    directions = scale[:, None] * basis
    # Unit length: one cut-off of the pseudo-inverse then has the same meaning for each direction.
    directions = directions / np.linalg.norm(directions, axis=0)
    size = directions.shape[1]
    information, middle = np.zeros((size, size)), np.zeros((size, size))
    stretches: list[Array] = []
    count = 0
    for residual, column, step in zip(residuals, columns, steps, strict=True):
        scaled = (column / scale) @ directions
        # All logs are summed: their noise is independent, so scores of different logs do not
        # correlate.
        information += np.einsum("nap,naq->pq", scaled, scaled)
        scores = innovation_scores(residual, scaled, settings.max_residual_memory)
        lags = automatic_lags(scores, settings.max_score_memory)
        # The plug-in assumes AR(1) scores. The lower bound covers slower errors that AR(1) does not
        # show.
        middle += long_run(scores, max(lags, round(settings.min_correlation_time / step)))
        stretches += sums_of_stretches(residual, scaled, step, settings.stretch_time)
        count += residual.size
    rounding = settings.min_information_share
    inverse = np.linalg.pinv(information, rcond=rounding, hermitian=True)
    # n/(n - Q): fitted residuals are smaller than the true errors, as in s^2 of ordinary least
    # squares.
    covariance = inverse @ middle @ inverse * count / max(count - size, 1)
    to_theta = directions / scale[:, None]
    found = to_theta @ covariance @ to_theta.T
    if len(stretches) < settings.min_stretches:
        return found
    spread = to_theta @ inverse @ _spread(stretches) @ inverse @ to_theta.T
    degrees = len(stretches) - 1
    return _raised(found, spread, chdtri(degrees, settings.stretch_level) / degrees)


def sums_of_stretches(residual: Array, columns: Array, step: float, length: float) -> list[Array]:
    """Score (P,) of each stretch of about ``length`` [s] in a log, rows ``step`` [s] apart."""
    scores = np.einsum("na,nap->np", residual, columns)
    count = max(1, round(len(scores) * step / length))
    return [part.sum(axis=0) for part in np.array_split(scores, count)]


def _spread(stretches: Sequence[Array]) -> Array:
    """Sum (P, P) of the squares of the stretches' scores, which add up to zero at the minimum."""
    scores = np.array(stretches)
    return scores.T @ scores * len(scores) / (len(scores) - 1)


def _raised(covariance: Array, other: Array, chance: float) -> Array:
    """The covariance (F, F), with the variances of another that are more than ``chance`` times as
    large. Correlations are kept."""
    variance = np.diag(covariance)
    ratio = np.diag(other) / np.where(variance > 0, variance, np.inf)
    factor = np.sqrt(np.where(ratio > max(chance, 1.0), ratio, 1.0))
    return covariance * np.outer(factor, factor)


def innovation_scores(residual: Array, columns: Array, most: float) -> Array:
    """Scores (n, P) with the same sum as residual * column, without the residual's AR(1) memory.

    residual (n, A), columns (n, A, P). Prewhitening of Andrews and Monahan (Econometrica 60(4),
    1992), applied to the columns: with the innovations e = A r, X' r = (A^-T X)' e. ``most``:
    upper bound of the memory.
    """
    total = np.zeros((len(columns), columns.shape[2]))
    # Each axis has its own AR(1) coefficient.
    for axis in range(residual.shape[1]):
        r = residual[:, axis]
        memory = float(np.clip(r[1:] @ r[:-1] / max(r @ r, 1e-300), 0.0, most))
        innovation = r - memory * np.concatenate([[0.0], r[:-1]])
        # A^-T: the AR(1) recursion, run backwards in time. [:0:-1] restores the order of time and
        # drops the initial zero of accumulate.
        carried = accumulate(columns[::-1, axis], memory)[:0:-1]
        total += innovation[:, None] * carried
    return total


def automatic_lags(scores: Array, most: float) -> int:
    """Bartlett bandwidth [rows] by Andrews' AR(1) plug-in (Econometrica 59(3), 1991, eq. 6.4).

    ``most``: bound of the AR(1) coefficient's size.
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
    # Bartlett weights keep the sum positive semidefinite. Each lag counts in both directions.
    for lag in range(1, min(lags, len(scores) - 1)):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / lags) * (cross + cross.T)
    return total
