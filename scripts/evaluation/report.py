"""A web page of one file: tables and pictures of an evaluation, nothing fetched from elsewhere."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identification.plot_style import write_figure
from youbot_scripts.evaluation.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem;
       color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2.5rem; }
h3 { font-size: 0.95rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.88rem; }
th, td { padding: 0.2rem 0.7rem; text-align: right; border-bottom: 1px solid #e4e4e4; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; height: auto; margin: 0.7rem 0; }
p.note { color: #555; margin: 0.3rem 0; } pre { background: #f4f4f4; padding: 0.7rem; }
pre { overflow-x: auto; }
"""


def page(
    command: str, tables: Sequence[Table], figures: Mapping[str, Figure], facts: Mapping[str, Any]
) -> str:
    """The HTML text.

    Parameters
    ----------
    command : that made it
    figures : by what they show
    facts : how it was made: versions, seed
    """
    made = ", ".join(f"{name} {value}" for name, value in facts.items())
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>youbot evaluate</title><style>{_STYLE}</style></head><body>",
        "<h1>Controllers compared</h1>",
        f"<pre>{escape(command)}</pre><p class=note>{escape(made)}</p>",
        *(_picture(name, figure) for name, figure in figures.items()),
        *(_table(table) for table in tables),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.headers)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n"
        for row in table.rows
    )
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in table.notes)
    heading = f"<h2>{escape(table.heading)}</h2>" if table.heading else ""
    title = f"{heading}<h3>{escape(table.title)}</h3>"
    return f"{title}<table><tr>{head}</tr>\n{rows}</table>{notes}"


def _picture(name: str, figure: Figure) -> str:
    with tempfile.TemporaryDirectory() as folder:
        content = write_figure(Path(folder) / "picture.png", figure).read_bytes()
    data = base64.b64encode(content).decode()
    return f'<img alt="{escape(name)}" src="data:image/png;base64,{data}">'
