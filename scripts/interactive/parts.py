"""What the parts of the workbench's page share: buttons, names of models, the look of figures."""

from __future__ import annotations

from typing import Any

NOTHING: dict[str, Any] = {"data": [], "layout": {}}
HIDDEN = {"display": "none"}

PLAIN_NAMES = {"paper": "paper (the published youBot's)"}
"""Models whose name alone tells a stranger nothing."""


def plain(model: str) -> str:
    """A model's name as the page writes it."""
    return PLAIN_NAMES.get(model, model.removeprefix("workbench/"))


def button(text: str, what: str, which: str = "", **more: Any) -> Any:
    """A button whose press is ``Callbacks.clicked``."""
    from dash import html

    return html.Button(text, id={"do": what, "with": which}, className="wide", **more)


def themed(figure: Any) -> Any:
    """A figure for light and dark: mid-grey lines stand on both."""
    if isinstance(figure, dict):  # of a file, as JSON
        layout = figure.setdefault("layout", {})
        layout.update(_PLAIN)
        for name, axis in layout.items():
            if name.startswith(("xaxis", "yaxis")):
                axis.update(_AXIS)
        return figure
    figure.update_layout(**_PLAIN)
    figure.update_xaxes(**_AXIS)
    figure.update_yaxes(**_AXIS)
    return figure


_AXIS = {"gridcolor": "rgba(128,128,128,0.22)", "zerolinecolor": "rgba(128,128,128,0.6)"}
_CLEAR = "rgba(0,0,0,0)"
_PLAIN = {"paper_bgcolor": _CLEAR, "plot_bgcolor": _CLEAR, "font": {"color": "#808a97", "size": 13}}
