"""Batch least squares on filtered forces, with standard deviations for correlated residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.covariance import hac_covariance
from identification.fitting.regression_rows import Indices, Rows, regression_rows
from identification.mechanisms.mechanism import Mechanism, Samples
from youbot_env.errors import InputError

Array = NDArray[np.float64]

ARRIVED = 1e-9
"""Squares that the last Gauss-Newton step moves, over the residual's: with 10^4 rows that is some
thousandths of a standard deviation."""

MOST_STEPS, PATIENCE, STALLED = 30, 4, 1e-5
"""Gauss-Newton steps at most, and without a fall of the squares by more than a share of STALLED.

Where the data hardly show a parameter (a breakaway peak that is not there, the place of a load
without mass) it wanders about, and the best that it has passed is kept."""

BLOWN_UP = 100.0
"""Squares over the least so far from which on a step has gone too far: it is halved."""

HUBER = 1.345
"""Huber's threshold in robust standard deviations: 95 % efficient on clean Gaussian residuals."""


@dataclass(frozen=True)
class Fit:
    """Result of a least-squares fit.

    theta (P,): all parameters, shape constants included; free (F,): indices of the fitted ones;
    covariance (F, F): true for correlated residuals; rows: residual and columns at theta, per log;
    bounded: indices of parameters that stopped at a physical bound.
    """

    theta: Array
    free: Indices
    covariance: Array
    rows: tuple[Rows, ...]
    bounded: tuple[int, ...] = ()

    @property
    def std(self) -> Array:
        """(F,) standard deviations of the free parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def square(self) -> float:
        """Sum of the squared residuals of all rows."""
        return float(sum((row.residual**2).sum() for row in self.rows))


def fit(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    start: Array,
    *,
    free: NDArray[np.bool_] | None = None,
    first: Sequence[Rows] | None = None,
    robust: bool = False,
    progress: Callable[[], None] = lambda: None,
) -> Fit:
    """Fit the free parameters; the others stay at their values in ``start``.

    Gauss-Newton on the filtered force residual: one step where the model is linear.

    Parameters
    ----------
    start : (P,) theta to start from
    free : (P,) which parameters are fitted; by default all but shape constants
    first : the logs' regression rows at ``start``, where they are at hand already
    robust : Huber weights on rows, for logs with outliers

    Raises
    ------
    InputError
        If the logs are too short for the filter to settle, or nothing can be fitted.
    """
    mask = mechanism.free if free is None else free
    chosen = np.flatnonzero(mask)
    basis = gauge_basis(mechanism, chosen)
    theta = np.array(start, float)
    linear = mechanism.is_linear and np.array_equal(mask, mechanism.free)
    bounded: tuple[int, ...] = ()
    rows = first or [regression_rows(mechanism, theta, samples, chosen) for samples in logs]
    lowest, waited, kept = np.inf, 0, (theta, rows, bounded)
    for _ in range(MOST_STEPS):
        progress()
        if sum(len(row.residual) for row in rows) < 2 * len(chosen):
            raise InputError("the logs are too short to fit a model: record some 20 s of motion")
        weights = _weights(rows, robust)
        square = _squares(rows, weights)
        waited = 0 if square < (1 - STALLED) * lowest else waited + 1
        if square < lowest:
            lowest, kept = square, (theta.copy(), rows, bounded)
        if waited > PATIENCE:
            break
        if not square < BLOWN_UP * lowest:
            theta = 0.5 * (theta + kept[0])
            rows = [regression_rows(mechanism, theta, samples, chosen) for samples in logs]
            continue
        step, bounded = solve_step(mechanism, rows, weights, theta, chosen, basis)
        theta[chosen] += step
        arrived = _explains(rows, weights, step) < ARRIVED * square
        if linear or arrived:
            rows = [replace(r, residual=r.residual - r.columns @ step) for r in rows]
        else:
            rows = [regression_rows(mechanism, theta, samples, chosen) for samples in logs]
        if arrived or (linear and not robust):
            kept = theta, rows, bounded
            break
    theta, rows, bounded = kept
    weights = _weights(rows, robust)
    # A robust fit's rows are weighted, so that its covariance is that of the weighted estimate.
    weighted = [_weighted(row, weight) for row, weight in zip(rows, weights, strict=True)]
    covariance = hac_covariance(weighted, basis, mechanism.scale[chosen])
    return Fit(theta, chosen, covariance, tuple(rows), bounded)


def _weights(rows: Sequence[Rows], robust: bool) -> list[Array]:
    return huber_weights(rows) if robust else [np.ones(len(row.residual)) for row in rows]


def _explains(rows: Sequence[Rows], weights: Sequence[Array], step: Array) -> float:
    """Squares that a step moves the prediction by."""
    moved = ((row.columns @ step) ** 2 for row in rows)
    return float(sum(w @ part.sum(axis=1) for w, part in zip(weights, moved, strict=True)))


def _squares(rows: Sequence[Rows], weights: Sequence[Array]) -> float:
    squares = ((row.residual**2).sum(axis=1) for row in rows)
    return float(sum(w @ part for w, part in zip(weights, squares, strict=True)))


def _weighted(rows: Rows, weight: Array) -> Rows:
    root = np.sqrt(weight)
    return replace(
        rows, residual=rows.residual * root[:, None], columns=rows.columns * root[:, None, None]
    )


def gauge_groups(mechanism: Mechanism, free: Indices | None = None) -> list[Indices]:
    """Places among the parameters ``free`` of those that are relative to each other, by group."""
    labels = [mechanism.labels[k] for k in _chosen(mechanism, free)]
    groups = dict.fromkeys(label.group for label in labels if label.group)
    return [
        np.array([k for k, label in enumerate(labels) if label.group == group], dtype=np.intp)
        for group in groups
    ]


def _chosen(mechanism: Mechanism, free: Indices | None) -> Indices:
    return np.flatnonzero(mechanism.free) if free is None else free


def gauge_basis(mechanism: Mechanism, free: Indices | None = None) -> Array:
    """(F, Q) directions of the parameters ``free`` that data can see at all.

    Of values that are relative to each other (gains, extra frictions) only differences can be
    seen: their sum is held at zero.
    """
    size = len(_chosen(mechanism, free))
    groups = gauge_groups(mechanism, free)
    alone = np.setdiff1d(np.arange(size), np.concatenate([[], *groups]))
    columns = [np.eye(size)[:, alone]]
    for members in groups:
        block = np.zeros((size, len(members) - 1))
        # Orthonormal complement of (1, ..., 1), from the QR factors of a full-rank matrix.
        frame = np.column_stack([np.ones(len(members)), np.eye(len(members))[:, 1:]])
        block[members] = np.linalg.qr(frame)[0][:, 1:]
        columns.append(block)
    return np.hstack(columns)


def solve_step(
    mechanism: Mechanism,
    rows: Sequence[Rows],
    weights: Sequence[Array],
    theta: Array,
    free: Indices,
    basis: Array,
) -> tuple[Array, tuple[int, ...]]:
    """Least-squares step (F,), within physical bounds if the free step would leave them."""
    scale = mechanism.scale[free]
    parts = [_weighted(row, weight) for row, weight in zip(rows, weights, strict=True)]
    matrix = np.concatenate([p.columns.reshape(-1, len(free)) for p in parts]) / scale
    right = np.concatenate([p.residual.ravel() for p in parts])
    directions = scale[:, None] * basis
    directions = directions / np.linalg.norm(directions, axis=0)
    solution, *_ = np.linalg.lstsq(matrix @ directions, right, rcond=1e-12)
    step = directions @ solution / scale
    lower, upper = mechanism.bounds
    outside = (theta[free] + step < lower[free]) | (theta[free] + step > upper[free])
    if not outside.any():
        return step, ()
    return _bounded_step(matrix, right, scale, theta[free], lower[free], upper[free])


def _bounded_step(
    matrix: Array, right: Array, scale: Array, value: Array, lower: Array, upper: Array
) -> tuple[Array, tuple[int, ...]]:
    from scipy.optimize import lsq_linear

    box = ((lower - value) * scale, (upper - value) * scale)
    inside = np.clip(value, lower, upper) - value
    box = (np.minimum(box[0], inside * scale), np.maximum(box[1], inside * scale) + 1e-300)
    # The gauge needs no constraint here: bounds and the least norm settle the common part.
    result = lsq_linear(matrix, right, bounds=box)
    active = tuple(int(k) for k in np.flatnonzero(result.active_mask))
    return result.x / scale, active


def huber_weights(rows: Sequence[Rows]) -> list[Array]:
    """One weight a row (n,): full inside Huber's threshold, falling as 1/size outside."""
    size = [np.sqrt((row.residual**2).mean(axis=1)) for row in rows]
    # 0.888: median of the root mean square of three unit normals, so that sigma is theirs.
    sigma = np.median(np.concatenate(size)) / 0.888
    return [np.minimum(1.0, HUBER * sigma / np.maximum(s, 1e-300)) for s in size]
