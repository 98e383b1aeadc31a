"""From the bytes of a CSV file to a table of floats, or to one line that says why it is refused.

A regular file is read by numpy's C parser. Any other file is read by a slower parser that works
cell by cell and can name the row and the column of a fault.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding, fault
from youbot_env.errors import InputError

MISSING = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none", "inf", "+inf", "-inf"})
"""Spellings, in lower case, of a value that is not there."""

MAX_HEADER = 1 << 20
"""Bytes of the first lines up to the header: 10,000 names have a fifth of it."""

MAX_COLUMNS = 10_000
"""Columns of a file: a recording of a whole robot has some thousands."""

MAX_ROWS = 1 << 22
"""Rows of a file, more than an hour at 1 kHz: each line that is parsed cell by cell takes a hundred
bytes and more."""

MAX_LINE = 1 << 20
"""Bytes of one line: 10,000 numbers with all their digits have a fifth of it."""

CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")
"""Control characters except tab, line feed, vertical tab, form feed and carriage return."""

GZIP_MAGIC, PARQUET_MAGIC = b"\x1f\x8b", b"PAR1"
_FOREIGN_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}


@dataclass
class LogTable:
    """Columns of a file as they stand; what is missing or infinite is NaN.

    ``values`` is (rows, columns), ``lines`` (rows,) the line of the file that each row came from,
    in 32 bits, since no file has more than ``MAX_ROWS``; ``header_row`` the line of the names, None
    in a file without lines.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    lines: NDArray[np.int32]
    findings: list[Finding] = field(default_factory=list)
    header_row: int | None = None


def parse_csv(source: str, content: bytes) -> LogTable:
    """Table of a CSV file's content.

    Raises
    ------
    InputError
        If it is no comma-separated UTF-8 text with a header and numbers below it.
    """
    if not content or content.isspace():
        raise fault(source, "is empty", "record it again")
    if content.startswith((GZIP_MAGIC, PARQUET_MAGIC)):
        kind = ".csv.gz" if content.startswith(GZIP_MAGIC) else ".parquet"
        raise fault(source, f"holds {kind} data under another name", f"rename it to {kind}")
    _check_size(source, content)
    byte_order_mark = content.startswith(b"\xef\xbb\xbf")
    content = content.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    table = _parse_regular(content) or _parse_cells(source, _decode(source, content))
    if byte_order_mark:
        table.findings.append(Finding("info", "byte-order mark skipped", row=1))
    return table


