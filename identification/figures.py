"""The paper's figures and those of a comparison, each from results to a matplotlib Figure.

Times are seconds from the log's start. Forces are (L F_X, L F_Y, M_W) [N m], filtered; velocities
(VX, VY, W) [m/s, m/s, rad/s]. Long lines are thinned for drawing, extremes kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification import plot_style as look
from identification.errors import Squares, Traces
from identification.plot_style import percent, styled
from identification.recursive import Course
from identification.residual_curves import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Stretch = tuple[str, float, float]
"""Name, start and end [s] of a part of a log that a figure names."""

TIME = "time from the log's start [s]"
FORCES = ((r"$L\,F_X$", "N m"), (r"$L\,F_Y$", "N m"), ("$M_W$", "N m"))
VELOCITIES = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$W$", "rad/s"))
"""Symbol and unit of each axis."""

BAND = 1.96
"""Standard deviations either side that hold 95 % of normal noise."""


@styled
def force_figure(
    traces: Traces, floor: Squares, *, name: str, stretches: Sequence[Stretch] = ()
) -> Figure:
    """The paper's figure 7: measured and predicted filtered forces, and their difference.

    Parameters
    ----------
    traces : filtered forces (n, 3) of one log
    floor : what measurement noise alone leaves in them, drawn as a band of 1.96 std
    """
    looks = {"label": "measured torques"}, {"label": "model", **look.PREDICTED}
    figure, panels = _with_strips(traces, Squares.of(traces), FORCES, looks, floor)
    look.header(panels[0], f"Filtered generalised forces: {name}")
    look.mark_stretches(panels, stretches)
    return figure


@styled
def free_run_figure(velocity: Traces, floor: Squares, *, name: str, length: float) -> Figure:
    """Measured velocities and the model's free run, driven by the measured torques alone.

    Parameters
    ----------
    velocity : (VX/L, VY/L, W) (n, 3) [rad/s]
    floor : what measurement noise alone leaves in them, drawn as a band of 1.96 std
    length : L [m]
    """
    scale = np.array([length, length, 1.0])
    traces = Traces(velocity.time, velocity.measured * scale, velocity.predicted * scale)
    noise = Squares(floor.residual * scale**2, floor.measured * scale**2)
    looks = {"label": "measured"}, {"label": "free run of the model", **look.PREDICTED}
    figure, panels = _with_strips(traces, Squares.of(traces), VELOCITIES, looks, noise)
    look.header(panels[0], f"Velocities in free run on measured torques: {name}")
    return figure


@styled
def tracking_figure(time: Array, twist: Array, reference: Array, *, name: str) -> Figure:
    """The paper's figure 3: response and reference (n, 3) in a multisine, and their difference."""
    looks = {"label": "response"}, {"label": "reference", **look.REFERENCE}
    traces = Traces(time, twist, reference)
    error = Squares((traces.residual**2).sum(axis=0), (reference**2).sum(axis=0))
    figure, panels = _with_strips(traces, error, VELOCITIES, looks)
    look.header(panels[0], f"Reference and response: {name}")
    return figure


def _with_strips(
    traces: Traces,
    error: Squares,
    axes_labels: Sequence[tuple[str, str]],
    looks: tuple[Mapping[str, Any], Mapping[str, Any]],
    floor: Squares | None = None,
) -> tuple[Figure, list[Axes]]:
    """For each axis a panel with two lines and, under it, a strip with their difference."""
    figure = look.new_figure(9.0)
    grid = figure.add_gridspec(6, 1, height_ratios=[3, 1.1] * 3)
    panels = [figure.add_subplot(grid[0])]
    panels += [figure.add_subplot(grid[k], sharex=panels[0]) for k in range(1, 6)]
    for k, (symbol, unit) in enumerate(axes_labels):
        main, strip = panels[2 * k : 2 * k + 2]
        look.line(main, traces.time, traces.measured[:, k], **{**look.MEASURED, **looks[0]})
        look.line(main, traces.time, traces.predicted[:, k], **looks[1])
        main.set_ylabel(f"{symbol}  [{unit}]")
        note = f"error\n{percent(error.by_axis[k])}"
        if floor is not None:
            note += f"\nnoise\n{percent(floor.by_axis[k])}"
        look.margin_note(main, note)
        noise = 0.0 if floor is None else BAND * np.sqrt(floor.residual[k] / len(traces.time))
        _strip(strip, traces.time, traces.residual[:, k], noise)
        strip.set_ylabel(f"$\\Delta$  [{unit}]", fontsize=9)
    # The legend of the first panel speaks for its strip too.
    panels[0].plot([], [], label=r"difference $\Delta$", **look.RESIDUAL)
    if floor is not None:
        panels[0].fill_between([], [], label="noise floor, ±1.96 std", **look.FLOOR)
    _finish(figure, panels)
    return figure, panels


