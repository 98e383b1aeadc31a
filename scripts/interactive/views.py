"""What the workbench's page shows: its frame, and the panel that follows the project."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from youbot_scripts.interactive.project import DONE, FAILED, Project, Step
from youbot_scripts.shared.tables import percent

NOTHING: dict[str, Any] = {"data": [], "layout": {}}
HIDDEN = {"display": "none"}

SHOWN_STEPS = 6
"""Commands that the panel lists, the newest first."""

SHOWN_CANDIDATES = 6
"""Candidates that get a card."""


def layout(project: Project, refresh: int) -> Any:
    """The frame: it is drawn once, and holds what a reader has chosen to look at.

    Parameters
    ----------
    refresh : [ms] between two looks at the project
    """
    from dash import dcc, html

    from controllers.registry import CONTROLLERS

    return html.Div(
        [
            dcc.Interval("tick", interval=refresh),
            *(dcc.Store(name) for name in ("revision", "said", "drawn", "span", "marked")),
            dcc.Download("download"),
            html.Header([html.H1("Workbench"), html.Code(str(project.folder))]),
            html.Div(
                [
                    html.Aside(_aside(project, list(CONTROLLERS))),
                    html.Main(
                        [
                            html.P("", id="message", role="alert", className="message"),
                            html.Div(id="panel"),
                            html.Section(_pictures(), className="pictures"),
                        ]
                    ),
                ],
                className="columns",
            ),
        ]
    )


ACTIVE = "active"
"""Stands for the model that is active when Drive is pressed."""


def models_of(project: Project, first: Mapping[str, str]) -> list[dict[str, str]]:
    """Models that can be chosen: ``first``, then all that the workbench has made, and the paper's.

    Parameters
    ----------
    first : value and label of what stands for no model of its own
    """
    made = [step.model for step in project.steps if step.model and step.state == DONE]
    names = dict.fromkeys([*project.versions, *made, "paper"])
    labels = {**first, **{name: name.removeprefix("workbench/") for name in names}}
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
        _button("Check the logs", "doctor"),
        _button("Identify", "identify"),
        _button("Compare", "compare"),
        html.Label(
            ["beside", dcc.Dropdown(id="beside", value="", clearable=False)], className="beside"
        ),
        _button("Diagnose: what is missing?", "diagnose"),
        html.H2("Drive"),
        _group(
            "Controllers",
            dcc.Checklist(
                id="controllers", options=controllers, value=["kinematic", "computed_torque"]
            ),
        ),
        html.Label(
            ["on the plant", dcc.Dropdown(id="plant", value=ACTIVE, clearable=False)],
            className="beside",
        ),
        _button("Drive", "drive"),
        html.H2("Take away"),
        *(
            html.Button(text, id={"save": what}, className="wide")
            for text, what in (
                ("Model", "model"), ("Commands as a script", "script"),
                ("Commands as a notebook", "notebook"),
            )
        ),
    ]  # fmt: skip


def _group(name: str, boxes: Any) -> Any:
    """Boxes under a name that a screen reader says with each."""
    from dash import html

    return html.Fieldset([html.Legend(name), boxes])


def _pictures() -> list[Any]:
    from dash import dcc, html

    # Only what works without a network.
    tools = ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]
    plain: Any = {"displaylogo": False, "responsive": True, "modeBarButtons": [tools]}
    brush: Any = {**plain, "modeBarButtons": [["select2d", *tools]]}
    return [
        html.Div(
            [
                html.Label(["Log ", dcc.Dropdown(id="log", clearable=False, className="log")]),
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
        dcc.Graph(id="signals", style=HIDDEN, config=brush),
        dcc.Graph(id="plan", style=HIDDEN, config=brush),
        dcc.Graph(id="residual", style=HIDDEN, config=plain),
        dcc.Graph(id="drive", style=HIDDEN, config=plain),
    ]  # fmt: skip


def _button(text: str, what: str, which: str = "", **more: Any) -> Any:
    from dash import html

    return html.Button(text, id={"do": what, "with": which}, className="wide", **more)


# --- the panel -------------------------------------------------------------------------------


def panel(project: Project) -> list[Any]:
    """What follows the project: the model, the verdict, the candidates, the commands."""
    return [
        *_versions(project),
        *_running(project),
        *_verdict(project),
        *_errors(project),
        *_cards(project),
        *_findings(project),
        *_driven(project),
        *_steps(project),
    ]


def _versions(project: Project) -> list[Any]:
    from dash import html

    names = [html.Code(name) for name in project.versions]
    between = [part for name in names for part in (" → ", name)][1:]
    undo = _button("Undo", "undo", disabled=len(project.versions) < 2)
    undo.className = "undo"
    return [html.Div([html.Strong("Model: "), *between, undo], className="versions")]


def _running(project: Project) -> list[Any]:
    """What is being done now: the list of commands stands further down."""
    from dash import html

    step = next((step for step in project.steps if step.is_open), None)
    if step is None:
        return []
    label: dict[str, Any] = {"aria-label": f"Now: {step.title}"}
    bar = html.Progress(value=str(step.share), max="1", **label)
    return [html.P([html.Strong(f"{step.title} ..."), bar], className="now", role="status")]


def _verdict(project: Project) -> list[Any]:
    """The last sentence on the active model, and what to do next."""
    from dash import html

    step = project.last("identify", "compare", "diagnose", "add")
    found = project.result(step)
    if step is None or found is None:
        return [html.Div(html.P(_first_hint(project)), className="verdict", role="status")]
    lines = _sentences(step, found)
    return [
        html.Div([html.P(line) for line in lines], className="verdict", role="status"),
        *(html.P(line, className="warning") for line in found.get("warnings", [])[:4]),
    ]


def _first_hint(project: Project) -> str:
    if not project.chosen:
        return "Choose logs under Logs, or drop them there."
    checked = project.result(project.last("doctor"))
    if checked is None:
        return "Next: check the logs, then identify."
    unusable = [name for name, report in checked["logs"].items() if not report["usable"]]
    if unusable:
        return f"{', '.join(unusable)} cannot be used: see the checks, or leave it out."
    return "The logs can be used. Next: identify."


def _sentences(step: Step, found: Mapping[str, Any]) -> list[str]:
    if step.kind == "diagnose":
        return [found["headline"], *found["words"], *_after_diagnosis(found)]
    if step.kind == "add":
        before, after = (percent(found[name]["force_error"]) for name in ("before", "after"))
        worth = "worth it" if found["worthwhile"] else "not worth it"
        reasons = [f"Not worth it: {reason}." for reason in found["reasons"]]
        onwards = "Next: compare it on a log that the fit has not seen, or drive controllers on it."
        told = [f"Force error {before} → {after}: {worth}.", found["words"], *reasons]
        return [*told, onwards if found["worthwhile"] else "Undo takes it away again."]
    errors = found["total"] if step.kind == "compare" else found["errors"]
    floor = found["noise_floor"] if step.kind == "compare" else errors["noise_floor"]
    error, noise = percent(errors["force_error"]), percent(floor["force_error"])
    line = f"Force error {error}; noise alone {noise}."
    if found.get("misfit"):
        return [line, "The model lacks something: press Diagnose to learn what."]
    return [line, "It fits."]


def _after_diagnosis(found: Mapping[str, Any]) -> list[str]:
    """What to press after a diagnosis."""
    if found["missing"]:
        name = found["missing"][0].replace("_", " ")
        return [f'Next: "Add to the model" on the card "{name}", and watch the error fall.']
    if found["verdict"] == "adequate":
        return ["Next: drive controllers on the model, or take it away."]
    return []


def _errors(project: Project) -> list[Any]:
    """The error of each version as it falls."""
    from dash import dcc

    from identification.figures.single_charts import errors_chart

    rows: list[tuple[str | None, float, float]] = []
    floor = {"force_error": float("nan"), "velocity_error": float("nan")}
    for step in project.kept:
        found = project.result(step)
        if step.kind != "add" or found is None:
            continue
        floor = {**floor, **_numbers(found.get("noise_floor", {}))}
        if not rows:
            before = _numbers(found["before"])
            rows.append((None, before["force_error"], before["velocity_error"]))
        after = _numbers(found["after"])
        rows.append((found["effect"], after["force_error"], after["velocity_error"]))
    if not rows:
        return []
    chart = errors_chart(rows, floor)
    style = {"height": f"{chart.height}px"}
    return [dcc.Graph(figure=themed(chart.figure), style=style, config={"displayModeBar": False})]


def _numbers(errors: Mapping[str, Any]) -> dict[str, float]:
    kinds = ("force_error", "velocity_error")
    return {
        kind: float("nan") if errors.get(kind) is None else float(errors[kind]) for kind in kinds
    }


def _cards(project: Project) -> list[Any]:
    """Candidates of the last diagnosis, each with what it would take away."""
    from dash import html

    step = project.last("diagnose")
    found = project.result(step)
    if step is None or found is None or not found["candidates"]:
        return []
    base, there = found["steps"][0]["force_error"], _effects_of(project)
    cards = [
        _card(item, base, found, item["effect"] in there)
        for item in found["candidates"][:SHOWN_CANDIDATES]
    ]
    return [html.H2("Candidates"), html.Div(cards, className="cards")]


def _card(item: Mapping[str, Any], base: float, found: Mapping[str, Any], there: bool) -> Any:
    from dash import html

    name = item["effect"]
    share = max(0.0, 1.0 - (item["force_error"] / base) ** 2) if base else 0.0
    sizes = [
        f"{key} = {entry['value']:.4g} {'' if entry['unit'] == '1' else entry['unit']}".strip()
        for key, entry in item["parameters"].items()
    ]
    marks = [
        *(["named by the diagnosis"] if name in found["missing"] else []),
        *(["in the model"] if there else []),
        *(f"cannot be told from {other}" for other in found["ambiguous_with"].get(name, [])),
    ]
    return html.Div(
        [
            html.H3(name.replace("_", " ")),
            html.P(
                f"takes away {max(share, 0.0):.0%} of the squared error; p = {item['p_value']:.2g}"
            ),
            html.P("; ".join(sizes), className="note"),
            *(html.P(mark, className="mark") for mark in marks),
            _button("Add to the model", "add", name, disabled=there),
        ],
        className="card",
    )


def _effects_of(project: Project) -> set[str]:
    """Effects that the active model holds."""
    from youbot_env.errors import InputError

    if project.model == "paper":
        return set()
    try:
        from identification.mechanisms.registry import load_any_model

        return set(load_any_model(project.folder / project.model).effects)
    except InputError:
        return set()


def _findings(project: Project) -> list[Any]:
    """What the checks of the logs have found, each with its cure."""
    from dash import html

    found = project.result(project.last("doctor"))
    rows = []
    for path, report in (found or {}).get("logs", {}).items():
        told = [item for item in report["findings"] if item["level"] != "info"]
        for item in told:
            cure = f" {item['cure']}" if item.get("cure") else ""
            rows.append(html.Li([html.Code(path), f" {item['level']}: {item['message']}.{cure}"]))
        if report["usable"] and not told:
            rows.append(html.Li([html.Code(path), " nothing wrong"]))
    if not rows:
        return []
    return [html.Details([html.Summary("Checks of the logs"), html.Ul(rows)], open=True)]


def _driven(project: Project) -> list[Any]:
    """Errors of the controllers that were driven last."""
    from dash import html

    found = project.result(project.last("drive"))
    if found is None:
        return []
    rows = [
        html.Tr([html.Td(row["controller"]), html.Td(_tracking(row))])
        for row in found.get("results", [])
    ]
    head = html.Thead(html.Tr([html.Th("controller"), html.Th("misses the reference by")]))
    return [html.H2("Driven"), html.Table([head, html.Tbody(rows)])] if rows else []


def _tracking(row: Mapping[str, Any]) -> str:
    error = row["metrics"]["nrmse"]["mean"]
    return "diverges" if row["diverged"] or error is None else percent(float(error))


def _steps(project: Project) -> list[Any]:
    """The commands, the newest first."""
    from dash import html

    rows = []
    for step in reversed(project.steps[-SHOWN_STEPS:]):
        parts: list[Any] = [
            html.Span(
                step.state + (", undone" if step.undone else ""), className=f"state {step.state}"
            ),
            html.Code(step.command),
        ]
        if step.is_open:
            label: dict[str, Any] = {"aria-label": step.title}
            parts.append(html.Progress(value=str(step.share), max="1", **label))
            parts.append(_cancel(step))
        if step.state == FAILED or (step.message and step.state != DONE):
            parts.append(html.P(step.message, className="warning"))
        rows.append(html.Li(parts))
    return [html.H2("Commands"), html.Ol(rows, className="steps", reversed=True)] if rows else []


def _cancel(step: Step) -> Any:
    from dash import html

    return html.Button("Cancel", id={"do": "cancel", "with": str(step.number)})


def themed(figure: Any, title: str = "") -> Any:
    """A figure for light and dark: mid-grey lines stand on both; its title above the legend."""
    heading = {"text": f"<b>{title}</b>", "x": 0.0, "xanchor": "left", "y": 1.0, "yanchor": "top",
               "yref": "container", "pad": {"t": 4, "l": 4}, "font": {"size": 15}}  # fmt: skip
    if isinstance(figure, dict):
        figure.setdefault("layout", {}).update({**_PLAIN, "title": heading})
        return figure
    figure.update_layout(title=heading)
    figure.update_layout(**_PLAIN)
    figure.update_xaxes(gridcolor=_GRID, zerolinecolor=_ZERO)
    figure.update_yaxes(gridcolor=_GRID, zerolinecolor=_ZERO)
    return figure


_GRID, _ZERO = "rgba(128,128,128,0.22)", "rgba(128,128,128,0.6)"
_CLEAR = "rgba(0,0,0,0)"
_PLAIN = {"paper_bgcolor": _CLEAR, "plot_bgcolor": _CLEAR, "font": {"color": "#808a97", "size": 13}}
