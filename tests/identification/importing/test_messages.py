"""Messages of many kinds, as robots publish them: each becomes the log that it carries."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mcap")

from identification.importing.importing import import_source, open_source
from tests.identification.importing.bags import LOG, instants

Message = Callable[[int, dict[str, int]], dict[str, Any]]
Topics = dict[str, tuple[str, Message]]

V, E = LOG.velocity, LOG.effort
ENDS = ("front_left", "front_right", "rear_left", "rear_right")


def written(path: Path, topics: Topics) -> Path:
    """An MCAP file of JSON messages: by topic a type, and what makes the message of a row."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for topic, (kind, _) in topics.items():
            schema = writer.register_schema(kind, "jsonschema", b"{}")
            channels[topic] = writer.register_channel(topic, "json", schema)
        for k, time in enumerate(instants().tolist()):
            stamp = {"sec": time // 10**9, "nanosec": time % 10**9}
            for topic, (_, make) in topics.items():
                data = json.dumps(make(k, stamp)).encode()
                writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def dynamic(k: int, stamp: dict[str, int]) -> dict[str, Any]:
    names = ["effort", "velocity"]
    values = [{"interface_names": names, "values": [E[k, i], V[k, i]]} for i in range(4)]
    joints = [f"{end}_wheel_joint" for end in ENDS]
    return {"header": {"stamp": stamp}, "joint_names": joints, "interface_values": values}


def controller_state(k: int, stamp: dict[str, int]) -> dict[str, Any]:
    ends = ("front_left", "front_right", "back_left", "back_right")
    speeds = {f"{end}_wheel_velocity": V[k, i] for i, end in enumerate(ends)}
    wanted = {"linear": {"x": 0.1, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
    return {"header": {"stamp": stamp}, **speeds, "reference_velocity": wanted}


def unnamed(k: int, stamp: dict[str, int]) -> dict[str, Any]:
    return {"name": [], "position": [], "velocity": V[k].tolist(), "effort": E[k].tolist()}


def with_an_arm(k: int, stamp: dict[str, int]) -> dict[str, Any]:
    names = ["arm_1", "arm_2", *(f"wheel_{end}_joint" for end in ENDS)]
    speeds, torques = [0.0, 0.0, *V[k].tolist()], [1.0, 2.0, *E[k].tolist()]
    return {"header": {"stamp": stamp}, "name": names, "velocity": speeds, "effort": torques}


def motors(k: int, stamp: dict[str, int]) -> dict[str, Any]:
    each = [{"id": i, "speed_rpm": 30 / np.pi * V[k, i], "torque": E[k, i]} for i in range(4)]
    return {"stamp": stamp, "motors": each}


def scalar(i: int, values: np.ndarray) -> Message:
    return lambda k, stamp: {"data": values[k, i]}


def array(values: np.ndarray) -> Message:
    return lambda k, stamp: {"layout": {"dim": [], "data_offset": 0}, "data": values[k].tolist()}


KINDS: dict[str, Topics] = {
    "dynamic joint states": {"/dynamic": ("control_msgs/msg/DynamicJointState", dynamic)},
    "controller state": {
        "/state": ("control_msgs/msg/MecanumDriveControllerState", controller_state)
    },
    "joints without names": {"/joint_states": ("sensor_msgs/msg/JointState", unnamed)},
    "joints beside an arm": {"/joint_states": ("sensor_msgs/msg/JointState", with_an_arm)},
    "a custom message": {"/robot": ("my_msgs/msg/Robot", motors)},
    "arrays": {
        "/wheel_speeds": ("std_msgs/msg/Float64MultiArray", array(V)),
        "/wheel_torques": ("std_msgs/msg/Float64MultiArray", array(E)),
    },
    "a topic for each wheel": {
        f"/base/{end}_wheel_vel": ("std_msgs/msg/Float32", scalar(i, V))
        for i, end in enumerate(ENDS)
    },
    "commands beside": {
        "/joint_commands": ("sensor_msgs/msg/JointState", unnamed),
        "/joint_states": ("sensor_msgs/msg/JointState", with_an_arm),
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_messages_become_the_log_that_they_carry(kind: str, tmp_path: Path) -> None:
    source = open_source([written(tmp_path / "run.mcap", KINDS[kind])])
    assert not source.undecided
    if kind == "commands beside":
        assert source.chosen.velocity.columns[0].startswith("/joint_states:")
    made = import_source(source).made
    assert np.allclose(made.channels["velocity"], V, atol=1e-9)
    if kind not in ("controller state", "a topic for each wheel"):
        assert np.allclose(made.channels["effort"], E, atol=1e-9)


def test_a_gyro_in_degrees_is_seen_by_its_size(tmp_path: Path) -> None:
    assert LOG.gyro_z is not None
    rate = np.rad2deg(LOG.gyro_z)

    def imu(k: int, stamp: dict[str, int]) -> dict[str, Any]:
        turning = {"x": 0.0, "y": 0.0, "z": rate[k]}
        return {"header": {"stamp": stamp}, "angular_velocity": turning}

    topics: Topics = {
        "/joint_states": ("sensor_msgs/msg/JointState", with_an_arm),
        "/imu": ("sensor_msgs/msg/Imu", imu),
    }
    made = import_source(open_source([written(tmp_path / "run.mcap", topics)])).made
    assert np.allclose(made.channels["gyro"][:, 0], LOG.gyro_z)


def test_odometry_is_taken_for_a_pose_with_a_warning(tmp_path: Path) -> None:
    assert LOG.pose is not None
    pose = LOG.pose

    def odometry(k: int, stamp: dict[str, int]) -> dict[str, Any]:
        x, y, yaw = pose[k].tolist()
        turn = {"x": 0.0, "y": 0.0, "z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
        where = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": turn}
        still = {"linear": {"x": 0.1, "y": 0.0, "z": 0.0}, "angular": {"x": 0, "y": 0, "z": 0.2}}
        return {"header": {"stamp": stamp}, "pose": {"pose": where}, "twist": {"twist": still}}

    topics: Topics = {
        "/joint_states": ("sensor_msgs/msg/JointState", with_an_arm),
        "/odom": ("nav_msgs/msg/Odometry", odometry),
    }
    source = open_source([written(tmp_path / "run.mcap", topics)])
    assert source.proposal is not None and "odometry" in source.proposal.doubts[0]
    made = import_source(source).made
    assert np.allclose(np.diff(made.channels["pose"], axis=0), np.diff(pose, axis=0), atol=1e-6)
    # Its twist is the wheels' as well: no gyro.
    assert "gyro" not in made.channels
