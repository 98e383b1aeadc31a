"""Output error: parameters whose free run, driven by the logged torques alone, fits best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.least_squares import Fit, solve_step
from identification.fitting.regression import Indices, Regression, covariance_of, stride
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.signals.filters import block_mean
from youbot_env.errors import InputError

Array = NDArray[np.float64]


def refine(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    start: Fit,
    *,
    settings: FitSettings = FitSettings(),
    progress: Callable[[], None] = lambda: None,
) -> Fit:
    """Gauss-Newton on the free run's velocity residual, from a force fit.

    No measured speed enters a column, so noise on the speeds does not bias the estimate. The price:
    a force that the torque channels do not contain adds up over the whole run.

    Raises
    ------
    InputError
        If the free run at the start diverges.
    """
    theta, free = start.theta.copy(), start.free
    basis = gauge_basis(mechanism)
    rows = [_rows(mechanism, theta, samples, free, settings, progress) for samples in logs]
    cost = _cost(rows)
    if not np.isfinite(cost):
        raise InputError("the free run diverges: the force fit is no start for an output-error fit")
    bounded: tuple[int, ...] = ()
    for _ in range(settings.output_error_max_steps):
        weights = [np.ones(len(row.residual)) for row in rows]
        step, bounded = solve_step(mechanism, rows, weights, theta, free, basis, settings)
        theta, lower = _line_search(mechanism, logs, theta, free, step, cost, settings)
        fell = (cost - lower) / cost
        if fell > 0:
            rows = [_rows(mechanism, theta, samples, free, settings, progress) for samples in logs]
            cost = lower
        # After the update, so that a last small improvement is kept and the rows belong to theta.
        if fell < settings.output_error_min_fall_share:
            break
    covariance = covariance_of(rows, basis, mechanism.scale[free], settings)
    return Fit(theta, free, covariance, tuple(rows), bounded)


def _line_search(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    theta: Array,
    free: Indices,
    step: Array,
    cost: float,
    settings: FitSettings,
) -> tuple[Array, float]:
    """The full step, or a half, a quarter, ... of it, until the cost falls."""
    for share in settings.output_error_step_shares:
        tried = theta.copy()
        tried[free] += share * step
        lower = sum(float((_residual(mechanism, tried, s, settings) ** 2).sum()) for s in logs)
        # A diverging free run gives NaN, and NaN < cost is False.
        if lower < cost:
            return tried, lower
    return theta, cost


def _cost(rows: Sequence[Regression]) -> float:
    return sum(float((row.residual**2).sum()) for row in rows)


def _residual(mechanism: Mechanism, theta: Array, samples: Samples, settings: FitSettings) -> Array:
    error = mechanism.measured_speed(samples) - mechanism.free_run(theta, samples)
    return block_mean(error, stride(samples.dt, settings.row_rate))


def _rows(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    free: Indices,
    settings: FitSettings,
    progress: Callable[[], None],
) -> Regression:
    """Residual and columns (sensitivities of the free run) by central differences."""
    columns = []
    size = stride(samples.dt, settings.row_rate)
    for index in free:
        # The larger of two steps: far above rounding, and small compared with the parameter.
        step = settings.output_error_scaled_difference / mechanism.scale[index]
        step = max(step, settings.output_error_relative_difference * abs(theta[index]))
        ahead, behind = theta.copy(), theta.copy()
        ahead[index] += step
        behind[index] -= step
        difference = mechanism.free_run(ahead, samples) - mechanism.free_run(behind, samples)
        columns.append(block_mean(difference / (2 * step), size))
        progress()
    residual = _residual(mechanism, theta, samples, settings)
    # No filter has to settle here, so the first row starts at the first sample.
    step = size * samples.dt
    time = samples.time[0] - samples.dt + step * np.arange(1, len(residual) + 1)
    return Regression(time, step, residual, np.stack(columns, axis=-1))
