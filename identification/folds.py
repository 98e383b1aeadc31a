"""Held-out judgement of linear(ised) models from normal equations, one log left out at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.regression import Rows

Array = NDArray[np.float64]

BLOCKS = 5
"""Contiguous blocks that a single log is cut into, so that something can be held out."""

BLOCK_TIME = 2.0
"""Length [s] of the stretches that bootstrap and standard errors treat as independent: 20/a_f."""


@dataclass(frozen=True)
class Fold:
    """What is held out together: a stretch of one log, by row numbers and by time [s]."""

    log: int
    rows: slice
    start: float
    end: float


def make_folds(rows: Sequence[Rows]) -> list[Fold]:
    """One fold a log; one log alone gives five blocks."""
    if len(rows) > 1:
        return [Fold(k, slice(0, len(r.time)), 0.0, float(r.time[-1])) for k, r in enumerate(rows)]
    time = rows[0].time
    edges = np.linspace(0, len(time), BLOCKS + 1).astype(int)
    return [
        Fold(0, slice(int(a), int(b)), float(time[a]) if a else 0.0, float(time[b - 1]))
        for a, b in zip(edges, edges[1:], strict=False)
    ]


@dataclass(frozen=True)
class HeldOut:
    """A linear model judged on what it was not fitted on.

    residual : per fold (n, A), held out
    steps : (folds, F) parameter steps from the rows' theta, each without its fold
    step : (F,) with all rows
    """

    residual: tuple[Array, ...]
    steps: Array
    step: Array

    @property
    def square(self) -> float:
        """Sum of squared held-out residuals."""
        return float(sum((r**2).sum() for r in self.residual))


def held_out(
    residual: Sequence[Array], columns: Sequence[Array], folds: Sequence[Fold], basis: Array
) -> HeldOut:
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
    total, side = grams.sum(axis=0), sides.sum(axis=0)
    everything = _solve(total, side)
    steps = np.stack(
        [_solve(total - gram, side - part) for gram, part in zip(grams, sides, strict=True)]
    )
    axes = residual[0].shape[1]
    left = tuple(
        (r - c @ step).reshape(-1, axes) for r, c, step in zip(right, seen, steps, strict=True)
    )
    return HeldOut(left, steps @ basis.T, basis @ everything)


def _solve(gram: Array, side: Array) -> Array:
    """Least squares from normal equations; directions that a fold cannot see stay at zero."""
    norm = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / np.outer(norm, norm)
    return np.linalg.pinv(scaled, rcond=1e-10, hermitian=True) @ (side / norm) / norm


def block_sums(values: Array, step: float) -> Array:
    """Sums (blocks, ...) of values (n, ...) over BLOCK_TIME; the last block may be shorter."""
    size = max(1, round(BLOCK_TIME / step))
    return np.add.reduceat(values, np.arange(0, len(values), size), axis=0)
