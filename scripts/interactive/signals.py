"""Figures of the workbench from the arrays that `drawing` kept: any stretch, in full detail."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.figures import chart_style as look
from identification.figures.single_charts import Line, plan_along, signals_chart, usual_largest
from identification.fitting.errors import Traces

Array = NDArray[Any]
Span = tuple[float, float]

BINS = 900
"""Stretches of a line: about one for each pixel."""


class Drawn:
    """What was drawn of one step; arrays stay on the disk until a stretch of them is asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.about: dict[str, Any] = json.loads((folder / "charts.json").read_text("utf-8"))

    def array(self, name: str) -> Array:
        """An array of the folder, mapped from its file."""
        return np.load(self.folder / f"{name}.npy", mmap_mode="r", allow_pickle=False)

    def signals(
        self,
        kind: str,
        log: int,
        span: Span | None,
        marked: list[Span],
        order: Sequence[str] = (),
    ) -> Any:
        """Measured and predicted signals of a log, thinned to what is seen of it.

        Parameters
        ----------
        kind : "velocity" or "force"
        span : [s] the stretch that is looked at; None: all
        marked : [s] stretches to be shaded
        order : all models by name: each keeps its colour, whatever it is compared with
        """
        time = self.array(f"{kind}_{log}_time")
        rows = _rows(time, span)
        names = self.about["models"]
        looks = looks_of(names, order)
        lines = [
            Line(name, np.asarray(self.array(f"{kind}_{log}_predicted_{j}")[rows], float), how)
            for j, (name, how) in enumerate(zip(names, looks, strict=False))
        ]
        measured = np.asarray(self.array(f"{kind}_{log}_measured")[rows], float)
        traces = Traces(np.asarray(time[rows], float), measured, lines[-1].predicted)
        quantities = [tuple(q) for q in self.about["speeds" if kind == "velocity" else "forces"]]
        chart = signals_chart("signals", "", traces, lines, quantities, None, BINS)
        return _shaded(chart.figure, marked), chart.height

    def plan(self, log: int, marked: list[Span]) -> Any:
        """The way of a log on the floor, coloured by the force residual; None without a floor."""
        if not (self.folder / f"pose_{log}.npy").exists():
            return None
        time = np.asarray(self.array(f"force_{log}_time"), float)
        last = len(self.about["models"]) - 1
        measured = np.asarray(self.array(f"force_{log}_measured"), float)
        predicted = np.asarray(self.array(f"force_{log}_predicted_{last}"), float)
        traces = Traces(time, measured, predicted)
        of_run = np.asarray(self.array(f"velocity_{log}_time"), float)
        pose = np.asarray(self.array(f"pose_{log}"), float)
        most = usual_largest(traces)
        figure: Any = plan_along("plan", "", of_run, pose, traces, most).figure
        at = np.asarray(figure.data[0].customdata, float)
        # As a list: of an array, which travels as bytes, Dash does not tell what was selected.
        figure.data[0].customdata = None  # or Plotly finds the list equal, and keeps the array
        figure.data[0].customdata = at.tolist()
        # Dots lie on top of each other: what is faint must stay so where the way crosses itself.
        figure.data[0].unselected = {"marker": {"opacity": 0.06}}
        if marked:
            inside = np.zeros(len(at), bool)
            for start, end in marked:
                inside |= (at >= start) & (at <= end)
            figure.data[0].selectedpoints = np.flatnonzero(inside)
        figure.update_layout(dragmode="select")
        return figure

    def drive(self) -> Any:
        """Reference and response of each controller."""
        figure = look.rows_figure(3, DRIVE_HEIGHT)
        for k, name in enumerate(self.about["controllers"]):
            time = np.asarray(self.array(f"drive_{k}_time"), float)
            twist, wanted = (self.array(f"drive_{k}_{what}") for what in ("twist", "reference"))
            colour = look.AXES[k % len(look.AXES)]
            for row, quantity in enumerate(look.VELOCITIES, start=1):
                if k == 0:
                    look.add_line(
                        figure, row, time, wanted[:, row - 1], "reference", look.MEASURED,
                        bins=BINS, legend=row == 1,
                    )  # fmt: skip
                    figure.update_yaxes(title_text=look.label(quantity), row=row, col=1)
                look.add_line(
                    figure, row, time, twist[:, row - 1], look.safe(name),
                    {"color": colour, "width": 1.4}, bins=BINS, legend=row == 1,
                )  # fmt: skip
        figure.update_xaxes(title_text="time [s]", row=3, col=1)
        return figure


DRIVE_HEIGHT = 560
"""[px]"""

COLOURS = ("#3d8fd1", "#e0691f", "#2aa876", "#c265a5", "#a98a1f", "#7b78d8")
"""Of models, in the order in which they were made; they stand on white and on black."""


def looks_of(names: Sequence[str], order: Sequence[str]) -> list[dict[str, Any]]:
    """The line of each model; those that ``order`` does not know come after the others."""
    places = list(dict.fromkeys([*order, *names]))
    found = [places.index(name) % len(COLOURS) for name in names]
    if len(set(found)) < len(found):  # two models that are a whole round of colours apart
        found[0] = (found[0] + 1) % len(COLOURS)
    return [{"color": COLOURS[place], "width": 1.4} for place in found]


def _rows(time: Array, span: Span | None) -> slice:
    if span is None:
        return slice(None)
    start, end = np.searchsorted(time, span)
    # One row more to each side, so that lines run to the edge.
    return slice(max(int(start) - 1, 0), min(int(end) + 1, len(time)))


def _shaded(figure: Any, marked: list[Span]) -> Any:
    for start, end in marked:
        figure.add_vrect(x0=start, x1=end, fillcolor="rgba(224,105,31,0.18)", line_width=0)
    return figure


def stretches(times: list[float], gap: float) -> list[Span]:
    """Stretches that hold some times [s]; those less than ``gap`` apart are one."""
    found: list[Span] = []
    for at in sorted(times):
        if found and at - found[-1][1] <= gap:
            found[-1] = (found[-1][0], at)
        else:
            found.append((at - gap / 2, at + gap / 2))
    return found
