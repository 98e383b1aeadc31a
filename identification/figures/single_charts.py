"""Single interactive charts, each from plain signals, curves or numbers to a Plotly figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.style import MAX_CURVES, percent
from identification.fitting.errors import SumsOfSquares, Traces
from identification.mechanisms.quantities import Quantity
from identification.residual_map.curves import Curve
from identification.residual_map.shares import ResidualMap
from identification.signals.filters import block_mean
from youbot_env.motions.base import motion_from_dict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

TIME = "time from the log's start [s]"


class Line(NamedTuple):
    """Predicted signals (n, A) of one model, its name in the legend and its look."""

    name: str
    predicted: Array
    look: dict[str, Any]


def errors_chart(
    steps: Sequence[tuple[str | None, float, float]],
    floor: Mapping[str, float],
    proposed: tuple[str, float, float] | None = None,
) -> Chart:
    """Held-out force and velocity error of each step of a diagnosis, beside the noise floor.

    Parameters
    ----------
    steps : effect (None: the refitted model), force error and velocity error
    floor : both errors by name
    proposed : name of a law that is proposed beside the effects, and both errors with it
    """
    names = ["the model, refitted", *(f"+ {look.safe(effect or '')}" for effect, _, _ in steps[1:])]
    patterns, title = [""] * len(steps), "The error as it falls, held out"
    if proposed is not None:
        # In two lines: on a phone a name takes the room of its bar.
        names.append(f"+ {look.safe(proposed[0])}<br>(proposed)")
        patterns, steps = [*patterns, "/"], [*steps, proposed]
        title += "; hatched: with the proposed law, which is not confirmed"
    # Bars stand further apart where a name has two lines.
    height = 150 + (70 if proposed is None else 95) * len(steps)
    floors = (floor["force_error"], floor["velocity_error"])
    titles = [
        f"{name}{f'; dotted: noise {percent(level)}' if np.isfinite(level) else ''}"
        for name, level in zip(("force error", "velocity error"), floors, strict=True)
    ]
    figure = look.rows_figure(2, height, titles, shared=False)
    # Names of effects are long: on a phone, little is left of a panel for a title to begin at.
    figure.update_annotations(x=1.0, xanchor="right")
    of_kinds = ([step[1] for step in steps], [step[2] for step in steps])
    for row, (errors, level) in enumerate(zip(of_kinds, floors, strict=True), start=1):
        values = 100 * np.nan_to_num(errors, posinf=0.0)
        figure.add_trace(
            look.plotly().Bar(
                y=names, x=values, orientation="h", showlegend=False,
                marker={
                    "color": look.BAR, "pattern": {"shape": patterns, "size": 5},
                    "line": {"color": look.BAR, "width": 1.5},
                },
                text=[percent(error) for error in errors], textposition="outside", cliponaxis=False,
                hovertemplate="%{y}: %{x:.3g} %<extra></extra>",
            ),
            row=row, col=1,
        )  # fmt: skip
        # Room for the last number beside its bar, and none left of zero.
        widest = float(np.nanmax([*values, 100 * level, 1e-9]))
        figure.update_xaxes(range=[0.0, 1.2 * widest], row=row, col=1)
        if np.isfinite(level):
            look.add_vertical(figure, row, 100 * level)
    figure.update_yaxes(autorange="reversed")
    figure.update_xaxes(ticksuffix=" %", rangemode="tozero", matches=None, showticklabels=True)
    return Chart("errors", title, figure, height)


def residual_charts(
    maps: Sequence[tuple[str, ResidualMap]],
    forces: Sequence[Quantity],
    *,
    explained: bool = False,
) -> Iterator[Chart]:
    """The residual over the variables that it depends on most, of one model or of two.

    Parameters
    ----------
    maps : name of a model and its residual map; the first one chooses the variables
    explained : of two maps, whether the second one's model is the first one's with effects: then
        the first one's residual is drawn as points, and through them what the effects take away
    """
    rows = _strongest(maps)
    if not rows:
        return
    height = 90 + 250 * len(rows)
    figure = look.rows_figure(len(rows), height, [title for title, _ in rows], shared=False)
    dashes = ("dot", "solid")[-len(maps) :]
    for row, (_, curves) in enumerate(rows, start=1):
        if explained and len(maps) == 2:
            _add_explained(figure, row, curves, forces)
        else:
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
        of_each = [
            residual_map.curve(variable) if variable in _variables(residual_map) else []
            for _, residual_map in maps
        ]
        share = f"{percent(shares[variable])} of the residual"
        for k, curve in enumerate(of_each[0]):
            # The twist has three curves, one for each component.
            alone = len(of_each[0]) == 1
            name = look.safe(variable)
            title = f"{name}: {share}" if alone else f"{look.safe(curve.label)} ({name}: {share})"
            found.append((title, [curves[k] if k < len(curves) else None for curves in of_each]))
    return found[:MAX_CURVES]


def _variables(residual_map: ResidualMap) -> set[str]:
    return {share.variable for share in residual_map.shares}


def _add_explained(
    figure: Figure, row: int, curves: Sequence[Curve | None], forces: Sequence[Quantity]
) -> None:
    """A residual over a variable as points, and what effects take away of it as a line."""
    before, after = curves
    if before is None:
        return
    _add_curve(figure, row, before, forces, "residual", None)
    if after is not None and before.at.shape == after.at.shape:
        taken = replace(before, force=before.force - after.force, std=np.zeros_like(before.std))
        _add_curve(figure, row, taken, forces, "explained", "solid")


def _add_curve(
    figure: Figure, row: int, curve: Curve, forces: Sequence[Quantity], model: str, dash: str | None
) -> None:
    """A residual over a variable: a line for each axis, or points, with bars that hold 95 %.

    ``dash``: of the line; None draws points alone.
    """
    mode = "markers" if dash is None else "lines+markers" if curve.std.any() else "lines"
    for k, (symbol, unit) in enumerate(forces):
        name = f"{look.symbol(symbol)}{', ' if model else ''}{look.safe(model)}"
        colour = look.AXES[k % len(look.AXES)]
        figure.add_trace(
            look.plotly().Scatter(
                x=look.compact(curve.at), y=look.compact(curve.force[:, k]), name=name,
                mode=mode, marker_size=5, legendgroup=name, showlegend=row == 1,
                line={"color": colour, "width": 1.5, "dash": dash}, marker_color=colour,
                error_y={
                    "array": look.compact(look.BAND * curve.std[:, k]), "thickness": 0.8, "width": 0
                } if curve.std.any() else None,
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


def plan_along(
    name: str, title: str, time: Array, pose: Array, traces: Traces, most: float
) -> Chart:
    """:func:`plan_chart` of a run whose pose (N, 3) is known at times (N,) [s] of its own."""
    places = np.searchsorted(time, traces.time).clip(0, len(pose) - 1)
    return plan_chart(name, title, pose[places], traces, most)


def usual_largest(traces: Traces) -> float:
    """Size [N m] of the force residual that hardly any sample exceeds: a colour scale's end."""
    return float(np.quantile(np.sqrt((traces.residual**2).mean(axis=1)), 0.98))


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


def signals_chart(
    name: str,
    title: str,
    traces: Traces,
    lines: Sequence[Line],
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
