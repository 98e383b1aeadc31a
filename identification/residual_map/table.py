"""Rows of the filtered residual beside the model's columns and the features of every variable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.cross_validation import rows_per_block
from identification.fitting.parts import reduced_by_parts, rows_in_parts
from identification.fitting.regression import residual_and_columns, stride
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, averaged_down, cut
from identification.residual_map.features import FeatureGroup, FeatureScales, feature_groups
from identification.residual_map.held_out_gain import FoldRows
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.variables import MotionVariables, smooth
from identification.signals.filters import Ends, RowFilter, at_both_ends, settled, slope_ends

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class ResidualTable:
    """The rows, features and variables from which a map is computed.

    Attributes
    ----------
    groups : of features, one a variable; index : places of each variable's features
    folds : what is held out together, a log each or some parts of a single one
    variables, reductions : by log, for curves
    """

    groups: tuple[FeatureGroup, ...]
    index: Mapping[str, Indices]
    folds: tuple[FoldRows, ...]
    variables: tuple[MotionVariables, ...]
    reductions: tuple[RowFilter, ...]
    settings: ResidualMapSettings


def residual_table(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    settings: ResidualMapSettings,
    fit: FitSettings,
) -> ResidualTable:
    """Residual, columns and features of logs (the mechanism's samples) at theta (P,)."""
    slow = [averaged_down(samples, settings.max_sample_rate) for samples in logs]
    seconds = sum(samples.dt * len(samples) for samples in slow)
    row_rate = min(settings.max_row_rate, settings.max_rows / seconds)
    constants = fit.filter.settling_time_constants
    reductions = [
        RowFilter(mechanism.filter_rate, constants, s.dt, stride(s.dt, row_rate)) for s in slow
    ]
    rows, variables = [], []
    for samples, reduction in zip(slow, reductions, strict=True):
        rows.append(_rows_of_model(mechanism, theta, samples, reduction, settings, fit))
        demanded = demanded_force(mechanism, theta, samples, reduction, settings, fit)
        variables.append(motion_variables(mechanism, samples, demanded, settings.smoothing_rate))
    del slow
    # Scales are pooled over logs: a feature must have the same meaning in training and held-out
    # logs.
    scales, groups = FeatureScales.of(variables, settings), feature_groups(variables[0])
    sizes = [group.features(variables[0].between(0, 2), scales).shape[-1] for group in groups]
    edges = np.cumsum([0, *sizes])
    index = {
        group.variable: np.arange(a, b)
        for group, a, b in zip(groups, edges, edges[1:], strict=False)
    }
    folds = []
    for row, one, reduction in zip(rows, variables, reductions, strict=True):
        features = np.empty((len(row), edges[-1]))
        for group, a, b in zip(groups, edges, edges[1:], strict=False):
            features[:, a:b] = _reduced(group, one, scales, reduction, settings, fit)
        block = rows_per_block(settings.bootstrap_block_time, reduction.step)
        folds.append(FoldRows(features, row[..., 1:], row[..., 0], block))
    if len(folds) == 1:
        folds = folds[0].split(fit.blocks_of_single_log)
    return ResidualTable(
        tuple(groups), index, tuple(folds), tuple(variables), tuple(reductions), settings
    )


def _rows_of_model(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    reduction: RowFilter,
    settings: ResidualMapSettings,
    fit: FitSettings,
) -> Array:
    """(n, A, 1 + P) residual and columns of the free parameters."""
    free = np.flatnonzero(mechanism.free)

    def ends_of(part: Samples) -> Array:
        return residual_and_columns(mechanism, mechanism.demand(theta, part), part, free)

    moving, whole = replace(samples, moves=None), mechanism.structure.changes_kinematics
    return reduced_by_parts(ends_of, moving, reduction, _in_parts(settings, fit), whole=whole)


def _reduced(
    group: FeatureGroup,
    one: MotionVariables,
    scales: FeatureScales,
    reduction: RowFilter,
    settings: ResidualMapSettings,
    fit: FitSettings,
) -> Array:
    """(n, Q) a group's features with the same filter and block means as the residual.

    Or a sharp function would not match it.
    """

    def ends_of(begin: int, end: int) -> Ends:
        found = group.features(one.between(begin, end), scales)
        return at_both_ends(found) if found.ndim == 2 else found

    return rows_in_parts(ends_of, len(one.time), None, reduction, _in_parts(settings, fit))


def _in_parts(settings: ResidualMapSettings, fit: FitSettings) -> FitSettings:
    return replace(fit, max_part_samples=settings.max_part_samples)


def demanded_force(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    reduction: RowFilter,
    settings: ResidualMapSettings,
    fit: FitSettings,
) -> Array:
    """(2, N - 1, A) force that the model demands at both ends of each interval [N m].

    Of long logs in parts, which see as much before and after them as those of the rows.
    """
    count, size = len(samples) - 1, settings.max_part_samples
    if count < size or mechanism.structure.changes_kinematics:
        return mechanism.demand(theta, samples).force
    margin = settled(reduction.rate, reduction.dt, fit.part_margin_time_constants)
    found = np.empty((2, count, len(mechanism.axes)))
    for begin in range(0, count, size):
        start, end = max(0, begin - margin), min(begin + size, count)
        part = cut(samples, start, min(end + margin, count) + 1)
        force = mechanism.demand(theta, part).force
        found[:, begin:end] = force[:, begin - start : end - start]
    return found


def motion_variables(
    mechanism: Mechanism, samples: Samples, demanded: Array, smoothing: float
) -> MotionVariables:
    """Variables of a log.

    Parameters
    ----------
    demanded : (2, N - 1, A) force that the model demands at both ends of each interval [N m]
    smoothing : rate of the filter ahead of jerk and load [rad/s]
    """
    # At a sample the force is the mean of the two intervals that meet there; they may differ.
    force = np.concatenate(
        [demanded[0, :1], 0.5 * (demanded[1, :-1] + demanded[0, 1:]), demanded[1, -1:]]
    )
    found = mechanism.variables(samples)
    torque = mechanism.joint_torque(force)
    derived = _derived(found.twist, torque, smoothing, samples.dt)
    derived["acceleration_ends"] = slope_ends(found.twist, samples.dt)
    derived["torque_ends"] = np.stack([mechanism.joint_torque(side) for side in demanded])
    known: dict[str, Any] = found._asdict() | derived
    return MotionVariables(time=samples.time, **known)


def _derived(twist: Array, torque: Array, smoothing: float, dt: float) -> dict[str, Array]:
    slow = smooth(torque, smoothing, dt)
    change = np.gradient(smooth(twist, smoothing, dt), dt, axis=0)
    return {
        "acceleration": np.gradient(twist, dt, axis=0),
        "jerk": np.gradient(smooth(change, smoothing, dt), dt, axis=0),
        "torque": torque,
        "load": np.abs(slow),
        "torque_rate": np.gradient(slow, dt, axis=0),
    }
