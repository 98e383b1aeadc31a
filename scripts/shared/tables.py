"""A table as data, for a terminal and for a web page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from youbot_scripts.shared import options as common
from youbot_scripts.shared.options import number, percent, to_digit_of, with_std

if TYPE_CHECKING:
    from rich.console import Console

    from identification.logs.log import Log


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


FITS = 1.25
"""Force error over the noise floor up to which a model is said to fit: as `diagnose` has it."""

Errors = Mapping[str, float]


def parameters(found: Mapping[str, Mapping[str, Any]], title: str = "Parameters") -> Table:
    """Values with standard deviation and 95 % interval.

    Parameters
    ----------
    found : by name value, std, interval (None where there is none) and unit
    """
    rows = []
    for name, entry in found.items():
        value, std, bounds = entry["value"], entry["std"], entry["interval"]
        shown, interval = number(value), "-"
        if std is not None and 0 < std < math.inf:
            shown = with_std(value, std)
            interval = " ... ".join(to_digit_of(bound, std) for bound in bounds)
        rows.append((name, shown, interval, entry["unit"]))
    headers = ("name", "value", "95 % interval", "unit")
    return Table(title, headers, tuple(rows), left=("unit",))


def of_model(model: Any) -> dict[str, dict[str, Any]]:
    """A model's parameters and those of its effects, as :func:`parameters` takes them."""
    from identification.fitting.settings import FitSettings

    entries = dict(model.parameters) | {
        f"{effect}.{name}": entry
        for effect, inner in model.effects.items()
        for name, entry in inner.items()
    }
    found = {}
    for name, entry in entries.items():
        reach = None if entry.std is None else FitSettings.interval_deviations * entry.std
        bounds = None if reach is None else [entry.value - reach, entry.value + reach]
        found[name] = {
            "value": entry.value, "std": entry.std, "interval": bounds, "unit": entry.unit
        }  # fmt: skip
    return found


def errors(title: str, rows: Iterable[tuple[str, Errors]], first: str = "with") -> Table:
    """Force and velocity errors, a row each; what is missing or no number is "-"."""
    cells = tuple(
        (name, *(percent(found.get(f"{kind}_error", math.nan)) for kind in ("force", "velocity")))
        for name, found in rows
    )
    return Table(title, (first, "force error", "velocity error"), cells)


def depends_on(title: str, where: Iterable[Mapping[str, Any]]) -> Table:
    """Variables that explain a share of the force residual; without rows if none does."""
    rows = [
        (
            row["variable"] + (f" ({row['cycles']} times a turn)" if row.get("cycles") else ""),
            percent(row["share"]),
        )
        for row in where
        if row["share"] > 0
    ]
    headers = ("variable (others: beyond the twist)", "held-out share of variance")
    return Table(title, headers, tuple(rows))


def residual(title: str, where: Sequence[Mapping[str, Any]]) -> Table:
    """The same for a page, which says so where nothing can be told."""
    found = depends_on(title, where)
    if found.rows:
        return found
    nothing = (
        "The residual depends on no variable more than chance would have it."
        if where
        else "The logs are too short to tell."
    )
    return Table(title, found.headers, (), (nothing,))


def logs(read: Iterable[Log]) -> Table:
    """Which data a page is of."""
    rows = tuple(
        (log.name, len(log), f"{log.duration:.1f}", f"{log.rate:.4g}", log.sha256 or "-")
        for log in read
    )
    return Table("Logs", ("log", "rows", "duration s", "Hz", "sha256"), rows, left=("sha256",))


def verdict(error: float, floor: float, what: str = "The model") -> str:
    """A force error beside its noise floor, in words."""
    left = f"{what} leaves {percent(error)} of the forces unexplained"
    noise = f"measurement noise alone would leave {percent(floor)}"
    if error <= FITS * floor:
        return f"{left}; {noise}: it fits."
    return (
        f"{left}; {noise}: it does not fit. `youbot diagnose` names what is missing, or says that "
        "it cannot."
    )
