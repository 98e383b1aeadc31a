"""A map as a TOML file that is to be read and edited by a person."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

from identification.importing.import_map import QUANTITIES, Channels, ImportMap
from youbot_env.physics.hardware import WHEELS

CHECK = "CHECK"
"""Begins the remark on what could not be decided."""


def map_text(
    proposed: ImportMap,
    remarks: Mapping[str, Sequence[str]] | None = None,
    head: Sequence[str] = (),
) -> str:
    """The text of a map's file.

    Parameters
    ----------
    remarks : sentences by part ("velocity", "time", ...), which stand above that part
    head : lines that stand above everything
    """
    told = remarks or {}
    lines = [*(_comment(line) for line in head), "version = 1", ""]
    lines += _part("time", _time(proposed), told)
    for quantity in QUANTITIES:
        found = proposed.of(quantity)
        if found is not None:
            lines += _part(quantity, _channels(found, quantity), told)
        elif told.get(quantity):
            lines += [*(_comment(line) for line in told[quantity]), ""]
    if proposed.pose is not None:
        lines += _part("pose", _pose(proposed), told)
    if proposed.gyro is not None:
        lines += _part("gyro", _gyro(proposed), told)
    return "\n".join(lines).rstrip() + "\n"


def _part(name: str, entries: Iterator[str], told: Mapping[str, Sequence[str]]) -> list[str]:
    return [*(_comment(line) for line in told.get(name, ())), f"[{name}]", *entries, ""]


def _comment(line: str) -> str:
    return f"# {' '.join(line.split())}"


def _text(value: str) -> str:
    # JSON's strings are TOML's basic strings, but for DEL, which TOML wants escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _number(value: float) -> str:
    return f"{value:.10g}" if value != round(value) else f"{value:.1f}"


def _signs(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.0f}' for value in values)}]"


def _time(proposed: ImportMap) -> Iterator[str]:
    time = proposed.time
    yield f"clock = {_text(time.clock)}"
    if time.unit:
        yield f"unit = {_text(time.unit)}"
    if time.rate is None:
        yield "# rate = 100.0    # Hz of the log; without it that of the wheels' channels"
    else:
        yield f"rate = {_number(time.rate)}    # Hz of the log"


def _channels(found: Channels, quantity: str) -> Iterator[str]:
    for wheel, column in zip(WHEELS, found.columns, strict=True):
        yield f"{wheel} = {_text(column)}"
    yield f"unit = {_text(found.unit)}"
    yield f"gear = {_number(found.gear)}    # turns of the motor per turn of the wheel"
    yield f"sign = {_signs(found.sign)}    # of fl, fr, bl, br"
    if found.torque_constant is not None:
        yield f"torque_constant = {_number(found.torque_constant)}    # N m/A"
    if found.counts_per_turn is not None:
        yield f"counts_per_turn = {_number(found.counts_per_turn)}"
    if found.wheel_radius is not None:
        yield f"wheel_radius = {_number(found.wheel_radius)}    # m"
    lacks = found.lacks()
    if lacks:
        yield f"# {lacks} =     # {CHECK}: {quantity} is left out without it"
    yield f"delay = {_number(found.delay)}    # s by which it comes late; undone"


def _pose(proposed: ImportMap) -> Iterator[str]:
    pose = proposed.pose
    assert pose is not None
    yield f"x = {_text(pose.x)}"
    yield f"y = {_text(pose.y)}"
    if pose.quaternion:
        yield f"quaternion = [{', '.join(map(_text, pose.quaternion))}]    # x, y, z, w"
    else:
        yield f"yaw = {_text(pose.yaw)}"
    yield f"unit = {_text(pose.unit)}"
    yield f"yaw_unit = {_text(pose.yaw_unit)}"
    yield f"sign = {_signs(pose.sign)}    # of x, y, yaw"
    yield f"frame_yaw = {_number(pose.frame_yaw)}    # rad, added to yaw: by `youbot kinematics`"
    lever = ", ".join(_number(number) for number in pose.lever)
    yield f"lever = [{lever}]    # m, m: place of the tracked point in the robot's frame"
    yield f"delay = {_number(pose.delay)}    # s by which it comes late; undone"


def _gyro(proposed: ImportMap) -> Iterator[str]:
    gyro = proposed.gyro
    assert gyro is not None
    yield f"z = {_text(gyro.z)}"
    yield f"unit = {_text(gyro.unit)}"
    yield f"sign = {gyro.sign:.0f}"
    yield f"delay = {_number(gyro.delay)}    # s by which it comes late; undone"
