"""Mutilations of the file as such: its bytes, its encoding, its compression."""

from __future__ import annotations

import gzip
import io

import pytest

from tests.identification.logs.mutilations.cases import (
    Read,
    Refused,
    Rows,
    case,
    text,
)


@case(Refused("is empty; "))
def empty(rows):
    return b""


@case(Refused("is empty; "))
def only_newlines(rows):
    return b"\n\n\n"


@case(Refused("no rows; "))
def header_only(rows):
    return rows[:1]


@case(Refused("only 1 row"))
def one_row(rows):
    return rows[:2]


@case(Refused("only 30 row"))
def thirty_rows(rows):
    return rows[:31]


@case(Refused("lasts only"))
def one_second(rows):
    return rows[:101]


@case(Refused("binary data", row=1))
def binary(rows):
    return bytes(range(256)) * 40


@case(Refused("binary data", row=101))
def null_bytes(rows):
    data = text(rows).split(b"\n")
    data[100] = data[100][:5] + b"\x00" * 4 + data[100][5:]
    return b"\n".join(data)


@case(Refused("UTF-16", row=1))
def utf16(rows):
    return text(rows).decode().encode("utf-16")


@case(Refused("UTF-8", row=1))
def latin1(rows):
    rows[0].append("Temperatur_°C")
    return "\n".join(",".join(row + ["1"] * (i > 0)) for i, row in enumerate(rows)).encode("latin1")


@case(Read("byte-order mark", "info"))
def byte_order_mark(rows):
    return b"\xef\xbb\xbf" + text(rows)


@case(Read(level=""))
def windows_line_ends(rows):
    return text(rows).replace(b"\n", b"\r\n")


@case(Read(level=""))
def old_mac_line_ends(rows):
    return text(rows).replace(b"\n", b"\r")


@case(Refused("unknown kind of file"), file="log.txt")
def unknown_ending(rows):
    return rows


@case(Refused("cut short"), file="log.csv.gz")
def truncated_gzip(rows):
    return gzip.compress(text(rows))[:-500]


@case(Refused("damaged"), file="log.csv.gz")
def damaged_gzip(rows):
    data = bytearray(gzip.compress(text(rows)))
    data[len(data) // 2] ^= 0xFF
    return bytes(data)


@case(Read("not compressed", "warning"), file="log.csv.gz")
def plain_text_called_gzip(rows):
    return rows


@case(Refused(".csv.gz data under another name"))
def gzip_called_csv(rows):
    return gzip.compress(text(rows))


@case(Refused("no sound Parquet"), file="log.parquet")
def corrupted_parquet(rows):
    data = bytearray(_parquet(rows, float))
    data[-40:-8] = b"\x55" * 32
    return bytes(data)


@case(Refused("no sound Parquet"), file="log.parquet")
def text_called_parquet(rows):
    return rows


@case(Refused("holds string", column="velocity_fr"), file="log.parquet")
def parquet_of_strings(rows):
    return _parquet(rows, str)


def _parquet(rows: Rows, kind: type) -> bytes:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = dict(zip(rows[0], zip(*rows[1:], strict=True), strict=True))
    table = {
        name: [kind(cell) if name == "velocity_fr" else float(cell) for cell in column]
        for name, column in columns.items()
    }
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.table(table), buffer)
    return buffer.getvalue()
