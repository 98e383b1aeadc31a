"""What the checks of a log found: one fault, repair or remark each."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from youbot_env.errors import InputError

Level = Literal["error", "repaired", "warning", "info"]


@dataclass(frozen=True)
class Finding:
    """One thing that a check found in a log.

    Attributes
    ----------
    level : "error" (the log cannot be used), "repaired" (data were changed), "warning" (the data
        are as they were, but doubtful) or "info"
    message : what was found, in one clause
    row : line of the file, counted from 1, so a CSV's header is row 1; None if it has no place
    column : name of the column, None if it concerns several
    cure : what the user can do about it
    """

    level: Level
    message: str
    row: int | None = None
    column: str | None = None
    cure: str = ""

    @property
    def names_its_column(self) -> bool:
        """Whether the message begins with the column, so that nobody need say it before."""
        return bool(self.column) and self.message.startswith(f"{self.column} ")

    def __str__(self) -> str:
        place = [f"row {self.row}"] if self.row is not None else []
        place += [f"column {self.column}"] if self.column is not None else []
        parts = [", ".join(place)] if place else []
        return ": ".join([*parts, self.message]) + (f"; {self.cure}" if self.cure else "")


def percent(share: float) -> str:
    """A share such as 0.0123 as "1.2 %": two digits, never a power of ten ("100 %")."""
    size = abs(100 * share)
    digits = 1 - math.floor(math.log10(size)) if size > 0 and math.isfinite(size) else 0
    rounded = round(100 * share, digits) if math.isfinite(share) else share
    return f"{rounded:.{max(digits, 0)}f} %"


_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")


def names_of(logs: Sequence[str]) -> str:
    """Names of logs for a sentence: "a, b and c", or of more "a and 11 others"."""
    match list(logs):
        case [one]:
            return one
        case [one, other]:
            return f"{one} and {other}"
        case [one, other, third]:
            return f"{one}, {other} and {third}"
        case [first, *others]:
            return f"{first} and {len(others)} others"
    return ""


def grouped(told: Iterable[tuple[str, str]]) -> list[str]:
    """Sentences about logs, each told once: "a and 11 others: 43 to 48 % of the rows ...".

    Parameters
    ----------
    told : names of logs, each with a sentence; of sentences that differ by their numbers alone
        one is told, with the least and the largest of each number
    """
    alike: dict[str, list[tuple[str, str]]] = {}
    for name, sentence in told:
        alike.setdefault(_NUMBER.sub("0", sentence), []).append((name, sentence))
    return [
        f"{names_of([name for name, _ in group])}: {_spanned([line for _, line in group])}"
        for group in alike.values()
    ]


def _spanned(sentences: Sequence[str]) -> str:
    """One sentence for several that differ by their numbers."""
    numbers = iter(zip(*(_NUMBER.findall(line) for line in sentences), strict=True))

    def span(_: re.Match[str]) -> str:
        found = sorted(set(next(numbers)), key=float)
        return found[0] if len(found) == 1 else f"{found[0]} to {found[-1]}"

    return _NUMBER.sub(span, sentences[0])


class LogError(InputError):
    """A log that cannot be used. ``findings`` holds all that was found, its errors included."""

    def __init__(self, source: str, findings: Iterable[Finding]) -> None:
        self.findings = tuple(findings)
        errors = [finding for finding in self.findings if finding.level == "error"]
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        super().__init__(f"{source}: {errors[0]}{more}".replace("\n", " ").replace("\r", " "))


def fault(
    source: str, message: str, cure: str, *, row: int | None = None, column: str | None = None
) -> LogError:
    """The error to raise for a fault that ends the reading at once."""
    return LogError(source, [Finding("error", message, row, column, cure)])
