"""Batch least squares on filtered forces, with standard deviations for correlated residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.filters import (
    FILTER_RATE,
    accumulate,
    block_mean,
    first_order,
    settled,
)
from identification.mechanism import Demand, Mechanism, Samples
from youbot_env.errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ROW_RATE = 20.0
"""Rows a second [Hz] that a fit sees: 2 a_f; the filter leaves little above."""

CORRELATION_TIME = 0.5
"""Least window [s] over which scores may be correlated beyond the residual's AR(1) memory."""

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
class Rows:
    """Filtered regression rows of one log at one theta.

    time (n,): end of each row [s], from the log's start; step: from one row to the next [s];
    residual (n, A): measured less demanded force; columns (n, A, F): of the free parameters.
    """

    time: Array
    step: float
    residual: Array
    columns: Array

    def between(self, start: float, end: float) -> Rows:
        """The rows that lie in a stretch of time [s]."""
        inside = (self.time - self.step >= start) & (self.time <= end)
        return replace(
            self,
            time=self.time[inside],
            residual=self.residual[inside],
            columns=self.columns[inside],
        )


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


def stride(dt: float, rate: float = ROW_RATE) -> int:
    """Samples in one regression row, for ``rate`` rows a second."""
    return max(1, round(1.0 / (rate * dt)))


def regression_rows(
    mechanism: Mechanism, theta: Array, samples: Samples, free: Indices, rate: float = ROW_RATE
) -> Rows:
    """Filtered residual and columns of one log, ``rate`` rows a second."""
    band = mechanism.filter_rate
    ends = residual_and_columns(mechanism, mechanism.demand(theta, samples), samples, free)
    filtered = reduce(ends, samples.dt, rate, band)
    step = stride(samples.dt, rate) * samples.dt
    first = samples.time[0] + (settled(band, samples.dt) - 1) * samples.dt
    time = first + step * np.arange(1, len(filtered) + 1)
    return Rows(time, step, filtered[..., 0], filtered[..., 1:])


def residual_of(mechanism: Mechanism, theta: Array, samples: Samples, rate: float) -> Array:
    """The filtered residual (n, A) of :func:`regression_rows` alone."""
    residual = residual_ends(mechanism, mechanism.demand(theta, samples), samples)
    return reduce(residual, samples.dt, rate, mechanism.filter_rate)


def residual_ends(mechanism: Mechanism, demand: Demand, samples: Samples) -> Array:
    """Measured less demanded force (2, N - 1, A) at both ends of each interval."""
    measured = mechanism.measured_force(samples)
    return np.stack([measured[:-1], measured[1:]]) - demand.force


def residual_and_columns(
    mechanism: Mechanism, demand: Demand, samples: Samples, free: Indices
) -> Array:
    """The same with the columns of the parameters ``free`` behind: (2, N - 1, A, 1 + F)."""
    residual = residual_ends(mechanism, demand, samples)
    return np.moveaxis(np.concatenate([residual[None], demand.columns(free)]), 0, -1)


def reduce(
    ends: Array, dt: float, rate: float = ROW_RATE, filter_rate: float = FILTER_RATE
) -> Array:
    """Filter interval ends (2, N - 1, ...) and average into regression rows (n, ...)."""
    filtered = first_order(ends[0], ends[1], filter_rate, dt)
    return block_mean(filtered[settled(filter_rate, dt) :], stride(dt, rate))


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


def hac_covariance(rows: Sequence[Rows], basis: Array, scale: Array) -> Array:
    """Covariance (F, F) of a least-squares estimate whose residuals are correlated in time.

    Newey and West (Econometrica 55(3), 1987): the scores' long-run covariance by Bartlett weights,
    between the inverses of the information matrix; prewhitened, since the filter's memory alone
    would cost a plain window a tenth of the standard deviation.
    """
    directions = scale[:, None] * basis
    directions = directions / np.linalg.norm(directions, axis=0)
    size = directions.shape[1]
    information, middle = np.zeros((size, size)), np.zeros((size, size))
    count = 0
    for row in rows:
        columns = (row.columns / scale) @ directions
        information += np.einsum("nap,naq->pq", columns, columns)
        scores = innovation_scores(row.residual, columns)
        lags = max(automatic_lags(scores), round(CORRELATION_TIME / row.step))
        middle += long_run(scores, lags)
        count += row.residual.size
    inverse = np.linalg.pinv(information, rcond=1e-13, hermitian=True)
    covariance = inverse @ middle @ inverse * count / max(count - size, 1)
    to_theta = directions / scale[:, None]
    return to_theta @ covariance @ to_theta.T


def innovation_scores(residual: Array, columns: Array) -> Array:
    """Scores (n, P) that sum up as residual * column does, without the residual's AR(1) memory.

    residual (n, A), columns (n, A, P). Prewhitening of Andrews and Monahan (Econometrica 60(4),
    1992), moved to the columns: with the innovations e = A r, X' r = (A^-T X)' e.
    """
    total = np.zeros((len(columns), columns.shape[2]))
    for axis in range(residual.shape[1]):
        r = residual[:, axis]
        memory = float(np.clip(r[1:] @ r[:-1] / max(r @ r, 1e-300), 0.0, 0.97))
        innovation = r - memory * np.concatenate([[0.0], r[:-1]])
        carried = accumulate(columns[::-1, axis], memory)[:0:-1]
        total += innovation[:, None] * carried
    return total


def automatic_lags(scores: Array) -> int:
    """Bartlett bandwidth [rows] by Andrews' AR(1) plug-in (Econometrica 59(3), 1991, eq. 6.4)."""
    power = np.maximum((scores**2).sum(axis=0), 1e-300)
    memory = np.clip((scores[1:] * scores[:-1]).sum(axis=0) / power, -0.95, 0.95)
    noise = ((scores[1:] - memory * scores[:-1]) ** 2).mean(axis=0)
    bend = (4 * memory**2 * noise**2 / ((1 - memory) ** 6 * (1 + memory) ** 2)).sum()
    level = (noise**2 / (1 - memory) ** 4).sum()
    return max(1, int(np.ceil(1.1447 * (bend / max(level, 1e-300) * len(scores)) ** (1 / 3))))


def long_run(scores: Array, lags: int) -> Array:
    """Sum (P, P) of the scores' (n, P) autocovariances under Bartlett weights."""
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1)):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / lags) * (cross + cross.T)
    return total
