"""A report as a web page in one file, without scripts and without links to other files."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.cli import command_line
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem;
       color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2.5rem; }
h3 { font-size: 0.95rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.88rem; }
th, td { padding: 0.2rem 0.7rem; text-align: right; border-bottom: 1px solid #e4e4e4;
         white-space: pre-line; }
th:first-child, td:first-child, .text { text-align: left; }
img { max-width: 100%; height: auto; margin: 0.7rem 0; }
p.note { color: #555; margin: 0.3rem 0; } pre { background: #f4f4f4; padding: 0.7rem; }
p.verdict { font-size: 1.1rem; } p.warning { border-left: 4px solid #e69f00; padding-left: 0.7rem; }
pre, div.wide { overflow-x: auto; }
"""


@dataclass(frozen=True)
class Words:
    """Paragraphs; kind: "verdict", "warning" or "note"."""

    sentences: Sequence[str]
    kind: str = "note"
    heading: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure's PNG file; name: what it shows."""

    name: str
    content: bytes


Part = Words | Table | Picture


def pictures(figures: Iterable[tuple[str, Figure]]) -> Iterator[Picture]:
    """Named figures as pictures, one at a time, so that memory holds one figure."""
    from identification.figures.style import png

    for name, figure in figures:
        yield Picture(name, png(figure))


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
    made = ", ".join(f"{name} {value}" for name, value in facts.items())
    lines = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
        f"<pre>{escape(command or command_line())}</pre><p class=note>{escape(made)}</p>",
        *map(_html, parts),
        "</body></html>",
    ]
    return "\n".join(lines) + "\n"


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


def _html(part: Part) -> str:
    if isinstance(part, Table):
        return _table(part)
    if isinstance(part, Picture):
        # Pictures are part of the file, so that it can be sent alone.
        data = base64.b64encode(part.content).decode()
        return f'<img alt="{escape(part.name)}" src="data:image/png;base64,{data}">'
    heading = f"<h2>{escape(part.heading)}</h2>" if part.heading else ""
    return heading + "".join(
        f'<p class="{escape(part.kind)}">{escape(sentence)}</p>' for sentence in part.sentences
    )


def _table(table: Table) -> str:
    # The style sheet aligns the first column by its place, the others by their class.
    marks = ["", *(' class="text"' if column.is_text else "" for column in table.columns[1:])]
    rows = [
        "<tr>" + "".join(_cell("td", *pair) for pair in zip(marks, row, strict=True)) + "</tr>\n"
        for row in table.cells
    ]
    head = "".join(_cell("th", *pair) for pair in zip(marks, table.headers, strict=True))
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in table.notes)
    heading = f"<h2>{escape(table.heading)}</h2>" if table.heading else ""
    title = f"<h3>{escape(table.title)}</h3>" if table.title else ""
    body = f"<table><tr>{head}</tr>\n{''.join(rows)}</table>" if rows else ""
    return f'{heading}{title}<div class="wide">{body}</div>{notes}'


def _cell(tag: str, mark: str, content: str) -> str:
    return f"<{tag}{mark}>{escape(content)}</{tag}>"
