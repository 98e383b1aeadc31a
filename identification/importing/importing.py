"""Foreign recordings to logs: read, mapped, brought to one time base, written."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from identification.importing.assembling import Assembled, assemble, back_jumps, clock_of
from identification.importing.delays import Delay, channel_delays
from identification.importing.import_map import ImportMap
from identification.importing.map_file import map_text
from identification.importing.proposal import Proposal, propose
from identification.importing.readers import read_sources
from identification.importing.settings import ImportSettings
from identification.importing.tables import Table, find
from identification.logs.findings import Finding, fault
from identification.logs.formats import parser_for, read_bytes
from identification.logs.writing import write_table
from youbot_env.errors import InputError


@dataclass(eq=False)
class Source:
    """What was read of one run, and the map that suits it.

    Attributes
    ----------
    tables : topics of bags, tables of text files
    proposal : None where a map was given
    chosen : the map in force
    """

    tables: list[Table]
    proposal: Proposal | None
    chosen: ImportMap

    @property
    def undecided(self) -> list[str]:
        """What a person must decide first; empty where a map was given."""
        return self.proposal.undecided if self.proposal else []

    @property
    def map_text(self) -> str:
        """The map as the text of a file."""
        names = " ".join(dict.fromkeys(table.source for table in self.tables))
        head = [
            f"Map of {names}: which column becomes which channel of a log.",
            "Edit it, and give it back: youbot import SOURCE... -o LOG --map THIS_FILE",
        ]
        if self.undecided:
            head.append("What could not be decided is marked CHECK.")
        return map_text(self.chosen, self.proposal.remarks if self.proposal else None, head)


@dataclass(eq=False)
class Imported:
    """A log that was made of a source.

    Attributes
    ----------
    findings : what was mended or left out
    delays : of the wheels' speeds behind the pose and the gyro
    """

    made: Assembled
    findings: list[Finding]
    delays: list[Delay] = field(default_factory=list)


def open_source(
    paths: Sequence[str | os.PathLike[str]],
    chosen: ImportMap | None = None,
    settings: ImportSettings = ImportSettings(),
) -> Source:
    """Read the files of one run, and propose a map unless one is given.

    Raises
    ------
    InputError
        If a file cannot be read, or no four columns look like wheels and no map names them.
    """
    tables = read_sources(paths, settings)
    if chosen is not None:
        return Source(tables, None, chosen)
    # A file may hold any number; what overflows is no number of a wheel, and is judged as such.
    with np.errstate(all="ignore"):
        proposal = propose(_first_run(tables, settings), settings)
    return Source(tables, proposal, proposal.map)


def import_source(source: Source, settings: ImportSettings = ImportSettings()) -> Imported:
    """The log of a source by the map in force.

    Raises
    ------
    InputError
        If the map names what is not there, or the source holds two runs.
    """
    with np.errstate(all="ignore"):
        made = assemble(source.chosen, source.tables, settings)
    used = [finding for table in _used_tables(source) for finding in _of_topic(table)]
    delays = channel_delays(made.time, made.channels, settings)
    return Imported(made, [*used, *made.findings], delays)


def _used_tables(source: Source) -> list[Table]:
    """The tables from which the map takes a column."""
    named = [find(source.tables, name) for name in source.chosen.references()]
    return list({id(place[0]): place[0] for place in named if place is not None}.values())


def _of_topic(table: Table) -> list[Finding]:
    """What a table's reader found, each with the topic's name."""
    topic = f"{table.topic}: " if table.topic else ""
    return [replace(found, message=topic + found.message) for found in table.findings]


def runs_of_source(source: Source, settings: ImportSettings = ImportSettings()) -> list[Source]:
    """A source for each run that one table holds: the clock is set back between them."""
    if len(source.tables) != 1:
        return [source]
    table = source.tables[0]
    cuts = back_jumps(clock_of(table, source.chosen), settings)
    edges = [0, *cuts, table.rows]
    return [
        Source([_rows(table, a, b)], source.proposal, source.chosen)
        for a, b in zip(edges[:-1], edges[1:], strict=True)
        if b - a > 1
    ]


def _first_run(tables: list[Table], settings: ImportSettings) -> list[Table]:
    """The tables up to where the clock of the only one is set back: a map is the same for both."""
    if len(tables) != 1 or not tables[0].clocks:
        return tables
    cuts = back_jumps(next(iter(tables[0].clocks.values())), settings)
    return [_rows(tables[0], 0, cuts[0])] if cuts else tables


def _rows(table: Table, start: int, stop: int) -> Table:
    part = slice(start, stop)
    return replace(
        table,
        columns={name: values[part] for name, values in table.columns.items()},
        clocks={name: time[part] for name, time in table.clocks.items()},
        findings=list(table.findings),
    )


def write_imported(path: str | os.PathLike[str], made: Assembled) -> None:
    """Write a log as .csv, .csv.gz or .parquet.

    Raises
    ------
    InputError
        If the ending is none of these or the file cannot be written.
    """
    values = made.values
    if not np.isfinite(values[:, 0]).all():
        raise InputError(f"{path}: a row has no time; check the map")
    write_table(path, made.columns, values)


def gaps(made: Assembled, settings: ImportSettings = ImportSettings()) -> list[tuple[float, float]]:
    """Start and length [s] of each pause that a reader of logs does not bridge."""
    steps = np.diff(made.time)
    long = np.flatnonzero(steps > settings.split_gap)
    return [(float(made.time[k]), float(steps[k])) for k in long]


def import_command(path: str | os.PathLike[str]) -> str | None:
    """The command that makes a log of a file that is none; None if import does not read it either.

    A file that has a log's layout already is left alone: its faults are not those of a layout.
    """
    try:
        source = open_source([path])
        made = import_source(source)
    except InputError:
        return None
    own = set(made.made.columns) <= {name for table in source.tables for name in table.columns}
    mended = any(finding.level == "repaired" for finding in made.findings)
    in_pieces = bool(gaps(made.made))
    if own and not (mended or in_pieces or source.undecided) and _is_table(Path(path)):
        return None
    stem = Path(path).name.split(".")[0]
    target = f"{stem}/" if in_pieces else f"{stem}_log.csv"
    return shlex.join(["youbot", "import", str(path), "-o", target])


def _is_table(path: Path) -> bool:
    """Whether the reader of logs takes a file's text for a table."""
    try:
        parser_for(path)(str(path), read_bytes(path))
    except InputError:
        return False
    return True


def check_log_ending(path: Path) -> None:
    """Refuse a name that is none of a log's, before anything is read.

    Raises
    ------
    InputError
        With the endings that there are.
    """
    if not path.name.lower().endswith((".csv", ".csv.gz", ".parquet", ".mcap")):
        cure = "end it in .csv, .csv.gz or .parquet; a folder ends in /"
        raise fault(str(path), "is no name of a log", cure)
