"""Figures of a result: one after another, or written into a folder, PNG and SVG (extra: plots)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.comparison import Comparison, LogComparison
from identification.diagnosis.report import Diagnosis
from identification.figures import failures as failure_figures, time_series as figures
from identification.figures.style import MAX_CURVES, percent, write_figures
from identification.fitting.errors import SumsOfSquares, force_traces
from identification.fitting.identify import Identification
from identification.logs.log import Log
from identification.logs.recorded_motion import recorded_motion
from identification.mechanisms.mechanism import ParameterLabel
from identification.mechanisms.quantities import Quantities
from identification.mechanisms.registry import AnyModel, quantities_of
from identification.residual_map.curves import Curve
from identification.residual_map.shares import ResidualMap
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion, MotionSequence
from youbot_env.motions.multisine import Multisine
from youbot_env.physics.geometry import WHEELS, Geometry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Named = Iterator[tuple[str, "Figure"]]

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
    """Write :func:`figures_of_identification` as PNG and SVG files; return the PNGs' paths.

    Parameters
    ----------
    folder : made if missing

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    return write_figures(folder, figures_of_identification(result, logs, truth))


def plot_comparison(
    result: Comparison, folder: str | Path, geometry: Geometry | None = None
) -> list[Path]:
    """Write :func:`figures_of_comparison` as PNG and SVG files; return the PNGs' paths.

    Parameters
    ----------
    folder : made if missing

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    return write_figures(folder, figures_of_comparison(result, geometry))


def plot_diagnosis(result: Diagnosis, folder: str | Path) -> list[Path]:
    """Write :func:`figures_of_diagnosis` as PNG and SVG files; return the PNGs' paths.

    Parameters
    ----------
    folder : made if missing

    Raises
    ------
    InputError
        If matplotlib is not installed or a file cannot be written.
    """
    return write_figures(folder, figures_of_diagnosis(result, result.model))


def figures_of_identification(
    result: Identification, logs: Sequence[Log] = (), truth: Model | None = None
) -> Named:
    """Names and figures of an identification.

    forces_LOG: measured and predicted forces; motion_LOG: velocities, beside the ideal ones where a
    record.json beside the log tells them (tracking_LOG, if that is a multisine); estimates: the
    recursive estimator's course.

    Parameters
    ----------
    logs : those of the result, for their references
    truth : true parameters, if they are known
    """
    marks, by_name = {}, {log.name: log for log in logs}
    shown = quantities_of(result.model)
    for samples, floor in zip(result.samples, result.floor.force, strict=True):
        name, log = samples.name, by_name.get(samples.name)
        motion = _reference(log)
        start = log.time[0] if log else 0.0
        marks[name] = _stretches(result, name, motion, start)
        yield f"forces_{name}", _force_figure(result, samples, floor, marks[name], shown)
        ideal = None if motion is None else motion.twist(samples.time + start)
        speed = result.mechanism.measured_speed(samples) * shown.speed_scale
        if isinstance(motion, Multisine) and ideal is not None:
            figure = figures.tracking_figure(samples.time, speed, ideal, name=name)
            yield f"tracking_{name}", figure
        else:
            figure = figures.motion_figure(
                samples.time, speed, ideal,
                name=name, stretches=marks[name], velocities=shown.speeds,
            )  # fmt: skip
            yield f"motion_{name}", figure
    if result.course is not None:
        yield "estimates", _estimates_figure(result, marks, truth)


def _reference(log: Log | None) -> Motion | None:
    """The motion that a platform was asked to follow, if it is known."""
    return recorded_motion(log) if log is not None and log.joints == WHEELS else None


def _stretches(
    result: Identification, name: str, motion: Motion | None, start: float
) -> list[figures.Stretch]:
    """Motions of a log: those that were driven, or else those that it looks like."""
    if isinstance(motion, MotionSequence):
        return [(what, max(a - start, 0.0), b - start) for what, a, b in motion.segments()]
    merged: list[figures.Stretch] = []
    for part in result.parts:
        if part.log != name or part.kind in ("free", "run"):
            continue
        if merged and merged[-1][0] == part.kind:
            merged[-1] = (part.kind, merged[-1][1], part.end)
        else:
            merged.append((part.kind, part.start, part.end))
    return merged


def _force_figure(
    result: Identification,
    samples: Any,
    floor: SumsOfSquares,
    stretches: Sequence[figures.Stretch],
    shown: Quantities,
) -> Figure:
    mechanism, theta = result.mechanism, result.fit.theta
    traces = force_traces(mechanism, theta, samples)
    return figures.force_figure(
        traces, floor, name=samples.name, stretches=stretches, forces=shown.forces
    )


def _estimates_figure(
    result: Identification, marks: dict[str, list[figures.Stretch]], truth: Model | None
) -> Figure:
    assert result.course is not None
    free, mechanism = result.force.free, result.mechanism
    # The recursive estimator's time runs through all logs, one after another.
    starts = np.cumsum([0.0, *(item.time[-1] for item in result.samples)])
    stretches = [
        (kind, start + a, start + b)
        for item, start in zip(result.samples, starts, strict=False)
        for kind, a, b in marks[item.name]
    ]
    known = truth is not None and truth.structure == mechanism.structure
    return figures.estimates_figure(
        result.course,
        [_axis_label(mechanism.labels[k], mechanism.structure.effects) for k in free],
        result.force.theta[free],
        stretches=stretches,
        truth=truth.theta[free] if truth is not None and known else None,
    )


def _axis_label(label: ParameterLabel, effects: Sequence[str]) -> str:
    added = label.component in effects
    symbol = f"{label.component}\n{label.name}" if added else SYMBOLS.get(label.name, label.name)
    return f"{symbol}  [{label.parameter.unit.replace('^2', '²')}]"


def figures_of_comparison(result: Comparison, geometry: Geometry | None = None) -> Named:
    """Names and figures of a comparison.

    free_run_LOG: measured and predicted velocities; where_LOG: force error by stretch;
    tracking_LOG: reference and response, where a record.json beside the log tells the reference;
    residual: the residual over the variables that it depends on most, if any.

    Parameters
    ----------
    geometry : the one that was compared with, if not the model's own
    """
    worst, shown = result.worst(), quantities_of(result.model, geometry)
    for item in result.logs:
        name = item.log.name
        yield (
            f"free_run_{name}",
            figures.free_run_figure(
                item.velocity, item.velocity_floor, name=name, quantities=shown
            ),
        )
        yield (
            f"where_{name}",
            failure_figures.stretch_figure(
                result.stretches(item),
                [row for row in worst if row["log"] == name],
                item.force_floor,
                name=name,
                forces=shown.forces,
            ),
        )
        yield from _tracking(item, shown)
    yield from figures_of_residual(result.where, result.model)


def figures_of_diagnosis(result: Diagnosis, model: AnyModel) -> Named:
    """Names and figures of a diagnosis.

    errors: held out, as they fall, with a proposed law at the end; residual, remaining: what is
    left of the forces before and after the accepted effects, over the variables that it depends on
    most.

    Parameters
    ----------
    model : that was given, or found: their axes are the same
    """
    steps = [(step.effect, step.force_error, step.velocity_error) for step in result.steps]
    proposed = result.proposal and result.proposal.step
    yield "errors", failure_figures.fall_figure(steps, result.noise_floor, proposed)
    for name, found in zip(("residual", "remaining"), result.maps, strict=False):
        yield from figures_of_residual(found, model, name)


def figures_of_residual(found: ResidualMap, model: AnyModel, name: str = "residual") -> Named:
    """The residual over the variables that it depends on most, if it depends on any."""
    rows = _strongest_curves(found)
    if rows:
        yield name, failure_figures.residual_figure(rows, quantities_of(model).forces)


def _strongest_curves(found: ResidualMap) -> list[tuple[str, Curve]]:
    """Titles and curves of the variables with the largest shares, at most MAX_CURVES of them."""
    shares = {share.variable: share.share for share in found.shares}
    rows = [
        (f"{variable}: {percent(shares[variable])}", curve)
        for variable in found.leading[:MAX_CURVES]
        for curve in found.curve(variable)
    ]
    return rows[:MAX_CURVES]


def _tracking(item: LogComparison, shown: Quantities) -> Named:
    motion = _reference(item.log)
    if isinstance(motion, Multisine):
        twist = item.velocity.measured * shown.speed_scale
        reference = motion.twist(item.log.time)
        figure = figures.tracking_figure(item.velocity.time, twist, reference, name=item.log.name)
        yield f"tracking_{item.log.name}", figure
