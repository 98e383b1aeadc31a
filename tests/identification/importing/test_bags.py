"""Bags and MCAP files become the log that they recorded; damaged ones end in one line."""

from __future__ import annotations

import sqlite3
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from identification.importing.assembling import Assembled
from identification.importing.exporting import export_log
from identification.importing.importing import import_source, open_source
from identification.importing.readers import read_source
from identification.logs.reading import read_log, write_log
from tests.identification.importing.bags import (
    BAGS,
    LOG,
    START,
    lone_db3,
    mcap_cdr,
    ros1_bag,
    ros2_bag,
)
from tests.identification.shared_data import DATA
from youbot_env.errors import InputError


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {name: make(tmp_path_factory.mktemp(name)) for name, make in BAGS.items()}


@pytest.mark.parametrize("kind", BAGS)
def test_a_bag_becomes_its_log(kind: str, bags: dict[str, Path]) -> None:
    source = open_source([bags[kind]])
    assert not source.undecided and source.proposal is not None
    assert not source.proposal.doubts
    found = import_source(source)
    made, at = found.made, kept(found.made)
    assert np.allclose(made.time - START, LOG.time[at], atol=1e-6)
    assert np.allclose(made.channels["velocity"], LOG.velocity[at])
    assert np.allclose(made.channels["effort"], LOG.effort[at])
    assert LOG.pose is not None and LOG.gyro_z is not None
    inner = slice(20, -20)
    off = made.channels["pose"][inner] - LOG.pose[at][inner]
    off -= np.round(off.mean(axis=0) / (2 * np.pi)) * np.array([0, 0, 2 * np.pi])
    # The true pose is drawn through the log's instants by straight lines: that is its error.
    assert np.abs(off).max() < 2e-3
    # The pose ends a row before the wheels: that row is left out, and this is told.
    assert len(at) == len(LOG) - 1 and np.isfinite(made.values).all()
    assert [str(f) for f in found.findings if "left out" in f.message] == [
        "column time: 0 row(s) at the start and 1 at the end left out: pose had no value there"
    ]
    if kind != "mcap_json":
        assert np.allclose(made.channels["gyro"][:, 0], LOG.gyro_z[at])
        assert LOG.position is not None
        assert np.allclose(made.channels["position"], LOG.position[at])


def kept(made: Assembled) -> NDArray[np.intp]:
    """The rows of the log that an import of it has kept."""
    return np.searchsorted(LOG.time, made.time - START - 1e-4)


def test_stamps_go_before_times_of_arrival(bags: dict[str, Path]) -> None:
    table = next(t for t in read_source(bags["ros1"]) if t.topic == "/joint_states")
    assert list(table.clocks) == ["header.stamp", "received"]
    late = table.clocks["received"] - table.clocks["header.stamp"]
    assert late == pytest.approx(2e-3, abs=1e-6)


def test_an_exported_log_comes_back(tmp_path: Path) -> None:
    write_log(tmp_path / "log.csv", LOG)
    export_log(tmp_path / "log.csv", tmp_path / "log.mcap")
    made = import_source(open_source([tmp_path / "log.mcap"])).made
    for part in ("velocity", "effort", "position", "command"):
        assert np.allclose(made.channels[part], getattr(LOG, part), atol=1e-6)
    assert LOG.pose is not None and LOG.gyro_z is not None
    turned = made.channels["pose"] - LOG.pose
    assert np.abs(turned[:, :2]).max() < 1e-6
    assert np.ptp(turned[:, 2]) < 1e-5
    assert np.allclose(made.channels["gyro"][:, 0], LOG.gyro_z, atol=1e-6)


def test_a_foreign_file_is_not_exported(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"is no log.*youbot import"):
        export_log(tmp_path / "other.csv", tmp_path / "log.mcap")
    assert not (tmp_path / "log.mcap").exists()


