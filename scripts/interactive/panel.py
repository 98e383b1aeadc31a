"""What follows the project on the workbench's page: model, verdict, candidates, commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from youbot_env.physics.effect import with_unit
from youbot_scripts.interactive.advice import (
    ABOUT_MODELS,
    Advice,
    advice,
    diagnosis_on_the_way,
    named_left,
    sentences,
    words,
)
from youbot_scripts.interactive.parts import button, plain, themed
from youbot_scripts.interactive.project import CANCELLED, DONE, FAILED, Project, Step
from youbot_scripts.shared.report_page import MAY_VANISH, unbroken
from youbot_scripts.shared.tables import percent

SHOWN_CANDIDATES = 6
"""Candidates that get a card, those that the diagnosis names included."""

SHOWN_SIZES = 4
"""Parameters that a card states: a table of ten phases tells nobody anything."""


def panel(project: Project) -> list[Any]:
    """What stands on top: what runs, the verdict, what to do next, the candidates."""
    return [
        *_versions(project),
        *_running(project),
        *_ended_badly(project),
        *_just_driven(project),
        *_verdict(project),
        *_compared(project),
        *_errors(project),
        *_cards(project),
        *_findings(project),
    ]


# --- on top ----------------------------------------------------------------------------------


def _versions(project: Project) -> list[Any]:
    from dash import html

    names = [html.Code(plain(name)) for name in project.versions]
    between = [part for name in names for part in (" → ", name)][1:]
    undo = button("Undo", "undo", disabled=len(project.versions) < 2)
    undo.className = "undo"
    return [html.Div([html.Strong("Model: "), *between, undo], className="versions")]


def _running(project: Project) -> list[Any]:
    """What is being done now, and what waits."""
    from dash import html

    steps = [step for step in project.steps if step.is_open]
    lines = []
    if project.drawing:
        title = f"Drawing the charts of {plain(project.drawing)} ..."
        lines.append([title, _bar(0.0), *_since(project)])
    elif steps:
        step = steps.pop(0)
        lines.append([f"{step.title} ...", _bar(step.share), *_since(project, step), _cancel(step)])
    lines += [[f"Then: {step.title} ", _cancel(step)] for step in steps]
    return [html.P(line, className="now", role="status") for line in lines]


def _bar(share: float) -> Any:
    """How far something is; it moves by itself while that is not known."""
    from dash import html

    known: dict[str, Any] = {"value": str(share)} if share > 0 else {}
    label: dict[str, Any] = {"aria-label": "progress"}
    return html.Progress(max="1", **known, **label)


def _since(project: Project, step: Step | None = None) -> list[Any]:
    """Seconds since it began, which the page counts by itself, and those of the last time."""
    from dash import html

    began: dict[str, Any] = {"data-since": f"{project.since:.1f}"}
    counted = [html.Span(className="since", **began)]
    earlier = [
        one.seconds for one in project.steps if step and one.kind == step.kind and one.seconds
    ]
    return [*counted, f" (the last time {earlier[-1]:.0f} s) "] if earlier else [*counted, " "]


def _cancel(step: Step) -> Any:
    from dash import html

    label: dict[str, Any] = {"aria-label": f"Cancel: {step.title}"}
    return html.Button("Cancel", id={"do": "cancel", "with": str(step.number)}, **label)


def _ended_badly(project: Project) -> list[Any]:
    """Why the last command failed, where it did."""
    from dash import html

    ended = [step for step in project.steps if not step.is_open]
    if not ended or ended[-1].state not in (FAILED, CANCELLED):
        return []
    step = ended[-1]
    return [html.P(f"{step.title}: {step.state}: {step.message}", className="warning")]


def _verdict(project: Project) -> list[Any]:
    """The last sentence on the active model, and what to do next."""
    from dash import html

    told = [html.P(unbroken(line)) for line in sentences(project)]
    told += [html.P([item.text, *_pressed(item)]) for item in advice(project)]
    found = project.result(project.last(*ABOUT_MODELS)) or {}
    # The verdict says so already, and leads to a button of the page.
    warnings = [line for line in found.get("warnings", []) if line != found.get("misfit")]
    doubt = [html.P(MAY_VANISH, className="note")] if warnings and found.get("misfit") else []
    return [
        html.Div(told, className="verdict", role="status"),
        *doubt,
        *(html.P(line, className="warning") for line in warnings[:4]),
    ]


def _pressed(item: Advice) -> list[Any]:
    """The button of an advice: another one than that of the same action beside or below it."""
    if not item.label:
        return []
    found = button(item.label, f"next-{item.do}", item.which)
    found.className = "next"
    return [" ", found]


def _compared(project: Project) -> list[Any]:
    """Errors of two models, side by side."""
    from dash import html

    step = project.last(*ABOUT_MODELS)
    if step is None or step.kind != "compare" or not step.beside:
        return []
    rows = []
    for one in (project.comparison(step.beside, step.logs), step):
        found = project.result(one)
        if one is None or found is None:
            continue
        cells = []
        for kind in ("force_error", "velocity_error"):
            error, noise = (_error(found[which][kind]) for which in ("total", "noise_floor"))
            # Under the error on a phone, where two columns more would be out of sight.
            cells.append(html.Td([f"{error} ", html.Small(f"noise {noise}")]))
        rows.append(html.Tr([html.Th(plain(one.subject), scope="row"), *cells]))
    names = ("model", "force error", "velocity error")
    head = html.Thead(html.Tr([html.Th(name, scope="col") for name in names]))
    return [html.Div(html.Table([head, html.Tbody(rows)]), className="wide-table")]


def _error(value: float | None) -> str:
    return "diverges" if value is None else percent(float(value))


def _errors(project: Project) -> list[Any]:
    """The error of each version as it falls."""
    from dash import dcc

    from identification.figures.single_charts import errors_chart

    rows: list[tuple[str | None, float, float]] = []
    floor = {"force_error": float("nan"), "velocity_error": float("nan")}
    for step in _additions(project):
        found = project.result(step)
        if found is None:
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


def _additions(project: Project) -> list[Step]:
    """The additions that made the active model from the last one that was identified."""
    found: list[Step] = []
    for name in reversed(project.versions):
        maker = project.maker(name)
        if maker is None or not maker.effect:
            break
        found.insert(0, maker)
    return found


def _numbers(errors: Mapping[str, Any]) -> dict[str, float]:
    kinds = ("force_error", "velocity_error")
    return {
        kind: float("nan") if errors.get(kind) is None else float(errors[kind]) for kind in kinds
    }


# --- candidates ------------------------------------------------------------------------------


def cards_of(found: Mapping[str, Any], named: Sequence[str]) -> tuple[list[Any], list[Any]]:
    """Candidates of a diagnosis: those that it names or cannot tell from them, and the others.

    An effect that was tried twice, also beside another one, comes once.
    """
    first: dict[str, Mapping[str, Any]] = {}
    for item in found["candidates"]:
        first.setdefault(item["effect"], item)
    alike = [name for one in named for name in found["ambiguous_with"].get(one, [])]
    leading = [name for name in dict.fromkeys([*named, *alike]) if name in first]
    others = [item for name, item in first.items() if name not in leading]
    return [first[name] for name in leading], others[: max(SHOWN_CANDIDATES - len(leading), 0)]


def _cards(project: Project) -> list[Any]:
    """Candidates of the diagnosis, each with what it would take away; what it names comes first."""
    from dash import html

    step, added = diagnosis_on_the_way(project)
    found = project.result(step)
    if found is None or not found["candidates"]:
        return []
    named = named_left(project)
    if added and not named:
        return []  # a diagnosis of a model without what has been added says no more
    leading, others = cards_of(found, named)
    there = _effects_of(project)
    drawn = [[_card(item, found, there) for item in items] for items in (leading, others)]
    note = html.P(_NOTE, className="note")
    if added:
        return [html.H2("Named as well"), note, html.Div(drawn[0], className="cards")]
    if not leading and found["verdict"] != "adequate":
        return [html.H2("Candidates"), note, html.Div(drawn[1], className="cards")]
    title = "Other candidates that were tried" if leading else "Candidates: none is needed"
    folded = html.Details([html.Summary(title), html.Div(drawn[1], className="cards")])
    shown = [html.H2("Candidates"), note, html.Div(drawn[0], className="cards")] if leading else []
    return [*shown, *([folded] if others else [])]


_NOTE = "p: how often chance alone would take away as much."


def _card(item: Mapping[str, Any], found: Mapping[str, Any], there: set[str]) -> Any:
    from dash import html

    name = item["effect"]
    joint = found["proposal"]["joint_fit"]["effects"] if found.get("proposal") else {}
    told = joint[name]["parameters"] if name in joint else item["parameters"]
    sizes = [
        f"{key} = {with_unit(format(entry['value'], '.4g'), entry['unit'])}"
        for key, entry in told.items()
    ]
    if len(sizes) > SHOWN_SIZES:
        sizes[SHOWN_SIZES:] = [f"and {len(sizes) - SHOWN_SIZES} more"]
    marks = [
        *(["named by the diagnosis"] if name in found["missing"] else []),
        *(["sizes as fitted with the proposed law"] if name in joint else []),
        *(["in the model"] if name in there else []),
        *(f"cannot be told from {other}" for other in found["ambiguous_with"].get(name, [])),
    ]
    gain = f"takes away {_share(item, found):.0%} of the squared error; p = {item['p_value']:.2g}"
    return html.Div(
        [
            html.H3(words(name)),
            html.P(gain),
            html.P("; ".join(sizes), className="note"),
            *(html.P(mark, className="mark") for mark in marks),
            button("Add to the model", "add", name, disabled=name in there),
        ],
        className="card",
    )


def _share(item: Mapping[str, Any], found: Mapping[str, Any]) -> float:
    """Share of the squared error that a candidate takes away; of one that is named, as it says."""
    for one in found["explained"]:
        if one["effect"] == item["effect"]:
            return float(one["share"])
    base = found["steps"][0]["force_error"]
    return max(0.0, 1.0 - (item["force_error"] / base) ** 2) if base else 0.0


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


# --- checks, controllers, commands -----------------------------------------------------------


def _findings(project: Project) -> list[Any]:
    """What the checks of the logs have found, each with its cure."""
    from dash import html

    found = project.result(project.last("doctor"))
    rows, wrong = [], False
    for path, report in (found or {}).get("logs", {}).items():
        told = [item for item in report["findings"] if item["level"] != "info"]
        for item in told:
            cure = f" {item['cure']}" if item.get("cure") else ""
            rows.append(html.Li([html.Code(path), f" {item['level']}: {item['message']}.{cure}"]))
        if report["usable"] and not told:
            rows.append(html.Li([html.Code(path), " nothing wrong"]))
        wrong = wrong or not report["usable"]
    if not rows:
        return []
    first = project.last(*ABOUT_MODELS) is None
    return [html.Details([html.Summary("Checks of the logs"), html.Ul(rows)], open=first or wrong)]


def driven(project: Project) -> list[Any]:
    """Errors of the controllers that were driven last with the active model."""
    from dash import html

    step = project.last("drive")
    found = project.result(step)
    if step is None or not found or not found.get("results"):
        return []
    rows = [
        html.Tr([html.Td(row["controller"]), html.Td(_tracking(row))]) for row in found["results"]
    ]
    head = html.Thead(html.Tr([html.Th("controller"), html.Th("misses the reference by")]))
    plant, model = step.read_models
    where = "that model itself" if plant == model else plain(plant)
    return [
        html.H2("Driven"),
        html.P(f"Controllers that know the model {plain(model)}, driven on {where}."),
        html.Table([head, html.Tbody(rows)]),
    ]


def _tracking(row: Mapping[str, Any]) -> str:
    error = row["metrics"]["nrmse"]["mean"]
    return "diverges" if row["diverged"] or error is None else percent(float(error))


def _just_driven(project: Project) -> list[Any]:
    """What controllers have just done: their table and chart stand further down."""
    from dash import html

    step = project.last("drive")
    ended = [one for one in project.steps if not one.is_open]
    found = project.result(step)
    if not found or step is not ended[-1]:
        return []
    told = ", ".join(f"{row['controller']} {_tracking(row)}" for row in found["results"])
    link = html.A("see the chart", href="#driven")
    return [html.P([f"Driven; error of the tracking: {told}; ", link, "."], className="verdict")]


def commands(project: Project) -> list[Any]:
    """All commands, the newest first, each under its own number."""
    from dash import html

    if not project.steps:
        return []
    rows = [html.Li(_command(step), value=str(step.number)) for step in reversed(project.steps)]
    return [html.H2("Commands"), html.Ol(rows, className="steps", reversed=True)]


def _command(step: Step) -> list[Any]:
    from dash import html

    state = step.state + (", undone" if step.undone else "")
    shown = html.Span(state, className=f"state {step.state}")
    parts: list[Any] = [shown, " ", html.Code(step.command)]
    if step.message and step.state != DONE:
        parts.append(html.P(step.message, className="warning"))
    return parts
