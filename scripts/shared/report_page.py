"""A report as a web page in one file: it needs no other file and no network."""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from os.path import commonprefix
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.cli import command_line
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import Table

if TYPE_CHECKING:
    from jinja2 import Template

    from identification.figures.chart_style import Chart


@dataclass(frozen=True)
class Words:
    """Paragraphs; kind: "verdict", "warning" or "note"."""

    sentences: Sequence[str]
    kind: str = "note"
    heading: str = ""


@dataclass(frozen=True)
class Charts:
    """Interactive charts, side by side where there is room.

    heading : of them all, by default the first one's title; folded : shown when it is opened
    """

    charts: Sequence[Chart]
    heading: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Formulas:
    """Formulas in LaTeX under a heading; new : those to be marked; notes : beside each."""

    heading: str
    latex: Sequence[str]
    new: Sequence[bool]
    notes: Sequence[str]


Part = Words | Table | Charts | Formulas

MAY_VANISH = (
    "While something is missing from the model, the warnings below may come of that, and vanish "
    "once it is added."
)


def groups_of(charts: Mapping[str, Chart]) -> Iterator[Charts]:
    """Charts folded below their titles; the floor plans of one log side by side.

    Parameters
    ----------
    charts : by name
    """
    plans: dict[str, list[Chart]] = {}
    for name, chart in charts.items():
        if name.startswith("plan_"):
            # plan_K, or plan_before_K and plan_after_K
            plans.setdefault(name.rpartition("_")[2], []).append(chart)
        else:
            yield Charts([chart], folded=True)
    for k, group in enumerate(plans.values()):
        heading = "Floor plan: where on the floor forces are left unexplained"
        # What the titles of a log's plans begin with: all but the name of a model.
        common = commonprefix([chart.title for chart in group])
        log = common.rpartition(",")[0] if len(group) > 1 else common
        yield Charts(group, log if k else heading, folded=k > 0)


def page(
    title: str, parts: Iterable[Part], facts: Mapping[str, Any], command: str | None = None
) -> str:
    """The HTML text.

    Parameters
    ----------
    parts : in their order on the page
    facts : how it was made: versions, seed
    command : that made it; by default the one that runs
    """
    shown = [_shown(part) for part in parts]
    return _template().render(
        title=title,
        parts=shown,
        made=", ".join(f"{name} {value}" for name, value in facts.items() if value is not None),
        command=command or command_line(),
        plotly=_plotly() if any(part["kind"] == "charts" for part in shown) else "",
    )


def facts(seed: int | None) -> dict[str, Any]:
    """Versions and seed for a page."""
    made = common.provenance(seed)
    return {"version": made["version"], "seed": made["seed"], **made["versions"]}


def write_page(path: Path, title: str, parts: Iterable[Part], seed: int | None) -> None:
    """Write a page on the results of the present command.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    common.write_text(path, page(title, parts, facts(seed)))


@cache
def _template() -> Template:
    from youbot_env.errors import optional_library

    jinja2 = optional_library("jinja2", "plots", "pages need jinja2", "leave --report out")
    text = resources.files("youbot_scripts.shared").joinpath("page.html").read_text("utf-8")
    # Autoescape: names of logs and models are a user's, and must never be markup.
    made = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.filters["unbroken"] = unbroken
    made.filters["coded"] = coded
    made.filters["typeset"] = typeset
    return made.from_string(text)


def unbroken(words: str) -> str:
    """Words whose numbers keep their per cent signs and deviations on their line."""
    words = words.replace(" +- ", " ± ")  # a terminal may not have the sign, a page does
    words = re.sub(r"(?<=\d)%(?!\w)", " %", words)
    return re.sub(r"(?<=\d) (?=%)|(?<=\d) (?=±)|(?<=±) (?=[\d.])", "\u00a0", words)


def coded(words: str) -> Any:
    """Words as markup in which what stands between backticks is code."""
    from markupsafe import Markup, escape

    parts = words.split("`")
    if len(parts) % 2 == 0:  # a backtick alone is a character of a name
        return escape(words)
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(p) if k % 2 else escape(p) for k, p in enumerate(parts))


def typeset(words: str) -> Any:
    """A unit or a parameter's name as markup: powers raised, indices lowered, phi in Greek."""
    from markupsafe import Markup, escape

    from identification.figures import chart_style as look

    return Markup(look.typeset(str(escape(words))).replace("</sub>&#39;", "</sub>′"))


@cache
def _plotly() -> str:
    """Plotly's library as the page unpacks it: zlib's format in base64, 2.0 of 4.8 MB."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(zlib.compress(get_plotlyjs().encode(), level=9)).decode("ascii")


def _shown(part: Part) -> dict[str, Any]:
    """A part as the template takes it."""
    if isinstance(part, Table):
        return _table(part)
    if isinstance(part, Charts):
        charts = [_chart(chart) for chart in part.charts]
        return {
            "kind": "charts", "charts": charts, "heading": part.heading, "folded": part.folded
        }  # fmt: skip
    if isinstance(part, Formulas):
        return {"kind": "formulas", "heading": part.heading, "formulas": list(_formulas(part))}
    lines = list(part.sentences)
    return {"kind": "words", "heading": part.heading, "look": part.kind, "lines": lines}


def _chart(chart: Chart) -> dict[str, Any]:
    from markupsafe import Markup

    text = chart.figure.to_json() or "{}"
    # In a script element "<" could end it; in JSON its escape means the same.
    safe = Markup(text.replace("<", "\\u003c"))
    return {"name": chart.name, "title": chart.title, "height": chart.height, "json": safe}


def _formulas(part: Formulas) -> Iterator[dict[str, Any]]:
    from markupsafe import Markup

    from youbot_env.errors import optional_library

    name = "latex2mathml.converter"
    converter = optional_library(name, "plots", "pages need latex2mathml", "leave --report out")
    for latex, new, note in zip(part.latex, part.new, part.notes, strict=True):
        terms = [Markup(converter.convert(term)) for term in terms_of(latex)]
        yield {"terms": terms, "new": new, "note": note}


def terms_of(latex: str) -> list[str]:
    """The terms of a formula, each with its sign: a line breaks between them, never within one."""
    found, depth, start = [], 0, 0
    for place in re.finditer(r"\\left|\\right|(?<!\\)[{}]|(?<= )[-+=](?= )", latex):
        mark = place[0]
        depth += (mark in ("{", "\\left")) - (mark in ("}", "\\right"))
        if depth == 0 and mark in ("+", "-", "="):
            found.append(latex[start : place.start()])
            start = place.start()
    terms = [term for term in (*found, latex[start:]) if term.strip()]
    # An empty term before a sign makes it one between two terms, with the space of such a sign.
    return [terms[0], *("{} " + term for term in terms[1:])]


def _table(table: Table) -> dict[str, Any]:
    marks = [column.is_text for column in table.columns]
    formulas = [column.is_formula for column in table.columns]
    # Above each other: the header's lines as one.
    names = [header.replace("\n", " ") for header in table.headers]
    return {
        "kind": "table",
        "heading": table.heading,
        "title": table.title,
        "head": list(zip(table.headers, marks, strict=True)),
        "rows": [list(zip(names, row, marks, formulas, strict=True)) for row in table.cells],
        "notes": table.notes,
    }
