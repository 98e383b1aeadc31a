"""Text files of any layout: delimiter, decimal sign, header, remarks, and columns of numbers."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from identification.importing.clocks import glued_nanoseconds, seconds_of_texts
from identification.importing.settings import ImportSettings
from identification.importing.tables import Array, Table
from identification.importing.vocabulary import meaning, unit_in_name
from identification.logs.findings import fault
from identification.logs.formats import import_parquet
from identification.logs.parsing import GZIP_MAGIC, MISSING, PARQUET_MAGIC
from youbot_env.physics.hardware import WHEELS

DELIMITERS = (";", "\t", "|", ",")
"""Of two that make as many numbers the first is taken."""

_COMMENT = re.compile(r"^\s*(#|%|//)\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}(\.\d{3})+,\d+\s*")
_US_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}(,\d{3})+\.\d*\s*")
_LIST = re.compile(r"""\s*(?:array\(\s*(?:'.'\s*,)?)?\s*[\[({]([^\[\](){}]*)[\])}]\s*\)?\s*""")
_TRUTH = {"true": 1.0, "false": 0.0}
_NAMES_OF_COLUMNS = re.compile(r"[A-Za-zµ_%]")

csv.field_size_limit(1 << 24)


@dataclass
class _Grid:
    """Rows of cells of a text, below a header.

    lines : line of the file that each row came from
    units : the row of units below the names, if there is one
    """

    names: list[str]
    rows: list[list[str]]
    lines: list[int]
    units: list[str]


def read_text_table(source: str, content: bytes) -> Table:
    """The table of a text file's content (CSV and its relatives, compressed by gzip or not).

    Raises
    ------
    InputError
        If it is no text, or holds no columns of numbers.
    """
    table = Table(source, "", "csv", {})
    text = _decode(source, _uncompressed(source, content), table)
    grid = _grid(source, text, table)
    columns = dict(zip(grid.names, zip(*grid.rows, strict=True), strict=True))
    joints = _joints_by_row(columns)
    for k, (name, cells) in enumerate(columns.items()):
        unit = grid.units[k] if grid.units else ""
        _add_column(table, name, list(cells), unit)
    if not table.columns:
        raise fault(source, "holds no column of numbers", "a log is a table of numbers")
    if joints is not None:
        _turn(table, joints)
    return table


def _joints_by_row(columns: Mapping[str, Sequence[str]]) -> list[str] | None:
    """The joint of each row (n,) where a column names one a row; None where none does."""
    for cells in columns.values():
        held = set(cells)
        wheels = {meaning(cell).wheel for cell in held if len(held) <= ImportSettings.max_array}
        if set(WHEELS) <= wheels:
            return list(cells)
    return None


def _turn(table: Table, joints: list[str]) -> None:
    """Makes a column a joint of each column of a table that has a row a joint."""
    named = np.array(joints)
    table.note("a row holds one joint: turned into a column a joint")
    for name in list(table.columns):
        if meaning(name).quantity == "time" or name in table.dates:
            continue
        values = table.columns.pop(name)
        unit = table.units.pop(name, "")
        for joint in dict.fromkeys(joints):
            table.columns[f"{name}[{joint}]"] = np.where(named == joint, values, np.nan)
            table.units |= {f"{name}[{joint}]": unit} if unit else {}


def read_parquet_table(source: str, content: bytes) -> Table:
    """The table of a Parquet file: numbers, dates as seconds since 1970, lists by their elements.

    Raises
    ------
    InputError
        If pyarrow is not installed or the file is damaged.
    """
    parquet = import_parquet(source)
    try:
        read = parquet.read_table(io.BytesIO(content))
        table = Table(source, "", "parquet", {})
        for name in read.column_names:
            _add_arrow_column(table, name, read.column(name))
    except Exception as error:  # pyarrow raises its own and the standard kinds
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise fault(source, f"is no sound Parquet file ({reason})", "write it again") from None
    if not table.columns:
        raise fault(source, "holds no column of numbers", "a log is a table of numbers")
    return table


def is_parquet(path: Path, content: bytes) -> bool:
    """Whether a file's content is Parquet's, whatever its name."""
    return content.startswith(PARQUET_MAGIC) or path.name.lower().endswith(".parquet")


def _add_arrow_column(table: Table, name: str, column) -> None:  # noqa: ANN001 - pyarrow's
    kind = str(column.type)
    if kind.startswith(("timestamp", "date")):
        values = column.cast("timestamp[ns]").to_numpy().astype("datetime64[ns]")
        seconds = values.astype(np.int64) * 1e-9
        table.columns[name] = np.where(np.isnat(values), np.nan, seconds)
        table.units[name] = "s"
    elif kind.startswith(("duration", "time")):
        table.columns[name] = np.array(column.cast("int64").to_numpy(), float)
    elif kind.startswith(("list", "fixed_size_list", "large_list")):
        _add_lists(table, name, column.to_pylist())
    elif re.fullmatch(r"u?int\d+|float|double|halffloat|bool|decimal.*", kind):
        cells = np.array(column.to_pylist(), float)
        cells[~np.isfinite(cells)] = np.nan
        table.columns[name] = cells
        table.units |= _stated_unit(name, "")
    elif kind in ("string", "large_string"):
        _add_column(table, name, [cell or "" for cell in column.to_pylist()], "")


# --- from bytes to rows of cells -------------------------------------------------------------


def _uncompressed(source: str, content: bytes) -> bytes:
    if not content.startswith(GZIP_MAGIC):
        return content
    limit = ImportSettings.max_bytes
    try:
        with gzip.open(io.BytesIO(content)) as file:
            text = file.read(limit + 1)
    except (EOFError, OSError, zlib.error) as error:
        cure = "copy or record it again (gzip -t tests it)"
        raise fault(source, f"the compressed file is damaged ({error})", cure) from None
    if len(text) > limit:
        cure = "cut it into pieces"
        raise fault(source, f"is larger than {limit >> 20} MB uncompressed", cure)
    return text


def _decode(source: str, content: bytes, table: Table) -> str:
    if not content or content.isspace():
        raise fault(source, "is empty", "record it again")
    for mark, name in (
        (b"\xef\xbb\xbf", "utf-8"),
        (b"\xff\xfe\x00\x00", "utf-32-le"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if content.startswith(mark):
            table.note(f"byte-order mark of {name} skipped")
            return content[len(mark) :].decode(name, errors="replace")
    start = content[: 1 << 12]
    # UTF-16 without a mark: every other byte of plain text is zero.
    for first, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(start) > 8 and not any(start[first : len(start) // 2 * 2 : 2]):
            table.note(f"read as {name}")
            return content.decode(name, errors="replace")
    odd = re.search(rb"[\x00-\x08\x0e-\x1f]", content)
    if odd:
        row = content.count(b"\n", 0, odd.start()) + 1
        cure = "import reads bags (.bag, .db3, .mcap), Parquet and text"
        raise fault(source, "holds binary data of an unknown kind", cure, row=row)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        # Of the encodings with a letter a byte, the one of most programs that still write one.
        table.note("is not UTF-8: read as Windows-1252")
        return content.decode("cp1252", errors="replace")


def _grid(source: str, text: str, table: Table) -> _Grid:
    """Rows of cells below a header: what a text holds besides is left out and told."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    used = [k for k, line in enumerate(lines) if line.strip()]
    delimiter = _delimiter([lines[k] for k in used])
    cells = {k: _cells(_COMMENT.sub("", lines[k]), delimiter) for k in used[: _searched()]}
    first = next((k for k, row in cells.items() if _numeric(row) and not _remark(lines[k])), None)
    if first is None:
        raise fault(source, "holds no row of numbers", "a log is a table of numbers")
    width = _width(lines, used, delimiter, first)
    header, units = _header(cells, first, width)
    names = _unique(header) if header else [f"column_{k + 1}" for k in range(width)]
    if not header:
        table.note("has no header")
    width = max(width, len(names))
    names += [f"column_{k + 1}" for k in range(len(names), width)]
    units += [""] * (width - len(units)) if units else []
    repeated = {tuple(row) for row in (header, units) if row}
    rows, rowlines, dropped = [], [], Counter()
    data = [k for k in used if k >= first]
    cut = not text.endswith(("\n", "\r"))
    for k in data:
        row = _cells(lines[k], delimiter)
        why = _no_row(row, lines[k], width, repeated, cut and k == data[-1])
        if why:
            dropped[why] += 1
            continue
        rows.append([*row[:width], *[""] * (width - len(row))])
        rowlines.append(k + 1)
    for why, count in dropped.items():
        table.note(f"{count} line(s) skipped: {why}")
    if not rows:
        raise fault(source, "holds no row of numbers", "a log is a table of numbers")
    return _Grid(names, rows, rowlines, units)


