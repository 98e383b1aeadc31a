"""The clocks of a text file's table: which of its columns hold time, and in which unit."""

from __future__ import annotations

import numpy as np

from identification.importing.clocks import TIME_UNITS, unit_of_time
from identification.importing.settings import ImportSettings
from identification.importing.tables import Array, Table
from identification.importing.vocabulary import meaning, words_of

_SECONDS = frozenset(["sec", "secs", "second", "seconds", "s"])
_FRACTIONS = {
    "nanosec": "ns",
    "nanosecs": "ns",
    "nsec": "ns",
    "nsecs": "ns",
    "ns": "ns",
    "nanosecond": "ns",
    "nanoseconds": "ns",
    "nanos": "ns",
    "usec": "us",
    "usecs": "us",
    "us": "us",
    "microseconds": "us",
    "msec": "ms",
    "ms": "ms",
    "milliseconds": "ms",
}
_ARRIVAL = frozenset(
    [
        "receive",
        "received",
        "recv",
        "arrival",
        "rx",
        "log",
        "logged",
        "bag",
        "rosbag",
        "record",
        "local",
    ]
)
_MEASURED = frozenset(["header", "stamp", "timestamp", "source", "sensor", "measured"])


def add_clocks(table: Table, settings: ImportSettings = ImportSettings()) -> None:
    """Adds the clocks of a text file's table to it, the best one first."""
    found: dict[str, Array] = {}
    for name, time in {**_split_stamps(table), **_single_columns(table)}.items():
        unit = table.units.get(name, "")
        if unit not in TIME_UNITS:
            unit, why = unit_of_time(time, settings)
            if unit:
                table.units[name] = unit
                table.note(f"column {name}: {why}")
            if unit == "ms" and _counts(time):
                table.questions.append(f"column {name} counts by ones: milliseconds, or rows?")
        if unit:
            found[name] = time * TIME_UNITS[unit]
    order = sorted(found, key=lambda name: _rank(name, found[name]))
    table.clocks = {name: found[name] for name in order}


def clock_named(table: Table, name: str, unit: str) -> Array | None:
    """The clock (n,) [s] that a map names: one that was found, or any column in its unit."""
    if unit and (column := {**_split_stamps(table), **table.columns}.get(name)) is not None:
        return column * TIME_UNITS[unit]
    if name in table.clocks:
        return table.clocks[name]
    column = table.columns.get(name)
    return None if column is None else column * TIME_UNITS[unit or "s"]


def moves(time: Array) -> bool:
    """Whether a clock (n,) tells most rows apart."""
    known = time[np.isfinite(time)]
    return len(known) > 1 and len(np.unique(known)) > len(known) / 2


def _counts(time: Array) -> bool:
    """Whether a column goes up by one each row: a time in ms at 1 kHz, or a row's number."""
    steps = np.diff(time[np.isfinite(time)])
    return bool(len(steps) and (steps == 1).mean() > ImportSettings.min_number_share)


def _rank(name: str, time: Array) -> tuple[bool, int]:
    words = set(words_of(name))
    kind = 2 if words & _ARRIVAL or name.startswith("%") else 0 if words & _MEASURED else 1
    return not moves(time), kind


def _single_columns(table: Table) -> dict[str, Array]:
    """Columns whose names speak of time, less the halves of split stamps."""
    halves = {half for name in _split_stamps(table) for half in name.split(" + ")}
    return {
        name: values
        for name, values in table.columns.items()
        if name in table.dates
        or (name not in halves and meaning(name).quantity == "time" and not meaning(name).wheel)
    }


def _split_stamps(table: Table) -> dict[str, Array]:
    """Seconds and their fractions in two columns, added [s]: "sec + nanosec"."""
    found: dict[str, Array] = {}
    for name, seconds in table.columns.items():
        stem = _stem(name, _SECONDS)
        if stem is None:
            continue
        for other, rest in table.columns.items():
            last = words_of(other)[-1:]
            if other != name and _stem(other, frozenset(_FRACTIONS)) == stem:
                joined = f"{name} + {other}"
                found[joined] = seconds + rest * TIME_UNITS[_FRACTIONS[last[0]]]
                table.units[joined] = "s"
    return found


def _stem(name: str, endings: frozenset[str]) -> tuple[str, ...] | None:
    """Words of a name before its last one, if that is among some; None if not."""
    words = words_of(name)
    return words[:-1] if words and words[-1] in endings else None
