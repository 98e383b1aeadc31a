"""The residual over one variable: a line through points, with standard errors, for a plot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.residual_map.table import ResidualTable
from identification.residual_map.variables import Signals, smooth

Array = NDArray[np.float64]

POINTS = 16
"""Of a curve."""

RARE = 0.004
"""Share of the rows below which a point is not shown."""

UNITS = {"speed": "rad/s", "angle": "rad", "torque": "N m", "heading": "rad", "time": "s"}
TWIST = (("VX", "m/s"), ("VY", "m/s"), ("W", "rad/s"))
ACCELERATION = {"x": "m/s^2", "y": "m/s^2", "yaw": "rad/s^2"}

OF_AXIS = {
    False: {"twist": "m/s", "acceleration": "m/s^2", "position": "m", "torque": "N"},
    True: {"twist": "rad/s", "acceleration": "rad/s^2", "position": "rad", "torque": "N m"},
}
"""Units of one axis, by whether it turns."""


@dataclass(frozen=True)
class Curve:
    """Residual over a variable.

    label, unit : of the abscissa; at (n,) its points; force (n, A) and std (n, A) [N m], NaN where
        the logs have hardly been
    """

    label: str
    unit: str
    at: Array
    force: Array
    std: Array


def curves_of(
    table: ResidualTable, residual: Sequence[Array], variable: str, cycles: int = 1
) -> list[Curve]:
    """Curves of the folds' residual (n, A) over a variable of the table.

    The line is fitted through the same filter as the residual's, so that a force that varies
    faster than the filter lets through shows its full size, where it belongs.
    """
    found = []
    for label, unit, logs, period in _abscissae(table.signals, variable, cycles):
        pooled = np.concatenate(logs)
        if period:
            knots = np.linspace(-period / 2, period / 2, POINTS + 1)
        else:
            low, high = np.quantile(pooled, [0.005, 0.995])
            knots = np.linspace(low, high, POINTS)
        features = [
            reduction(hats(values, knots, period))
            for values, reduction in zip(logs, table.reductions, strict=True)
        ]
        found.append(_fitted(label, unit, knots, features, residual, table))
    return found


def _abscissae(
    signals: Sequence[Signals], variable: str, cycles: int
) -> Iterator[tuple[str, str, list[Array], float | None]]:
    """Label, unit, values by log, and the period if there is one."""
    first = signals[0]
    if variable == "twist":
        names = TWIST if first.turns is None else (("speed", OF_AXIS[first.turns]["twist"]),)
        for k, (label, unit) in enumerate(names):
            yield label, unit, [log.twist[:, k] for log in signals], None
    elif variable == "heading":
        turn = 2 * np.pi
        yield "heading", "rad", [_wrapped(_required(log.heading), turn) for log in signals], turn
    elif variable == "time":
        yield "time from the log's start", "s", [log.time for log in signals], None
    else:
        yield _of_component(signals, variable, cycles)


def _of_component(
    signals: Sequence[Signals], variable: str, cycles: int
) -> tuple[str, str, list[Array], float | None]:
    kind, _, which = variable.rpartition("_") if "_" in variable else (variable, "", "")
    first = signals[0]
    own = {} if first.turns is None else OF_AXIS[first.turns]
    if kind == "position":
        k, unit = first.places.index(which), own.get(kind, "m")
        return f"position {which}".strip(), unit, [log.position[:, k] for log in signals], None
    if kind == "acceleration":
        k, unit = first.axes.index(which), own.get(kind) or ACCELERATION[which]
        label = f"acceleration {which}".strip()
        return label, unit, [smooth(log.acceleration, _dt(log))[:, k] for log in signals], None
    k, name = first.joints.index(which), kind.rpartition("_")[2]
    label = f"{kind.replace('_', ' ')} {which}".strip()
    logs = [_required(getattr(log, name))[:, k] for log in signals]
    if name == "angle":
        turn = 2 * np.pi / cycles
        label += f", {cycles} times a turn" if cycles > 1 else ""
        return label, "rad", [_wrapped(values, turn) for values in logs], turn
    if name == "torque":
        logs = [smooth(log.torque, _dt(log))[:, k] for log in signals]
        label = label if first.turns is None else "effort"
    return label, own.get(name) or UNITS[name], logs, None


def _dt(signals: Signals) -> float:
    return float(signals.time[1] - signals.time[0])


def _wrapped(values: Array, period: float) -> Array:
    return np.mod(values + period / 2, period) - period / 2


def _required(values: Array | None) -> Array:
    assert values is not None
    return values


def hats(values: Array, knots: Array, period: float | None) -> Array:
    """(N, n) weights of a line through points at the knots; the last knot of a period is the first.

    Beyond the knots the line goes on level.
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


def _fitted(
    label: str,
    unit: str,
    knots: Array,
    features: Sequence[Array],
    residual: Sequence[Array],
    table: ResidualTable,
) -> Curve:
    """Least squares, and standard errors that hold for residuals correlated within a block."""
    flexible, force = np.concatenate(features), np.concatenate(residual)
    gram = flexible.T @ flexible
    inverse = np.linalg.inv(gram + 1e-6 * np.trace(gram) * np.eye(len(gram)))
    value = inverse @ flexible.T @ force
    left = force - flexible @ value
    size = table.parts[0].block
    starts = np.arange(0, len(left), size)
    scores = np.stack([flexible[a : a + size].T @ left[a : a + size] for a in starts])
    spread = np.einsum("pq,bqa->bpa", inverse, scores)
    std = np.sqrt((spread**2).sum(axis=0))
    rare = flexible.sum(axis=0) < RARE * len(flexible)
    value[rare] = std[rare] = np.nan
    return Curve(label, unit, knots[: len(value)], value, std)
