"""The paper's figures and a free run's, each from results to a matplotlib Figure.

Times are seconds from the log's start. Forces of a platform are (L F_X, L F_Y, M_W) [N m],
filtered, velocities (VX, VY, W) [m/s, m/s, rad/s]; other mechanisms name theirs (A axes). Long
lines are thinned for drawing, extremes kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.figures import style as look
from identification.figures.style import percent, styled
from identification.fitting.errors import SumsOfSquares, Traces
from identification.fitting.estimate_history import EstimateHistory
from identification.mechanisms.quantities import FORCES, VELOCITIES, Quantities, Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Stretch = tuple[str, float, float]
"""Name, start and end [s] of a part of a log that a figure names."""

TIME = "time from the log's start [s]"


@styled
def force_figure(
    traces: Traces,
    floor: SumsOfSquares,
    *,
    name: str,
    stretches: Sequence[Stretch] = (),
    forces: Sequence[Quantity] = FORCES,
) -> Figure:
    """The paper's figure 7: measured and predicted filtered forces, and their difference.

    Parameters
    ----------
    traces : filtered forces (n, A) of one log
    floor : what measurement noise alone leaves in them, drawn as a band of 1.96 std
    """
    looks = {"label": "measured torques"}, {"label": "model", **look.PREDICTED}
    title = "Filtered generalised forces"
    if len(forces) == 1:
        looks, title = ({"label": "measured"}, looks[1]), f"Filtered {forces[0][0]}"
    figure, panels = _with_strips(traces, SumsOfSquares.of(traces), forces, looks, floor)
    look.header(panels[0], f"{title}: {name}")
    look.mark_stretches(panels, stretches)
    return figure


@styled
def free_run_figure(
    velocity: Traces, floor: SumsOfSquares, *, name: str, quantities: Quantities
) -> Figure:
    """Measured velocities and the model's free run, driven by the measured torques alone.

    Parameters
    ----------
    velocity : (n, A) as the engine has them; of a platform (VX/L, VY/L, W) [rad/s]
    floor : what measurement noise alone leaves in them, drawn as a band of 1.96 std
    quantities : symbols and units, and the scale to them
    """
    scale, speeds = quantities.speed_scale, quantities.speeds
    traces = Traces(velocity.time, velocity.measured * scale, velocity.predicted * scale)
    noise = SumsOfSquares(floor.residual * scale**2, floor.measured * scale**2)
    looks = {"label": "measured"}, {"label": "free run of the model", **look.PREDICTED}
    figure, panels = _with_strips(traces, SumsOfSquares.of(traces), speeds, looks, noise)
    title = "Velocities in free run on measured torques"
    if len(speeds) == 1:
        title = f"Speed in free run on measured {quantities.forces[0][0]}s"
    look.header(panels[0], f"{title}: {name}")
    return figure


@styled
def tracking_figure(time: Array, twist: Array, reference: Array, *, name: str) -> Figure:
    """The paper's figure 3: response and reference (n, 3) in a multisine, and their difference."""
    looks = {"label": "response"}, {"label": "reference", **look.REFERENCE}
    traces = Traces(time, twist, reference)
    error = SumsOfSquares((traces.residual**2).sum(axis=0), (reference**2).sum(axis=0))
    figure, panels = _with_strips(traces, error, VELOCITIES, looks)
    look.header(panels[0], f"Reference and response: {name}")
    return figure


