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
from numpy.typing import NDArray

from identification.logs.findings import Finding, fault
from identification.logs.parsing import GZIP_MAGIC, LogTable, parse_csv


def read_bytes(path: Path) -> bytes:
    """Content of a file.

    Raises
    ------
    InputError
        If there is no such file, it is a directory or may not be read.
    """
    source = str(path)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise fault(source, "no such file", "check the path") from None
    except IsADirectoryError:
        cure = (
            f"name the logs in it: {path}/*.csv (of a ROS 2 bag: youbot import {path} -o LOG.csv)"
        )
        raise fault(source, "is a directory", cure) from None
    except PermissionError:
        raise fault(source, "no permission to read it", f"chmod +r {path}") from None
    except (OSError, ValueError) as error:
        raise fault(source, f"cannot be read ({error})", "check the path and the disk") from None


def parser_for(path: Path) -> Callable[[str, bytes], LogTable]:
    """The parser for a file's ending (.csv, .csv.gz, .parquet)."""
    name = path.name.lower()
    if name.endswith(".parquet"):
        return parse_parquet
    if name.endswith(".csv.gz"):
        return parse_gzip
    if name.endswith(".csv"):
        return parse_csv
    cure = f"a log ends in .csv, .csv.gz or .parquet; of others: youbot import {path} -o LOG.csv"
    raise fault(str(path), "unknown kind of file", cure)


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
        text = gzip.decompress(content)
    except EOFError:
        cure = "copy or record it again (gzip -t tests it)"
        raise fault(source, "the compressed file is cut short", cure) from None
    except (OSError, zlib.error) as error:
        cure = "copy or record it again (gzip -t tests it)"
        raise fault(source, f"the compressed file is damaged ({error})", cure) from None
    return parse_csv(source, text)


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
        columns = parquet.read_table(io.BytesIO(content))
    except Exception as error:  # pyarrow raises its own and the standard kinds
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise fault(source, f"is no sound Parquet file ({reason})", "write it again") from None
    names = tuple(columns.column_names)
    if len(set(names)) < len(names):
        raise fault(source, "a column occurs twice", "keep one of the two")
    arrays = [_parquet_column(source, name, columns.column(name)) for name in names]
    values = np.column_stack(arrays) if arrays else np.empty((0, 0))
    # Infinity means a missing value, as in a CSV file.
    values[~np.isfinite(values)] = np.nan
    return LogTable(names, values, np.arange(1, len(values) + 1))


def _parquet_column(source: str, name: str, column: Any) -> NDArray[np.float64]:
    kind = str(column.type)
    if not re.fullmatch(r"u?int\d+|float|double|halffloat|null", kind):
        cure = "store it as float64"
        raise fault(source, f"holds {kind}, not numbers", cure, column=name)
    return np.array(column.to_numpy(), dtype=float)


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
