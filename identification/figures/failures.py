"""Figures of where a model fails, and of how the error falls: each from results to a Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.figures import style as look
from identification.figures.style import percent, styled
from identification.figures.time_series import finish
from identification.fitting.errors import SumsOfSquares
from identification.mechanisms.quantities import FORCES, Quantity
from identification.residual_map.curves import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def stretch_figure(
    stretches: Sequence[Mapping[str, Any]],
    worst: Sequence[Mapping[str, Any]],
    floor: SumsOfSquares,
    *,
    name: str,
    forces: Sequence[Quantity] = FORCES,
) -> Figure:
    """Force error of each axis by stretch of one log, beside the noise floor.

    Parameters
    ----------
    stretches : axis, from, to [s] and force_error of each, as in a comparison's ``where``
    worst : those to point out
    """
    figure = look.new_figure(1.2 + 1.6 * len(forces))
    panels = list(figure.subplots(len(forces), 1, sharex=True, squeeze=False).flat)
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
        axes.set_ylabel(f"{forces[k][0]}  [%]")
        axes.grid(axis="x", visible=False)
    # Empty areas make entries of the legend: the bars of one call cannot have two labels.
    panels[0].fill_between([], [], color=look.BAR, label="force error")
    panels[0].fill_between([], [], color=look.WORST, label="largest shares of all residual")
    look.header(panels[0], f"Force error by stretch: {name}")
    finish(figure, panels)
    return figure


@styled
def residual_figure(
    rows: Sequence[tuple[str, Curve]], forces: Sequence[Quantity] = FORCES
) -> Figure:
    """The residual of each force over variables that it depends on, with a band of 1.96 std.

    Parameters
    ----------
    rows : a title (the variable and its share) and a curve each
    """
    figure = look.new_figure(1.4 + 1.8 * len(rows))
    panels = figure.subplots(len(rows), len(forces), sharey=True, squeeze=False)
    # One scale for all panels, so that sizes can be compared. NaN marks points without rows.
    reach = max(float(np.nanmax(np.abs(curve.force) + curve.std)) for _, curve in rows)
    for row, (title, curve) in zip(panels, rows, strict=True):
        for k, axes in enumerate(row):
            value, band = curve.force[:, k], look.BAND * curve.std[:, k]
            axes.axhline(0.0, **look.TRUTH)
            axes.fill_between(curve.at, value - band, value + band, **look.FLOOR)
            axes.plot(curve.at, value, marker=".", **look.ESTIMATE)
            axes.set_xlabel(f"{curve.label}  [{curve.unit}]" if curve.unit else curve.label)
        row[0].set_ylabel(title)
    look.symmetric(panels[0, 0], 1.1 * reach)
    for axes, (symbol, unit) in zip(panels[0], forces, strict=True):
        axes.set_title(f"residual of {symbol}  [{unit}]")
    return figure


@styled
def fall_figure(
    steps: Sequence[tuple[str | None, float, float]],
    floor: Mapping[str, float],
    proposed: tuple[str, float, float] | None = None,
) -> Figure:
    """Held-out force and velocity error of each step of a diagnosis, beside the noise floor.

    Parameters
    ----------
    steps : effect (None: the refitted model), force error and velocity error
    floor : both errors by name
    proposed : name of a law that is proposed beside the effects, and both errors with it
    """
    names = ["the model, refitted", *(f"with {effect}" for effect, _, _ in steps[1:])]
    if proposed is not None:
        names.append(f"with {proposed[0]}\n(proposed)")
        steps = [*steps, proposed]
    figure = look.new_figure(1.4 + 0.55 * len(steps))
    panels = list(figure.subplots(1, 2, sharey=True, squeeze=False).flat)
    errors = {"force_error": [s[1] for s in steps], "velocity_error": [s[2] for s in steps]}
    for axes, (kind, values) in zip(panels, errors.items(), strict=True):
        widths = 100 * np.nan_to_num(values, posinf=0.0)  # "-" for a free run that diverged
        bars = axes.barh(names, widths, height=0.6, color=look.BAR)
        if proposed is not None:
            bars[-1].set(hatch="////", edgecolor="white")
        axes.bar_label(bars, [percent(value) for value in values], padding=4, fontsize=9)
        if np.isfinite(floor[kind]):
            label = f"noise floor, {percent(floor[kind])}"
            axes.axvline(100 * floor[kind], label=label, **look.TRUTH)
            axes.legend(loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.3)
        axes.set_title(kind.replace("_", " "))
        axes.set_xlabel("[%]")
        axes.set_xmargin(0.15)
        axes.grid(axis="y", visible=False)
    # barh draws upwards; the first step belongs at the top.
    panels[0].invert_yaxis()
    return figure