def _with_strips(
    traces: Traces,
    error: SumsOfSquares,
    axes_labels: Sequence[Quantity],
    looks: tuple[Mapping[str, Any], Mapping[str, Any]],
    floor: SumsOfSquares | None = None,
) -> tuple[Figure, list[Axes]]:
    """For each axis a panel with two lines and, under it, a strip with their difference."""
    count = len(axes_labels)
    figure = look.new_figure(1.2 + 2.6 * count)
    grid = figure.add_gridspec(2 * count, 1, height_ratios=[3, 1.1] * count)
    panels = [figure.add_subplot(grid[0])]
    panels += [figure.add_subplot(grid[k], sharex=panels[0]) for k in range(1, 2 * count)]
    for k, (symbol, unit) in enumerate(axes_labels):
        main, strip = panels[2 * k : 2 * k + 2]
        look.line(main, traces.time, traces.measured[:, k], **{**look.MEASURED, **looks[0]})
        look.line(main, traces.time, traces.predicted[:, k], **looks[1])
        main.set_ylabel(f"{symbol}  [{unit}]")
        note = f"error\n{percent(error.by_axis[k])}"
        if floor is not None:
            note += f"\nnoise\n{percent(floor.by_axis[k])}"
        look.margin_note(main, note)
        noise = 0.0 if floor is None else look.BAND * np.sqrt(floor.residual[k] / len(traces.time))
        _strip(strip, traces.time, traces.residual[:, k], noise)
        strip.set_ylabel(f"$\\Delta$  [{unit}]", fontsize=9)
    # Empty artists: the first panel's legend also explains the strip below it.
    panels[0].plot([], [], label=r"difference $\Delta$", **look.RESIDUAL)
    if floor is not None:
        panels[0].fill_between([], [], label="noise floor, ±1.96 std", **look.FLOOR)
    finish(figure, panels)
    return figure, panels


def _strip(axes: Axes, time: Array, residual: Array, noise: float) -> None:
    if noise > 0:
        axes.axhspan(-noise, noise, **look.FLOOR)
    look.line(axes, time, residual, **look.RESIDUAL)
    look.symmetric(axes, 1.1 * max(float(np.abs(residual).max()), noise))


def finish(figure: Figure, panels: Sequence[Axes]) -> None:
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
    velocities: Sequence[Quantity] = VELOCITIES,
) -> Figure:
    """The paper's figure 5: measured velocities (n, A), and the ideal motion's if it is known."""
    count = len(velocities)
    figure = look.new_figure(1.3 + 1.9 * count)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False).flat)
    for k, (axes, (symbol, unit)) in enumerate(zip(panels, velocities, strict=True)):
        look.line(axes, time, twist[:, k], label="measured", **look.MEASURED)
        axes.set_ylabel(f"{symbol}  [{unit}]")
        if ideal is not None:
            look.line(axes, time, ideal[:, k], label="ideal motion", **look.REFERENCE)
            rms = np.sqrt(np.mean((twist[:, k] - ideal[:, k]) ** 2))
            look.margin_note(axes, f"rms off\n{rms:.2g}\n{unit}")
    # VX and VY have one scale, so that noise on an axis at rest does not look like motion.
    shown = twist[:, :2] if ideal is None else np.concatenate([twist[:, :2], ideal[:, :2]])
    for axes in panels[:2]:
        look.symmetric(axes, 1.08 * float(np.abs(shown).max()))
    title = "Velocities on the motions" if count > 1 else f"Measured {velocities[0][0]}"
    look.header(panels[0], f"{title}: {name}")
    finish(figure, panels)
    look.mark_stretches(panels, stretches)
    return figure


@styled
def estimates_figure(
    course: EstimateHistory,
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
        value, band = course.theta[:, k], look.BAND * course.std[:, k]
        axes.plot(course.time, value, label="recursive estimate", **look.ESTIMATE)
        ends = value - band, value + band
        axes.fill_between(course.time, *ends, label="±1.96 std", **look.FLOOR)
        axes.axhline(batch[k], label="batch estimate", **look.BATCH)
        if truth is not None:
            axes.axhline(truth[k], label="true value", **look.TRUTH)
        axes.set_ylim(*_settled_range(*ends, batch[k]))
        axes.set_ylabel(label)
        # With an offset the ticks would not show the values themselves.
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
    """Range of the ordinate that shows the second half of a band.

    At the start the band is very wide (prior variance) and would hide the rest.
    """
    half = len(low) // 2
    bottom, top = min(float(low[half:].min()), batch), max(float(high[half:].max()), batch)
    pad = 0.06 * (top - bottom) or 1.0
    return bottom - pad, top + pad
