"""Mutilations of position, pose and gyro."""

from __future__ import annotations

import numpy as np

from tests.identification.logs.mutilations.cases import (
    Read,
    Refused,
    case,
    change,
    column,
    put,
)


@case(Read(level=""), rich=True)
def wrapped_yaw(rows):
    return change(rows, ["pose_yaw"], lambda yaw: (yaw + np.pi) % (2 * np.pi) - np.pi)


@case(Refused("degrees", column="pose_yaw"), rich=True)
def yaw_in_degrees(rows):
    return change(rows, ["pose_yaw"], np.rad2deg)


@case(Refused("wraps at 360", column="pose_yaw"), rich=True)
def wrapped_yaw_in_degrees(rows):
    return change(rows, ["pose_yaw"], lambda yaw: np.rad2deg(yaw - 3.2) % 360)


@case(Refused("millimetres", column="pose_x"), rich=True)
def pose_in_millimetres(rows):
    return change(rows, ["pose_x", "pose_y"], lambda x: 1e3 * x)


@case(Refused("degrees a second", column="gyro_z"), rich=True)
def gyro_in_degrees(rows):
    return change(rows, ["gyro_z"], np.rad2deg)


@case(Refused("runs against the wheels", column="gyro_z"), rich=True)
def gyro_upside_down(rows):
    return change(rows, ["gyro_z"], lambda w: -w)


@case(Read("position_br missing", "warning"), rich=True)
def position_of_three_wheels(rows):
    i = column(rows, "position_br")
    return [row[:i] + row[i + 1 :] for row in rows]


@case(Read("not used, nor what belongs", "warning"), rich=True)
def position_of_nan(rows):
    return put(rows, "position_fl", range(2, len(rows) + 1), "nan")


@case(Read("does not follow the integral", "warning"), rich=True)
def position_in_degrees(rows):
    return change(rows, [f"position_{w}" for w in ("fl", "fr", "bl", "br")], np.rad2deg)


@case(Read("1 outlier(s)", row=500), rich=True)
def pose_spike(rows):
    return put(rows, "pose_x", [500], "25.0")
