"""Mutilations of speeds and efforts."""

from __future__ import annotations

import re

import numpy as np

from tests.identification.healthy import healthy_log
from tests.identification.logs.mutilations.cases import (
    EFFORTS,
    HEALTHY,
    VELOCITIES,
    Read,
    Refused,
    case,
    cells,
    change,
    column,
    put,
)


@case(Read("1 missing value", changed=1, row=600))
def single_nan(rows):
    return put(rows, "velocity_bl", [600], "nan")


@case(Read("1 missing value", changed=1, row=600))
def empty_cell(rows):
    return put(rows, "effort_bl", [600], "")


@case(Read("1 missing value", changed=1, row=600))
def infinity(rows):
    return put(rows, "effort_bl", [600], "-inf")


@case(Read("4 missing value", changed=4, row=600))
def short_run_of_nan(rows):
    return put(rows, "velocity_bl", range(600, 604), "NaN")


@case(Refused("lacks 60 values, up to 60 in a row", row=600, column="velocity_bl"))
def long_run_of_nan(rows):
    return put(rows, "velocity_bl", range(600, 660), "NaN")


@case(Refused("lacks 666 values", row=3, column="effort_fl"))
def every_third_value_missing(rows):
    return put(rows, "effort_fl", range(3, len(rows), 3), "")


@case(Refused("has no values", row=2, column="velocity_fl"))
def column_of_nan(rows):
    return put(rows, "velocity_fl", range(2, len(rows) + 1), "nan")


@case(Read("5 row(s) at an end", rows=len(HEALTHY) - 5, row=2))
def nan_at_the_start(rows):
    return put(rows, "velocity_fl", range(2, 7), "nan")


@case(Refused("lacks 500 of 2000", row=1502, column="velocity_fl"))
def sensor_lost_for_good(rows):
    return put(rows, "velocity_fl", range(1502, 2002), "nan")


@case(Read("taken as missing", "warning", changed=1, row=600))
def huge_value(rows):
    return put(rows, "velocity_fl", [600], "1e300")


@case(Refused("has no values", column="effort_fr"))
def huge_values(rows):
    return put(rows, "effort_fr", range(2, len(rows) + 1), "3.4e38")


@case(Read("1 outlier(s) such as 400", changed=1, row=777))
def speed_spike(rows):
    return put(rows, "velocity_fl", [777], "400.0")


@case(Read("1 outlier(s) such as -9", changed=1, row=777))
def effort_spike(rows):
    return put(rows, "effort_fl", [777], "-9.0")


@case(Read("4 outlier(s)", changed=4, row=300))
def four_spikes(rows):
    put(rows, "velocity_fr", [300, 1200], "-12.0")
    return put(rows, "velocity_fr", [900, 901], "15.0")


@case(Read("1 outlier(s) such as 30", changed=1, row=2))
def spike_in_first_row(rows):
    return put(rows, "velocity_fl", [2], "30.0")


@case(Read("1 outlier(s) such as 30", changed=1, row=2001))
def spike_in_last_row(rows):
    return put(rows, "velocity_fl", [2001], "30.0")


@case(Refused("400 rad/s cannot be", row=1001, column="velocity_fl"))
def wheel_at_400_rad_s(rows):
    return put(rows, "velocity_fl", range(1001, 1300), "400.0")


@case(Refused("rpm", column="velocity_fl"))
def revolutions_per_minute(rows):
    return change(rows, VELOCITIES, lambda v: v * 60 / (2 * np.pi))


@case(Refused("deg/s", column="velocity_fl"))
def degrees_per_second(rows):
    return change(rows, VELOCITIES, np.rad2deg)


@case(Refused("from mN m: times 0.001", column="effort_fl"))
def millinewtonmetres(rows):
    return change(rows, EFFORTS, lambda e: 1e3 * e)


@case(Refused("nothing moves"))
def standstill(rows):
    for name in VELOCITIES:
        put(rows, name, range(2, len(rows) + 1), "0.0")
    return rows


@case(Refused("nothing moves"))
def noise_alone(rows):
    rng = np.random.default_rng(1)
    return change(rows, VELOCITIES + EFFORTS, lambda v: 0.01 * rng.normal())


@case(Refused("moves for"))
def motion_for_one_second(rows):
    rng = np.random.default_rng(1)
    for row in rows[101:]:
        for i in range(1, 9):
            row[i] = f"{0.01 * rng.normal():.4f}"
    return rows


