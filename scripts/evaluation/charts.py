"""The interactive charts of an evaluation: errors by frequency and controller, torques, courses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from controllers.loop import Trace
from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.interval_charts import Spread, add_spreads, height_of, name_rows
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.evaluation.metrics import AXES
from youbot_scripts.evaluation.summary import (
    Result,
    TimeCourse,
    bands_of,
    controllers_of,
    models_of,
)

UNITS = ("m/s", "m/s", "rad/s")

COLOURS = ("#e0691f", "#d99a00", "#2aa876", "#56b4e9", "#3d8fd1", "#cc79a7", "#8f8f8f", "#a6761d")
"""Of the controllers, in their order: Okabe and Ito's (2008), as they stand on black and white."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "star", "cross", "x")

DASHES = ("dash", "dot", "dashdot")
"""Lines of all models but the last one, beginning with the last but one."""

MOST_LEGEND = 4
"""Names in a legend that stands on one line of a screen, and on two of a phone."""

COSTS = (
    ("effort", "torque, rms [N m]", 1.0),
    ("torque_rate", "rate of the torque, rms [N m/s]", 1.0),
    ("saturation", "time at a torque limit [%]", 100.0),
    ("position_drift", "drift in the end [m]", 1.0),
)
"""Metric, its words (short: a phone's width) and the factor from its unit."""

COURSE_BINS = 500
"""Stretches of a line over time: sixty lines of them are 0.6 MB of a page."""