def test_transforms_are_a_topic_for_each_pair_of_frames(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    kind, one = types["tf2_msgs/msg/TFMessage"], types["geometry_msgs/msg/TransformStamped"]
    moved, joints = types["geometry_msgs/msg/Transform"], types["sensor_msgs/msg/JointState"]
    names, none = [f"wheel_{w}" for w in ("fl", "fr", "bl", "br")], np.empty(0)
    with Writer(tmp_path / "tf_bag", version=9) as writer:
        tf = writer.add_connection("/tf", kind.__msgtype__, typestore=store)
        states = writer.add_connection("/joints", joints.__msgtype__, typestore=store)
        for k in range(300):
            time = 10**9 + k * 10**7
            at = stamp(time // 10**9, time % 10**9)
            pairs = (("world", "robot", 0.01 * k), ("robot", "arm", 0.5))
            sent = [
                one(header(at, a), b, moved(vector(x, 0.0, 0.0), turn(0.0, 0.0, 0.0, 1.0)))
                for a, b, x in pairs
            ]
            writer.write(tf, time, store.serialize_cdr(kind(sent), kind.__msgtype__))
            state = joints(header(at, ""), names, none, np.full(4, np.sin(0.05 * k)), none)
            writer.write(states, time, store.serialize_cdr(state, joints.__msgtype__))
    source = open_source([tmp_path / "tf_bag"])
    assert source.chosen.pose is not None
    assert source.chosen.pose.x == "/tf[world>robot]:transform.translation.x"
    made = import_source(source).made
    assert np.allclose(made.channels["pose"][:, 0], 0.01 * np.arange(300))


@pytest.mark.parametrize("make", [ros1_bag, mcap_cdr], ids=["ros1", "mcap"])
def test_damaged_bags_end_in_one_line_or_in_what_was_whole(make, tmp_path: Path) -> None:
    whole = make(tmp_path).read_bytes()
    rng = np.random.default_rng(1)
    piece = tmp_path / f"piece{'.bag' if make is ros1_bag else '.mcap'}"
    for length in (0, 5, 13, 4096, len(whole) - 7):
        piece.write_bytes(whole[:length])
        read_or_refused(piece)
    for _ in range(3):
        broken = bytearray(whole)
        for at in rng.integers(0, len(whole), 20):
            broken[at] = rng.integers(0, 256)
        piece.write_bytes(broken)
        read_or_refused(piece)


def read_or_refused(path: Path) -> None:
    try:
        import_source(open_source([path]))
    except InputError as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 500


def test_an_unfinished_mcap_gives_what_it_holds(tmp_path: Path) -> None:
    path = mcap_cdr(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    source = open_source([path])
    made = import_source(source).made
    assert 0.3 * len(LOG) < len(made.time) < 0.7 * len(LOG)
    assert any("ends in mid-record" in f.message for t in source.tables for f in t.findings)


def test_a_folder_without_metadata_is_read_by_its_pieces(tmp_path: Path) -> None:
    folder = ros2_bag(tmp_path)
    (folder / "metadata.yaml").unlink()
    assert len(import_source(open_source([folder])).made.time) == len(LOG) - 1


@pytest.mark.parametrize("library", ["rosbags.highlevel", "mcap.reader"])
def test_without_the_extra_the_way_to_it_is_said(
    library: str, bags: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    kind = "ros1" if library.startswith("rosbags") else "mcap_json"
    with pytest.raises(InputError, match=r"pip install 'youbot\[import\]'"):
        read_source(bags[kind])


BAG = DATA / "polimi_mecanum" / "bag1.bag"


@pytest.mark.skipif(not BAG.is_file(), reason="the real bag is not at hand")
def test_a_real_robots_bag_without_a_map() -> None:
    source = open_source([BAG])
    assert not source.undecided
    found = import_source(source)
    assert set(found.made.channels) == {"velocity", "position", "pose"}
    assert 2860 < len(found.made.time) <= 2871
    assert np.isfinite(found.made.channels["pose"][[0, -1]]).all()
    assert source.chosen.velocity.unit == "?" and source.chosen.pose is not None
    (delay,) = found.delays
    assert 0.03 < delay.value < 0.07
    assert delay.certain


def test_a_log_that_was_written_is_read(bags: dict[str, Path], tmp_path: Path) -> None:
    from identification.importing.importing import write_imported

    made = import_source(open_source([bags["ros2"]])).made
    write_imported(tmp_path / "run.csv", made)
    log = read_log(tmp_path / "run.csv")
    assert np.allclose(log.velocity, LOG.velocity[kept(made)], atol=1e-6)
    assert log.pose is not None and log.gyro_z is not None and log.position is not None


def test_a_time_of_another_type_in_a_database_is_one_line(tmp_path: Path):
    path = lone_db3(tmp_path)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET timestamp = x'17' WHERE id = 40")
    with pytest.raises(InputError, match="the time of a message is no number"):
        import_source(open_source([path]))
