"""Mutilations of the table: header, cells, rows, delimiters."""

from __future__ import annotations

from tests.identification.logs.mutilations.cases import (
    HEALTHY,
    Read,
    Refused,
    case,
    column,
    put,
    text,
)


@case(Refused("missing; a log needs it", row=1, column="effort_bl"))
def missing_column(rows):
    i = column(rows, "effort_bl")
    return [row[:i] + row[i + 1 :] for row in rows]


@case(Refused("missing", row=1, column="time"))
def missing_time(rows):
    return [row[1:] for row in rows]


@case(Refused("rename 'velocityfl' to 'velocity_fl'", row=1, column="velocity_fl"))
def misspelt_column(rows):
    rows[0][1] = "velocityfl"
    return rows


@case(Refused("rename 'Time' to 'time'", row=1, column="time"))
def capital_letter(rows):
    rows[0][0] = "Time"
    return rows


@case(Refused("missing", row=1, column="velocity_fl"))
def nan_in_header(rows):
    rows[0][1] = "nan"
    return rows


@case(Refused("has no header", row=1))
def no_header(rows):
    return rows[1:]


@case(Refused("occurs twice", row=1, column="velocity_fl"))
def duplicate_column(rows):
    rows[0][2] = "velocity_fl"
    return rows


@case(Refused("header occurs again", row=1001, column="time"))
def duplicate_header(rows):
    return [*rows[:1000], rows[0], *rows[1000:]]


@case(Read("unknown column", "info", row=1))
def unknown_column(rows):
    return [[*row, "temperature" if i == 0 else "31.5"] for i, row in enumerate(rows)]


@case(Read("unknown column", "info", row=1))
def index_without_a_name(rows):
    return [["" if i == 0 else str(i), *row] for i, row in enumerate(rows)]


@case(Read(level=""))
def reordered_columns(rows):
    return [row[::-1] for row in rows]


@case(Read(level=""))
def spaces_in_cells(rows):
    return text(rows, delimiter=" , ")


@case(Read(level=""))
def quoted_cells(rows):
    return [[f'"{cell}"' for cell in row] for row in rows]


@case(Read(level=""))
def trailing_comma_everywhere(rows):
    return [[*row, ""] for row in rows]


@case(Read(level=""))
def trailing_comma_below_header(rows):
    return [rows[0], *([*row, ""] for row in rows[1:])]


@case(Read("2 blank or comment lines", "info"))
def blank_lines(rows):
    data = text(rows).split(b"\n")
    return b"\n".join([*data[:50], b"", b"   ", *data[50:]])


@case(Read("2 blank or comment lines", "info"))
def comment_lines(rows):
    data = text(rows).split(b"\n")
    return b"\n".join([b"# youBot, run 3", *data[:50], b"# battery changed", *data[50:]])


@case(Refused("'abc' is not a number", row=57, column="velocity_fr"))
def text_in_cell(rows):
    return put(rows, "velocity_fr", [57], "abc")


@case(Refused("'0.1 rad/s' is not a number", row=2, column="velocity_fl"))
def units_in_cells(rows):
    return put(rows, "velocity_fl", range(2, 500), "0.1 rad/s")


@case(Refused("not a number", row=60, column="effort_br"))
def underscore_in_number(rows):
    return put(rows, "effort_br", [60], "1_000")


@case(Refused("8 cells, the header 9", row=99))
def ragged_row(rows):
    rows[98].pop()
    return rows


@case(Refused("10 cells, the header 9", row=99))
def row_too_long(rows):
    rows[98].append("1.0")
    return rows


@case(Refused("cells, the header 9", row=80))
def two_rows_in_one_line_and_none(rows):
    # as many numbers in all as a sound file: only line by line does it show
    rows[79], rows[80] = rows[79] + rows[80][:1], rows[80][1:]
    return rows


@case(Refused("semicolons", row=1))
def semicolons(rows):
    return text(rows, ";")


@case(Refused("tabs", row=1))
def tabs(rows):
    return text(rows, "\t")


@case(Refused("decimals with a point", row=2))
def decimal_commas(rows):
    return [rows[0], *([cell.replace(".", ",") for cell in row] for row in rows[1:])]


@case(Refused("decimals with a point", row=2, column="time"))
def quoted_decimal_commas(rows):
    return [rows[0], *([f'"{cell.replace(".", ",")}"' for cell in row] for row in rows[1:])]


@case(Refused("semicolons", row=1))
def semicolons_and_decimal_commas(rows):
    return text(rows, ";").replace(b".", b",")


@case(Read("incomplete", rows=len(HEALTHY) - 1, row=len(HEALTHY) + 1))
def cut_within_last_row(rows):
    return text(rows)[:-30]


@case(Read("incomplete", rows=len(HEALTHY) - 1, row=len(HEALTHY) + 1))
def cut_within_last_number(rows):
    return text(rows)[:-3]


@case(Read(level=""))
def no_newline_at_end(rows):
    return text(rows)[:-1]
