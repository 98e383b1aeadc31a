"""Columns that hold time: which they are, in which unit, and what makes seconds of them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from identification.importing.settings import ImportSettings

Array = NDArray[np.float64]

TIME_UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "day": 86400.0,
}
"""Seconds in a unit of time."""

_ISO = re.compile(
    r"(\d{4}-\d\d?-\d\d?|\d{4}/\d\d?/\d\d?|\d\d?\.\d\d?\.\d{4})[T _]+"
    r"(\d\d?:\d\d(?::\d\d(?:[.,]\d+)?)?)\s*(Z|UTC|[+-]\d\d:?\d\d)?"
)
_OF_DAY = re.compile(r"(?:(\d\d?):)?(\d\d?):(\d\d[.,]\d+|(?<=:\d\d:)\d\d)")


def seconds_of_texts(cells: Iterable[str]) -> Array | None:
    """Seconds (n,) since 1970 of dates with times, or of times of day; None if they are neither.

    A date without a zone is taken as UTC: only differences matter, and those between two logs of
    one logger stay right.
    """
    found = [_seconds(cell.strip()) for cell in cells]
    known = [value for value in found if value is not None]
    # A few odd cells (a repeated header, a remark) do not make the column another one.
    if not known or len(known) < len(found) * ImportSettings.min_number_share:
        return None
    return np.array([np.nan if value is None else value for value in found])


def _seconds(text: str) -> float | None:
    match = _ISO.fullmatch(text)
    try:
        if match:
            date, clock, zone = match.groups()
            return _of_date(date, clock, zone or "Z")
        match = _OF_DAY.fullmatch(text)
        if match:
            parts = (float((part or "0").replace(",", ".")) for part in match.groups())
            hours, minutes, seconds = parts
            return (hours * TIME_UNITS["min"] + minutes) * TIME_UNITS["min"] + seconds
    except (ValueError, OverflowError):
        pass
    return None


def _of_date(date: str, clock: str, zone: str) -> float:
    if "." in date:  # 01.05.2024
        date = "-".join(reversed(date.split(".")))
    year, month, day = (int(part) for part in re.split("[-/]", date))
    hours, minutes, *rest = clock.replace(",", ".").split(":")
    start = datetime(year, month, day, int(hours), int(minutes), tzinfo=UTC).timestamp()
    if zone not in ("Z", "UTC"):
        shift = int(zone[1:3]) * 60 + int(zone[-2:])
        start -= (1 if zone[0] == "+" else -1) * shift * TIME_UNITS["min"]
    # Fractions are added as a float: datetime would drop nanoseconds.
    return start + (float(rest[0]) if rest else 0.0)


def unit_of_time(time: Array, settings: ImportSettings = ImportSettings()) -> tuple[str, str]:
    """Unit of a time column (n,) and why: by its date, or by its step; "" if it tells none."""
    known = time[np.isfinite(time)]
    if not len(known):
        return "", "it holds no number"
    steps = np.diff(np.unique(known))  # rows may be in any order
    step = float(np.median(steps)) if len(steps) else 0.0
    first = float(np.median(known))
    if step == 0:
        return "", "it does not move"
    scales = {unit: scale for unit, scale in TIME_UNITS.items() if unit not in ("min", "day")}
    # A date goes first: the step alone does not tell a slow log in ms from a fast one in s. Its
    # step may be coarse (whole seconds), but is never hours.
    for unit, scale in scales.items():
        dated = settings.min_epoch < first * scale < settings.max_epoch
        if dated and settings.min_step <= step * scale <= settings.max_coarse_step:
            return unit, f"a date in {unit}: {datetime.fromtimestamp(first * scale, UTC).date()}"
    if settings.min_day < first < settings.max_day and step * TIME_UNITS["day"] < settings.max_step:
        return "day", f"days since 1900, as a spreadsheet has them: steps of {step:.4g}"
    for unit, scale in scales.items():
        if settings.min_step <= step * scale <= settings.max_step:
            return unit, f"steps of {step:.4g}, {1 / (step * scale):.4g} Hz"
    return "", f"steps of {step:.4g}"


def spread(time: Array) -> Array | None:
    """Times (n,) of a clock that holds each for several rows, spread evenly over them.

    None where rows do not come evenly, or the clock tells the rows apart.
    """
    changes = np.flatnonzero(np.diff(time) != 0) + 1
    if len(changes) < 3 or len(time) < 2 * len(changes) or (np.diff(time) < 0).any():
        return None
    # As many rows each time, but for one: the rows come evenly, and only the clock is coarse.
    if np.ptp(np.diff(changes)) > 1:
        return None
    slope, start = np.polyfit(changes, time[changes] - time[0], 1)
    return time[0] + start + slope * np.arange(len(time))


def glued_nanoseconds(cells: list[str]) -> Array | None:
    """Seconds (n,) of stamps written as SECONDS.NANOSECONDS without the zeros between.

    10 ms, written so, are "0.10000000" and read as 0.1 s: such a column runs back at each second,
    but rises once what is behind the point is taken as a count. None if it does not.
    """
    parts = [re.fullmatch(r"(\d+)\.(\d{1,9})", cell.strip()) for cell in cells]
    if len(parts) < 3 or not all(parts):
        return None
    seconds = np.array([float(part[1]) for part in parts if part])
    nanoseconds = np.array([float(part[2]) for part in parts if part])
    # The same number of digits throughout: it is a decimal fraction, as anybody writes it.
    widths = {len(part[2]) for part in parts if part}
    plain = np.array([float(part[0]) for part in parts if part])
    glued = seconds + nanoseconds * TIME_UNITS["ns"]
    runs_back = (np.diff(plain) < 0).any()
    rises = (np.diff(glued) > 0).all()
    return glued if len(widths) > 1 and runs_back and rises else None
