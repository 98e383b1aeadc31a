"""Rows of the filtered residual beside the model's columns and the features of every variable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.regression_rows import residual_and_columns
from identification.fitting.settings import FitSettings
from identification.residual_map.features import Group, Scales, groups
from identification.residual_map.held_out_shares import Part
from identification.residual_map.variables import Signals, signals_of, slowed
from identification.signals.filters import block_mean, filter_samples, first_order, settled

if TYPE_CHECKING:
    from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ROW_RATE = 50.0
"""Rows a second [Hz]: more than the filter leaves of a motion, for the ripple of a fast wheel."""

MOST_ROWS = 60_000
"""Longer logs get fewer rows a second, so that memory stays bounded."""


@dataclass(frozen=True)
class Reduction:
    """From samples (N, ...) at ``dt`` [s] to rows (n, ...): the filter, then means of blocks.

    rate: of the filter [rad/s]; size: samples in a row.
    """

    rate: float
    dt: float
    size: int

    @property
    def step(self) -> float:
        """From one row to the next [s]."""
        return self.size * self.dt

    def __call__(self, signal: Array) -> Array:
        return self._finished(filter_samples(signal, self.rate, self.dt))

    def ends(self, ends: Array) -> Array:
        """The same from interval ends (2, N - 1, ...)."""
        return self._finished(first_order(ends[0], ends[1], self.rate, self.dt))

    def _finished(self, filtered: Array) -> Array:
        return block_mean(filtered[settled(self.rate, self.dt) :], self.size)


@dataclass(frozen=True)
class ResidualTable:
    """All that a map is made of.

    parts: what is held out together, a log each or five blocks of a single one; index: places of
    each variable's features; signals and reductions by log, for curves.
    """

    groups: tuple[Group, ...]
    index: Mapping[str, Indices]
    parts: tuple[Part, ...]
    signals: tuple[Signals, ...]
    reductions: tuple[Reduction, ...]


def make_table(mechanism: Mechanism, theta: Array, logs: Sequence[Any]) -> ResidualTable:
    """Residual, columns and features of logs at theta (P,)."""
    slow = [slowed(samples) for samples in logs]
    seconds = sum(samples.dt * len(samples) for samples in slow)
    rows_a_second = min(ROW_RATE, MOST_ROWS / seconds)
    reductions = [
        Reduction(mechanism.filter_rate, s.dt, max(1, round(1.0 / (rows_a_second * s.dt))))
        for s in slow
    ]
    pairs = [
        _residual_and_signals(mechanism, theta, samples, reduction)
        for samples, reduction in zip(slow, reductions, strict=True)
    ]
    signals = [pair[1] for pair in pairs]
    scales, found = Scales.of(signals), groups(signals[0])
    parts, sizes = [], []
    for (rows, one), reduction in zip(pairs, reductions, strict=True):
        features = [reduction(group.features(one, scales)) for group in found]
        sizes = [part.shape[1] for part in features]
        flexible = np.column_stack(features)
        parts.append(Part(flexible, rows[..., 1:], rows[..., 0], reduction.step))
    edges = np.cumsum([0, *sizes])
    index = {
        group.variable: np.arange(a, b)
        for group, a, b in zip(found, edges, edges[1:], strict=False)
    }
    folds = parts if len(parts) > 1 else parts[0].pieces(FitSettings.blocks_of_single_log)
    return ResidualTable(tuple(found), index, tuple(folds), tuple(signals), tuple(reductions))


def _residual_and_signals(
    mechanism: Mechanism, theta: Array, samples: Any, reduction: Reduction
) -> tuple[Array, Signals]:
    """Rows (n, A, 1 + P) of the residual and the model's columns; the signals of the log."""
    demand = mechanism.demand(theta, samples)
    free = np.flatnonzero(mechanism.free)
    rows = reduction.ends(residual_and_columns(mechanism, demand, samples, free))
    return rows, signals_of(mechanism, samples, demand.force)