def _strip(axes: Axes, time: Array, residual: Array, noise: float) -> None:
    if noise > 0:
        axes.axhspan(-noise, noise, **look.FLOOR)
    look.line(axes, time, residual, **look.RESIDUAL)
    look.symmetric(axes, 1.1 * max(float(np.abs(residual).max()), noise))


def _finish(figure: Figure, panels: Sequence[Axes]) -> None:
    """Time at the bottom alone, ordinates' labels in line."""
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False, bottom=False)
    panels[-1].set_xlabel(TIME)
    figure.align_ylabels(list(panels))


@styled
def motion_figure(
    time: Array,
    twist: Array,
    ideal: Array | None,
    *,
    name: str,
    stretches: Sequence[Stretch] = (),
) -> Figure:
    """The paper's figure 5: measured velocities (n, 3), and the ideal motion's if it is known."""
    figure = look.new_figure(7.0)
    panels = list(figure.subplots(3, 1, sharex=True))
    for k, (axes, (symbol, unit)) in enumerate(zip(panels, VELOCITIES, strict=True)):
        look.line(axes, time, twist[:, k], label="measured", **look.MEASURED)
        axes.set_ylabel(f"{symbol}  [{unit}]")
        if ideal is not None:
            look.line(axes, time, ideal[:, k], label="ideal motion", **look.REFERENCE)
            rms = np.sqrt(np.mean((twist[:, k] - ideal[:, k]) ** 2))
            look.margin_note(axes, f"rms off\n{rms:.2g}\n{unit}")
    # One scale for both speeds: an axis at rest should look at rest.
    shown = twist[:, :2] if ideal is None else np.concatenate([twist[:, :2], ideal[:, :2]])
    for axes in panels[:2]:
        look.symmetric(axes, 1.08 * float(np.abs(shown).max()))
    look.header(panels[0], f"Velocities on the motions: {name}")
    _finish(figure, panels)
    look.mark_stretches(panels, stretches)
    return figure


@styled
def estimates_figure(
    course: Course,
    labels: Sequence[str],
    batch: Array,
    *,
    stretches: Sequence[Stretch] = (),
    truth: Array | None = None,
) -> Figure:
    """The paper's figure 6: estimates over time with their band of 1.96 std, a panel each.

    Parameters
    ----------
    labels : (F,) name and unit of each parameter
    batch : (F,) the batch estimate, as a line
    truth : (F,) true values, where they are known
    """
    rows = (len(labels) + 1) // 2
    figure = look.new_figure(1.2 + 1.7 * rows)
    panels = list(figure.subplots(rows, 2, sharex=True).flat)
    for axes in panels[len(labels) :]:
        axes.axis("off")
    panels = panels[: len(labels)]
    for k, (axes, label) in enumerate(zip(panels, labels, strict=True)):
        value, band = course.theta[:, k], BAND * course.std[:, k]
        axes.plot(course.time, value, label="recursive estimate", **look.ESTIMATE)
        ends = value - band, value + band
        axes.fill_between(course.time, *ends, label="±1.96 std", **look.FLOOR)
        axes.axhline(batch[k], label="batch estimate", **look.BATCH)
        if truth is not None:
            axes.axhline(truth[k], label="true value", **look.TRUTH)
        axes.set_ylim(*_settled_range(*ends, batch[k]))
        axes.set_ylabel(label)
        axes.ticklabel_format(axis="y", useOffset=False)
    look.header(panels[0], "Estimates over time")
    for axes in panels[-2:]:
        axes.tick_params(labelbottom=True)
    figure.supxlabel("time from the first log's start [s]", fontsize=10)
    figure.align_ylabels(list(panels))
    for top in (0, 1):
        look.mark_stretches(panels[top::2], stretches)
    return figure


