"""Interactive charts of a result, for a page or a browser: each yields named Plotly figures.

Times are seconds from a log's start; quantities as in :mod:`identification.figures.time_series`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.comparison import Comparison, LogComparison
from identification.diagnosis.report import Diagnosis
from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.style import MAX_CURVES, percent
from identification.fitting.errors import SumsOfSquares, Traces, force_traces, velocity_traces
from identification.fitting.identify import Identification
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.quantities import Quantities, Quantity
from identification.mechanisms.registry import AnyModel, quantities_of
from identification.mechanisms.samples import Samples, planar_pose
from identification.residual_map.curves import Curve
from identification.residual_map.shares import ResidualMap
from identification.signals.filters import block_mean
from youbot_env.errors import InputError
from youbot_env.motions.base import motion_from_dict
from youbot_env.physics.geometry import Geometry

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]
Charts = Iterator[Chart]

TIME = "time from the log's start [s]"


class _Line(NamedTuple):
    """Predicted signals (n, A) of one model, its name in the legend and its look."""

    name: str
    predicted: Array
    look: dict[str, Any]


def charts_of_identification(result: Identification) -> Charts:
    """forces_K: measured and predicted forces of log K; estimates: the recursive estimates."""
    mechanism, theta = result.mechanism, result.fit.theta
    shown = quantities_of(result.model)
    bins = bins_of(len(result.samples), 3 * len(shown.forces))
    for k, (samples, floor) in enumerate(zip(result.samples, result.floor.force, strict=True)):
        traces = force_traces(mechanism, theta, samples)
        model = _Line("model", traces.predicted, look.AFTER)
        title = f"Filtered forces: {samples.name}"
        yield _signals(f"forces_{k}", title, traces, [model], shown.forces, floor, bins)
    if result.course is not None:
        yield _estimates(result)


def charts_of_comparison(result: Comparison, geometry: Geometry | None = None) -> Charts:
    """Of a comparison.

    free_run_K and forces_K: measured and predicted, of log K; plan_K: its way on the floor,
    coloured by the force residual; stretches: force error by stretch, of all logs; residual: over
    the variables that it depends on most.
    """
    shown = quantities_of(result.model, geometry)
    bins = bins_of(2 * len(result.logs), 3 * len(shown.forces))
    yield _stretches(result)
    for k, item in enumerate(result.logs):
        name = item.log.name
        run = _scaled(item.velocity, shown)
        floor = _scaled_squares(item.velocity_floor, shown)
        line = _Line("free run of the model", run.predicted, look.AFTER)
        title = f"Velocities in free run: {name}"
        yield _signals(f"free_run_{k}", title, run, [line], shown.speeds, floor, bins)
        line = _Line("model", item.force.predicted, look.AFTER)
        title = f"Filtered forces: {name}"
        yield _signals(
            f"forces_{k}", title, item.force, [line], shown.forces, item.force_floor, bins
        )
    yield from _plans_of_comparison(result, shown)
    yield from residual_charts([("", result.where)], shown.forces)


def charts_of_diagnosis(result: Diagnosis, model: AnyModel) -> Charts:
    """Of a diagnosis.

    errors: held out, as they fall; residual: over its strongest variables, before and after the
    accepted effects; forces_K, free_run_K: measured and predicted of log K, before and after;
    plan_before_K, plan_after_K: the way on the floor, coloured by the force residual; next: the
    motion proposed.

    Parameters
    ----------
    model : that was given
    """
    shown, steps = quantities_of(model), list(result.steps)
    yield errors_chart(
        [(step.effect, step.force_error, step.velocity_error) for step in steps], result.noise_floor
    )
    if result.next_experiment:
        yield motion_chart(result.next_experiment)
    titles = ("refitted model", "with " + ", ".join(result.missing))
    maps = list(zip(("before", "after") if len(steps) > 1 else ("",), result.maps, strict=False))
    yield from residual_charts(maps, shown.forces)
    ends = steps if len(steps) == 1 else [steps[0], steps[-1]]
    pairs = [(step.fitted.mechanism, step.fitted.theta) for step in ends]
    yield from _before_and_after(result.samples, pairs, titles, shown)


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
        lines = [_Line(*row) for row in zip(titles, predicted, looks, strict=False)]
        title = f"Filtered forces: {samples.name}"
        yield _signals(f"forces_{k}", title, forces[-1], lines, shown.forces, None, bins)
        runs = [_free_run(mechanism, theta, samples, shown) for mechanism, theta in pairs]
        ran = [
            (_Line(title, run.predicted, how), run)
            for title, run, how in zip(titles, runs, looks, strict=False)
            if run is not None
        ]
        if ran:
            title = f"Velocities in free run: {samples.name}"
            yield _signals(
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
    most = _largest(forces[0])
    places = np.searchsorted(samples.time, forces[0].time).clip(0, len(samples) - 1)
    names = ("before", "after") if len(forces) > 1 else ("before",)
    return [
        plan_chart(
            f"plan_{name}_{k}", f"{samples.name}, {title}", samples.pose[places], traces, most
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


# --- single charts ---------------------------------------------------------------------------


def errors_chart(
    steps: Sequence[tuple[str | None, float, float]], floor: Mapping[str, float]
) -> Chart:
    """Held-out force and velocity error of each step of a diagnosis, beside the noise floor.

    Parameters
    ----------
    steps : effect (None: the refitted model), force error and velocity error
    floor : both errors by name
    """
    names = ["the model, refitted", *(f"+ {look.safe(effect or '')}" for effect, _, _ in steps[1:])]
    height = 150 + 70 * len(steps)
    floors = (floor["force_error"], floor["velocity_error"])
    titles = [
        f"{name}{f'; dotted: noise {percent(level)}' if np.isfinite(level) else ''}"
        for name, level in zip(("force error", "velocity error"), floors, strict=True)
    ]
    figure = look.rows_figure(2, height, titles, shared=False)
    of_kinds = ([step[1] for step in steps], [step[2] for step in steps])
    for row, (errors, level) in enumerate(zip(of_kinds, floors, strict=True), start=1):
        values = 100 * np.nan_to_num(errors, posinf=0.0)
        figure.add_trace(
            look.plotly().Bar(
                y=names, x=values, orientation="h", marker_color=look.BAR, showlegend=False,
                text=[percent(error) for error in errors], textposition="auto",
                hovertemplate="%{y}: %{x:.3g} %<extra></extra>",
            ),
            row=row, col=1,
        )  # fmt: skip
        if np.isfinite(level):
            look.add_vertical(figure, row, 100 * level)
    figure.update_yaxes(autorange="reversed")
    figure.update_xaxes(ticksuffix=" %", rangemode="tozero", matches=None, showticklabels=True)
    return Chart("errors", "The error as it falls, held out", figure, height)


def residual_charts(maps: Sequence[tuple[str, ResidualMap]], forces: Sequence[Quantity]) -> Charts:
    """The residual over the variables that it depends on most, of one model or of two.

    Parameters
    ----------
    maps : name of a model and its residual map; the first one chooses the variables
    """
    rows = _strongest(maps)
    if not rows:
        return
    height = 90 + 250 * len(rows)
    figure = look.rows_figure(len(rows), height, [title for title, _ in rows], shared=False)
    dashes = ("dot", "solid")[-len(maps) :]
    for row, (_, curves) in enumerate(rows, start=1):
        for curve, (name, _), dash in zip(curves, maps, dashes, strict=True):
            if curve is not None:
                _add_curve(figure, row, curve, forces, name, dash)
        first = next(curve for curve in curves if curve is not None)
        unit = f" [{first.unit}]" if first.unit else ""
        figure.update_xaxes(title_text=f"{look.safe(first.label)}{unit}", row=row, col=1)
        figure.update_yaxes(title_text=f"[{forces[0][1]}]", row=row, col=1)
    title = "Force residual over the variables that it depends on most"
    yield Chart("residual", title, figure, height)


def _strongest(
    maps: Sequence[tuple[str, ResidualMap]],
) -> list[tuple[str, list[Curve | None]]]:
    """Title of each of the first map's strongest curves, and this curve in every map."""
    first = maps[0][1]
    shares = {share.variable: share.share for share in first.shares}
    found: list[tuple[str, list[Curve | None]]] = []
    for variable in first.leading[:MAX_CURVES]:
        title = f"{look.safe(variable)}: {percent(shares[variable])} of the residual"
        of_each = [
            residual_map.curve(variable) if variable in _variables(residual_map) else []
            for _, residual_map in maps
        ]
        for k in range(len(of_each[0])):
            found.append((title, [curves[k] if k < len(curves) else None for curves in of_each]))
    return found[:MAX_CURVES]


