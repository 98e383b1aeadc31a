"""Tables to CSV, compressed CSV or Parquet: atomically, and the same bytes every time."""

from __future__ import annotations

import gzip
import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import fault
from identification.logs.formats import import_parquet
from youbot_env.files import write_atomically

DECIMALS = 6
"""Microseconds, microradians: two digits more than such sensors resolve."""


def write_table(
    path: str | os.PathLike[str],
    names: Sequence[str],
    values: NDArray[np.float64],
    decimals: int = DECIMALS,
) -> None:
    """Write columns (n, c) with a header, as the ending says: .csv, .csv.gz or .parquet.

    CSV is rounded to `decimals`; Parquet holds the numbers as they are. If writing fails, no partly
    written file is left.

    Raises
    ------
    InputError
        If the ending is unknown, the folder is missing or cannot be written to, or pyarrow is
        not installed.
    """
    path = Path(path)
    name = path.name.lower()
    if name.endswith(".parquet"):
        content = _parquet(str(path), names, values)
    elif name.endswith(".csv.gz"):
        # mtime=0: gzip would write the present time into its header, and the same log would have
        # another hash each time.
        content = gzip.compress(_csv(names, values, decimals), 6, mtime=0)
    elif name.endswith(".csv"):
        content = _csv(names, values, decimals)
    else:
        raise fault(str(path), "unknown kind of file", "a log ends in .csv, .csv.gz or .parquet")
    write_atomically(path, content)


def _csv(names: Sequence[str], values: NDArray[np.float64], decimals: int) -> bytes:
    rounded = np.round(values, decimals) + 0.0  # no negative zeros
    line = ",".join([f"%.{decimals}f"] * len(names))
    # One format for a whole row is faster than one for each number.
    rows = map(line.__mod__, map(tuple, rounded.tolist()))
    return "\n".join([",".join(names), *rows, ""]).encode("ascii")


def _parquet(source: str, names: Sequence[str], values: NDArray[np.float64]) -> bytes:
    parquet = import_parquet(source)
    import pyarrow

    columns = {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(names)}
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), buffer)
    return buffer.getvalue()
