"""Regression rows of a log: filtered residual and columns, block by block."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import DemandedForce, Mechanism, Samples
from identification.signals.filters import block_mean, first_order, settled

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


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


def stride(dt: float, rate: float) -> int:
    """Samples in one regression row, for ``rate`` rows a second."""
    return max(1, round(1.0 / (rate * dt)))


def regression_rows(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    free: Indices,
    settings: FitSettings = FitSettings(),
) -> Rows:
    """Filtered residual and columns of one log."""
    ends = residual_and_columns(mechanism, mechanism.demand(theta, samples), samples, free)
    filtered = reduce(ends, mechanism, samples, settings)
    step = stride(samples.dt, settings.row_rate) * samples.dt
    first = samples.time[0] + (_settled(mechanism, samples, settings) - 1) * samples.dt
    time = first + step * np.arange(1, len(filtered) + 1)
    return Rows(time, step, filtered[..., 0], filtered[..., 1:])


def residual_of(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    settings: FitSettings = FitSettings(),
) -> Array:
    """The filtered residual (n, A) of :func:`regression_rows` alone."""
    residual = residual_ends(mechanism, mechanism.demand(theta, samples), samples)
    return reduce(residual, mechanism, samples, settings)


def residual_ends(mechanism: Mechanism, demand: DemandedForce, samples: Samples) -> Array:
    """Measured less demanded force (2, N - 1, A) at both ends of each interval."""
    measured = mechanism.measured_force(samples)
    return np.stack([measured[:-1], measured[1:]]) - demand.force


def residual_and_columns(
    mechanism: Mechanism, demand: DemandedForce, samples: Samples, free: Indices
) -> Array:
    """The same with the columns of the parameters ``free`` behind: (2, N - 1, A, 1 + F)."""
    residual = residual_ends(mechanism, demand, samples)
    return np.moveaxis(np.concatenate([residual[None], demand.columns(free)]), 0, -1)


def reduce(
    ends: Array, mechanism: Mechanism, samples: Samples, settings: FitSettings = FitSettings()
) -> Array:
    """Filter interval ends (2, N - 1, ...) and average into regression rows (n, ...)."""
    filtered = first_order(ends[0], ends[1], mechanism.filter_rate, samples.dt)
    size = stride(samples.dt, settings.row_rate)
    return block_mean(filtered[_settled(mechanism, samples, settings) :], size)


def _settled(mechanism: Mechanism, samples: Samples, settings: FitSettings) -> int:
    """Samples until the filter has forgotten its start."""
    constants = settings.filter.settling_time_constants
    return settled(mechanism.filter_rate, samples.dt, constants)
