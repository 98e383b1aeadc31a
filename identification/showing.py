"""Results at a prompt, in a notebook, as a table, as charts and as a page.

Tables, charts and pages stand above the results in the house, so they are looked up by name when
one is asked for: a result that nobody looks at loads none of them.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, ClassVar

from youbot_env.errors import InputError, optional_library

CHARTS = "identification.figures.charts"
"""Where ``charts_of_<kind>(result)`` stand."""

PAGES = "youbot_scripts.shared.pages"
"""Where ``write_<kind>(path, result)`` stand."""


class Shown:
    """What results of commands have in common.

    A subclass names its ``kind`` and gives ``summary`` (a sentence or two) and ``rows`` (its main
    table, by column).
    """

    kind: ClassVar[str] = ""

    def summary(self) -> str:
        """The result in a sentence or two."""
        raise NotImplementedError

    def rows(self) -> list[dict[str, Any]]:
        """The main table: a mapping from column to value for each row."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary()}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the summary and the main table."""
        return f"<p>{escape(self.summary())}</p>{_table(self.rows())}"

    def to_dataframe(self) -> Any:
        """The main table as a pandas data frame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        pandas = optional_library("pandas", "notebook", "a data frame needs pandas")
        return pandas.DataFrame(self.rows())

    def drawn(self) -> dict[str, Any]:
        """The page's charts by name, in its order, each with title, figure and height.

        Raises
        ------
        InputError
            If Plotly is not installed.
        """
        make = getattr(importlib.import_module(CHARTS), f"charts_of_{self.kind}")
        return {chart.name: chart for chart in make(self)}

    @property
    def charts(self) -> dict[str, Any]:
        """Interactive figures (Plotly) by name.

        Raises
        ------
        InputError
            If Plotly is not installed.
        """
        return {name: chart.figure for name, chart in self.drawn().items()}

    def plot(self, name: str = "") -> Any:
        """One of ``charts``, the first by default; a notebook draws what this returns.

        Raises
        ------
        InputError
            If there is no chart of this name, or Plotly is not installed.
        """
        found = self.charts
        if name and name not in found:
            raise InputError(f"no chart {name!r}; there are {', '.join(found)}")
        return found[name or next(iter(found))]

    def report(self, path: str | os.PathLike[str]) -> None:
        """Write the web page that the command's ``--report`` writes.

        Raises
        ------
        InputError
            If the file cannot be written, or a library of the extra `plots` is missing.
        """
        write = getattr(importlib.import_module(PAGES), f"write_{self.kind}")
        write(path, self)


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{escape(str(name))}</th>" for name in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_text(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
