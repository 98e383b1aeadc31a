"""The frame of the workbench's page: it is drawn once, what follows the project stands in it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from youbot_scripts.interactive.parts import HIDDEN, button, plain
from youbot_scripts.interactive.project import DONE, Project


def layout(project: Project, refresh: int) -> Any:
    """The frame: it is drawn once, and holds what a reader has chosen to look at.

    Parameters
    ----------
    refresh : [ms] between two looks at the project
    """
    from dash import dcc, html

    from controllers.registry import CONTROLLERS

    # The page says it when the server has gone.
    command = f"youbot workbench --folder {shlex.quote(str(project.folder))}"
    again: dict[str, Any] = {"data-command": command}
    return html.Div(
        [
            dcc.Interval("tick", interval=refresh),
            *(dcc.Store(name) for name in ("revision", "said", "drawn", "span", "marked")),
            dcc.Download("download"),
            html.Header([html.H1("Workbench"), html.Code(str(project.folder))], **again),
            html.Div(
                [
                    html.Aside(_aside(project, list(CONTROLLERS))),
                    html.Main(
                        [
                            html.P("", id="message", role="alert", className="message"),
                            html.Div(id="panel"),
                            html.Section(_driven(), className="pictures"),
                            html.Section(_pictures(), id="pictures", className="pictures"),
                            html.Div(id="commands"),
                        ]
                    ),
                ],
                className="columns",
            ),
        ]
    )


def models_of(project: Project, first: Mapping[str, str]) -> list[dict[str, str]]:
    """Models that can be chosen: ``first``, then all that the workbench has made, and the paper's.

    Parameters
    ----------
    first : value and label of what stands for no model of its own
    """
    made = [step.model for step in project.steps if step.model and step.state == DONE]
    names = dict.fromkeys([*project.versions, *made, "paper"])
    labels = {**first, **{name: plain(name) for name in names}}
    return [{"label": label, "value": value} for value, label in labels.items()]


def _aside(project: Project, controllers: list[str]) -> list[Any]:
    from dash import dcc, html

    return [
        html.H2("Logs"),
        _group(
            "Logs to work on",
            dcc.Checklist(
                id="logs", options=project.logs, value=project.chosen, className="logs",
            ),
        ),
        dcc.Upload(
            html.Button("Drop logs here, or choose files", className="wide"),
            id="upload", multiple=True, className="drop",
        ),
        html.H2("Do"),
        button("Check the logs", "doctor"),
        button("Identify", "identify"),
        button("Compare", "compare"),
        _choice("with", "beside", models_of(project, BESIDE), ""),
        button("Diagnose: what is missing?", "diagnose"),
        _folding(
            "Drive",
            _group(
                "Controllers",
                dcc.Checklist(
                    id="controllers", options=controllers, value=["kinematic", "computed_torque"]
                ),
            ),
            _choice("on the plant", "plant", models_of(project, PLANT), ACTIVE),
            button("Drive", "drive"),
        ),
        _folding(
            "Download",
            *(
                html.Button(text, id={"save": what}, className="wide")
                for text, what in (
                    ("The model (JSON)", "model"), ("Commands as a script", "script"),
                    ("Commands as a notebook", "notebook"),
                )
            ),
        ),
    ]  # fmt: skip


ACTIVE = "active"
"""Stands for the model that is active when Drive is pressed."""

PLANT = {ACTIVE: "the model itself"}
BESIDE = {"": "the version before it"}
"""What stands first among the models that can be chosen: value and label."""


def _choice(text: str, name: str, options: list[dict[str, str]], value: str) -> Any:
    """A list of models to choose one from."""
    from dash import dcc, html

    chosen = dcc.Dropdown(id=name, options=options, value=value, clearable=False, searchable=False)
    return html.Label([text, chosen], className="beside")


def _folding(title: str, *parts: Any) -> Any:
    """A part of the buttons that is folded on a phone, where results stand below them all."""
    from dash import html

    return html.Details([html.Summary(html.H2(title)), *parts], open=True, className="folding")


def _group(name: str, boxes: Any) -> Any:
    """Boxes under a name that a screen reader says with each."""
    from dash import html

    return html.Fieldset([html.Legend(name), boxes])


# Only what works without a network.
_TOOLS = ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]
_PLAIN: Any = {"displaylogo": False, "responsive": True, "modeBarButtons": [_TOOLS]}
_BRUSH: Any = {**_PLAIN, "modeBarButtons": [["select2d", *_TOOLS]]}


def _driven() -> list[Any]:
    """What the last controllers did: numbers, and under them the chart."""
    from dash import dcc, html

    return [html.Div(id="driven"), dcc.Graph(id="drive", style=HIDDEN, config=_PLAIN)]


RESIDUAL_NOTE = (
    "What the model leaves of the measured torques, as forces: along x and y, each times a length "
    "of the robot (L), so that all are in N m, and the moment about the vertical. The twist is the "
    "three velocities of the base; panels of one share belong together."
)


def _log() -> Any:
    from dash import dcc

    return dcc.Dropdown(id="log", clearable=False, searchable=False, className="log")


def _pictures() -> list[Any]:
    from dash import dcc, html

    return [
        html.Div(
            [
                html.Label(["Log ", _log()]),
                html.Div(
                    dcc.RadioItems(
                        id="kind", value="velocity", inline=True,
                        options=[
                            {"label": "velocities in free run", "value": "velocity"},
                            {"label": "forces", "value": "force"},
                        ],
                    ),
                    role="radiogroup", **{"aria-label": "Signals"},  # type: ignore[arg-type]
                ),
                html.Button("Clear the mark", id="unmark"),
            ],
            className="bar",
        ),
        html.P(
            "Drag in a chart to zoom: all rows of what you see are drawn. Select on the floor "
            "plan, or with the box tool in a signal, to mark the same stretch in every chart.",
            className="note",
        ),
        # The style sheet hides a heading above a chart that is hidden.
        html.H2("Measured, and what the model says"),
        dcc.Graph(id="signals", style=HIDDEN, config=_BRUSH),
        html.H2("Floor plan: where forces are left unexplained"),
        dcc.Graph(id="plan", style=HIDDEN, config=_BRUSH),
        html.H2("Force residual over what it depends on most"),
        html.P(RESIDUAL_NOTE, className="note"),
        dcc.Graph(id="residual", style=HIDDEN, config=_PLAIN),
    ]  # fmt: skip