@case(Read("little motion", "warning", tolerance=1e9, changed=len(HEALTHY)))
def little_motion(rows):
    return change(rows, VELOCITIES, lambda v: 0.01 * v)


@case(Refused("is 0 all the time", column="effort_fl"))
def no_effort_at_all(rows):
    for name in EFFORTS:
        put(rows, name, range(2, len(rows) + 1), "0.0")
    return rows


@case(Refused("is 0 all the time", column="velocity_bl"))
def dead_encoder(rows):
    return put(rows, "velocity_bl", range(2, len(rows) + 1), "0.0000")


@case(Refused("stands still", row=800, column="velocity_bl"))
def encoder_that_stops(rows):
    value = rows[799][column(rows, "velocity_bl")]
    return put(rows, "velocity_bl", range(800, 900), value)


@case(Refused("stands still", row=822, column="velocity_bl"))
def encoder_that_stops_in_a_log_without_noise(rows):
    times = [float(row[0]) for row in rows[1:]]
    for row, t in zip(rows[1:], times, strict=True):
        for i in range(4):
            speed = 3 + 4 * np.sin(t) if t > 1 else 0.0
            row[1 + i], row[5 + i] = f"{speed:.2f}", f"{0.1 * speed:.2f}"
    return put(rows, "velocity_bl", range(800, 900), rows[799][3])


@case(Read("wheels slip for", "warning", changed=100, tolerance=9.0))
def one_wheel_spins(rows):
    for row in rows[1000:1100]:
        row[3] = f"{float(row[3]) + 8 * np.sin(np.pi * (float(row[0]) - 10)) ** 2:.4f}"
    return rows


@case(Refused("the stock driver negates the left wheels"))
def left_wheels_negated(rows):
    return change(rows, [VELOCITIES[0], VELOCITIES[2], EFFORTS[0], EFFORTS[2]], lambda v: -v)


@case(Refused("multiply velocity_fl and velocity_bl by -1"))
def left_speeds_negated_alone(rows):
    return change(rows, [VELOCITIES[0], VELOCITIES[2]], lambda v: -v)


@case(Refused("multiply velocity_br and the effort there by -1"))
def one_wheel_negated(rows):
    return change(rows, ["velocity_br", "effort_br"], lambda v: -v)


@case(Refused("multiply effort_fl and effort_bl by -1"))
def left_efforts_negated(rows):
    return change(rows, ["effort_fl", "effort_bl"], lambda v: -v)


@case(Refused("opposite corners seem swapped"))
def opposite_corners_swapped(rows):
    swap = {"fl": "br", "br": "fl"}
    rows[0] = [re.sub("fl$|br$", lambda m: swap[m[0]], name) for name in rows[0]]
    return rows


@case(Refused("a front and a back column are swapped"))
def front_and_back_swapped(rows):
    swap = {"fr": "br", "br": "fr"}
    rows[0] = [re.sub("fr$|br$", lambda m: swap[m[0]], name) for name in rows[0]]
    return rows


@case(Refused("velocity_bl seems off by a factor: multiply it by 0.5"))
def one_wheel_of_another_gear(rows):
    return change(rows, ["velocity_bl"], lambda v: 2 * v)


@case(Refused("cannot move like that"))
def four_unrelated_speeds(rows):
    for i, row in enumerate(rows[1:]):
        for k in range(4):
            speed = 5 * np.sin((0.011 + 0.003 * k) * i)
            row[1 + k], row[5 + k] = f"{speed:.4f}", f"{0.1 * speed:.4f}"
    return rows


@case(Read("the wheels slip", "warning", tolerance=1e9, changed=len(HEALTHY)))
def front_wheels_of_another_run(rows):
    other = cells(healthy_log(seed=5, duration=40.0))[1000:]
    for row, strange in zip(rows[1:], other, strict=False):
        row[1:3] = strange[1:3]
    return rows


@case(Read("at its extreme", "warning", tolerance=1e9, changed=len(HEALTHY)))
def saturated_effort(rows):
    return change(rows, EFFORTS, lambda e: float(np.clip(e, -0.5, 0.5)))


@case(Read("repeat the row before", "warning", tolerance=1e9, changed=len(HEALTHY)))
def every_row_held_twice(rows):
    for i in range(2, len(rows), 2):
        rows[i][1:] = rows[i - 1][1:]
    return rows
