"""Mutilations of the time column."""

from __future__ import annotations

import numpy as np

from identification.logs.reading import log_table
from tests.identification.logs.mutilations.cases import (
    HEALTHY,
    Read,
    Refused,
    case,
    change,
    put,
)


@case(Read("written twice", row=502))
def row_written_twice(rows):
    return [*rows[:501], rows[500], *rows[501:]]


@case(Read("time of the row before", row=502, changed=1))
def repeated_time(rows):
    return put(rows, "time", [502], rows[500][0])


@case(Refused("rounded: 50 % of the rows have the time of the row before", row=3, column="time"))
def coarse_time(rows):
    for i, row in enumerate(rows[1:]):
        row[0] = f"{(i // 2) * 0.02:.2f}"
    return rows


@case(Refused("runs back", row=1001, column="time"))
def clock_set_back(rows):
    return change(rows, ["time"], lambda t: t - 3.0, first=1001)


@case(Read("another order than their times: sorted", row=701))
def two_rows_exchanged(rows):
    rows[700], rows[701] = rows[701], rows[700]
    return rows


@case(Refused("does not increase", row=3, column="time"))
def reversed_time(rows):
    return [rows[0], *rows[:0:-1]]


@case(Refused("rounded: 100 % of the rows have the time", column="time"))
def constant_time(rows):
    return put(rows, "time", range(2, len(rows) + 1), "5.0")


@case(Refused("jumps by 3.01 s", row=1001, column="time"))
def clock_set_forward(rows):
    return change(rows, ["time"], lambda t: t + 3.0, first=1001)


@case(Read("3 missing row(s) in 1 gap", changed=3, row=501))
def small_gap(rows):
    return [*rows[:500], *rows[503:]]


@case(Read("6 missing row(s) in 3 gap", changed=6, row=301))
def three_small_gaps(rows):
    return [*rows[:300], *rows[301:600], *rows[602:900], *rows[903:]]


@case(Refused("jumps by 1.01 s", row=501, column="time"))
def large_gap(rows):
    return [*rows[:500], *rows[600:]]


@case(Refused("rows are missing", column="time"))
def every_fifth_row_missing(rows):
    return [row for i, row in enumerate(rows) if i == 0 or i % 5]


@case(Read("without a time", row=400))
def empty_time_cell(rows):
    return put(rows, "time", [400], "")


@case(Refused("no time", row=400, column="time"))
def many_empty_time_cells(rows):
    return put(rows, "time", range(400, 480), "")


@case(Refused("looks like milliseconds", column="time"))
def milliseconds(rows):
    return change(rows, ["time"], lambda t: 1e3 * t)


@case(Refused("looks like microseconds", column="time"))
def microseconds(rows):
    return change(rows, ["time"], lambda t: 1e6 * t)


@case(Refused("looks like nanoseconds", column="time"))
def nanoseconds_since_the_epoch(rows):
    for row in rows[1:]:
        row[0] = str(1_700_000_000_000_000_000 + int(1e9 * float(row[0])))
    return rows


@case(Refused("milliseconds", column="time"))
def sample_counter(rows):
    for i, row in enumerate(rows[1:]):
        row[0] = str(i)
    return rows


@case(Read(level=""))
def seconds_since_the_epoch(rows):
    return change(rows, ["time"], lambda t: 1_700_000_000 + t)


@case(Read(level=""))
def negative_time(rows):
    return change(rows, ["time"], lambda t: t - 100)


@case(Refused("10 Hz is below 20 Hz", column="time"))
def ten_hertz(rows):
    return [rows[0], *rows[1::10]]


@case(Refused("2000 Hz is above 1 kHz; keep every 2nd row", column="time"))
def two_kilohertz(rows):
    return change(rows, ["time"], lambda t: t / 20)


@case(Read("time steps vary", tolerance=0.2, changed=len(HEALTHY)))
def jittery_time(rows):
    rng = np.random.default_rng(3)
    names, values = log_table(HEALTHY)
    time = values[:, 0] + 0.0015 * rng.uniform(-1, 1, len(values))
    moved = [np.interp(time, values[:, 0], values[:, i]) for i in range(1, values.shape[1])]
    return [names, *([f"{x:.6f}" for x in row] for row in np.column_stack([time, *moved]))]


@case(Read(level=""))
def time_rounded_to_milliseconds(rows):
    # 100 Hz started at an odd instant: rounding alone makes no irregular log
    return change(rows, ["time"], lambda t: round(t + 0.0004, 3))
