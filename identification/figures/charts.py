"""Interactive charts of a result, for a page or a browser: each yields named Plotly figures.

Times are seconds from a log's start; quantities as in :mod:`identification.figures.time_series`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.comparison import Comparison, LogComparison
from identification.diagnosis.addition import Addition
from identification.diagnosis.report import Diagnosis
from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.single_charts import (
    TIME,
    Line,
    errors_chart,
    motion_chart,
    plan_along,
    residual_charts,
    signals_chart,
    usual_largest,
)
from identification.fitting.errors import SumsOfSquares, Traces, force_traces, velocity_traces
from identification.fitting.identify import Identification
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.quantities import Quantities
from identification.mechanisms.registry import quantities_of
from identification.mechanisms.samples import Samples, planar_pose
from youbot_env.errors import InputError

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]
Charts = Iterator[Chart]


def charts_of_identification(result: Identification) -> Charts:
    """forces_K: measured and predicted forces of log K; estimates: the recursive estimates."""
    mechanism, theta = result.mechanism, result.fit.theta
    shown = quantities_of(result.model)
    bins = bins_of(len(result.samples), 3 * len(shown.forces))
    for k, (samples, floor) in enumerate(zip(result.samples, result.floor.force, strict=True)):
        traces = force_traces(mechanism, theta, samples)
        model = Line("model", traces.predicted, look.AFTER)
        title = f"Filtered forces: {samples.name}"
        yield signals_chart(f"forces_{k}", title, traces, [model], shown.forces, floor, bins)
    if result.course is not None:
        yield _estimates(result)


def charts_of_comparison(result: Comparison) -> Charts:
    """Of a comparison.

    free_run_K and forces_K: measured and predicted, of log K; plan_K: its way on the floor,
    coloured by the force residual; stretches: force error by stretch, of all logs; residual: over
    the variables that it depends on most.
    """
    shown = quantities_of(result.model, result.geometry)
    bins = bins_of(2 * len(result.logs), 3 * len(shown.forces))
    yield _stretches(result)
    for k, item in enumerate(result.logs):
        name = item.log.name
        run = _scaled(item.velocity, shown)
        floor = _scaled_squares(item.velocity_floor, shown)
        line = Line("free run of the model", run.predicted, look.AFTER)
        title = f"Velocities in free run: {name}"
        yield signals_chart(f"free_run_{k}", title, run, [line], shown.speeds, floor, bins)
        line = Line("model", item.force.predicted, look.AFTER)
        title = f"Filtered forces: {name}"
        yield signals_chart(
            f"forces_{k}", title, item.force, [line], shown.forces, item.force_floor, bins
        )
    yield from _plans_of_comparison(result, shown)
    yield from residual_charts([("", result.where)], shown.forces)


def charts_of_diagnosis(result: Diagnosis) -> Charts:
    """Of a diagnosis.

    errors: held out, as they fall, with a proposed law at the end; residual: of the refitted model
    over its strongest variables, with what the accepted effects explain of it; forces_K,
    free_run_K: measured and predicted of log K, before and after; plan_before_K, plan_after_K: the
    way on the floor, coloured by the force residual; next: the motion proposed.
    """
    shown, steps = quantities_of(result.model), list(result.steps)
    rows = [(step.effect, step.force_error, step.velocity_error) for step in steps]
    yield errors_chart(rows, result.noise_floor, result.proposal and result.proposal.step)
    if result.next_experiment:
        yield motion_chart(result.next_experiment)
    titles = ("refitted model", "with " + ", ".join(result.missing))
    maps = list(zip(("before", "after") if len(steps) > 1 else ("",), result.maps, strict=False))
    yield from residual_charts(maps, shown.forces, explained=True)
    ends = steps if len(steps) == 1 else [steps[0], steps[-1]]
    pairs = [(step.fitted.mechanism, step.fitted.theta) for step in ends]
    yield from _before_and_after(result.samples, pairs, titles, shown)


def charts_of_addition(result: Addition) -> Charts:
    """Of an effect that was added: the errors, and the signals before and after, as above."""
    steps = [result.before, result.after]
    rows = [(step.effect, step.force_error, step.velocity_error) for step in steps]
    yield errors_chart(rows, result.noise_floor)
    pairs = [(step.fitted.mechanism, step.fitted.theta) for step in steps]
    titles = ("refitted model", f"with {result.effect}")
    yield from _before_and_after(result.samples, pairs, titles, quantities_of(result.model))


def _before_and_after(
    logs: Sequence[Samples],
    pairs: Sequence[tuple[Mechanism, Array]],
    titles: Sequence[str],
    shown: Quantities,
) -> Charts:
    """Signals and floor plans of logs, as one model or two explain them."""
    looks = [look.AFTER] if len(pairs) == 1 else [look.BEFORE, look.AFTER]
    bins = bins_of(2 * len(logs), (2 + len(pairs)) * len(shown.forces))
    plans: list[Chart] = []
    for k, samples in enumerate(logs):
        forces = [force_traces(mechanism, theta, samples) for mechanism, theta in pairs]
        predicted = [traces.predicted for traces in forces]
        lines = [Line(*row) for row in zip(titles, predicted, looks, strict=False)]
        title = f"Filtered forces: {samples.name}"
        yield signals_chart(f"forces_{k}", title, forces[-1], lines, shown.forces, None, bins)
        runs = [_free_run(mechanism, theta, samples, shown) for mechanism, theta in pairs]
        ran = [
            (Line(title, run.predicted, how), run)
            for title, run, how in zip(titles, runs, looks, strict=False)
            if run is not None
        ]
        if ran:
            title = f"Velocities in free run: {samples.name}"
            yield signals_chart(
                f"free_run_{k}",
                title,
                ran[-1][1],
                [row[0] for row in ran],
                shown.speeds,
                None,
                bins,
            )
        if samples.pose.shape[1] == 3:
            plans += _plans(k, samples, forces, titles)
    yield from plans


def _plans(
    k: int, samples: Samples, forces: Sequence[Traces], titles: Sequence[str]
) -> list[Chart]:
    """The way of one log, coloured by what each model leaves; one scale for all."""
    most = usual_largest(forces[0])
    names = ("before", "after") if len(forces) > 1 else ("before",)
    return [
        plan_along(
            f"plan_{name}_{k}", f"{samples.name}, {title}", samples.time, samples.pose, traces, most
        )
        for name, title, traces in zip(names, titles, forces, strict=False)
    ]


def _free_run(
    mechanism: Mechanism, theta: Array, samples: Samples, shown: Quantities
) -> Traces | None:
    """Speeds in free run as people state them; None where it diverges."""
    try:
        traces = velocity_traces(mechanism, theta, samples)
    except InputError:
        return None
    return _scaled(traces, shown) if np.isfinite(traces.predicted).all() else None


def _stretches(result: Comparison) -> Chart:
    """Force error of each axis by stretch, a panel for each log; the worst are pointed out."""
    worst = {(row["log"], row["axis"], row["from"]) for row in result.worst()}
    height = 90 + 220 * len(result.logs)
    names = [look.safe(item.log.name) for item in result.logs]
    figure = look.rows_figure(len(names), height, names, shared=False)
    for row, item in enumerate(result.logs, start=1):
        for k, axis in enumerate(item.axes):
            bars = [part for part in result.stretches(item) if part["axis"] == axis]
            edge = [2.0 if (item.log.name, axis, part["from"]) in worst else 0.0 for part in bars]
            figure.add_trace(
                look.plotly().Bar(
                    x=[0.5 * (part["from"] + part["to"]) for part in bars],
                    y=[100 * part["force_error"] for part in bars], name=axis, legendgroup=axis,
                    marker={
                        "color": look.AXES[k % len(look.AXES)],
                        "line": {"color": look.WORST, "width": edge},
                    },
                    showlegend=row == 1, hovertemplate="%{y:.3g} % around %{x:.0f} s",
                ),
                row=row, col=1,
            )  # fmt: skip
        figure.update_yaxes(ticksuffix=" %", row=row, col=1)
    figure.update_xaxes(title_text=TIME, row=len(result.logs), col=1)
    title = "Force error by stretch of time"
    return Chart("stretches", title, figure, height)


def _plans_of_comparison(result: Comparison, shown: Quantities) -> Charts:
    if len(shown.speeds) != 3:
        return
    most = max(usual_largest(item.force) for item in result.logs)
    for k, item in enumerate(result.logs):
        time, pose = item.velocity.time, pose_of(item, shown)
        yield plan_along(f"plan_{k}", item.log.name, time, pose, item.force, most)


def pose_of(item: LogComparison, shown: Quantities) -> Array:
    """(N, 3) pose at the times of the free run: as logged, or integrated from the wheels."""
    if item.log.pose is not None:
        return item.log.pose
    time = item.velocity.time
    step = float((time[-1] - time[0]) / max(len(time) - 1, 1))
    return planar_pose(item.velocity.measured * shown.speed_scale, step)


def _estimates(result: Identification) -> Chart:
    """The recursive estimates over time with their band, a panel each."""
    course, free = result.course, result.force.free
    assert course is not None
    labels = [result.mechanism.labels[k] for k in free]
    height = 120 + 130 * len(labels)
    figure = look.rows_figure(len(labels), height)
    for k, item in enumerate(labels):
        value, half = course.theta[:, k], look.BAND * course.std[:, k]
        row, first = k + 1, k == 0
        ends = {"low": value - half, "high": value + half}
        for name, end in ends.items():
            figure.add_trace(
                look.plotly().Scatter(
                    x=look.compact(course.time), y=look.compact(end), mode="lines", line_width=0,
                    fill="tonexty" if name == "high" else None, fillcolor=look.FLOOR_FILL,
                    name="±1.96 std", legendgroup="band", showlegend=first and name == "high",
                    hoverinfo="skip",
                ),
                row=row, col=1,
            )  # fmt: skip
        look.add_line(
            figure, row, course.time, value, "recursive estimate", look.BEFORE,
            bins=400, legend=first,
        )  # fmt: skip
        batch = float(result.force.theta[free[k]])
        look.add_horizontal(figure, row, batch)
        settled = len(value) // 2
        low = min(float(ends["low"][settled:].min()), batch)
        high = max(float(ends["high"][settled:].max()), batch)
        pad = 0.06 * (high - low) or 1.0
        name = look.parameter(item.name, item.parameter.unit)
        figure.update_yaxes(title_text=name, range=[low - pad, high + pad], row=row, col=1)
    figure.update_xaxes(title_text="time from the first log's start [s]", row=len(labels), col=1)
    title = "Estimates over time; dashed: the batch estimate"
    return Chart("estimates", title, figure, height)


# --- what they have in common ----------------------------------------------------------------


def bins_of(charts: int, lines: int) -> int:
    """Stretches of a line, so that a page of so many charts and lines stays small."""
    return int(np.clip(look.MOST_POINTS / (2 * max(charts * lines, 1)), 80, 900))


def _scaled(traces: Traces, shown: Quantities) -> Traces:
    scale = shown.speed_scale
    return Traces(traces.time, traces.measured * scale, traces.predicted * scale)


def _scaled_squares(squares: SumsOfSquares, shown: Quantities) -> SumsOfSquares:
    scale = shown.speed_scale**2
    return SumsOfSquares(squares.residual * scale, squares.measured * scale)
