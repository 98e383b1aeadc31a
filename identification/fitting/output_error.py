"""Output error: parameters whose free run, driven by the logged torques alone, fits best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.least_squares import Fit, solve_step
from identification.fitting.regression import Indices, Regression, covariance_of, stride
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, cut
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
    run = _FreeRuns(mechanism, logs, settings, progress)
    theta, free = start.theta.copy(), start.free
    basis = gauge_basis(mechanism, free)
    residual = run.residuals(theta)
    cost = _cost(residual)
    if not np.isfinite(cost):
        raise InputError("the free run diverges: the force fit is no start for an output-error fit")
    rows = run.rows(theta, free, residual)
    bounded: tuple[int, ...] = ()
    for _ in range(settings.output_error_max_steps):
        weights = [np.ones(len(row.residual)) for row in rows]
        step, bounded = solve_step(mechanism, rows, weights, theta, free, basis, settings)
        theta, lower, residual = run.line_search(theta, free, step, cost, residual)
        fell, cost = (cost - lower) / cost, lower
        if fell > settings.output_error_max_old_columns_fall:
            rows = run.rows(theta, free, residual)
        else:
            # Columns cost two free runs a parameter, and those of a nearby theta lead there too.
            rows = [replace(row, residual=r) for row, r in zip(rows, residual, strict=True)]
        # After the update, so that a last small improvement is kept and the rows belong to theta.
        if fell < settings.output_error_min_fall_share:
            break
    covariance = covariance_of(rows, basis, mechanism.scale[free], settings)
    return Fit(theta, free, covariance, tuple(rows), bounded, in_free_run=True)


def _cost(residual: Sequence[Array]) -> float:
    return sum(float((part**2).sum()) for part in residual)


@dataclass(frozen=True)
class _FreeRuns:
    """Free runs of some logs: their residuals, and columns, at one theta (P,) or another."""

    mechanism: Mechanism
    logs: Sequence[Samples]
    settings: FitSettings
    progress: Callable[[], None]

    def residuals(self, theta: Array) -> list[Array]:
        """Per log (n, A): measured less simulated speeds, averaged over each row."""
        return [self._left(item, self.mechanism.free_run(theta, item)) for item in self.logs]

    def _left(self, samples: Samples, simulated: Array) -> Array:
        """(n, A) means over rows of a log's measured speeds less simulated ones (N, A)."""
        size = stride(samples.dt, self.settings.row_rate)
        rows = max(1, self.settings.max_part_samples // size) * size
        found = []
        for begin in range(0, len(samples), rows):
            part = cut(samples, begin, begin + rows)
            speed = self.mechanism.measured_speed(part)
            found.append(block_mean(speed - simulated[begin : begin + rows], size))
        return np.concatenate(found)

    def line_search(
        self, theta: Array, free: Indices, step: Array, cost: float, residual: list[Array]
    ) -> tuple[Array, float, list[Array]]:
        """The full step, or a half, a quarter, ... of it, until the cost falls."""
        for share in self.settings.output_error_step_shares:
            tried = theta.copy()
            tried[free] += share * step
            there = self.residuals(tried)
            # A diverging free run gives NaN, and NaN < cost is False.
            if (lower := _cost(there)) < cost:
                return tried, lower, there
        return theta, cost, residual

    def rows(self, theta: Array, free: Indices, residual: Sequence[Array]) -> list[Regression]:
        """The rows at theta, whose residuals are known: columns are sensitivities of the free run.

        By forward differences. An error of theirs moves no minimum, since the residuals are exact.
        """
        columns = [self._column(theta, index, residual) for index in free]
        found = []
        for item, left, *parts in zip(self.logs, residual, *columns, strict=True):
            # No filter has to settle here, so the first row starts at the first sample.
            step = stride(item.dt, self.settings.row_rate) * item.dt
            time = item.time[0] - item.dt + step * np.arange(1, len(left) + 1)
            found.append(Regression(time, step, left, np.stack(parts, axis=-1)))
        return found

    def _column(self, theta: Array, index: int, residual: Sequence[Array]) -> list[Array]:
        """Per log (n, A): slope of the simulated speeds in one parameter."""
        settings = self.settings
        # The larger of two steps: far above rounding, and small compared with the parameter.
        step = settings.output_error_scaled_difference / self.mechanism.scale[index]
        step = max(step, settings.output_error_relative_difference * abs(theta[index]))
        moved = theta.copy()
        moved[index] += step
        self.progress()
        there = self.residuals(moved)
        return [(here - left) / step for here, left in zip(residual, there, strict=True)]
