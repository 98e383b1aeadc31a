"""How interactive charts look: Plotly figures that fit a phone and a screen, light and dark.

Colours of text, grid and background are left out: the page sets them, by the reader's choice of
light or dark.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.figures.style import BAND, thin
from identification.mechanisms.quantities import VELOCITIES as VELOCITIES, Quantity
from youbot_env.errors import optional_library

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

GREEK = {"phi": "φ", "mu": "µ"}
"""Letters of the names of parameters and angles."""

# As in `style`, Okabe and Ito's palette, a little lighter: it must stand on black too.
MEASURED = {"color": "#9a9a9a", "width": 3}
BEFORE = {"color": "#3d8fd1", "width": 1.2}
AFTER = {"color": "#e0691f", "width": 1.4}
RESIDUAL = {"color": "#8a8a8a", "width": 0.8}
REFERENCE = {"color": "#3d8fd1", "width": 1.2, "dash": "dot"}
FLOOR_FILL = "rgba(86,180,233,0.28)"
BAR, WORST = "#6aaed6", "#e0691f"
AXES = ("#3d8fd1", "#e0691f", "#2aa876")
"""One colour for each axis of the mechanism, where axes share a chart."""

TOP, BOTTOM = 74, 46
"""Margins [px] of every chart: above for the legend and a title, below for the abscissa's name."""

SCALE = "Viridis"
"""Of a size, by colour: even in lightness, and readable to the colour-blind."""


MOST_POINTS = 50_000
"""Points of all lines of a page: its file then stays below 6 MB, Plotly's own 4.8 MB included."""

PLAN_HEIGHT = 440
"""[px]"""

PLAN_POINTS = 1500
"""Points of one floor plan: more lie on top of each other."""


PATH_POINTS = 2000
"""Of a way on the floor, and of a speed over time: what a screen shows."""

SPEED_TIME = 0.2
"""[s] over which the pose is differenced: its white noise of a millimetre is 7 mm/s then."""

UNITS = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "rad": (180.0 / np.pi, "°")}
"""By the SI unit, factor and unit in which people state these numbers."""

ROW, SIDE = 26, 96
"""[px] Of rows of marks: of one row, and of what stands above and below all rows of a panel."""


@dataclass(frozen=True)
class Chart:
    """An interactive figure.

    Attributes
    ----------
    name : letters, digits and "_", unique on a page
    title : what it shows, one line
    figure : Plotly's
    height : [px]
    """

    name: str
    title: str
    figure: Figure
    height: int


def plotly() -> Any:
    """Plotly's graph objects, loaded only when a chart is made.

    Raises
    ------
    InputError
        If it is not installed.
    """
    optional_library("plotly", "plots", "pages need plotly", "leave --report out")
    import plotly.graph_objects as objects

    return objects


def symbol(mathtext: str) -> str:
    """A quantity's symbol as Plotly writes it: ``$L\\,F_X$`` becomes L F with a subscript."""
    plain = mathtext.replace("$", "").replace(r"\,", " ")
    return re.sub(r"_(\w|\{.*?\})", lambda m: f"<sub>{m[1].strip('{}')}</sub>", plain)


def safe(text: str) -> str:
    """Text of a user's (a log's name) that a chart must not read as markup."""
    return escape(text, quote=False)


def typeset(escaped: str) -> str:
    """Names of parameters and units as markup: powers raised, indices lowered, phi, mu in Greek.

    ``escaped``: text that holds no markup any more.
    """
    indexed = re.sub(
        r"\b(phi|mu|m|I|x|M|a)_?(\d|[XY])\b",
        lambda name: f"{GREEK.get(name[1], name[1])}<sub>{name[2]}</sub>",
        escaped,
    )
    return re.sub(r"\^(-?\d+)", r"<sup>\1</sup>", indexed)


def parameter(name: str, unit: str) -> str:
    """A parameter's name and unit for a title or an axis: ``mu1`` is a letter with an index."""
    return f"{typeset(safe(name).replace('m_a', 'm a'))} [{typeset(safe(unit))}]"


def label(quantity: Quantity) -> str:
    """Symbol and unit of a quantity, for an axis."""
    return f"{symbol(quantity[0])} [{quantity[1]}]"


