"""A table as data, for a terminal and for a web page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from youbot_scripts import common

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Table:
    """A table, whoever shows it.

    notes : lines below it; heading: above it, where it opens a part; left: headers of the columns
        of text beside the first, which are aligned to the left
    """

    title: str
    headers: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    notes: tuple[str, ...] = ()
    heading: str = ""
    left: tuple[str, ...] = ()


def show(out: Console, found: Iterable[Table]) -> None:
    """Print tables, their headings and their notes."""
    for table in found:
        if table.heading:
            out.print(f"{table.heading}\n")
        common.show_table(out, table.title, table.headers, table.rows, left=table.left)
        for note in table.notes:
            out.print(f"  {note}", soft_wrap=True)
        if table.notes:
            out.print()
