"""Regression rows of a log: filtered residual and columns, block by block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.covariance import hac_covariance
from identification.fitting.parts import reduced_by_parts
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import AddedNoise, DemandedForce, Samples
from identification.signals.filters import Ends
from youbot_env.physics.effect import CHANNEL

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Regression:
    """Filtered regression rows of one log at one theta.

    time (n,): end of each row [s], from the log's start; step: from one row to the next [s];
    residual (n, A): measured less demanded force; columns (n, A, F): of the free parameters.
    """

    time: Array
    step: float
    residual: Array
    columns: Array

    def between(self, start: float, end: float) -> Regression:
        """The rows that lie in a stretch of time [s]."""
        # A row's time is its end; its start must lie inside as well.
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


def row_rate(mechanism: Mechanism, settings: FitSettings = FitSettings()) -> float:
    """Rows a second: those of the settings, or more where the filter passes faster forces."""
    return max(settings.row_rate, settings.rows_per_filter_rate * mechanism.filter_rate)


def regression(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    free: Indices,
    settings: FitSettings = FitSettings(),
    added: AddedNoise | None = None,
) -> Regression:
    """Filtered residual and columns of one log; of coarse speeds what `Samples.for_fit` leaves.

    ``added``: noise that is put on the speeds first.
    """
    if added is not None and np.isfinite(samples.bandwidth):
        # A low pass sees the whole log.
        samples, added = added.on(samples, 0), None
    samples = samples.for_fit

    def ends_of(part: Samples) -> Array:
        return residual_and_columns(mechanism, mechanism.demand(theta, part), part, free)

    filtered = rows_by_parts(ends_of, mechanism, samples, settings, added)
    reduced = settings.rows_of(mechanism.filter_rate, samples.dt)
    # Time of the last sample before the first row, which starts where the filter has settled.
    first = samples.time[0] + (reduced.first - 1) * samples.dt
    time = first + reduced.step * np.arange(1, len(filtered) + 1)
    return Regression(time, reduced.step, filtered[..., 0], filtered[..., 1:])


def filtered_residual(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    settings: FitSettings = FitSettings(),
) -> Array:
    """The filtered residual (n, A) of :func:`regression` alone."""

    def ends_of(part: Samples) -> Array:
        return residual_ends(mechanism, mechanism.demand(theta, part), part)

    return rows_by_parts(ends_of, mechanism, samples.for_fit, settings)


def regressions(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    free: Indices,
    settings: FitSettings = FitSettings(),
) -> list[Regression]:
    """Rows of some logs, whose least squares are those of the error as a share of what acts.

    Where nothing takes a part of the torque they are the rows of each log. A limit of the torque
    takes more the lower it is: with one near zero no force acts that a model could miss, and least
    squares of forces alone would choose it. With S the squares of the residual r and A those of
    what acts, a step dtheta changes S/A as it changes the squares of r - C dtheta, with columns
    C = -dr/dtheta + r/2 dln(A)/dtheta.
    """
    rows = [regression(mechanism, theta, item, free, settings) for item in logs]
    return by_share(rows, acting_slope(mechanism, theta, logs, free))


def by_share(rows: Sequence[Regression], slope: Array) -> list[Regression]:
    """The rows with columns of the error as a share of what acts, see `acting_slope`."""
    return [
        replace(row, columns=columns_by_share(row.columns, row.residual, slope)) for row in rows
    ]


def columns_by_share(columns: Array, residual: Array, slope: Array) -> Array:
    """(n, A, F) the same of columns (n, A, F) and the residual (n, A) of a log."""
    return columns + 0.5 * slope * residual[..., None] if slope.any() else columns


def acting_share(mechanism: Mechanism, theta: Array, logs: Sequence[Samples]) -> float:
    """Squares of the force that channels let pass, over those of the logged one: at most 1."""
    if not mechanism.structure.has_nonlinear_channel:
        return 1.0
    logged = _acting_square(mechanism.with_effects(()), theta, logs)
    return _acting_square(mechanism, theta, logs) / max(logged, 1e-300)


def acting_slope(
    mechanism: Mechanism, theta: Array, logs: Sequence[Samples], free: Indices
) -> Array:
    """(F,) d ln(A) / d theta of the squares A of the force that channels let pass."""
    found = np.zeros(len(free))
    if not mechanism.structure.has_nonlinear_channel:
        return found
    channels = {item.name for item, _ in mechanism.structure.at(CHANNEL)}
    for k, index in enumerate(free):
        label = mechanism.labels[index]
        if label.component not in channels:
            continue
        step = np.zeros(len(theta))
        step[index] = label.parameter.difference
        ends = [_acting_square(mechanism, theta + way * step, logs) for way in (1.0, -1.0)]
        found[k] = np.log(ends[0] / ends[1]) / (2.0 * step[index]) if min(ends) > 0 else 0.0
    return found


def _acting_square(mechanism: Mechanism, theta: Array, logs: Sequence[Samples]) -> float:
    return sum(float((mechanism.passed_force(theta, item.for_fit) ** 2).sum()) for item in logs)


def residual_ends(mechanism: Mechanism, demand: DemandedForce, samples: Samples) -> Array:
    """Measured less demanded force (2, N - 1, A) at both ends of each interval."""
    measured = mechanism.measured_force(samples)
    return np.stack([measured[:-1], measured[1:]]) - demand.force


def residual_and_columns(
    mechanism: Mechanism, demand: DemandedForce, samples: Samples, free: Indices
) -> Array:
    """`residual_ends`, followed by the columns of the parameters ``free``: (2, N - 1, A, 1 + F)."""
    residual = residual_ends(mechanism, demand, samples)
    # One array, so that residual and columns pass exactly the same filter and means.
    return np.moveaxis(np.concatenate([residual[None], demand.columns(free)]), 0, -1)


def rows_by_parts(
    ends_of: Callable[[Samples], Ends],
    mechanism: Mechanism,
    samples: Samples,
    settings: FitSettings = FitSettings(),
    added: AddedNoise | None = None,
) -> Array:
    """:func:`filtered_rows` of what ``ends_of`` makes of samples, see :func:`reduced_by_parts`."""
    reduce = settings.rows_of(mechanism.filter_rate, samples.dt)
    # What is integrated from corrected wheels would begin anew in each part.
    whole = mechanism.structure.changes_kinematics
    return reduced_by_parts(ends_of, samples, reduce, settings, whole=whole, added=added)


def filtered_rows(
    ends: Array, mechanism: Mechanism, samples: Samples, settings: FitSettings = FitSettings()
) -> Array:
    """Filter interval ends (2, N - 1, ...) and average into regression rows (n, ...).

    Rows in which the mechanism rests are zero: they neither ask nor tell anything.
    """
    return settings.rows_of(mechanism.filter_rate, samples.dt)(ends, samples.moves)


def covariance_of(
    rows: Sequence[Regression], basis: Array, scale: Array, settings: FitSettings = FitSettings()
) -> Array:
    """Covariance (F, F) of the least-squares estimate with these residuals and columns."""
    residuals, columns = [row.residual for row in rows], [row.columns for row in rows]
    steps = [row.step for row in rows]
    return hac_covariance(residuals, columns, steps, basis, scale, settings)
