"""Cross-validation of linear(ised) models by normal equations, one log left out at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.fitting.regression import Regression
from identification.fitting.settings import FitSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fold:
    """Rows of one log that are held out together: by row numbers and by time [s].

    whole : the fold is the whole log
    """

    log: int
    rows: slice
    start: float
    end: float
    whole: bool


def make_folds(
    rows: Sequence[Regression], columns: Sequence[Array] = (), settings: FitSettings = FitSettings()
) -> list[Fold]:
    """One fold a log; a log that alone shows some column of the model gives several blocks.

    Example: only the longest log lasts until a load is put on. If all of it were held out, no other
    log could determine the load, and the load would seem to explain nothing. Columns together are
    asked too: drives that get warm are seen in the first log, and in the others all torques are
    less alike, as if all masses were more.

    Parameters
    ----------
    columns : per log (n, A, F) of the model that is to be judged
    """
    lonely = {0} if len(rows) == 1 else _lonely(columns, settings)
    folds = []
    for k, row in enumerate(rows):
        blocks = settings.blocks_of_single_log if k in lonely else 1
        edges = np.linspace(0, len(row.time), blocks + 1).astype(int)
        for a, b in zip(edges.tolist(), edges[1:].tolist(), strict=False):
            # The first block starts with the log: the rows' first time lies behind the filter's
            # settling.
            start = float(row.time[a]) if a else 0.0
            folds.append(Fold(k, slice(a, b), start, float(row.time[b - 1]), blocks == 1))
    return folds


def _lonely(columns: Sequence[Array], settings: FitSettings) -> set[int]:
    """Logs that hold more than a share of the squares of some column, or combination of columns."""
    if not columns:
        return set()
    flat = [part.reshape(-1, part.shape[-1]) for part in columns]
    grams = np.stack([part.T @ part for part in flat])
    total = grams.sum(axis=0)
    squares = np.diagonal(grams, axis1=1, axis2=2)
    alone = squares > settings.min_lone_share * np.diag(total)
    most = _largest_shares(grams, total, settings.min_held_out_share)
    together = most > settings.min_lone_share_of_combination
    return {int(k) for k in np.nonzero(alone.any(axis=1) | together)[0]}


def _largest_shares(grams: Array, total: Array, rounding: float) -> Array:
    """(K,) of each log the largest share, over combinations of columns, of their squares.

    ``grams`` (K, F, F), ``total`` their sum; ``rounding``: see `_solve`.
    """
    norm = np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(total / np.outer(norm, norm))
    seen = values > rounding * values.max()
    # Combinations whose squares over all logs are one, and nothing two by two.
    frame = vectors[:, seen] / np.sqrt(values[seen]) / norm[:, None]
    return np.array([np.linalg.eigvalsh(frame.T @ gram @ frame)[-1] for gram in grams])


@dataclass(frozen=True)
class CrossValidation:
    """A linear model judged on what it was not fitted on.

    folds : what was held out, in turn
    residual : per fold (n, A), held out
    steps : (folds, F) parameter steps from the rows' theta, each without its fold
    step : (F,) with all rows
    square : sum of the squared held-out residuals
    """

    folds: tuple[Fold, ...]
    residual: tuple[Array, ...]
    steps: Array
    step: Array
    square: float


def cross_validate(
    residual: Sequence[Array],
    columns: Sequence[Array],
    folds: Sequence[Fold],
    basis: Array,
    settings: FitSettings = FitSettings(),
) -> CrossValidation:
    """Fit without each fold in turn, by normal equations.

    Parameters
    ----------
    residual, columns : per log (n, A) and (n, A, F)
    basis : (F, Q) directions of the parameters that data can see, in any scale
    """
    seen = [
        np.ascontiguousarray(columns[fold.log][fold.rows]).reshape(-1, columns[0].shape[-1]) @ basis
        for fold in folds
    ]
    right = [residual[fold.log][fold.rows].ravel() for fold in folds]
    grams = np.stack([c.T @ c for c in seen])
    sides = np.stack([c.T @ r for c, r in zip(seen, right, strict=True)])
    # Normal equations add up over rows, so a fold is left out by a subtraction.
    total, side = grams.sum(axis=0), sides.sum(axis=0)
    rest = np.concatenate([total - grams, total[None]]), np.concatenate([side - sides, side[None]])
    *steps, everything = _solve(*rest, settings.min_held_out_share)
    axes = residual[0].shape[1]
    left = tuple(
        (r - c @ step).reshape(-1, axes) for r, c, step in zip(right, seen, steps, strict=True)
    )
    square = float(sum((r**2).sum() for r in left))
    return CrossValidation(
        tuple(folds), left, np.stack(steps) @ basis.T, basis @ everything, square
    )


def _solve(grams: Array, sides: Array, rounding: float) -> Array:
    """(K, F) least squares from K normal equations; directions that are not seen stay at zero.

    Parameters
    ----------
    grams, sides : (K, F, F) and (K, F)
    rounding : share of the largest eigenvalue under which a direction is not seen
    """
    norm = np.sqrt(np.maximum(np.diagonal(grams, axis1=1, axis2=2), 1e-300))
    # Scaled to a unit diagonal: the cut-off must not depend on the units of the parameters.
    scaled = grams / (norm[:, :, None] * norm[:, None, :])
    inverse = np.linalg.pinv(scaled, rcond=rounding, hermitian=True)
    return (inverse @ (sides / norm)[..., None])[..., 0] / norm


def block_sums(values: Array, step: float, length: float) -> Array:
    """Sums (blocks, ...) of values (n, ...), rows ``step`` apart, over ``length`` [s] each.

    The last block may be shorter.
    """
    size = rows_per_block(length, step)
    return np.add.reduceat(values, np.arange(0, len(values), size), axis=0)


def rows_per_block(length: float, step: float) -> int:
    """Rows, ``step`` [s] apart, in a block of some length [s]."""
    return max(1, round(length / step))
