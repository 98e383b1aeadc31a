"""Output error: parameters whose free run, driven by the logged torques alone, fits best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.covariance import hac_covariance
from identification.fitting.least_squares import Fit, gauge_basis, solve_step
from identification.fitting.regression_rows import Indices, Rows, stride
from identification.mechanisms.mechanism import Mechanism, Samples
from identification.signals.filters import block_mean
from youbot_env.errors import InputError

Array = NDArray[np.float64]

ITERATIONS = 12
ENOUGH = 1e-5
"""The search stops when an iteration lowers the cost by less than this share."""


def refine(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    start: Fit,
    *,
    progress: Callable[[], None] = lambda: None,
) -> Fit:
    """Gauss-Newton on the free run's velocity residual, from a force fit.

    Noise on the measured speeds cannot bias it, since no measured speed enters a column; in
    return all that the torque channels do not explain adds up over the run.

    Raises
    ------
    InputError
        If the free run at the start diverges.
    """
    theta, free = start.theta.copy(), start.free
    basis = gauge_basis(mechanism)
    rows = [_rows(mechanism, theta, samples, free, progress) for samples in logs]
    cost = _cost(rows)
    if not np.isfinite(cost):
        raise InputError("the free run diverges: the force fit is no start for an output-error fit")
    bounded: tuple[int, ...] = ()
    for _ in range(ITERATIONS):
        weights = [np.ones(len(row.residual)) for row in rows]
        step, bounded = solve_step(mechanism, rows, weights, theta, free, basis)
        theta, lower = _line_search(mechanism, logs, theta, free, step, cost)
        fell = (cost - lower) / cost
        if fell > 0:
            rows = [_rows(mechanism, theta, samples, free, progress) for samples in logs]
            cost = lower
        if fell < ENOUGH:
            break
    covariance = hac_covariance(rows, basis, mechanism.scale[free])
    return Fit(theta, free, covariance, tuple(rows), bounded)


def _line_search(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    theta: Array,
    free: Indices,
    step: Array,
    cost: float,
) -> tuple[Array, float]:
    """The full step, or a half, a quarter, ... of it, until the cost falls."""
    for share in (1.0, 0.5, 0.25, 0.125):
        tried = theta.copy()
        tried[free] += share * step
        lower = sum(float((_residual(mechanism, tried, s) ** 2).sum()) for s in logs)
        if lower < cost:
            return tried, lower
    return theta, cost


def _cost(rows: Sequence[Rows]) -> float:
    return sum(float((row.residual**2).sum()) for row in rows)


def _residual(mechanism: Mechanism, theta: Array, samples: Samples) -> Array:
    error = mechanism.measured_speed(samples) - mechanism.free_run(theta, samples)
    return block_mean(error, stride(samples.dt))


def _rows(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    free: Indices,
    progress: Callable[[], None],
) -> Rows:
    """Residual and columns (sensitivities of the free run) by central differences."""
    columns = []
    for index in free:
        step = 1e-4 / mechanism.scale[index]
        step = max(step, 1e-5 * abs(theta[index]))
        ahead, behind = theta.copy(), theta.copy()
        ahead[index] += step
        behind[index] -= step
        difference = mechanism.free_run(ahead, samples) - mechanism.free_run(behind, samples)
        columns.append(block_mean(difference / (2 * step), stride(samples.dt)))
        progress()
    residual = _residual(mechanism, theta, samples)
    step = stride(samples.dt) * samples.dt
    time = samples.time[0] - samples.dt + step * np.arange(1, len(residual) + 1)
    return Rows(time, step, residual, np.stack(columns, axis=-1))
