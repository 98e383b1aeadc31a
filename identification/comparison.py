"""Model against measurements: errors by log and axis, noise floors, and the worst stretches."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import (
    NoiseLevel,
    Squares,
    Traces,
    add_up,
    force_floor,
    force_traces,
    velocity_floor,
    velocity_traces,
)
from identification.logs import Log
from identification.mecanum import Mecanum
from identification.noise import white_noise
from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_env.geometry import WHEELS, Geometry
from youbot_env.model import Model

Array = NDArray[np.float64]

WINDOW = 5.0
"""Seconds of a stretch that `where` judges."""

WORST = 8
"""Stretches that `where` lists."""


@dataclass(frozen=True)
class LogComparison:
    """One log beside the model's predictions."""

    log: Log
    seen_in_fit: bool
    force: Traces
    velocity: Traces
    force_floor: Squares
    velocity_floor: Squares
    wheel_speed: Array


@dataclass(frozen=True)
class Comparison:
    """Result of :func:`compare`."""

    model: Model
    logs: tuple[LogComparison, ...]

    @property
    def counted(self) -> tuple[LogComparison, ...]:
        """Logs in the totals: those that the fit has not seen, or all if it has seen all."""
        unseen = tuple(item for item in self.logs if not item.seen_in_fit)
        return unseen or self.logs

    def to_dict(self) -> dict[str, Any]:
        """JSON form, as the design fixes it."""
        counted = self.counted
        return {
            "logs": {item.log.name: _log_dict(item) for item in self.logs},
            "total": {
                "force_error": add_up(Squares.of(item.force) for item in counted).ratio,
                "velocity_error": add_up(Squares.of(item.velocity) for item in counted).ratio,
            },
            "noise_floor": {
                "force_error": add_up(item.force_floor for item in counted).ratio,
                "velocity_error": add_up(item.velocity_floor for item in counted).ratio,
            },
            "where": self.worst(),
        }

    def worst(self) -> list[dict[str, Any]]:
        """Stretches with the largest shares of all squared force residual, worst first."""
        found = []
        for item in self.logs:
            found += stretches_of(item)
        everything = sum(row["square"] for row in found)
        for row in found:
            row["share"] = row.pop("square") / everything if everything > 0 else 0.0
        return sorted(found, key=lambda row: -row["share"])[:WORST]


def _log_dict(item: LogComparison) -> dict[str, Any]:
    force, velocity = Squares.of(item.force), Squares.of(item.velocity)
    return {
        "force_error": force.ratio,
        "velocity_error": velocity.ratio,
        "force_error_by_axis": dict(zip(Mecanum.axes, force.by_axis.tolist(), strict=True)),
        "velocity_error_by_axis": dict(zip(Mecanum.axes, velocity.by_axis.tolist(), strict=True)),
        "noise_floor": {
            "force_error": item.force_floor.ratio,
            "velocity_error": item.velocity_floor.ratio,
        },
        "seen_in_fit": item.seen_in_fit,
    }


def stretches_of(item: LogComparison) -> list[dict[str, Any]]:
    """Force error and squared residual of each axis in each stretch of one log, in time's order."""
    time, square = item.force.time, item.force.residual**2
    edges = np.arange(time[0], time[-1], WINDOW)
    rows = np.searchsorted(time, [*edges, np.inf])
    return [
        {
            "log": item.log.name,
            "axis": axis,
            "from": float(time[a]),
            "to": float(time[b - 1]),
            "force_error": float(np.sqrt(square[a:b, k].mean() / measured[k])),
            "square": float(square[a:b, k].sum()),
        }
        for measured in [(item.force.measured**2).mean(axis=0) + 1e-300]
        for a, b in zip(rows, rows[1:], strict=False)
        for k, axis in enumerate(Mecanum.axes)
        if b > a
    ]


def compare(
    model: Model,
    logs: Sequence[Log],
    *,
    geometry: Geometry | None = None,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
) -> Comparison:
    """Errors of a model on logs, with predictions; nothing is fitted.

    Parameters
    ----------
    geometry : replaces the model's own
    seed : of the noise floor's random numbers

    Raises
    ------
    InputError
        If no log is given, or the free run diverges.
    """
    if not logs:
        raise InputError("no log given: compare needs at least one")
    mechanism = Mecanum(geometry or model.geometry, model.structure)
    seen = {log.get("sha256") for log in model.logs}
    found = []
    for log in logs:
        found.append(_compare_one(mechanism, model, log, log.sha256 in seen, seed))
        progress()
    return Comparison(model, tuple(found))


def _compare_one(
    mechanism: Mecanum, model: Model, log: Log, seen: bool, seed: int
) -> LogComparison:
    theta, samples = model.theta, mechanism.samples(log)
    noise = NoiseLevel(white_noise(log.velocity), white_noise(log.effort))
    velocity = velocity_traces(mechanism, theta, samples)
    if not np.isfinite(velocity.predicted).all():
        raise InputError(f"{log.source or log.name}: the model's free run diverges on this log")
    force = force_traces(mechanism, theta, samples)
    twist = velocity.predicted / mechanism.speed_scale
    return LogComparison(
        log=log,
        seen_in_fit=bool(log.sha256) and seen,
        force=force,
        velocity=velocity,
        force_floor=force_floor(mechanism, theta, samples, force, noise, seed),
        velocity_floor=velocity_floor(mechanism, theta, samples, velocity, noise, seed),
        wheel_speed=mechanism.geometry.wheel_speeds(twist),
    )


def write_predictions(path: str | os.PathLike[str], item: LogComparison) -> None:
    """Write the free run's wheel speeds [rad/s] as CSV: time as it stands in the log's file.

    One row per row of that file, also where rows were repaired or resampled.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    log = item.log
    time = log.file_time.tolist()
    speeds = np.column_stack(
        [np.interp(time, log.time, item.wheel_speed[:, k]) for k in range(len(WHEELS))]
    )
    lines = [",".join(["time", *(f"velocity_{wheel}" for wheel in WHEELS)])]
    # repr keeps every digit of a time stamp; speeds to a nanoradian per second are plenty.
    lines += [
        f"{t!r},{row[0]:.9f},{row[1]:.9f},{row[2]:.9f},{row[3]:.9f}"
        for t, row in zip(time, speeds.tolist(), strict=True)
    ]
    write_atomically(path, "\n".join(lines) + "\n")