def _variables(residual_map: ResidualMap) -> set[str]:
    return {share.variable for share in residual_map.shares}


def _add_curve(
    figure: Figure, row: int, curve: Curve, forces: Sequence[Quantity], model: str, dash: str
) -> None:
    """A residual over a variable: a line for each axis, with bars that hold 95 %."""
    for k, (symbol, unit) in enumerate(forces):
        name = f"{look.symbol(symbol)}{', ' if model else ''}{look.safe(model)}"
        figure.add_trace(
            look.plotly().Scatter(
                x=look.compact(curve.at), y=look.compact(curve.force[:, k]), name=name,
                mode="lines+markers", marker_size=4, legendgroup=name, showlegend=row == 1,
                line={"color": look.AXES[k % len(look.AXES)], "width": 1.5, "dash": dash},
                error_y={
                    "array": look.compact(look.BAND * curve.std[:, k]), "thickness": 0.8, "width": 0
                },
                hovertemplate=f"%{{y:.3g}} {unit} at %{{x:.3g}}",
            ),
            row=row, col=1,
        )  # fmt: skip


def plan_chart(name: str, title: str, pose: Array, traces: Traces, most: float) -> Chart:
    """A run seen from above: place [m] in the world, coloured by the size of the force residual.

    Parameters
    ----------
    pose : (n, 3) at the traces' times
    most : [N m] the colour scale's end
    """
    size = max(1, len(pose) // look.PLAN_POINTS)
    x, y = block_mean(pose[:, :2], size).T
    left = np.sqrt(block_mean((traces.residual**2).mean(axis=1, keepdims=True), size))[:, 0]
    time = block_mean(traces.time[:, None], size)[:, 0]
    figure = look.finished(look.plotly().Figure(), look.PLAN_HEIGHT)
    figure.add_trace(
        look.plotly().Scatter(
            x=look.compact(x), y=look.compact(y), customdata=look.compact(time), mode="markers",
            marker={
                "color": look.compact(left), "colorscale": look.SCALE, "cmin": 0.0, "cmax": most,
                "size": 5, "showscale": True,
                "colorbar": {"title": "[N m]", "thickness": 12, "len": 0.9},
            },
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{marker.color:.3g} N m at "
            "%{customdata:.1f} s<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text="x [m]")
    figure.update_yaxes(title_text="y [m]", scaleanchor="x", scaleratio=1)
    return Chart(name, f"Floor plan, force residual: {title}", figure, look.PLAN_HEIGHT)


def motion_chart(proposed: Mapping[str, Any]) -> Chart:
    """The twist of a proposed motion over time."""
    motion = motion_from_dict(proposed["motion"])
    time = np.linspace(0.0, motion.duration, 1200)
    twist = motion.twist(time)
    quantities = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$W$", "rad/s"))
    figure = look.rows_figure(len(quantities), 480)
    for row, quantity in enumerate(quantities, start=1):
        look.add_line(
            figure, row, time, twist[:, row - 1], "set point", look.REFERENCE,
            bins=600, legend=row == 1,
        )  # fmt: skip
        figure.update_yaxes(title_text=look.label(quantity), row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    return Chart("next", f"Next experiment: motion {proposed['name']}", figure, 480)


def _signals(
    name: str,
    title: str,
    traces: Traces,
    lines: Sequence[_Line],
    quantities: Sequence[Quantity],
    floor: SumsOfSquares | None,
    bins: int,
) -> Chart:
    """For each axis measured and predicted, and under it what each model leaves; one time axis."""
    count = len(quantities)
    height = 110 + 240 * count
    figure = look.rows_figure(2 * count, height)
    for k, quantity in enumerate(quantities):
        top, strip, first = 2 * k + 1, 2 * k + 2, k == 0
        measured = traces.measured[:, k]
        look.add_line(
            figure, top, traces.time, measured, "measured", look.MEASURED, bins=bins, legend=first
        )
        for line in lines:
            predicted = line.predicted[:, k]
            look.add_line(
                figure, top, traces.time, predicted, look.safe(line.name), line.look,
                bins=bins, legend=first,
            )  # fmt: skip
            look.add_line(
                figure, strip, traces.time, measured - predicted, look.safe(line.name),
                {**line.look, "width": 0.9}, bins=bins, legend=False,
            )  # fmt: skip
        if floor is not None:
            half = look.half_band(float(floor.residual[k]), len(traces.time))
            look.add_band(figure, strip, half)
        figure.update_yaxes(title_text=look.label(quantity), row=top, col=1)
        figure.update_yaxes(title_text=f"Δ [{quantity[1]}]", row=strip, col=1)
    figure.update_xaxes(title_text=TIME, row=2 * count, col=1)
    return Chart(name, title, figure, height)


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
    most = max(_largest(item.force) for item in result.logs)
    for k, item in enumerate(result.logs):
        pose = _pose(item, shown)
        places = np.searchsorted(item.velocity.time, item.force.time).clip(0, len(pose) - 1)
        yield plan_chart(f"plan_{k}", item.log.name, pose[places], item.force, most)


def _pose(item: LogComparison, shown: Quantities) -> Array:
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
        name = f"{look.safe(item.name)} [{item.parameter.unit}]"
        figure.update_yaxes(title_text=name, range=[low - pad, high + pad], row=row, col=1)
    figure.update_xaxes(title_text="time from the first log's start [s]", row=len(labels), col=1)
    title = "Estimates over time; dashed: the batch estimate"
    return Chart("estimates", title, figure, height)


# --- what they have in common ----------------------------------------------------------------


def bins_of(charts: int, lines: int) -> int:
    """Stretches of a line, so that a page of so many charts and lines stays small."""
    return int(np.clip(look.MOST_POINTS / (2 * max(charts * lines, 1)), 80, 900))


def _largest(traces: Traces) -> float:
    """Size [N m] of the force residual that hardly any sample exceeds."""
    return float(np.quantile(np.sqrt((traces.residual**2).mean(axis=1)), 0.98))


def _scaled(traces: Traces, shown: Quantities) -> Traces:
    scale = shown.speed_scale
    return Traces(traces.time, traces.measured * scale, traces.predicted * scale)


def _scaled_squares(squares: SumsOfSquares, shown: Quantities) -> SumsOfSquares:
    scale = shown.speed_scale**2
    return SumsOfSquares(squares.residual * scale, squares.measured * scale)
