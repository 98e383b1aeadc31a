"""A log as an MCAP file with ROS 2 messages, which PlotJuggler, Foxglove and ROS 2 open."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from identification.importing.tables import Array
from identification.logs.findings import fault
from identification.logs.formats import parser_for, read_bytes
from youbot_env.errors import optional_library
from youbot_env.files import write_atomically
from youbot_env.physics.hardware import WHEELS

Messages = Iterator[tuple[str, str, Any]]
"""Topic, type and message, of one row."""


def export_log(source: str | os.PathLike[str], target: str | os.PathLike[str]) -> None:
    """Write a log's channels as messages, a row of the log at a time.

    ``/joint_states`` holds positions, velocities and efforts by the names wheel_joint_fl, ...;
    ``/joint_commands`` commanded efforts, ``/pose`` the pose, ``/imu`` the gyro.

    Raises
    ------
    InputError
        If the log cannot be read, the file not be written, or mcap or rosbags is not installed.
    """
    path = Path(source)
    table = parser_for(path)(str(path), read_bytes(path))
    columns = {name: table.values[:, k] for k, name in enumerate(table.names)}
    lacking = [name for name in ("time", *_four("velocity")) if name not in columns]
    if lacking:
        cure = f"youbot import {path} -o log.csv makes one of it"
        raise fault(str(path), "is no log, so it is not exported", cure, column=lacking[0])
    write_atomically(target, _mcap(columns))


def _four(quantity: str) -> tuple[str, ...]:
    return tuple(f"{quantity}_{wheel}" for wheel in WHEELS)


def _mcap(columns: dict[str, Array]) -> bytes:
    need = "MCAP files need rosbags and mcap"
    writing = optional_library("mcap.writer", "import", need)
    typesys = optional_library("rosbags.typesys", "import", need)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    makers = _makers(columns, store.types)
    buffer = io.BytesIO()
    writer = writing.Writer(buffer)
    writer.start(profile="ros2", library="youbot")
    channels: dict[str, int] = {}
    for topic, kind, _ in makers:
        text = store.generate_msgdef(kind, ros_version=2)[0].encode()
        schema = writer.register_schema(kind, "ros2msg", text)
        channels[topic] = writer.register_channel(topic, "cdr", schema)
    for row in np.flatnonzero(np.isfinite(columns["time"])):
        time = round(float(columns["time"][row]) * 1e9)
        for topic, kind, make in makers:
            message = make(int(row), time)
            if message is not None:
                data = bytes(store.serialize_cdr(message, kind))
                writer.add_message(channels[topic], time, data, time)
    writer.finish()
    return buffer.getvalue()


_Maker = Callable[[int, int], Any]


def _makers(columns: dict[str, Array], types: Any) -> list[tuple[str, str, _Maker]]:
    """Topics of a log with their types, and what makes a message of a row and its time [ns]."""
    header = _header_of(types)
    joint_state = types["sensor_msgs/msg/JointState"]
    names = [f"wheel_joint_{wheel}" for wheel in WHEELS]

    def listed(quantity: str) -> Callable[[int], Array]:
        held = [columns[name] for name in _four(quantity) if name in columns]
        whole = np.column_stack(held) if len(held) == len(WHEELS) else np.empty((0, 4))
        return lambda row: whole[row] if len(whole) else np.empty(0)

    position, velocity, effort = (listed(q) for q in ("position", "velocity", "effort"))
    command, nothing = listed("command"), np.empty(0)

    def joints(row: int, time: int) -> Any:
        return joint_state(header(time, ""), names, position(row), velocity(row), effort(row))

    def commands(row: int, time: int) -> Any:
        return joint_state(header(time, ""), names, nothing, nothing, command(row))

    makers: list[tuple[str, str, _Maker]] = [("/joint_states", joint_state.__msgtype__, joints)]
    if set(_four("command")) <= set(columns):
        makers.append(("/joint_commands", joint_state.__msgtype__, commands))
    if {"pose_x", "pose_y", "pose_yaw"} <= set(columns):
        makers.append(("/pose", "geometry_msgs/msg/PoseStamped", _pose(columns, types, header)))
    if "gyro_z" in columns:
        makers.append(("/imu", "sensor_msgs/msg/Imu", _imu(columns["gyro_z"], types, header)))
    return makers


def _header_of(types: Any) -> Callable[[int, str], Any]:
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]

    def make(time: int, frame: str) -> Any:
        seconds, rest = divmod(time, 1_000_000_000)
        return header(stamp(seconds, rest), frame)

    return make


def _pose(columns: dict[str, Array], types: Any, header: Callable[[int, str], Any]) -> _Maker:
    stamped, pose = types["geometry_msgs/msg/PoseStamped"], types["geometry_msgs/msg/Pose"]
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    x, y, yaw = (columns[name] for name in ("pose_x", "pose_y", "pose_yaw"))

    def make(row: int, time: int) -> Any:
        if not np.isfinite([x[row], y[row], yaw[row]]).all():
            return None
        half = float(yaw[row]) / 2
        rotation = turn(0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
        where = pose(point(float(x[row]), float(y[row]), 0.0), rotation)
        return stamped(header(time, "world"), where)

    return make


def _imu(rate: Array, types: Any, header: Callable[[int, str], Any]) -> _Maker:
    imu, vector = types["sensor_msgs/msg/Imu"], types["geometry_msgs/msg/Vector3"]
    turn = types["geometry_msgs/msg/Quaternion"]
    unknown = np.zeros(9)
    # By the message's definition: a covariance that starts with -1 means "not measured".
    absent = np.array([-1.0, *unknown[1:]])

    def make(row: int, time: int) -> Any:
        if not np.isfinite(rate[row]):
            return None
        turning, still = vector(0.0, 0.0, float(rate[row])), vector(0.0, 0.0, 0.0)
        upright = turn(0.0, 0.0, 0.0, 1.0)
        return imu(header(time, "base_link"), upright, absent, turning, unknown, still, absent)

    return make
