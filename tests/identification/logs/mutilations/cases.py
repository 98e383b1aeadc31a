"""Kinds of mutilation of a healthy log, each with what is expected of reading it.

The modules beside this one register theirs with `case`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from identification.logs.log import Log
from identification.logs.reading import log_table
from tests.identification.healthy import healthy_log

HEALTHY = healthy_log()
RICH = healthy_log(extras=True)
Rows = list[list[str]]


def cells(log: Log, decimals: int = 4) -> Rows:
    """Header and rows of a log as text; row i of the list is line i + 1 of the file."""
    names, values = log_table(log)
    return [list(names), *([f"{value:.{decimals}f}" for value in row] for row in values)]


def text(rows: Rows, delimiter: str = ",") -> bytes:
    return ("\n".join(delimiter.join(row) for row in rows) + "\n").encode()


@dataclass(frozen=True)
class Refused:
    """The log is refused; row and column as named, and these words in the line."""

    words: str
    row: int | None = None
    column: str | None = None


@dataclass(frozen=True)
class Read:
    """The log is read; a finding of the level says these words, none where level is "".

    ``rows`` is the number of samples, ``changed`` how many of them the repair may have invented,
    ``tolerance`` by how much these may differ from the undamaged log (rad/s, N m).
    """

    words: str = ""
    level: str = "repaired"
    rows: int = len(HEALTHY)
    changed: int = 0
    row: int | None = None
    tolerance: float = 0.15


@dataclass(frozen=True)
class Case:
    name: str
    content: Callable[[], bytes]
    expected: Refused | Read
    file: str = "log.csv"
    rich: bool = False


CASES: list[Case] = []


def case(expected: Refused | Read, file: str = "log.csv", rich: bool = False, name: str = ""):
    """Register a mutilation: a function from rows of text to rows or to a file's bytes."""

    def register(mutilate: Callable[[Rows], Rows | bytes]):
        def content() -> bytes:
            result = mutilate(cells(RICH if rich else HEALTHY))
            return result if isinstance(result, bytes) else text(result)

        CASES.append(Case(name or mutilate.__name__, content, expected, file, rich))
        return mutilate

    return register


def column(rows: Rows, name: str) -> int:
    return rows[0].index(name)


def put(rows: Rows, name: str, lines: range | list[int], value: str) -> Rows:
    """Write a value into a column at these lines of the file."""
    for line in lines:
        rows[line - 1][column(rows, name)] = value
    return rows


def change(
    rows: Rows, names: list[str], function: Callable[[float], float], first: int = 2
) -> Rows:
    for row in rows[first - 1 :]:
        for name in names:
            row[column(rows, name)] = f"{function(float(row[column(rows, name)])):.6f}"
    return rows


VELOCITIES = ["velocity_fl", "velocity_fr", "velocity_bl", "velocity_br"]
EFFORTS = ["effort_fl", "effort_fr", "effort_bl", "effort_br"]
