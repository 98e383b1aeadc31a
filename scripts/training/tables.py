"""What a run of training prints: a line for each evaluation, and a table of its final test."""

from __future__ import annotations

from typing import Any

from youbot_scripts.shared.tables import Column, Table, columns, decimals, percent


def progress_line(row: dict[str, Any]) -> str:
    """One evaluation on held-out references."""
    by_axis = "  ".join(percent(error) for error in row["error_by_axis"].values())
    return (
        f"{row['steps']:>9,} steps {row['wall_time']:6.0f} s  held-out "
        f"{percent(row['error']):>8}  VX, VY, W {by_axis}"
    )


def summary_line(record: dict[str, Any]) -> str:
    """Steps, times and seed of a run."""
    return (
        f"{record['steps']:,} steps, {record['wall_time']:.0f} s ({record['cpu_time']:.0f} s of "
        f"one core), seed {record['seed']}"
    )


def tested(record: dict[str, Any]) -> Table:
    """The policy and other controllers on references that training has not used."""
    shown = (
        *(Column(axis, percent) for axis in ("VX", "VY", "W", "mean")),
        Column("N m/s", decimals(1)),
        Column("saturated", lambda share: f"{100 * share:.1f}"),
    )
    rows = tuple(
        (
            name,
            *found["error_by_axis"].values(),
            found["error"],
            found["torque_rate"],
            found["saturated"],
        )
        for name, found in record["test"].items()
    )
    count = next(iter(record["test"].values()))["references"]
    title = f"{count} unseen references, error over the reference"
    return Table(title, columns("controller", *shown), rows)