def _decode(source: str, content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise fault(source, "is UTF-16 text", "save it as UTF-8", row=1)
    check_text(source, content)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise fault(source, "is not UTF-8 text", "save it as UTF-8", row=row) from None


def check_text(source: str, content: bytes) -> None:
    """Refuse what holds characters that no text has."""
    if odd := CONTROL.search(content):
        row = content.count(b"\n", 0, odd.start()) + 1
        cure = "a log is UTF-8 text; export it again as CSV"
        raise fault(source, "holds binary data", cure, row=row)


def check_width(source: str, columns: int, row: int | None = None) -> None:
    """Refuse more columns than any log has."""
    if columns > MAX_COLUMNS:
        reason = f"has {columns} columns, more than {MAX_COLUMNS}"
        raise fault(source, reason, "keep the columns that a log needs", row=row)


def _check_size(source: str, content: bytes) -> None:
    """Refuse, before anything is split, what would take long or much memory to read."""
    # Files of old Macs end a line with a carriage return alone.
    breaks = b"\n" if b"\n" in content[:MAX_HEADER] else b"\r"
    if len(content) > MAX_HEADER and breaks not in content[:MAX_HEADER]:
        check_text(source, content[:MAX_HEADER])
        reason = f"its first line has more than {MAX_HEADER >> 20} MiB"
        raise fault(source, reason, "is it a CSV file? A log has a line a sample", row=1)
    rows = content.count(breaks)
    if rows > MAX_ROWS:
        reason = f"has {rows} lines, more than {MAX_ROWS}: too large to be read"
        raise fault(source, reason, "cut it into several logs")
    start = 0
    # From one line break to the last one within reach: a few steps for a file of usual lines.
    while len(content) - start > MAX_LINE:
        end = content.rfind(breaks, start, start + MAX_LINE)
        if end < start:
            row = content.count(breaks, 0, start) + 1
            raise fault(source, f"a line has more than {MAX_LINE >> 20} MiB", "remove it", row=row)
        start = end + 1


def _parse_regular(content: bytes) -> LogTable | None:
    """Table of a file of finite numbers, one full row a line; None of any other."""
    # The body is not cut out: a copy of an hour at 1 kHz takes as much memory as its numbers.
    header, start = content[: content.find(b"\n") + 1], content.find(b"\n") + 1
    if header.count(b",") >= MAX_COLUMNS:
        return None
    try:
        names = tuple(name.strip() for name in header.decode("ascii").split(","))
    except UnicodeDecodeError:
        return None
    plain = all(re.fullmatch(r"[A-Za-z_]\w*", name) for name in names)
    # numpy would accept all of this without a word. The slow parser can name the row and column.
    empty = re.compile(rb"\S").search(content, start) is None
    if not plain or len(set(names)) < len(names) or empty or not content.endswith(b"\n"):
        return None
    try:
        stream = io.BytesIO(content)
        stream.seek(start)
        text = io.TextIOWrapper(stream, encoding="ascii", newline="\n")
        values = np.loadtxt(text, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    # numpy skips blank lines; row numbers would then no longer be line numbers of the file.
    as_many = values.shape == (content.count(b"\n", start), len(names))
    if not as_many or not np.isfinite(values).all():
        return None
    return LogTable(names, values, np.arange(2, len(values) + 2, dtype=np.int32), header_row=1)


def _parse_cells(source: str, text: str) -> LogTable:
    """Table of a file that may be irregular, cell by cell."""
    lines = text.split("\n")
    used = [i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")]
    if not used:
        raise fault(source, "holds no table", "record it again")
    findings = []
    skipped = used[-1] + 1 - len(used)
    if skipped:
        findings.append(Finding("info", f"{skipped} blank or comment lines skipped"))
    if not text.endswith("\n") and len(used) > 2 and _is_cut(lines, used):
        row = used.pop() + 1
        cure = "the file was cut while it was written"
        findings.append(Finding("repaired", "the last row is incomplete: dropped", row, cure=cure))
    names = _read_header(source, lines[used[0]], used[0] + 1)
    width = len(names)
    names, kept = _without_text(names, [_split(lines[i]) for i in used[1:_LOOKED_AT]], findings)
    rows = []
    for i in used[1:]:
        row = i + 1
        cells = _split(lines[i])
        if any(cell.strip() for cell in cells[width:]) or len(cells) < width:
            raise _ragged(source, cells, width, row)
        rows.append(_numbers(source, [cells[k] for k in kept], names, row))
    values = np.array(rows, float).reshape(len(rows), len(names))
    # Infinity means a missing value too.
    values[~np.isfinite(values)] = np.nan
    lines_used = np.array(used[1:], dtype=np.int32) + 1
    return LogTable(names, values, lines_used, findings, header_row=used[0] + 1)


_LOOKED_AT = 20
"""Rows from the first that tell whether a column holds text."""

_OF_A_LOG = re.compile(
    r"(time|pose_x|pose_y|pose_yaw|gyro_z|(velocity|effort|position|command)\w*)$"
)
"""Names that a log's own columns have; text in these is a fault."""


def _without_text(
    names: tuple[str, ...], rows: list[list[str]], findings: list[Finding]
) -> tuple[tuple[str, ...], list[int]]:
    """Names and places of the columns without those of text, which are told and left out."""
    kept = []
    for k, name in enumerate(names):
        cells = [row[k].strip() for row in rows if len(row) > k]
        text = [cell for cell in cells if cell.lower() not in MISSING and not _is_number(cell)]
        # A decimal comma splits a number in two, and a header that occurs again is told as such.
        if text and not _OF_A_LOG.match(name) and len(text) == len(cells):
            shown = text[0] if len(text[0]) <= 20 else text[0][:17] + "..."
            message = f"holds text ({shown!r}): left out"
            findings.append(Finding("warning", message, 1, name, "a log needs numbers only"))
        else:
            kept.append(k)
    return tuple(names[k] for k in kept), kept


def _split(line: str) -> list[str]:
    # str.split is faster than the csv module, and right unless a cell is quoted.
    return next(csv.reader([line])) if '"' in line else line.split(",")


def _is_cut(lines: list[str], used: list[int]) -> bool:
    """Whether the last line, which no newline ends, looks as if its end were missing."""
    last = _split(lines[used[-1]])
    # The last fifty complete rows show how many cells and decimals a complete row has.
    before = [_split(lines[i]) for i in used[max(1, len(used) - 51) : -1]]
    if len(last) < min(len(cells) for cells in before):
        return True
    # A number that lost its last decimals is still a number, but a wrong one.
    decimals = [len(cells[-1].strip().partition(".")[2]) for cells in before]
    return len(last[-1].strip().partition(".")[2]) < min(decimals)


def _read_header(source: str, line: str, row: int) -> tuple[str, ...]:
    names = [name.strip() for name in _split(line)]
    check_width(source, len(names), row)
    if all(_is_number(name) for name in names if name) and any(names):
        cure = "write the column names into its first line: time,velocity_fl,..."
        raise fault(source, "has no header", cure, row=row)
    if len(names) == 1:
        for delimiter, word in _FOREIGN_DELIMITERS.items():
            if delimiter in line.strip():
                cure = "separate columns by commas and write decimals with a point"
                raise fault(source, f"columns are separated by {word}", cure, row=row)
    # A comma at the end of the header makes an empty last name.
    while names and not names[-1]:
        names.pop()
    names = [name or f"(column {i})" for i, name in enumerate(names, 1)]
    seen: set[str] = set()
    for name in names:
        if name in seen:
            cure = "keep one of the two"
            raise fault(source, "the column occurs twice", cure, row=row, column=name)
        seen.add(name)
    return tuple(names)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    # float() accepts nan and inf, which are no numbers here.
    return cell.strip().lower() not in MISSING


def _ragged(source: str, cells: list[str], width: int, row: int) -> InputError:
    cure = "complete the row or remove it"
    # A decimal comma splits nearly every number into two cells.
    if len(cells) >= 2 * width - 1:
        cure = "write decimals with a point, not a comma"
    return fault(source, f"has {len(cells)} cells, the header {width}", cure, row=row)


def _numbers(source: str, cells: list[str], names: tuple[str, ...], row: int) -> list[float]:
    numbers = []
    for i, cell in enumerate(cells):
        try:
            if "_" in cell:  # float() accepts 1_000
                raise ValueError
            numbers.append(float(cell))
        except ValueError:
            text = cell.strip()
            if text.lower() not in MISSING:
                raise _no_number(source, text, names[i], row) from None
            numbers.append(np.nan)
    return numbers


def _no_number(source: str, text: str, column: str, row: int) -> InputError:
    if text == column:
        cure = "split it there into two logs, or remove the row"
        return fault(source, "the header occurs again", cure, row=row, column=column)
    cure = "write a number, or leave the cell empty"
    if re.fullmatch(r"[+-]?\d+,\d*", text):
        cure = "write decimals with a point, not a comma"
    shown = text if len(text) <= 20 else text[:17] + "..."
    return fault(source, f"{shown!r} is not a number", cure, row=row, column=column)