def colours(names: Sequence[str]) -> dict[str, str]:
    """One colour for each controller, in their order."""
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def frequency_chart(name: str, group: Sequence[Result]) -> Chart:
    """Normalised RMSE over the bands on one plant, an axis a panel; bars: 95 % over seeds.

    Where controllers were built on several models, the last one's lines are solid.
    """
    names = controllers_of(group)
    height = look.TOP + look.BOTTOM + 3 * 240 + 26 * (len(names) // MOST_LEGEND)
    figure = look.rows_figure(3, height, AXES)
    for row, axis in enumerate(AXES, start=1):
        for k, (model, dash) in enumerate(_dashes(group).items()):
            for n, controller in enumerate(names):
                mine = [r for r in group if (r.controller, r.place["model"]) == (controller, model)]
                first = row == 1 and k == len(models_of(group)) - 1
                figure.add_trace(_curve(mine, axis, n, len(names), dash, first), row=row, col=1)
        figure.update_yaxes(title_text="error [%]", row=row, col=1)
    edges = sorted({edge for result in group for edge in result.band})
    figure.update_xaxes(
        type="log", tickvals=edges, ticktext=[f"{edge:g}" for edge in edges],
        range=[math.log10(0.85 * edges[0]), math.log10(1.18 * edges[-1])],
    )  # fmt: skip
    figure.update_xaxes(title_text="reference frequency [rad/s]", row=3, col=1)
    errors = [100 * result.mean(f"nrmse {axis}") for result in group for axis in AXES]
    # Intervals reach down to a tenth of a mean, see `_curve`.
    ticks = look.log_axis([*errors, *(0.1 * error for error in errors)])
    labels = {key: ticks[key] for key in ("type", "tickvals", "ticktext")}
    figure.update_yaxes(**labels, zeroline=False)
    return Chart(name, "Tracking error against reference frequency", figure, height)


def _dashes(group: Sequence[Result]) -> dict[str, str]:
    """Line of each model: the last one's is solid."""
    *others, last = models_of(group)
    broken = {model: DASHES[k % len(DASHES)] for k, model in enumerate(reversed(others))}
    return {model: broken[model] for model in others} | {last: "solid"}


def _curve(
    results: Sequence[Result], axis: str, place: int, count: int, dash: str, legend: bool
) -> Any:
    ordered = sorted(results, key=lambda result: result.band)
    # A factor, not a shift: the axis is logarithmic.
    beside = 1.0 + 0.03 * (place - (count - 1) / 2)
    mean = np.array([100 * r.mean(f"nrmse {axis}") for r in ordered])
    half = np.array([100 * r.half(f"nrmse {axis}") for r in ordered])
    name, colour = look.safe(ordered[0].controller), COLOURS[place % len(COLOURS)]
    model = look.safe(ordered[0].place["model"])
    return look.plotly().Scatter(
        x=[beside * math.sqrt(r.band[0] * r.band[1]) for r in ordered],
        y=[None if math.isnan(value) else value for value in mean.tolist()],
        # A logarithmic axis cannot show an interval that reaches zero.
        error_y={
            "type": "data", "symmetric": False, "thickness": 1.2, "width": 3,
            "array": np.nan_to_num(half).tolist(),
            "arrayminus": np.nan_to_num(np.minimum(half, 0.9 * mean)).tolist(),
        },
        text=[
            f"{name} on {model}, {r.band[0]:g}-{r.band[1]:g} rad/s<br>{axis}: {_told(m, h)}"
            for r, m, h in zip(ordered, mean.tolist(), half.tolist(), strict=True)
        ],
        mode="lines+markers", name=name, legendgroup=name, showlegend=legend,
        line={"color": colour, "width": 1.5, "dash": dash},
        marker={
            "symbol": SYMBOLS[place % len(SYMBOLS)] + ("" if dash == "solid" else "-open"),
            "size": 7, "color": colour,
        },
        hovertemplate="%{text}<extra></extra>",
    )  # fmt: skip


def _told(mean: float, half: float) -> str:
    return f"{mean:.3g} %" + (f" ± {half:.2g} %" if half else "")


def controllers_chart(name: str, group: Sequence[Result]) -> Chart:
    """Mean normalised RMSE of one condition, a row a controller and a mark a band."""
    names, bands = controllers_of(group), bands_of(group)
    height = height_of(len(names), 1, len(bands))
    figure = look.rows_figure(1, height)
    _marks(figure, 1, group, "nrmse", 100.0, "%", legend=True)
    means = [(100 * result.mean("nrmse"), 100 * result.half("nrmse")) for result in group]
    # A logarithmic axis cannot show an interval that reaches zero: it runs out of the chart.
    ends = [end for mean, half in means for end in (max(mean - half, 0.1 * mean), mean + half)]
    figure.update_xaxes(**look.log_axis(ends), title_text="error [%]", row=1, col=1)
    lost = {r.controller for r in group if r.diverged}
    shown = [f"{one} (diverges)" if one in lost else one for one in names]
    name_rows(figure, 1, shown)
    title = "Tracking error by controller, with 95 % intervals"
    return Chart(name, title, figure, height)


def costs_chart(name: str, group: Sequence[Result]) -> Chart:
    """What the tracking costs: torque, its rate, saturation; and the drift that is left."""
    names, bands = controllers_of(group), bands_of(group)
    height = height_of(len(names), len(COSTS), len(bands))
    figure = look.rows_figure(len(COSTS), height, [words for _, words, _ in COSTS], shared=False)
    for row, (metric, _, factor) in enumerate(COSTS, start=1):
        _marks(figure, row, group, metric, factor, "", legend=row == 1)
        name_rows(figure, row, names)
    figure.update_xaxes(rangemode="tozero", matches=None, showticklabels=True)
    return Chart(name, "Torque use and drift by controller, with 95 % intervals", figure, height)


def _marks(
    figure: Any, row: int, group: Sequence[Result], metric: str, factor: float, unit: str,
    *, legend: bool,
) -> None:  # fmt: skip
    names, bands = controllers_of(group), bands_of(group)
    by_key = {(result.controller, result.band): result for result in group}
    for k, band in enumerate(bands):
        spreads = []
        for name in names:
            result = by_key[name, band]
            mean, half = factor * result.mean(metric), factor * result.half(metric)
            # A share or a size is never below zero, however wide Student's interval is.
            low, high = (max(mean - half, 0.02 * mean), mean + half) if half else (None, None)
            spreads.append(Spread(name, mean, low, high))
        series = f"{band[0]:g} to {band[1]:g} rad/s"
        mark = {"color": COLOURS[k % len(COLOURS)], "symbol": SYMBOLS[k % len(SYMBOLS)]}
        beside = 0.7 * ((k + 0.5) / len(bands) - 0.5)
        add_spreads(figure, row, spreads, series, mark, beside=beside, legend=legend, unit=unit)


def course_chart(name: str, title: str, traces: Mapping[str, Trace], names: Sequence[str]) -> Chart:
    """Reference and true twist over time, and under each axis the error; one time axis.

    Parameters
    ----------
    traces : by controller, all along one reference
    names : of all controllers, in the order that gives them their colours
    """
    height, of = 110 + 3 * 250, colours(list(dict.fromkeys([*names, *traces])))
    traces = {one: traces[one] for one in of if one in traces}  # in one order on all charts
    figure = look.rows_figure(6, height)
    longest = max(traces.values(), key=lambda trace: len(trace.time))
    for axis in range(3):
        top, strip, first = 2 * axis + 1, 2 * axis + 2, axis == 0
        wanted = longest.reference[:, axis]
        look.add_line(
            figure, top, longest.time, wanted, "reference", look.MEASURED,
            bins=COURSE_BINS, legend=first,
        )  # fmt: skip
        for controller, trace in traces.items():
            line = {"color": of[controller], "width": 1.2}
            said = look.safe(controller) + (" (diverges)" if trace.diverged is not None else "")
            error = trace.twist[:, axis] - trace.reference[:, axis]
            for row, values in ((top, trace.twist[:, axis]), (strip, error)):
                look.add_line(
                    figure, row, trace.time, values, said, line,
                    bins=COURSE_BINS, legend=first and row == top,
                )  # fmt: skip
        # What diverges would press the others flat; it can be zoomed out to.
        reach = 1.6 * max(float(np.abs(wanted).max()), 1e-3)
        figure.update_yaxes(
            title_text=f"{AXES[axis]} [{UNITS[axis]}]", range=[-reach, reach], row=top, col=1
        )
        figure.update_yaxes(title_text=f"error [{UNITS[axis]}]", row=strip, col=1)
    figure.update_xaxes(title_text="time [s]", row=6, col=1)
    return Chart(name, title, figure, height)


def torques_chart(
    name: str, title: str, traces: Mapping[str, Trace], names: Sequence[str]
) -> Chart:
    """Commanded torque of each wheel over time, with the limits."""
    of = colours(list(dict.fromkeys([*names, *traces])))
    traces = {one: traces[one] for one in of if one in traces}
    height = 110 + 4 * 150
    figure = look.rows_figure(4, height)
    for k, wheel in enumerate(WHEELS):
        for controller, trace in traces.items():
            line = {"color": of[controller], "width": 1.0}
            look.add_line(
                figure, k + 1, trace.time, trace.command[:, k], look.safe(controller), line,
                bins=COURSE_BINS, legend=k == 0,
            )  # fmt: skip
        limit = max(trace.torque_limit for trace in traces.values())
        most = max(float(np.abs(trace.command[:, k]).max(initial=0.0)) for trace in traces.values())
        for side in (-limit, limit) if most > 0.7 * limit else ():
            look.add_horizontal(figure, k + 1, side)
        figure.update_yaxes(title_text=f"{wheel} [N m]", row=k + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=4, col=1)
    return Chart(name, title, figure, height)


def course_charts(number: int, course: TimeCourse, names: Sequence[str]) -> Iterator[Chart]:
    """What the closed loops of one condition did over time."""
    title = f"Reference and response over time: {course.reference}"
    yield course_chart(f"course_{number}", title, course.traces, names)
    title = f"Torques of the wheels over time: {course.reference}"
    yield torques_chart(f"torques_{number}", title, course.traces, names)