def rows_figure(
    count: int, height: int, titles: Sequence[str] = (), *, shared: bool = True
) -> Figure:
    """A figure of panels below each other, ``height`` [px] in all.

    With ``shared`` their abscissae zoom together, and the lowest alone has numbers.
    """
    plotly()
    from plotly.subplots import make_subplots

    # Between panels: room for a title, and for an abscissa of their own with its name.
    between = (14 if shared else 70) + (22 if titles else 0)
    gap = min(between / (height - TOP - BOTTOM), 0.9 / max(count - 1, 1))
    figure = make_subplots(
        rows=count, cols=1, shared_xaxes=shared, vertical_spacing=gap,
        subplot_titles=[f"<b>{title}</b>" for title in titles] or None,
    )  # fmt: skip
    # Titles are notes, each above the left end of its panel.
    figure.update_annotations(x=0.0, xanchor="left", font_size=13)
    return finished(figure, height)


def finished(figure: Figure, height: int) -> Figure:
    """A figure of some height [px] with the margins, legend and behaviour of all charts."""
    figure.update_layout(
        margin={"l": 62, "r": 12, "t": TOP, "b": BOTTOM},
        # Above the first panel's title, whatever the height.
        legend={
            "orientation": "h", "yanchor": "bottom", "x": 0,
            "y": 1.0 + 26.0 / (height - TOP - BOTTOM),
        },
        hovermode="closest",
        dragmode="zoom",
        font={"size": 13},
        template="none",
        autosize=True,
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": "#8a8a8a", "activecolor": AFTER["color"]},
    )  # fmt: skip
    figure.update_xaxes(automargin=True, zeroline=False, showspikes=False)
    figure.update_yaxes(automargin=True, zeroline=True)
    return figure


def compact(values: Array | Sequence[float]) -> NDArray[np.float32]:
    """Single precision: what a screen shows, in half the bytes."""
    return np.asarray(values, np.float32)


def add_line(
    figure: Figure, row: int, time: Array, values: Array, name: str, look: dict[str, Any],
    *, bins: int, legend: bool, visible: bool | str = True,
) -> None:  # fmt: skip
    """A line in a panel (from 1), thinned to ``bins`` stretches, extremes kept.

    One entry in the legend stands for the line in all panels.
    """
    x, y = thin(time, values, bins)
    trace = plotly().Scatter(
        x=compact(x), y=compact(y), name=name, line=look, mode="lines", visible=visible,
        legendgroup=name, showlegend=legend, hovertemplate="%{y:.4g} at %{x:.2f} s",
    )  # fmt: skip
    figure.add_trace(trace, row=row, col=1)


def add_band(figure: Figure, row: int, half: float) -> None:
    """The band from -half to half over a whole panel: what noise alone leaves."""
    if half > 0:
        how: dict[str, Any] = {"fillcolor": FLOOR_FILL, "line_width": 0, "layer": "below"}
        figure.add_hrect(y0=-half, y1=half, **_panel(row), **how)


def add_vertical(figure: Figure, row: int, x: float) -> None:
    """A dotted line across a panel (from 1)."""
    line: dict[str, Any] = {"line_dash": "dot", "line_width": 1.5}
    figure.add_vline(x=x, **_panel(row), **line)


def add_horizontal(figure: Figure, row: int, y: float) -> None:
    """A dashed line along a panel (from 1)."""
    colour, width = AFTER["color"], 1.2
    line: dict[str, Any] = {"line_dash": "dash", "line_width": width, "line_color": colour}
    figure.add_hline(y=y, **_panel(row), **line)


def _panel(row: int) -> dict[str, Any]:
    # Any: plotly declares these numbers as str.
    return {"row": row, "col": 1}


def log_axis(values: Sequence[float]) -> dict[str, Any]:
    """A logarithmic axis around positive values, whose few labels do not run into each other."""
    known = [value for value in values if 0 < value < np.inf]
    low, high = (min(known), max(known)) if known else (1.0, 10.0)
    low, high = 0.8 * low, 1.25 * high
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    # More than three decades have room for their own labels alone.
    steps = (1, 2, 5) if high < 30 * low else (1, 3) if high < 1000 * low else (1,)
    ticks = [step * 10.0**decade for decade in decades for step in steps]
    ticks = [tick for tick in ticks if low <= tick <= high]
    return {
        "type": "log", "range": [float(np.log10(low)), float(np.log10(high))],
        "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks],
    }  # fmt: skip


def half_band(square: float, count: int) -> float:
    """Half the width that holds 95 % of noise whose squares over ``count`` samples are given."""
    return BAND * float(np.sqrt(square / max(count, 1)))
