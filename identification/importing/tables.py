"""What the readers of foreign files make of them: tables of numbers with names and clocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding

Array = NDArray[np.float64]

RECEIVED = "received"
"""Name of the clock of arrival: when the logger wrote a message."""


@dataclass(eq=False)
class Table:
    """One topic of a bag, or the table of a text file.

    Attributes
    ----------
    source : path of the file
    topic : its name; "" for the one table of a file that has no topics
    kind : type of the messages, such as "sensor_msgs/msg/JointState", or "csv"
    columns : numbers (n,) by field path or column name, NaN where there is none
    units : as the header states them, by column
    texts : what text columns hold, where it is one text throughout (names of joints, of frames)
    clocks : times (n,) [s] by name, the best one first: of measurement, then of arrival
    dates : columns that held dates or times of day, [s] here
    questions : what the layout leaves open and a person must confirm
    findings : what the reader had to leave out or to mend
    """

    source: str
    topic: str
    kind: str
    columns: dict[str, Array]
    units: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    clocks: dict[str, Array] = field(default_factory=dict)
    dates: set[str] = field(default_factory=set)
    questions: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def drop_absurd(self, most: float) -> None:
        """Take numbers beyond +-``most`` for missing ones."""
        for values in self.columns.values():
            # Written so that NaN stays without a warning.
            values[~(np.abs(values) <= most)] = np.nan

    @property
    def rows(self) -> int:
        """Number of rows, or of messages."""
        arrays = [*self.columns.values(), *self.clocks.values()]
        return len(arrays[0]) if arrays else 0

    def note(self, message: str, row: int | None = None, column: str | None = None) -> None:
        """Adds a remark on how the file was read."""
        self.findings.append(Finding("info", message, row, column))


def reference(table: Table, column: str) -> str:
    """How a map names a column: ``TOPIC:COLUMN``, or the column alone in a file without topics."""
    return f"{table.topic}:{column}" if table.topic else column


def find(tables: list[Table], name: str) -> tuple[Table, str] | None:
    """The table and column that a reference means, or None if there is no such column."""
    for table in tables:
        prefix = f"{table.topic}:" if table.topic else ""
        column = name.removeprefix(prefix)
        if name.startswith(prefix) and column in table.columns:
            return table, column
    # In a single table the topic need not be named: a map then serves other files as well.
    if len(tables) == 1 and name in tables[0].columns:
        return tables[0], name
    return None


def rate_of(time: Array) -> float:
    """Usual rate [Hz] of instants (n,) [s], of which some may be missing; NaN if they tell none."""
    known = np.unique(time[np.isfinite(time)])
    steps = np.diff(known)
    # Steps far from the median are gaps, or messages that came together.
    usual = steps[np.abs(steps - np.median(steps)) <= np.median(steps) / 2] if len(steps) else steps
    return float(1 / usual.mean()) if len(usual) and usual.mean() > 0 else float("nan")
