"""Small bags, made with the writers of rosbags and mcap: one run of a healthy log each."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from identification.logs.log import Log
from tests.identification.healthy import healthy_log
from youbot_env.physics.geometry import WHEELS

LOG = healthy_log(duration=5.0, extras=True)
START = 1_700_000_000
POSE_RATE = 170.0
NAMES = [f"wheel_joint_{wheel}" for wheel in WHEELS]
JOINTS, POSE, IMU = "/joint_states", "/mocap/robot/pose", "/imu/data"


def instants(log: Log = LOG) -> np.ndarray:
    """Times [ns] of the log's rows."""
    return START * 10**9 + np.round(1e9 * log.time).astype(np.int64)


def poses(log: Log = LOG) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and poses (m, 3), faster than the log and not at its instants."""
    assert log.pose is not None
    time = np.arange(log.time[0], log.time[-1], 1 / POSE_RATE)
    columns = [np.interp(time, log.time, column) for column in log.pose.T]
    return START * 10**9 + np.round(1e9 * time).astype(np.int64), np.column_stack(columns)


Events = list[tuple[int, str, str, Any]]


def events(types: Any, ros1: bool) -> Events:
    """All messages of the run in order: time [ns], topic, type, message."""
    header = header_maker(types, ros1)
    state = types["sensor_msgs/msg/JointState"]
    nothing = np.empty(0)
    found: Events = []
    for k, time in enumerate(instants()):
        assert LOG.position is not None
        # An arm's joints come in messages of their own, as the youBot's driver has them; and the
        # order of the names may change.
        order = [3, 1, 0, 2] if k % 2 else [0, 1, 2, 3]
        arm = state(header(time, ""), ["arm_joint_1"], np.zeros(1), np.ones(1), nothing)
        wheels = state(
            header(time, "base"),
            [NAMES[i] for i in order],
            LOG.position[k, order],
            LOG.velocity[k, order],
            LOG.effort[k, order],
        )
        found += [(int(time), JOINTS, state.__msgtype__, message) for message in (arm, wheels)]
        found.append((int(time), IMU, *imu(types, header, time, k)))
    for time, pose in zip(*poses(), strict=True):
        found.append((int(time), POSE, *stamped(types, header, time, pose)))
    return sorted(found, key=lambda event: event[0])


def header_maker(types: Any, ros1: bool) -> Callable[[int, str], Any]:
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]

    def make(time: int, frame: str) -> Any:
        at = stamp(int(time // 10**9), int(time % 10**9))
        return header(0, at, frame) if ros1 else header(at, frame)

    return make


def imu(types: Any, header: Callable, time: int, k: int) -> tuple[str, Any]:
    assert LOG.gyro_z is not None
    kind, vector = types["sensor_msgs/msg/Imu"], types["geometry_msgs/msg/Vector3"]
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    rate, still, none = vector(0.0, 0.0, float(LOG.gyro_z[k])), vector(0.0, 0.0, 9.8), np.zeros(9)
    return kind.__msgtype__, kind(header(time, "imu"), turn, none, rate, none, still, none)


def stamped(types: Any, header: Callable, time: int, pose: np.ndarray) -> tuple[str, Any]:
    kind, where = types["geometry_msgs/msg/PoseStamped"], types["geometry_msgs/msg/Pose"]
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    x, y, yaw = (float(number) for number in pose)
    rotation = turn(0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
    return kind.__msgtype__, kind(header(time, "world"), where(point(x, y, 0.3), rotation))


def ros1_bag(folder: Path) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = folder / "run.bag"
    with Writer(path) as writer:
        connections: dict[str, Any] = {}
        for time, topic, kind, message in events(store.types, ros1=True):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            data = store.serialize_ros1(message, kind)
            # It arrives 2 ms after its stamp.
            writer.write(connections[topic], time + 2_000_000, data)
    return path


def ros2_bag(folder: Path, plugin: str = "SQLITE3") -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    path = folder / f"run_{plugin.lower()}"
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        connections: dict[str, Any] = {}
        for time, topic, kind, message in events(store.types, ros1=False):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            data = store.serialize_cdr(message, kind)
            writer.write(connections[topic], time + 2_000_000, data)
    return path


def ros2_mcap_bag(folder: Path) -> Path:
    return ros2_bag(folder, "MCAP")


def lone_db3(folder: Path) -> Path:
    return next(ros2_bag(folder).glob("*.db3"))


def mcap_cdr(folder: Path) -> Path:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    path = folder / "run_cdr.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 14)
        writer.start()
        channels: dict[str, int] = {}
        for time, topic, kind, message in events(store.types, ros1=False):
            if topic not in channels:
                text = store.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], time + 2_000_000, data, time)
        writer.finish()
    return path


def mcap_json(folder: Path) -> Path:
    from mcap.writer import Writer

    path = folder / "run_json.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 14)
        writer.start()
        schema = writer.register_schema("robot.State", "jsonschema", b'{"type": "object"}')
        wheels = writer.register_channel("/wheels", "json", schema)
        place = writer.register_channel("/mocap", "json", schema)
        for k, time in enumerate(instants()):
            stamp = {"sec": int(time // 10**9), "nsec": int(time % 10**9)}
            state = {"timestamp": stamp, "ok": True}
            # A custom message: wheels as members, each with its own numbers.
            for i, wheel in enumerate(("front_left", "front_right", "rear_left", "rear_right")):
                number = {"speed": LOG.velocity[k, i], "torque": LOG.effort[k, i]}
                state[wheel] = {name: float(value) for name, value in number.items()}
            writer.add_message(wheels, int(time), json.dumps(state).encode(), int(time))
        for time, (x, y, yaw) in zip(*poses(), strict=True):
            stamp = {"sec": int(time // 10**9), "nsec": int(time % 10**9)}
            where = {"position": {"x": x, "y": y, "z": 0.1}}
            where["orientation"] = {"x": 0, "y": 0, "z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
            data = json.dumps({"timestamp": stamp, "pose": where}).encode()
            writer.add_message(place, int(time), data, int(time))
        writer.finish()
    return path


BAGS: dict[str, Callable[[Path], Path]] = {
    "ros1": ros1_bag,
    "ros2": ros2_bag,
    "db3": lone_db3,
    "ros2_mcap": ros2_mcap_bag,
    "mcap_cdr": mcap_cdr,
    "mcap_json": mcap_json,
}
"""What makes a bag of each kind in a folder."""
