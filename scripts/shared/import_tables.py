"""Tables of a source that is to be imported: topics, columns, what each seems to be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from identification.importing.groups import column_meaning
from identification.importing.import_map import QUANTITIES, ImportMap
from identification.importing.importing import Source
from identification.importing.tables import Table as SourceTable, rate_of, reference
from youbot_env.physics.hardware import WHEELS
from youbot_scripts.shared.tables import Table, columns, text

MOST_ROWS = 80
"""Columns of a source that are shown one by one."""


def source_tables(source: Source) -> list[Table]:
    """What a source holds: a table of its topics and one of its columns."""
    used = _used(source.chosen)
    topics = Table(
        "Topics and files",
        columns("name", text("type"), "rows", "rate Hz", text("clocks")),
        tuple(
            (
                table.topic or table.source,
                table.kind,
                str(table.rows),
                _rate(table),
                ", ".join(table.clocks) or "none",
            )
            for table in source.tables
        ),
    )
    rows = [row for table in source.tables for row in _columns(table, used)]
    # What is used first: a bag may hold hundreds of fields.
    rows.sort(key=lambda row: row[-1] == "")
    notes = (f"and {len(rows) - MOST_ROWS} more",) if len(rows) > MOST_ROWS else ()
    fields = Table(
        "Columns",
        columns("column", "least", "largest", text("seems to be"), text("used as")),
        tuple(rows[:MOST_ROWS]),
        notes,
    )
    return [topics, fields]


def source_to_dict(source: Source) -> dict[str, Any]:
    """JSON form of the same."""
    used = _used(source.chosen)
    return {
        "tables": [
            {
                "source": table.source,
                "topic": table.topic,
                "type": table.kind,
                "rows": table.rows,
                "clocks": {name: rate_of(time) for name, time in table.clocks.items()},
                "columns": [
                    dict(zip(("name", "least", "largest", "meaning", "used"), row, strict=True))
                    for row in _columns(table, used)
                ],
            }
            for table in source.tables
        ],
        "map": source.map_text,
        "why": source.proposal.remarks if source.proposal else {},
        "undecided": source.undecided,
        "doubts": source.proposal.doubts if source.proposal else [],
    }


def _rate(table: SourceTable) -> str:
    time = next(iter(table.clocks.values()), None)
    return "" if time is None else f"{rate_of(time):.4g}"


def _columns(table: SourceTable, used: dict[str, str]) -> Iterator[tuple[str, str, str, str, str]]:
    for name, values in table.columns.items():
        known = values[np.isfinite(values)]
        least, largest = (f"{known.min():.6g}", f"{known.max():.6g}") if len(known) else ("", "")
        found = column_meaning(table, name)
        words = [found.wheel, "wanted" if found.wanted else "", found.quantity]
        said = " ".join(word for word in words if word)
        unit = f" [{found.unit}]" if found.unit else ""
        ref = reference(table, name)
        yield ref, least, largest, f"{said}{unit}", used.get(ref, used.get(name, ""))


def _used(chosen: ImportMap) -> dict[str, str]:
    """The channel that each reference becomes."""
    found = {}
    for quantity in QUANTITIES:
        channels = chosen.of(quantity)
        if channels is not None:
            for wheel, column in zip(WHEELS, channels.columns, strict=True):
                found[column] = f"{quantity}_{wheel} ({channels.unit})"
    if chosen.pose is not None:
        pose = chosen.pose
        found |= {pose.x: f"pose_x ({pose.unit})", pose.y: f"pose_y ({pose.unit})"}
        heading = pose.quaternion or (pose.yaw,)
        found |= dict.fromkeys(heading, "pose_yaw")
    if chosen.gyro is not None:
        found[chosen.gyro.z] = f"gyro_z ({chosen.gyro.unit})"
    for clock in chosen.time.clock.split(" + "):
        found.setdefault(clock, "time")
    return found
