"""The residual over one variable: a line through points, with standard errors, for a plot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.variables import MotionVariables, smooth
from identification.signals.filters import RowFilter

Array = NDArray[np.float64]

UNITS = {"speed": "rad/s", "angle": "rad", "torque": "N m", "heading": "rad", "time": "s"}
TWIST = (("VX", "m/s"), ("VY", "m/s"), ("W", "rad/s"))
ACCELERATION = {"x": "m/s^2", "y": "m/s^2", "yaw": "rad/s^2"}

UNITS_OF_AXIS = {
    False: {"twist": "m/s", "acceleration": "m/s^2", "position": "m", "torque": "N"},
    True: {"twist": "rad/s", "acceleration": "rad/s^2", "position": "rad", "torque": "N m"},
}
"""Units of one axis, by whether it turns."""


@dataclass(frozen=True)
class Curve:
    """Residual over a variable.

    label, unit : of the abscissa; at (n,) its points; force (n, A) and std (n, A) [N m], NaN where
        few rows lie
    """

    label: str
    unit: str
    at: Array
    force: Array
    std: Array


@dataclass(frozen=True)
class _Abscissa:
    """What a curve is drawn over: values (N,) by log, and their period if they have one."""

    label: str
    unit: str
    values: list[Array]
    period: float | None = None


def curves_of(
    variable: str,
    logs: Sequence[MotionVariables],
    reductions: Sequence[RowFilter],
    residual: Sequence[Array],
    *,
    block: int,
    settings: ResidualMapSettings,
    cycles: int = 1,
    period: float | None = None,
) -> list[Curve]:
    """Curves of a residual over a variable: one, or one for each component of the twist.

    The line is fitted through the same filter as the residual's, so that a force that varies
    faster than the filter lets through shows its full size, where it belongs.

    Parameters
    ----------
    logs, reductions : of each log; residual : (n, A) of each fold, in the logs' order
    block : rows within which residuals are correlated
    cycles : per turn, for a wheel's angle; period : of a place or of time, to draw one of many
        over another
    """
    found = []
    for abscissa in _abscissae(logs, variable, cycles, period, settings.smoothing_rate):
        knots = _knots(abscissa, settings)
        features = [
            reduction.of_samples(hat_functions(values, knots, abscissa.period))
            for values, reduction in zip(abscissa.values, reductions, strict=True)
        ]
        rows, force = np.concatenate(features), np.concatenate(residual)
        value, std = _fitted(rows, force, block)
        rare = rows.sum(axis=0) < settings.min_share_of_rows * len(rows)
        # The least-squares value of a point with few rows is mostly noise.
        value[rare] = std[rare] = np.nan
        found.append(Curve(abscissa.label, abscissa.unit, knots[: len(value)], value, std))
    return found


def _knots(abscissa: _Abscissa, settings: ResidualMapSettings) -> Array:
    if abscissa.period:
        half = abscissa.period / 2
        # One more: the last knot is the first one again, a period later.
        return np.linspace(-half, half, settings.curve_points + 1)
    low, high = np.quantile(np.concatenate(abscissa.values), settings.curve_range)
    return np.linspace(low, high, settings.curve_points)


def _abscissae(
    logs: Sequence[MotionVariables],
    variable: str,
    cycles: int,
    period: float | None,
    smoothing: float,
) -> Iterator[_Abscissa]:
    turns = logs[0].turns
    if variable == "twist":
        names = TWIST if turns is None else (("speed", UNITS_OF_AXIS[turns]["twist"]),)
        for k, (label, unit) in enumerate(names):
            yield _Abscissa(label, unit, [log.twist[:, k] for log in logs])
    elif variable == "heading":
        turn = 2 * np.pi
        headings = [_wrapped(_required(log.heading), turn) for log in logs]
        yield _Abscissa("heading", "rad", headings, turn)
    elif variable == "time":
        label = "time" if period else "time from the log's start"
        yield _modulo(_Abscissa(label, "s", [log.time for log in logs]), period)
    else:
        yield _of_component(logs, variable, cycles, period, smoothing)


def _of_component(
    logs: Sequence[MotionVariables],
    variable: str,
    cycles: int,
    period: float | None,
    smoothing: float,
) -> _Abscissa:
    """The component (place, axis or joint) that the variable's name ends with: torque_fl."""
    kind, _, which = variable.rpartition("_") if "_" in variable else (variable, "", "")
    first = logs[0]
    own = {} if first.turns is None else UNITS_OF_AXIS[first.turns]
    label = f"{kind.replace('_', ' ')} {which}".strip()
    if kind == "position":
        k, unit = first.places.index(which), own.get(kind, "m")
        return _modulo(_Abscissa(label, unit, [log.position[:, k] for log in logs]), period)
    if kind == "acceleration":
        k, unit = first.axes.index(which), own.get(kind) or ACCELERATION[which]
        smoothed = [smooth(log.acceleration, smoothing, log.dt)[:, k] for log in logs]
        return _Abscissa(label, unit, smoothed)
    k, name = first.joints.index(which), kind.rpartition("_")[2]
    if name == "angle":
        turn = 2 * np.pi / cycles
        label += f", {cycles} times a turn" if cycles > 1 else ""
        angles = [_wrapped(_required(log.angle)[:, k], turn) for log in logs]
        return _Abscissa(label, "rad", angles, turn)
    unit = own.get(name) or UNITS[name]
    if name == "torque":
        label = label if first.turns is None else "effort"
        return _Abscissa(label, unit, [smooth(log.torque, smoothing, log.dt)[:, k] for log in logs])
    return _Abscissa(label, unit, [_required(getattr(log, name))[:, k] for log in logs])


def _modulo(abscissa: _Abscissa, period: float | None) -> _Abscissa:
    """One period of it, on which all others lie, where it has one."""
    if not period:
        return abscissa
    values = [_wrapped(part, period) for part in abscissa.values]
    return _Abscissa(f"{abscissa.label}, modulo a period", abscissa.unit, values, period)


def _wrapped(values: Array, period: float) -> Array:
    return np.mod(values + period / 2, period) - period / 2


def _required(values: Array | None) -> Array:
    assert values is not None
    return values


def hat_functions(values: Array, knots: Array, period: float | None) -> Array:
    """(N, n) weights of a line through points at the knots; the last knot of a period is the first.

    Outside the knots the line is constant.
    """
    step = knots[1] - knots[0]
    place = np.clip((values - knots[0]) / max(step, 1e-300), 0.0, len(knots) - 1.0)
    left = np.minimum(place.astype(int), len(knots) - 2)
    share = place - left
    rows = np.arange(len(values))
    found = np.zeros((len(values), len(knots)))
    found[rows, left] = 1.0 - share
    found[rows, left + 1] = share
    if period:
        found[:, 0] += found[:, -1]
        found = found[:, :-1]
    return found


def _fitted(features: Array, force: Array, block: int) -> tuple[Array, Array]:
    """Least squares (n, A), and standard errors for residuals correlated within a block of rows."""
    gram = features.T @ features
    # A point without rows would make the matrix singular. Such points are hidden afterwards.
    inverse = np.linalg.inv(gram + 1e-6 * np.trace(gram) * np.eye(len(gram)))
    value = inverse @ features.T @ force
    left = force - features @ value
    starts = np.arange(0, len(left), block)
    # Sandwich covariance: scores are summed by block, in which residuals are correlated.
    scores = np.stack([features[a : a + block].T @ left[a : a + block] for a in starts])
    spread = np.einsum("pq,bqa->bpa", inverse, scores)
    return value, np.sqrt((spread**2).sum(axis=0))
