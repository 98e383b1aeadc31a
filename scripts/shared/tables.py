"""A table as data: columns with formats and rows of values, for a terminal or a web page."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from youbot_env.errors import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    header : its name
    show : the text of a value; a value that is text already is shown as it is
    is_text : aligned to the left, and wrapped where the terminal is narrow
    is_formula : units or names of parameters, which a page typesets
    """

    header: str
    show: Callable[[Any], str] = str
    is_text: bool = False
    is_formula: bool = False

    def cell(self, value: object) -> str:
        """The text of one value."""
        return value if isinstance(value, str) else self.show(value)


def text(header: str) -> Column:
    """A column of words."""
    return Column(header, is_text=True)


def unit(header: str = "unit") -> Column:
    """A column of units."""
    return Column(header, is_text=True, is_formula=True)


def columns(first: str, *others: Column | str) -> tuple[Column, ...]:
    """Columns of a table: the first one holds names; a bare header is a column of ready cells."""
    found = (column if isinstance(column, Column) else Column(column) for column in others)
    return (text(first), *found)


@dataclass(frozen=True)
class Table:
    """A table, for a terminal or a web page.

    Attributes
    ----------
    rows : values, one for each column
    notes : lines below it
    heading : line above it, if it is the first of a section
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[object, ...], ...]
    notes: tuple[str, ...] = ()
    heading: str = ""

    @property
    def headers(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.header for column in self.columns)

    @property
    def cells(self) -> tuple[tuple[str, ...], ...]:
        """The rows as texts."""
        return tuple(
            tuple(column.cell(value) for column, value in zip(self.columns, row, strict=True))
            for row in self.rows
        )


def show(out: Console, tables: Iterable[Table]) -> None:
    """Print tables with their headings and notes; long text folds at the terminal's width."""
    for table in tables:
        if table.heading:
            out.print(f"{table.heading}\n")
        _print(out, table)
        for note in table.notes:
            out.print(f"  {note}", soft_wrap=True)
        if table.notes:
            out.print()


def _print(out: Console, table: Table) -> None:
    from rich import box
    from rich.table import Table as RichTable

    if table.title:
        # Above the table, not as its own title: that folds at the table's width.
        out.print(_text(table.title), soft_wrap=True)
    rows, names = table.cells, [column.header for column in table.columns]
    is_text = [column.is_text for column in table.columns]
    widths = text_widths([names, *rows], is_text, out.width)
    drawn = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, width in zip(table.columns, widths, strict=True):
        drawn.add_column(
            _text(folded(column.header, width)),
            justify="left" if column.is_text else "right",
            overflow="fold",
            no_wrap=not column.is_text,
        )
    for row in rows:
        drawn.add_row(
            *(_text(folded(cell, width)) for cell, width in zip(row, widths, strict=True))
        )
    out.print(drawn)


EDGE, BETWEEN = 2, 3
"""Blanks that the terminal's tables have at both sides together, and between two columns."""


def text_widths(
    rows: Sequence[Sequence[str]], is_text: Sequence[bool], width: int
) -> list[int | None]:
    """Characters that each column of words may take in a terminal; None: as many as it has.

    The widest columns of words give way, so that figures and short names stay whole.

    Parameters
    ----------
    rows : cells, the heads of the columns among them
    width : of the terminal [characters]
    """
    wanted = [max(map(_longest_line, column)) for column in zip(*rows, strict=True)]
    left = width - EDGE - BETWEEN * (len(wanted) - 1)
    left -= sum(size for size, words in zip(wanted, is_text, strict=True) if not words)
    words = sorted(size for size, words in zip(wanted, is_text, strict=True) if words)
    most = None
    for k, size in enumerate(words):
        share = left // (len(words) - k)
        if size > share:
            most = max(share, 1)
            break
        left -= size
    return [most if words else None for words in is_text]


def _longest_line(cell: str) -> int:
    return max(map(len, cell.split("\n")))


def folded(cell: str, width: int | None) -> str:
    """A cell in lines of at most ``width`` characters; long names break after "_" and ".".

    A line is cut elsewhere only where a part of a name is longer than it.
    """
    if width is None or _longest_line(cell) <= width:
        return cell
    lines = list[str]()
    for line in cell.split("\n"):
        # "%" stays with its number.
        words = re.split(r"(?<=\s)(?=[^\s%])", line)
        parts = [part for word in words for part in _parts(word, width)]
        lines.append("")
        for part in parts:
            if len((lines[-1] + part).rstrip()) > width and lines[-1]:
                lines[-1] = lines[-1].rstrip()
                lines.append("")
            lines[-1] += part
    return "\n".join(line.rstrip() for line in lines)


def _parts(word: str, width: int) -> list[str]:
    """A word whole; in parts where it is a name that is longer than a line."""
    return re.split(r"(?<=[_.])(?=[A-Za-z])", word) if len(word.rstrip()) > width else [word]


def _text(cell: str) -> Text:
    """A cell as Rich's text, line by line."""
    from rich.text import Text

    return Text("\n".join(map(visible, cell.split("\n"))))


# --- formats ---------------------------------------------------------------------------------


def number(value: float | None, digits: int = 4) -> str:
    """`value` with `digits` significant digits; "-" where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def percent(share: float) -> str:
    """A share such as 0.0123 as "1.23 %"; "-" where it is not a number."""
    # NaN is the only number that differs from itself.
    return f"{100 * share:.2f} %" if share == share else "-"


def with_std(value: float, std: float) -> str:
    """`value ± std`, both to the second significant digit of the standard deviation."""
    if not (math.isfinite(value) and math.isfinite(std) and std > 0):
        return number(value)
    return f"{to_digit_of(value, std)} ± {to_digit_of(std, std)}"


def to_digit_of(value: float, std: float) -> str:
    """`value` to the second significant digit of its standard deviation `std` > 0."""
    return f"{value:.{max(0, 1 - math.floor(math.log10(std)))}f}"


def decimals(digits: int, unit: str = "") -> Callable[[float], str]:
    """The format of a number with so many digits after the point."""
    return lambda value: f"{value:.{digits}f}{unit}"