def _searched() -> int:
    return ImportSettings.header_search


def _remark(line: str) -> bool:
    return bool(_COMMENT.match(line))


def _no_row(
    row: list[str], line: str, width: int, repeated: set[tuple[str, ...]], cut: bool
) -> str:
    """Why a line is no row of the table; "" if it is one."""
    if _remark(line):
        return "remarks"
    if tuple(cell.strip() for cell in row) in repeated:
        return "the header again"
    if not any(_is_value(cell) for cell in row):
        return "text"
    if cut and len(row) < width:
        return "the last one, which is cut"
    # Text between the rows, with a number in it: "Total: 1500 rows".
    if len(row) == 1 < width or (len(row) < width / 2 and not _numeric(row)):
        return "text"
    return ""


def _delimiter(lines: list[str]) -> str | None:
    """What separates cells; None for blanks, or where there is one column."""
    sample = [_COMMENT.sub("", line) for line in lines[: _searched()]]
    sample += lines[len(lines) // 2 : len(lines) // 2 + _searched()]
    # By what makes numbers: a comma may also be the decimal sign, a semicolon stand in a text.
    made = {d: sum(_is_value(c) for line in sample for c in _cells(line, d)) for d in DELIMITERS}
    wide = [d for d in DELIMITERS if sum(d in line for line in sample) > len(sample) / 2]
    best = max(wide, key=lambda d: made[d], default=None)
    blanks = sum(_is_value(cell) for line in sample for cell in line.split())
    # Blanks stand beside commas too, but then make no more numbers.
    return None if best is None or blanks > made[best] else best


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    if '"' not in line and "'" not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    quote = '"' if '"' in line else "'"
    reader = csv.reader([line], delimiter=delimiter, quotechar=quote, skipinitialspace=True)
    try:
        return [cell.strip() for cell in next(reader)]
    except (csv.Error, StopIteration):
        return line.split(delimiter)


def _is_value(cell: str) -> bool:
    """Whether a cell holds a number, a list of numbers or a date."""
    return (
        _number(cell) is not None
        or bool(_LIST.fullmatch(cell) and re.search(r"\d", cell))
        or seconds_of_texts([cell]) is not None
    )


def _numeric(row: list[str]) -> bool:
    filled = [cell for cell in row if cell.strip()]
    values = sum(_is_value(cell) for cell in filled)
    # Text columns may be many (joint names, a frame), but a header has no number at all.
    return values >= max(1, len(filled) / 3) and (len(filled) > 1 or len(row) == 1)


def _width(lines: list[str], used: list[int], delimiter: str | None, first: int) -> int:
    below = islice((k for k in used if k >= first), _searched())
    return Counter(len(_cells(lines[k], delimiter)) for k in below).most_common(1)[0][0]


def _header(cells: dict[int, list[str]], first: int, width: int) -> tuple[list[str], list[str]]:
    """Names, and units where a line of them stands between names and numbers."""
    above = [row for k, row in cells.items() if k < first]
    # The names are the lowest line of about as many cells as the rows have, without a number.
    for k in range(len(above) - 1, -1, -1):
        row = above[k]
        while row and not row[-1]:
            row = row[:-1]
        if not _names_columns(row, width):
            continue
        if k > 0 and _names_columns(above[k - 1], width):
            if _all_units(row):
                return above[k - 1], row
            if len(set(above[k - 1])) < len(row) == len(above[k - 1]) and len(set(row)) < len(row):
                # Quantities above, wheels below.
                return [" ".join(pair).strip() for pair in zip(above[k - 1], row, strict=True)], []
        return row, []
    return [], []


def _names_columns(row: list[str], width: int) -> bool:
    named = sum(bool(_NAMES_OF_COLUMNS.search(cell)) for cell in row)
    close = width / 2 < len(row) <= width + 1
    return close and named > len(row) / 2 and not any(_number(cell) is not None for cell in row)


def _all_units(row: list[str]) -> bool:
    filled = [cell.strip("[]()<>{} ") for cell in row]
    return all(not cell or unit_in_name(f"x [{cell}]")[1] or cell in "-1" for cell in filled)


def _unique(names: list[str]) -> list[str]:
    """Names of columns, of which no two are alike and none is empty."""
    found: list[str] = []
    for k, name in enumerate(names, 1):
        name = name.strip().strip("\"'") or f"column_{k}"
        twins = sum(other == name or other.startswith(f"{name} #") for other in found)
        found.append(f"{name} #{twins + 1}" if twins else name)
    return found


# --- from cells to numbers -------------------------------------------------------------------


def _add_column(table: Table, name: str, cells: list[str], unit: str) -> None:
    """Adds a column to a table as what it holds: numbers, dates, lists; or notes its text."""
    numbers = _numbers(cells)
    if numbers is not None:
        falls = bool((numbers[1:] < numbers[:-1]).any())
        glued = glued_nanoseconds(cells) if falls else None
        if glued is not None:
            table.note(f"column {name}: SECONDS.NANOSECONDS without zeros between, read as such")
            table.units[name] = "s"
            table.columns[name] = glued
            return
        table.columns[name] = numbers
        table.units |= _stated_unit(name, unit)
        return
    seconds = seconds_of_texts(cells)
    if seconds is not None:
        table.columns[name], table.units[name] = seconds, "s"
        table.dates.add(name)
        return
    lists = [_list(cell) for cell in cells]
    if sum(row is not None for row in lists) > len(lists) * ImportSettings.min_number_share:
        _add_lists(table, name, lists)
        return
    held = Counter(cell for cell in cells if cell.strip())
    if len(held) == 1:
        table.texts[name] = next(iter(held))


def _add_lists(table: Table, name: str, lists: Sequence[Sequence[object] | None]) -> None:
    """Columns NAME[0], NAME[1], ... of a column of lists; texts where they hold names."""
    width = max((len(row) for row in lists if row), default=0)
    for k in range(min(width, ImportSettings.max_array)):
        cells = [str(row[k]) if row is not None and k < len(row) else "" for row in lists]
        _add_column(table, f"{name}[{k}]", cells, "")


def _list(cell: str) -> list[str] | None:
    match = _LIST.fullmatch(cell)
    if not match:
        return None
    inside = match[1]
    delimiter = next((d for d in (",", ";") if d in inside), None)
    return [part.strip().strip("\"'") for part in inside.split(delimiter)]


def _stated_unit(name: str, unit: str) -> dict[str, str]:
    if unit:
        # In brackets, so that a lone letter is taken for a unit and not for a name.
        stated = unit_in_name(f"x [{unit.strip('[]()<>{} ')}]")[1]
        return {name: stated} if stated else {}
    stated = unit_in_name(name)[1]
    return {name: stated} if stated else {}


def _numbers(cells: list[str]) -> Array | None:
    """Numbers (n,) of cells, NaN for what is missing; None if they are mostly no numbers."""
    try:
        # Most columns hold nothing but numbers, and numpy reads them 20 times as fast.
        values = np.array(cells, dtype=float)
        if not any("_" in cell for cell in cells):
            values[~np.isfinite(values)] = np.nan
            return values
    except ValueError:
        pass
    values = np.full(len(cells), np.nan)
    odd = filled = 0
    for k, cell in enumerate(cells):
        number = _number(cell)
        if number is not None:
            values[k] = number
        elif cell.strip().lower() not in MISSING:
            odd += 1
        filled += cell.strip() != ""
    return None if odd > (1 - ImportSettings.min_number_share) * filled or not filled else values


def _number(cell: str) -> float | None:
    """A number, with a decimal point or comma; NaN for infinities; None for anything else."""
    text = cell.strip()
    if text.lower() in MISSING or "_" in text:
        return None
    try:
        value = float(text)
    except ValueError:
        if text.lower() in _TRUTH:
            return _TRUTH[text.lower()]
        if _US_THOUSANDS.fullmatch(text):
            text = text.replace(",", "")
        elif _THOUSANDS.fullmatch(text):
            text = text.replace(".", "")
        elif not _DECIMAL_COMMA.fullmatch(text):
            return None
        value = float(text.replace(",", "."))
    return value if np.isfinite(value) else None
