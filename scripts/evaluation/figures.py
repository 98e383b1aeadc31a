"""The pictures of an evaluation: error against reference frequency, and time courses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.loop import Trace
from identification.figures.style import GREY, line, new_figure, styled
from youbot_scripts.evaluation.metrics import AXES
from youbot_scripts.evaluation.summary import Result, by_plant, in_words, models_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_CLAIM = 0.5
"""Frequency [rad/s] above which the source paper calls kinematic control unsatisfactory."""

COLOURS = ("#d55e00", "#e69f00", "#009e73", "#56b4e9", "#0072b2", "#cc79a7", "#222222", "#a6761d")
"""Colours of the controllers, in their order: Okabe and Ito's palette (2008)."""

MARKERS = "osD^vPX*"

BROKEN = ("dashed", "dotted", "dashdot")
"""Line styles of all models but the last one, beginning with the last but one."""

UNITS = ("m/s", "m/s", "rad/s")


def _look(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    return {
        name: {"color": COLOURS[n % len(COLOURS)], "marker": MARKERS[n % len(MARKERS)]}
        for n, name in enumerate(names)
    }


def errors_by_plant(results: Sequence[Result], brief: bool) -> dict[str, Figure]:
    """A picture by name for each plant that was driven on several models; if ``brief``, for all."""
    drawn, plants = {}, by_plant(results)
    for n, group in enumerate(plants):
        several = len(models_of(group)) > 1
        if several or brief:
            name = "error_by_model" if several else "error_by_frequency"
            drawn[numbered(name, n, plants)] = error_by_frequency(group)
    return drawn


def numbered(name: str, n: int, among: Sequence[object]) -> str:
    """The name of picture ``n``, counted where there are several."""
    return f"{name}_{n + 1}" if len(among) > 1 else name


@styled
def error_by_frequency(group: Sequence[Result]) -> Figure:
    """Normalised RMSE of every controller over the bands on one plant, an axis a panel.

    Where the controllers were built on several models, the last one's lines are solid and those of
    the others broken, with hollow markers. Points stand at a band's geometric mean, side by side;
    bars are 95 % intervals over seeds. A controller that diverges in a band has a cross at the
    upper edge there.
    """
    figure = new_figure(5.2)
    panels = figure.subplots(1, 3, sharey=True)
    names = list(dict.fromkeys(result.controller for result in group))
    look = _look(names)
    for axis, (panel, label) in enumerate(zip(panels, AXES, strict=True)):
        panel.set(xscale="log", yscale="log", xlabel="reference frequency [rad/s]")
        panel.set_title(label)
        for n, name in enumerate(names):
            # A factor, not a shift: the axis is logarithmic.
            beside = 1.0 + 0.03 * (n - (len(names) - 1) / 2)
            mine = [result for result in group if result.controller == name]
            for model, strokes in _strokes(group).items():
                drawn = [result for result in mine if result.place["model"] == model]
                _curve(panel, drawn, label, beside, look[name] | strokes)
        panel.axvline(PAPER_CLAIM, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0.5)
        if axis == 0:
            panel.set_ylabel("normalised RMSE [%]")
            panel.annotate(
                "the paper: kinematic control\nunsatisfactory above 0.5 rad/s",
                (PAPER_CLAIM, 1.0), (4, -4), ("data", "axes fraction"), "offset points",
                va="top", fontsize=8, color=GREY,
            )  # fmt: skip
        _ticks(panel, group)
    _legend(figure, panels[0])
    _state(figure, "Tracking error against reference frequency", _stated(group))
    return figure


def _strokes(group: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Line style of each model: the last one solid with full markers, the others broken."""
    *others, last = models_of(group)
    broken = reversed(list(zip(reversed(others), cycle(BROKEN), strict=False)))
    hollow = {model: {"linestyle": style, "markerfacecolor": "white"} for model, style in broken}
    return hollow | {last: {"linestyle": "solid"}}


def _stated(group: Sequence[Result]) -> str:
    """Plant, models, loop and seeds in words."""
    models = models_of(group)
    if len(models) > 1:
        models = [f"{model} ({look['linestyle']})" for model, look in _strokes(group).items()]
    runs = max(result.runs for result in group)
    seeds = f"seeds 0 to {runs - 1}" if runs > 1 else "seed 0"
    crosses = "; crosses: diverged" if any(result.diverged for result in group) else ""
    return f"{in_words({**group[0].place, 'model': ', '.join(models)})}; {seeds}{crosses}"


def _curve(
    panel: Axes, results: Sequence[Result], label: str, beside: float, look: Mapping[str, Any]
) -> None:
    ordered = sorted(results, key=lambda result: result.band)
    centre = np.array([beside * math.sqrt(r.band[0] * r.band[1]) for r in ordered])
    mean = np.array([100 * r.mean(f"nrmse {label}") for r in ordered])
    half = np.array([100 * r.half(f"nrmse {label}") for r in ordered])
    # A logarithmic axis cannot show an interval that reaches zero.
    below = np.minimum(half, 0.9 * mean)
    named = ordered[0].controller if look["linestyle"] == "solid" else None
    panel.errorbar(
        centre, mean, np.vstack([below, half]),
        label=named, linewidth=1.2, markersize=5, capsize=2.5, **look,
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


def _state(figure: Figure, title: str, stated: str) -> None:
    """Title, and below it plant, model, loop and seeds, wrapped at the figure's width."""
    lines = wrap(stated, 148, break_on_hyphens=False)
    room = "\n" * len(lines)  # empty lines in the title, for which the layout leaves space
    figure.suptitle(f"{title}{room}", x=0.01, ha="left", fontsize=12, fontweight="bold")
    below = 1.0 - 0.29 / figure.get_figheight()
    figure.text(0.01, below, "\n".join(lines), fontsize=8.5, color=GREY, va="top")


def _legend(figure: Figure, panel: Axes) -> None:
    """One for all panels, at the lower edge."""
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))


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
    # A loop that diverged has a shorter trace; the reference is drawn from the longest one.
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
    _legend(figure, panels[0, 0])
    _state(figure, "Reference and response", stated)
    return figure
