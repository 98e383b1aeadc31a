"""Files made to exhaust a reader are refused in one line, in seconds, and with little memory."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from identification import write_log
from tests.identification.healthy import healthy_log

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.skipif(
    not os.path.exists("/proc/self/status"), reason="this machine does not tell a process' memory"
)

SECONDS, MEGABYTES = 5.0, 512.0

PROGRAM = """
import re, sys, time
from identification.logs.reading import read_log
from youbot_env.errors import InputError
start = time.perf_counter()
try:
    read_log(sys.argv[1])
    print("read")
except InputError as error:
    print(error)
# Not getrusage, which counts what the parent had before this program was started.
peak = re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]
print(time.perf_counter() - start, int(peak) / 1024)
"""


def refused(path: Path | str, **options: object) -> str:
    """The line that a process prints which reads the file; its time and memory are bounded."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        **options,  # type: ignore[call-overload]
    )
    assert done.returncode == 0, done.stderr
    line, numbers = done.stdout.strip().split("\n")
    seconds, megabytes = map(float, numbers.split())
    assert seconds < SECONDS and megabytes < MEGABYTES, numbers
    assert len(line) < 2500
    return line


def members(folder: Path, piece: bytes, count: int) -> Path:
    """A compressed file of one piece many times: quickly made, and large when it is read."""
    path = folder / "bomb.csv.gz"
    path.write_bytes(gzip.compress(piece) * count)
    return path


def header(columns: int) -> bytes:
    return b",".join(b"c%d" % k for k in range(columns)) + b"\n"


FILES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "zeros, compressed": (lambda d: members(d, bytes(1 << 24), 200), "binary data"),
    "text, compressed": (lambda d: members(d, b"1.0,1.0\n" * (1 << 21), 200), "too large"),
    "a line of 200 MB": (lambda d: put(d, b"time," + b"1" * 200_000_000), "first line"),
    "a second line of 200 MB": (lambda d: put(d, b"a,b\n" + b"1" * 200_000_000), "a line has"),
    "zeros": (lambda d: put(d, bytes(100_000_000)), "binary data"),
    "10^6 columns": (lambda d: put(d, header(10**6)), "first line"),
    "30,000 columns": (lambda d: put(d, header(30_000) + b"1\n"), "has 30000 columns"),
    "lines without an end": (lambda d: put(d, b"a\n" * 50_000_000), "lines, more than"),
    "carriage returns": (lambda d: put(d, b"a\r" * 50_000_000), "lines, more than"),
    "a hole of a terabyte": (lambda d: hole(d), "too large"),
}


def put(folder: Path, content: bytes) -> Path:
    path = folder / "log.csv"
    path.write_bytes(content)
    return path


def hole(folder: Path) -> Path:
    path = folder / "log.csv"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    return path


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_would_exhaust_memory_is_one_line(name: str, tmp_path: Path):
    make, cause = FILES[name]
    assert cause in refused(make(tmp_path))


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs /dev/zero")
def test_a_device_without_an_end_is_one_line():
    assert "too large" in refused("/dev/zero")


def parquet(folder: Path, groups: int, columns: int = 1) -> Path:
    pytest.importorskip("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = [f"c{k}" for k in range(columns)]
    rows = 10**6 if columns == 1 else 1
    table = pa.table({name: np.zeros(rows) for name in names})
    path = folder / "bomb.parquet"
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(groups):
            writer.write_table(table)
    return path


def test_a_small_parquet_file_of_many_values_is_one_line(tmp_path: Path):
    path = parquet(tmp_path, groups=60)
    assert path.stat().st_size < 1 << 20
    assert "60000000 rows of 1 columns: too large" in refused(path)


def test_a_parquet_file_of_many_columns_is_one_line(tmp_path: Path):
    assert "has 10050 columns" in refused(parquet(tmp_path, groups=1, columns=10_050))


def test_repeated_names_are_found_at_once(tmp_path: Path):
    path = put(tmp_path, header(9_999)[:-1] + b",c0\n1\n")
    assert "occurs twice" in refused(path)


# --- what is no regular file -----------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="concerns pipes")
@pytest.mark.parametrize("form", ("csv", "csv.gz", "parquet"))
def test_a_log_is_read_from_a_pipe(form: str, tmp_path: Path):
    """``youbot doctor <(cat log.csv)`` and ``/dev/stdin``."""
    if form == "parquet":
        pytest.importorskip("pyarrow")
    write_log(tmp_path / f"log.{form}", healthy_log())
    content = (tmp_path / f"log.{form}").read_bytes()
    assert refused("/dev/stdin", stdin=_pipe(content)) == "read"


def _pipe(content: bytes) -> int:
    """The reading end of a pipe into which another thread writes."""
    reading, writing = os.pipe()

    def write() -> None:
        with open(writing, "wb") as file:
            file.write(content)

    threading.Thread(target=write, daemon=True).start()
    return reading
