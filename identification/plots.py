"""Figures of a result, written as PNG files into a folder (extra: plots)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification import figures
from identification.comparison import Comparison, LogComparison, stretches_of
from identification.errors import NoiseLevel, force_floor, force_traces
from identification.fitting import Identification
from identification.logs import Log
from identification.mecanum import Label, Samples
from identification.noise import white_noise
from identification.plot_style import matplotlib, percent, write_figure
from identification.references import recorded_motion
from identification.residual_curves import Curve
from youbot_env.errors import InputError
from youbot_env.geometry import Geometry
from youbot_env.model import Model
from youbot_env.motions import Motion, MotionSequence, Multisine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Named = Iterator[tuple[str, "Figure"]]

CURVES = 5
"""Curves in the figure of the residual."""

SYMBOLS = {
    "m0": "$m_0$", "I0": "$I_0$", "I1": "$I_1$", "m_aX": "$m\\,a_X$", "m_aY": "$m\\,a_Y$",
    "mu1": r"$\mu_1$", "mu2": r"$\mu_2$",
}  # fmt: skip


def plot_identification(
    result: Identification,
    folder: str | Path,
    logs: Sequence[Log] = (),
    truth: Model | None = None,
) -> list[Path]:
    """Write the figures of an identification and return their paths.

    forces_LOG.png: measured and predicted forces; motion_LOG.png: velocities, beside the ideal ones
    where a record.json beside the log tells them (tracking_LOG.png, if that is a multisine);
    estimates.png: the recursive estimator's course.

    Parameters
    ----------
    folder : made if missing
    logs : those of the result, for their references
    truth : true parameters, if they are known

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    return _write(_of_identification(result, {log.name: log for log in logs}, truth), folder)


def plot_comparison(
    result: Comparison, folder: str | Path, geometry: Geometry | None = None
) -> list[Path]:
    """Write the figures of a comparison and return their paths.

    free_run_LOG.png: measured and predicted velocities; where_LOG.png: force error by stretch;
    tracking_LOG.png: reference and response, where a record.json beside the log tells the
    reference; residual.png: the residual over the variables that it depends on most, if any.

    Parameters
    ----------
    folder : made if missing
    geometry : the one that was compared with, if not the model's own

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    return _write(_of_comparison(result, geometry or result.model.geometry), folder)


def _write(named: Named, folder: str | Path) -> list[Path]:
    """Each figure is drawn and written before the next, so that memory holds one."""
    matplotlib()
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    return [write_figure(folder / f"{name}.png", figure) for name, figure in named]


def _of_identification(result: Identification, logs: dict[str, Log], truth: Model | None) -> Named:
    marks = {}
    for samples in result.samples:
        name, log = samples.name, logs.get(samples.name)
        motion = recorded_motion(log) if log else None
        start = log.time[0] if log else 0.0
        marks[name] = _stretches(result, name, motion, start)
        yield f"forces_{name}", _force_figure(result, samples, marks[name])
        ideal = None if motion is None else motion.twist(samples.time + start)
        if isinstance(motion, Multisine) and ideal is not None:
            figure = figures.tracking_figure(samples.time, samples.twist, ideal, name=name)
            yield f"tracking_{name}", figure
        else:
            figure = figures.motion_figure(
                samples.time, samples.twist, ideal, name=name, stretches=marks[name]
            )
            yield f"motion_{name}", figure
    if result.course is not None:
        yield "estimates", _estimates_figure(result, marks, truth)


def _stretches(
    result: Identification, name: str, motion: Motion | None, start: float
) -> list[figures.Stretch]:
    """Motions of a log: those that were driven, or else those that it looks like."""
    if isinstance(motion, MotionSequence):
        return [(what, max(a - start, 0.0), b - start) for what, a, b in motion.segments()]
    merged: list[figures.Stretch] = []
    for part in result.parts:
        if part.log != name or part.kind == "free":
            continue
        if merged and merged[-1][0] == part.kind:
            merged[-1] = (part.kind, merged[-1][1], part.end)
        else:
            merged.append((part.kind, part.start, part.end))
    return merged


def _force_figure(
    result: Identification, samples: Samples, stretches: Sequence[figures.Stretch]
) -> Figure:
    mechanism, theta = result.mechanism, result.fit.theta
    noise = NoiseLevel(white_noise(samples.wheel_speed), white_noise(samples.torque))
    traces = force_traces(mechanism, theta, samples)
    floor = force_floor(mechanism, theta, samples, traces, noise, seed=0)
    return figures.force_figure(traces, floor, name=samples.name, stretches=stretches)


def _estimates_figure(
    result: Identification, marks: dict[str, list[figures.Stretch]], truth: Model | None
) -> Figure:
    assert result.course is not None
    free, mechanism = result.force.free, result.mechanism
    starts = np.cumsum([0.0, *(item.time[-1] for item in result.samples)])
    stretches = [
        (kind, start + a, start + b)
        for item, start in zip(result.samples, starts, strict=False)
        for kind, a, b in marks[item.name]
    ]
    known = truth is not None and truth.structure == mechanism.structure
    return figures.estimates_figure(
        result.course,
        [_axis_label(mechanism.labels[k]) for k in free],
        result.force.theta[free],
        stretches=stretches,
        truth=truth.theta[free] if truth is not None and known else None,
    )


def _axis_label(label: Label) -> str:
    symbol = SYMBOLS.get(label.name, f"{label.component}\n{label.name}")
    return f"{symbol}  [{label.parameter.unit.replace('^2', '²')}]"


def _of_comparison(result: Comparison, geometry: Geometry) -> Named:
    worst = result.worst()
    for item in result.logs:
        name = item.log.name
        yield (
            f"free_run_{name}",
            figures.free_run_figure(
                item.velocity, item.velocity_floor, name=name, length=geometry.L
            ),
        )
        yield (
            f"where_{name}",
            figures.stretch_figure(
                stretches_of(item),
                [row for row in worst if row["log"] == name],
                item.force_floor,
                name=name,
            ),
        )
        yield from _tracking(item, geometry)
    rows = _strongest_curves(result)
    if rows:
        yield "residual", figures.residual_figure(rows)


def _strongest_curves(result: Comparison) -> list[tuple[str, Curve]]:
    """Titles and curves of the variables with the largest shares, at most CURVES of them."""
    shares = {share.variable: share.share for share in result.where.shares}
    rows = [
        (f"{variable}: {percent(shares[variable])}", curve)
        for variable in result.where.leading[:CURVES]
        for curve in result.where.curve(variable)
    ]
    return rows[:CURVES]


def _tracking(item: LogComparison, geometry: Geometry) -> Named:
    motion = recorded_motion(item.log)
    if isinstance(motion, Multisine):
        twist = geometry.body_twist(item.log.velocity)
        reference = motion.twist(item.log.time)
        figure = figures.tracking_figure(item.velocity.time, twist, reference, name=item.log.name)
        yield f"tracking_{item.log.name}", figure