def _settled_range(low: Array, high: Array, batch: float) -> tuple[float, float]:
    """Range that shows the second half of a band whole: before, all is still open."""
    half = len(low) // 2
    bottom, top = min(float(low[half:].min()), batch), max(float(high[half:].max()), batch)
    pad = 0.06 * (top - bottom) or 1.0
    return bottom - pad, top + pad


@styled
def stretch_figure(
    stretches: Sequence[Mapping[str, Any]],
    worst: Sequence[Mapping[str, Any]],
    floor: Squares,
    *,
    name: str,
) -> Figure:
    """Force error of each axis by stretch of one log, beside the noise floor.

    Parameters
    ----------
    stretches : axis, from, to [s] and force_error of each, as in a comparison's ``where``
    worst : those to point out
    """
    figure = look.new_figure(6.0)
    panels = list(figure.subplots(3, 1, sharex=True))
    pointed = {(row["axis"], row["from"]) for row in worst}
    names = list(dict.fromkeys(row["axis"] for row in stretches))
    for k, (axes, axis) in enumerate(zip(panels, names, strict=True)):
        rows = [row for row in stretches if row["axis"] == axis]
        axes.bar(
            [row["from"] for row in rows],
            [100 * row["force_error"] for row in rows],
            [0.94 * (row["to"] - row["from"]) for row in rows],
            align="edge",
            color=[look.WORST if (axis, row["from"]) in pointed else look.BAR for row in rows],
        )
        axes.axhline(100 * floor.by_axis[k], label="noise floor", **look.TRUTH)
        axes.set_ylabel(f"{FORCES[k][0]}  [%]")
        axes.grid(axis="x", visible=False)
    panels[0].fill_between([], [], color=look.BAR, label="force error")
    panels[0].fill_between([], [], color=look.WORST, label="largest shares of all residual")
    look.header(panels[0], f"Force error by stretch: {name}")
    _finish(figure, panels)
    return figure


@styled
def residual_figure(rows: Sequence[tuple[str, Curve]]) -> Figure:
    """The residual of each force over variables that it depends on, with a band of 1.96 std.

    Parameters
    ----------
    rows : a title (the variable and its share) and a curve each
    """
    forces = FORCES if rows[0][1].force.shape[1] == len(FORCES) else (("force", ""),)
    figure = look.new_figure(1.4 + 1.8 * len(rows))
    panels = figure.subplots(len(rows), len(forces), sharey=True, squeeze=False)
    reach = max(float(np.nanmax(np.abs(curve.force) + curve.std)) for _, curve in rows)
    for row, (title, curve) in zip(panels, rows, strict=True):
        for k, axes in enumerate(row):
            value, band = curve.force[:, k], BAND * curve.std[:, k]
            axes.axhline(0.0, **look.TRUTH)
            axes.fill_between(curve.at, value - band, value + band, **look.FLOOR)
            axes.plot(curve.at, value, marker=".", **look.ESTIMATE)
            axes.set_xlabel(f"{curve.label}  [{curve.unit}]" if curve.unit else curve.label)
        row[0].set_ylabel(title)
    look.symmetric(panels[0, 0], 1.1 * reach)
    for axes, (symbol, unit) in zip(panels[0], forces, strict=True):
        axes.set_title(f"residual of {symbol}  [{unit}]" if unit else "residual")
    return figure
