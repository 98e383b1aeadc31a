"""The files that a log may come in: CSV, CSV compressed by gzip, Parquet."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from identification.logs.findings import Finding, fault
from identification.logs.parsing import (
    GZIP_MAGIC,
    PARQUET_MAGIC,
    LogTable,
    check_text,
    check_width,
    parse_csv,
)
from youbot_env.errors import InputError
from youbot_env.files import read_bounded

MAX_BYTES = 1 << 30
"""Size of a log's file [bytes]: an hour of a platform at 1 kHz has half as many."""

MAX_STREAM = 1 << 27
"""Bytes of a pipe, of a device, or of what a compressed file may hold: a pipe and a file of gzip do
not say how long they are, and each byte is kept until the end is reached."""

MAX_CELLS = 1 << 25
"""Values in a Parquet file: a few bytes of it can stand for thousands of millions."""

CHUNK = 1 << 20
"""Bytes that are decompressed at a time."""


def read_bytes(path: Path) -> bytes:
    """Content of a file, or of a pipe as the shell's ``<(...)`` makes one.

    Raises
    ------
    InputError
        If there is no such file, it is a directory, may not be read, or is too large.
    """
    source = str(path)
    try:
        return read_bounded(source, MAX_BYTES if path.is_file() else MAX_STREAM)
    except FileNotFoundError:
        raise fault(source, "no such file", "check the path") from None
    except IsADirectoryError:
        raise fault(source, "is a directory", f"name the logs in it: {path}/*.csv") from None
    except PermissionError:
        raise fault(source, "no permission to read it", f"chmod +r {path}") from None
    except InputError as error:
        reason = str(error).removeprefix(f"{source}: ")
        raise fault(source, reason, "cut it into several logs") from None
    except (OSError, ValueError) as error:
        raise fault(source, f"cannot be read ({error})", "check the path and the disk") from None


def parser_for(path: Path, content: bytes = b"") -> Callable[[str, bytes], LogTable]:
    """The parser for a file's ending (.csv, .csv.gz, .parquet); for a pipe, by what it holds."""
    name = path.name.lower()
    if name.endswith(".parquet"):
        return parse_parquet
    if name.endswith(".csv.gz"):
        return parse_gzip
    if name.endswith(".csv"):
        return parse_csv
    if path.exists() and not path.is_file():
        kinds = {GZIP_MAGIC: parse_gzip, PARQUET_MAGIC: parse_parquet}
        return next((kinds[magic] for magic in kinds if content.startswith(magic)), parse_csv)
    raise fault(str(path), "unknown kind of file", "a log ends in .csv, .csv.gz or .parquet")


def parse_gzip(source: str, content: bytes) -> LogTable:
    """Table of a gzip-compressed CSV."""
    # Some programs decompress a file without renaming it.
    if content and not content.startswith(GZIP_MAGIC):
        table = parse_csv(source, content)
        table.findings.append(
            Finding("warning", "is not compressed, read as plain CSV", cure="rename it to .csv")
        )
        return table
    try:
        text = _decompressed(source, content)
    except EOFError:
        cure = "copy or record it again (gzip -t tests it)"
        raise fault(source, "the compressed file is cut short", cure) from None
    except (OSError, zlib.error) as error:
        cure = "copy or record it again (gzip -t tests it)"
        raise fault(source, f"the compressed file is damaged ({error})", cure) from None
    return parse_csv(source, text)


def _decompressed(source: str, content: bytes) -> bytes:
    pieces: list[bytes] = []
    size = 0
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
        while piece := stream.read(CHUNK):
            # Zeros, of which a small file can hold thousands of millions, are no text.
            if not pieces:
                check_text(source, piece)
            size += len(piece)
            if size > MAX_STREAM:
                reason = f"holds more than {MAX_STREAM >> 20} MiB of text: too large to be read"
                raise fault(source, reason, "cut it into several logs")
            pieces.append(piece)
    return b"".join(pieces)


def parse_parquet(source: str, content: bytes) -> LogTable:
    """Table of a Parquet file; its rows are counted from 1.

    Raises
    ------
    InputError
        If pyarrow is not installed, or the file is damaged or holds columns that are no numbers.
    """
    parquet = import_parquet(source)
    if not content:
        raise fault(source, "is empty", "record it again")
    try:
        file = parquet.ParquetFile(io.BytesIO(content))
        schema, rows = file.schema_arrow, file.metadata.num_rows
    except Exception as error:  # pyarrow raises its own and the standard kinds
        raise _no_parquet(source, error) from None
    # All this before a value is read: the file may be small and its values many.
    names = tuple(schema.names)
    check_width(source, len(names))
    if len(set(names)) < len(names):
        raise fault(source, "a column occurs twice", "keep one of the two")
    for name, kind in zip(names, map(str, schema.types), strict=True):
        _check_numbers(source, name, kind)
    if not 0 <= rows * max(len(names), 1) <= MAX_CELLS:
        reason = f"holds {rows} rows of {len(names)} columns: too large to be read"
        raise fault(source, reason, "cut it into several logs")
    try:
        columns = file.read()
    except Exception as error:
        raise _no_parquet(source, error) from None
    arrays = [np.array(columns.column(name).to_numpy(), dtype=float) for name in names]
    values = np.column_stack(arrays) if arrays else np.empty((0, 0))
    # Infinity means a missing value, as in a CSV file.
    values[~np.isfinite(values)] = np.nan
    return LogTable(names, values, np.arange(1, len(values) + 1, dtype=np.int32))


def _no_parquet(source: str, error: Exception) -> InputError:
    reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
    return fault(source, f"is no sound Parquet file ({reason})", "write it again")


def _check_numbers(source: str, name: str, kind: str) -> None:
    if not re.fullmatch(r"u?int\d+|float|double|halffloat|null", kind):
        cure = "store it as float64"
        raise fault(source, f"holds {kind[:40]}, not numbers", cure, column=name)


def import_parquet(source: str) -> Any:
    """The module pyarrow.parquet, loaded only when a Parquet file is at hand.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        cure = "pip install 'youbot[parquet]', or use .csv"
        raise fault(source, "Parquet needs pyarrow", cure) from None
    return parquet
