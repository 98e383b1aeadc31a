"""The pictures of an evaluation: error against reference frequency, and time courses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.plot_style import GREY, line, new_figure, styled, write_figure
from youbot_scripts.evaluation.closed_loop import Trace
from youbot_scripts.evaluation.metrics import AXES
from youbot_scripts.evaluation.summary import Result, in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_CLAIM = 0.5
"""Frequency [rad/s] above which the source paper calls kinematic control unsatisfactory."""

COLOURS = ("#d55e00", "#e69f00", "#009e73", "#56b4e9", "#0072b2", "#cc79a7", "#222222", "#a6761d")
"""Of controllers in turn: Okabe and Ito's palette (2008)."""

MARKERS = "osD^vPX*"

UNITS = ("m/s", "m/s", "rad/s")


def _look(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    return {
        name: {"color": COLOURS[n % len(COLOURS)], "marker": MARKERS[n % len(MARKERS)]}
        for n, name in enumerate(names)
    }


@styled
def error_by_frequency(group: Sequence[Result]) -> Figure:
    """Normalised RMSE of every controller over the bands of one condition, an axis a panel.

    Points stand at a band's geometric mean, side by side; bars are 95 % intervals over seeds. A
    controller that diverges in a band has a cross at the upper edge there.
    """
    figure = new_figure(5.2)
    panels = figure.subplots(1, 3, sharey=True)
    names = list(dict.fromkeys(result.controller for result in group))
    look = _look(names)
    for axis, (panel, label) in enumerate(zip(panels, AXES, strict=True)):
        panel.set(xscale="log", yscale="log", xlabel="reference frequency [rad/s]")
        panel.set_title(label)
        for n, name in enumerate(names):
            beside = 1.0 + 0.03 * (n - (len(names) - 1) / 2)
            _curve(panel, [r for r in group if r.controller == name], label, beside, look[name])
        panel.axvline(PAPER_CLAIM, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0.5)
        if axis == 0:
            panel.set_ylabel("normalised RMSE [%]")
            panel.annotate(
                "the paper: kinematic control\nunsatisfactory above 0.5 rad/s",
                (PAPER_CLAIM, 1.0), (4, -4), ("data", "axes fraction"), "offset points",
                va="top", fontsize=8, color=GREY,
            )  # fmt: skip
        _ticks(panel, group)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    _state(figure, "Tracking error against reference frequency", group)
    return figure


def _curve(
    panel: Axes, results: Sequence[Result], label: str, beside: float, look: Mapping[str, Any]
) -> None:
    ordered = sorted(results, key=lambda result: result.band)
    centre = np.array([beside * math.sqrt(r.band[0] * r.band[1]) for r in ordered])
    mean = np.array([100 * r.mean(f"nrmse {label}") for r in ordered])
    half = np.array([100 * r.half(f"nrmse {label}") for r in ordered])
    # An interval that reaches zero would leave a logarithmic axis.
    below = np.minimum(half, 0.9 * mean)
    panel.errorbar(
        centre, mean, np.vstack([below, half]),
        label=ordered[0].controller, linewidth=1.2, markersize=5, capsize=2.5, **look,
    )  # fmt: skip
    for x, result in zip(centre, ordered, strict=True):
        if result.diverged:
            panel.plot(
                x, 0.985, "x", color=look["color"], markersize=7,
                transform=panel.get_xaxis_transform(), clip_on=False,
            )  # fmt: skip


def _ticks(panel: Axes, group: Sequence[Result]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    edges = sorted({edge for result in group for edge in result.band})
    panel.set_xlim(0.85 * edges[0], 1.18 * edges[-1])
    panel.set_xticks(edges, [f"{edge:g}" for edge in edges])
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.margins(y=0.12)


def _state(figure: Figure, title: str, group: Sequence[Result]) -> None:
    """Title, and beneath it plant, model, loop and seeds."""
    runs = max(result.runs for result in group)
    seeds = f"seeds 0 to {runs - 1}" if runs > 1 else "seed 0"
    crosses = "; crosses: diverged" if any(result.diverged for result in group) else ""
    stated = f"{in_words(group[0].place)}; {seeds}{crosses}"
    figure.suptitle(f"{title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
    figure.text(0.01, 0.945, stated, fontsize=8.5, color=GREY, va="top")


@styled
def time_courses(
    traces: Mapping[str, Trace], stated: str, names: Sequence[str], seconds: float = 15.0
) -> Figure:
    """Reference and true twist of selected controllers, an axis a row; beside them the errors.

    Parameters
    ----------
    traces : by controller, all along one reference
    stated : plant, model, loop, reference and seed in words
    names : of all controllers, in the order that gives them their colours
    seconds : of the responses that are shown, from the start; errors are shown to the end
    """
    figure = new_figure(6.8)
    panels = figure.subplots(3, 2, sharex="col", width_ratios=(3, 2))
    look = _look(list(dict.fromkeys([*names, *traces])))
    longest = max(traces.values(), key=lambda trace: len(trace.time))
    for axis, (left, right) in enumerate(panels):
        shown = longest.time <= seconds
        line(left, longest.time[shown], longest.reference[shown, axis], label="reference",
             color="#a6a6a6", linewidth=3.2)  # fmt: skip
        for name, trace in traces.items():
            colour, shown = look[name]["color"], trace.time <= seconds
            label = name if trace.diverged is None else f"{name} (diverges)"
            line(left, trace.time[shown], trace.twist[shown, axis], label=label, linewidth=1.1,
                 color=colour)  # fmt: skip
            line(right, trace.time, np.abs(trace.twist - trace.reference)[:, axis],
                 linewidth=0.8, color=colour)  # fmt: skip
        reach = 1.6 * max(float(np.abs(longest.reference[:, axis]).max()), 1e-3)
        left.set_ylim(-reach, reach)
        left.set_ylabel(f"{AXES[axis]} [{UNITS[axis]}]")
        right.set_yscale("log")
        right.set_ylim(1e-4 * reach, 2 * reach)
    panels[0, 1].set_title("absolute error", fontsize=10, fontweight="normal")
    for panel in panels[-1]:
        panel.set_xlabel("time [s]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    figure.suptitle("Reference and response\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
    figure.text(0.01, 0.955, stated, fontsize=8.5, color=GREY, va="top")
    return figure


def write_all(folder: Path, figures: Mapping[str, Figure]) -> list[Path]:
    """Write figures as PNG files, named by their keys.

    Raises
    ------
    InputError
        If the folder or a file cannot be written.
    """
    return [write_figure(folder / f"{name}.png", figure) for name, figure in figures.items()]
