"""Numbers with intervals: a row for each name, a mark for each number, a bar for its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from identification.figures import chart_style as look

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True)
class Spread:
    """A number with the ends of its interval, which are None where there is none.

    Attributes
    ----------
    name : of its row
    told : what is shown when it is pointed at; by default number and interval
    """

    name: str
    value: float
    low: float | None = None
    high: float | None = None
    told: str = ""


def height_of(rows: int, panels: int = 1, series: int = 1) -> int:
    """Height [px] of panels below each other with so many rows of names each."""
    return look.TOP + look.BOTTOM + panels * (rows * max(look.ROW, 12 * series) + look.SIDE)


def add_spreads(
    figure: Figure,
    row: int,
    spreads: Sequence[Spread],
    series: str,
    mark: dict[str, Any],
    *,
    beside: float = 0.0,
    legend: bool = False,
    unit: str = "",
) -> None:
    """Marks with intervals in a panel (from 1) whose ordinate is the number of the row.

    :func:`name_rows` gives the rows their names.

    Parameters
    ----------
    series : name in the legend, one for all panels
    mark : Plotly's marker
    beside : part of a row by which the marks are moved down: several series do not cover each other
    """
    ends = [(_end(s.low, s.value), _end(s.high, s.value)) for s in spreads]
    figure.add_trace(
        look.plotly().Scatter(
            x=[s.value for s in spreads],
            y=[k + beside for k in range(len(spreads))],
            error_x={
                "type": "data", "symmetric": False, "thickness": 1.4, "width": 3,
                "array": [high - s.value for s, (_, high) in zip(spreads, ends, strict=True)],
                "arrayminus": [s.value - low for s, (low, _) in zip(spreads, ends, strict=True)],
                "color": mark.get("line", {}).get("color") or mark.get("color"),
            },
            text=[s.told or _told(s, unit) for s in spreads],
            mode="markers", marker={"size": 8, **mark}, name=series, legendgroup=series,
            showlegend=legend, hovertemplate="%{text}<extra></extra>",
        ),
        row=row, col=1,
    )  # fmt: skip


def name_rows(figure: Figure, row: int, names: Sequence[str]) -> None:
    """Names of a panel's rows, the first one on top, and a thin line at each."""
    figure.update_yaxes(
        tickvals=list(range(len(names))), ticktext=[look.safe(name) for name in names],
        range=[len(names) - 0.5, -0.5], zeroline=False, row=row, col=1,
    )  # fmt: skip


def _end(end: float | None, value: float) -> float:
    return value if end is None else end


def _told(spread: Spread, unit: str) -> str:
    unit = f" {unit}" if unit else ""
    said = f"{look.safe(spread.name)}: {spread.value:.4g}{unit}"
    if spread.low is None or spread.high is None:
        return said
    return f"{said}<br>95 %: {spread.low:.4g} to {spread.high:.4g}{unit}"
