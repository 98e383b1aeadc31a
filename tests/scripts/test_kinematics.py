"""The command kinematics: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from identification.logs.writing import write_table
from tests.identification.kinematics.made_platforms import Made, made
from tests.identification.shared_data import DATA
from tests.scripts.test_reports import charts, stands_alone, visible
from youbot_env.model.model_file import load_geometry
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_scripts.cli import main

PLATFORM = Geometry(l=0.16, h=0.22, R=0.0499)


def write_motion(path: Path, factor: float = 1.0, **what: float) -> None:
    """A log of wheels and pose, without efforts."""
    motion = made(Made(geometry=PLATFORM, seconds=40.0, **what), 1)  # type: ignore[arg-type]
    assert motion.pose is not None
    names = ["time", *(f"velocity_{w}" for w in WHEELS), "pose_x", "pose_y", "pose_yaw"]
    write_table(path, names, np.column_stack([motion.time, motion.velocity * factor, motion.pose]))


def test_finds_writes_and_its_geometry_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture):
    log, out, target = (tmp_path / name for name in ("run.csv", "f.json", "g.json"))
    write_motion(log, delay=0.03)
    report = tmp_path / "page.html"
    line = ["kinematics", str(log), "-o", str(target), "--json", str(out)]
    assert main([*line, "--report", str(report)]) == 0
    page = report.read_text()
    assert stands_alone(page) and charts(page) == {"lengths", "wheels", "way", "speeds"}
    assert "R 49.9" in visible(page) and " mm" in visible(page) and "delay [ms]" in page
    found = json.loads(out.read_text())
    assert set(found["parameters"]) >= {"R", "L", "delay", "frame_yaw"}
    assert found["parameters"]["R"]["value"] == pytest.approx(PLATFORM.R, rel=0.005)
    assert found["parameters"]["R"]["unit"] == "m"
    assert found["findings"] and found["slip"]["share"] < 0.03
    assert load_geometry(target).R == pytest.approx(PLATFORM.R, rel=0.005)
    assert load_geometry(target).L == pytest.approx(PLATFORM.L, rel=0.01)
    printed = capsys.readouterr().out
    assert "R = 0.0499" in printed and "30 ms behind the pose" in printed


def test_identify_says_plainly_what_a_log_without_efforts_is_good_for(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    log = tmp_path / "run.csv"
    write_motion(log)
    assert main(["identify", str(log)]) == 2
    error = capsys.readouterr().err
    assert "effort_fl: the column is missing" in error and "youbot kinematics" in error


def test_a_log_without_pose_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture):
    log = tmp_path / "run.csv"
    time = np.arange(200) / 50
    names = ["time", *(f"velocity_{w}" for w in WHEELS)]
    write_table(log, names, np.column_stack([time, *[np.sin(time)] * 4]))
    assert main(["kinematics", str(log)]) == 2
    assert "neither pose_x" in capsys.readouterr().err


BAG = DATA / "polimi_mecanum" / "bag1.bag"


@pytest.mark.skipif(not BAG.exists(), reason="the real robot's bag is not redistributed")
def test_a_real_robot(tmp_path: Path):
    """Radians a minute of the motor at 5:1 (said to be rpm), some 50 ms late, frame 2 degrees."""
    reader = pytest.importorskip("rosbags.rosbag1")
    types = pytest.importorskip("rosbags.typesys")
    store = types.get_typestore(types.Stores.ROS1_NOETIC)
    wheels, poses = [], []
    with reader.Reader(BAG) as bag:
        for connection, _, raw in bag.messages():
            message = store.deserialize_ros1(raw, connection.msgtype)
            stamp = message.header.stamp.sec % 10_000 + message.header.stamp.nanosec * 1e-9
            if connection.topic == "/wheel_states":
                wheels.append([stamp, *message.velocity, *message.position])
            else:
                p, q = message.pose.position, message.pose.orientation
                yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
                poses.append([stamp, p.x, p.y, yaw])
    wheel, pose = np.array(wheels), np.array(poses)
    at = [np.interp(wheel[:, 0], pose[:, 0], column) for column in pose[:, 1:].T]
    names = ["time", *(f"velocity_{w}" for w in WHEELS), *(f"position_{w}" for w in WHEELS)]
    log, nominal, out = tmp_path / "bag1.csv", tmp_path / "nominal.json", tmp_path / "f.json"
    columns = np.column_stack([wheel, *at])
    write_table(log, [*names, "pose_x", "pose_y", "pose_yaw"], columns)
    lengths = {"l": 0.169, "h": 0.2, "R": 0.07, "r": 0.014, "m1": 1.0}
    nominal.write_text(json.dumps({"geometry": lengths}))
    arguments = ["kinematics", log, "--geometry", nominal, "--json", out]
    assert main([str(word) for word in arguments]) == 0
    found = json.loads(out.read_text())
    known = found["parameters"]
    assert 0.0667 < known["R"]["value"] < 0.0681
    assert 2 < np.degrees(known["frame_yaw"]["value"]) < 3
    assert 0.03 < known["delay"]["value"] < 0.07
    assert known["L"]["value"] is None
    assert any("L is not shown" in one["message"] for one in found["findings"])
    assert found["unit"]["name"] == "rad/min of the motor at 5:1"


def test_a_geometry_in_centimetres_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture):
    log, nominal = tmp_path / "run.csv", tmp_path / "g.json"
    write_motion(log)
    for factor, unit in ((100, "cm"), (1000, "mm")):
        lengths = {"l": 0.15, "h": 0.2355, "R": 0.0475, "r": 0.014}
        scaled = {name: value * factor for name, value in lengths.items()} | {"m1": 1.4}
        nominal.write_text(json.dumps({"geometry": scaled}))
        assert main(["kinematics", str(log), "--geometry", str(nominal)]) == 2
        error = capsys.readouterr().err
        assert f"lengths in {unit}? divide l, h, R, r by {factor}" in error
