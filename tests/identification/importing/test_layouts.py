"""Text files of any layout are read without a map where their meaning is plain."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.importing.import_map import read_map
from identification.importing.importing import (
    Imported,
    Source,
    import_source,
    open_source,
    write_imported,
)
from identification.importing.map_file import map_text
from identification.logs.reading import read_log
from tests.identification.importing.layouts import LAYOUTS, LOG, joined, names, plain, rows
from tests.identification.shared_data import DATA, needs_data
from youbot_env.errors import InputError
from youbot_env.physics.geometry import WHEELS


def imported(path: Path) -> tuple[Source, Imported]:
    source = open_source([path])
    return source, import_source(source)


def written(tmp_path: Path, text: str | bytes, name: str = "foreign.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_plain_layouts_become_the_log_that_they_are(layout: str, tmp_path: Path) -> None:
    source, found = imported(written(tmp_path, LAYOUTS[layout]()))
    assert not source.undecided
    made = found.made
    assert len(made.time) >= len(LOG) - 2
    # Dates count from 1970, a log from the start of its run; both end on the same row.
    at = len(LOG) - 1 - np.round((made.time[-1] - made.time) * LOG.rate).astype(int)
    for part, true in (("velocity", LOG.velocity), ("effort", LOG.effort)):
        block = made.channels[part]
        assert block.shape == (len(made.time), 4)
        off = np.abs(block - true[at])
        # Half-empty rows hold the efforts between the speeds: they are interpolated noise there.
        tolerance = 2e-4 if layout != "plotjuggler" or part == "velocity" else 0.15
        assert np.nanquantile(off, 0.99) < tolerance
        assert np.isfinite(block).mean() > 0.99
    if layout != "plotjuggler":
        # Whole seconds that 100 rows share tell the rate to a row in the first and last second.
        near = 1e-4 if layout != "whole_seconds" else 3e-4
        assert np.abs(np.diff(made.time) - 0.01).max() < near


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
def test_other_encodings(encoding: str, tmp_path: Path) -> None:
    text = joined(["Zeit", *names("Motor für {}: vel"), *names("Motor für {}: torque")], rows(LOG))
    source, found = imported(written(tmp_path, text.encode(encoding)))
    assert not source.undecided
    assert np.allclose(found.made.channels["effort"], LOG.effort, atol=1e-4)


def test_old_line_ends_and_a_cut_last_row(tmp_path: Path) -> None:
    text = plain().replace("\n", "\r")[:-30]
    _, found = imported(written(tmp_path, text))
    assert len(found.made.time) == len(LOG) - 1


def test_several_topics_of_one_run_meet_on_the_stamps_of_the_wheels(tmp_path: Path) -> None:
    full = LOG.velocity
    wheels = joined(["t", *names("velocity_{}")], [row[:5] for row in rows(LOG)])
    time = np.arange(0.05, 5.9, 0.0033)
    circle = np.column_stack([time, np.cos(time), np.sin(time), np.rad2deg(time % 6)])
    pose = [[f"{number:.6f}" for number in row] for row in circle]
    one = written(tmp_path, wheels, "wheels.csv")
    other = written(tmp_path, joined(["stamp", "x [m]", "y [m]", "yaw [deg]"], pose), "mocap.csv")
    made = import_source(open_source([one, other])).made
    at = np.searchsorted(LOG.time, made.time - 1e-6)
    assert np.allclose(made.channels["velocity"], full[at], atol=1e-4)
    inner = (made.time > 0.4) & (made.time < 5.5)
    x, y, yaw = made.channels["pose"][inner].T
    at = made.time[inner]
    assert np.abs(x - np.cos(at)).max() < 1e-3
    assert np.abs(y - np.sin(at)).max() < 1e-3
    assert np.abs(yaw - at).max() < 1e-3
    # Beyond its ends there is no pose, and none is invented: these rows are left out, and told.
    assert np.isfinite(made.values).all() and made.time[0] >= 0.05 and made.time[-1] <= 5.9
    told = [str(f) for f in made.findings if "left out" in f.message]
    lost = len(LOG) - len(made.time)
    assert len(told) == 1 and "pose had no value" in told[0]
    assert lost == sum(map(int, re.findall(r"(\d+)(?: row| at)", told[0])))


def test_a_channel_of_half_the_run_does_not_cost_the_others_their_rows(tmp_path: Path) -> None:
    wheels = joined(["t", *names("velocity_{}")], [row[:5] for row in rows(LOG)])
    circle = [[f"{t:.4f}", "1.0", f"{t:.4f}", "0.1"] for t in np.arange(3.0, 5.99, 0.01)]
    one = written(tmp_path, wheels, "wheels.csv")
    other = written(tmp_path, joined(["stamp", "x [m]", "y [m]", "yaw [deg]"], circle), "mocap.csv")
    made = import_source(open_source([one, other])).made
    assert len(made.time) == len(LOG) and np.isnan(made.channels["pose"][made.time < 2.9]).all()
    told = [str(f) for f in made.findings if f.column == "pose" and f.level == "warning"]
    assert len(told) == 1 and "no value in the first 2.99 s" in told[0]


def test_gaps_stay_gaps(tmp_path: Path) -> None:
    body = rows(LOG)
    late = [[f"{float(row[0]) + 12:.5f}", *row[1:]] for row in body[300:]]
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    _, found = imported(written(tmp_path, joined(header, body[:300] + late)))
    assert len(found.made.time) == len(LOG)
    pieces = found.made.pieces()
    assert [len(piece.time) for piece in pieces] == [300, len(LOG) - 300]


def test_two_runs_in_one_file_are_not_mixed(tmp_path: Path) -> None:
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    body = rows(LOG)
    again = [[row[0], *other[1:]] for row, other in zip(body[:200], body[200:], strict=False)]
    with pytest.raises(InputError, match=r"two runs in one; `-o FOLDER/`"):
        imported(written(tmp_path, joined(header, [*body, *again])))


def test_a_file_without_header_is_guessed_by_place_and_asked(tmp_path: Path) -> None:
    source, found = imported(written(tmp_path, joined(rows(LOG)[0], rows(LOG)[1:])))
    assert "there is no header" in source.undecided[0]
    assert np.allclose(found.made.channels["effort"], LOG.effort, atol=1e-4)


def test_a_count_of_rows_is_no_time(tmp_path: Path) -> None:
    body = [[str(k), *row[1:]] for k, row in enumerate(rows(LOG))]
    header = ["t", *names("velocity_{}"), *names("effort_{}")]
    source = open_source([written(tmp_path, joined(header, body))])
    assert "milliseconds, or rows?" in source.undecided[0]


def test_the_order_of_numbered_wheels_is_asked_where_it_cannot_be_theirs(tmp_path: Path) -> None:
    order = [0, 2, 1, 3]
    values = np.column_stack([LOG.time, LOG.velocity[:, order], LOG.effort[:, order]])
    body = [[f"{number:.5f}" for number in row] for row in values]
    header = ["t", *(f"w{k}" for k in range(4)), *(f"tau{k}" for k in range(4))]
    source, found = imported(written(tmp_path, joined(header, body)))
    assert "order of the numbered wheels" in source.undecided[0]
    assert np.allclose(found.made.channels["velocity"], LOG.velocity, atol=1e-4)
    assert np.allclose(found.made.channels["effort"], LOG.effort, atol=1e-4)


def test_what_no_column_tells_is_asked_and_guessed(tmp_path: Path) -> None:
    body = [["1.70E+09", *row[1:]] for row in rows(LOG)]
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    source = open_source([written(tmp_path, joined(header, body))])
    assert "rate of the rows" in source.undecided[0]
    assert len(import_source(source).made.time) == len(LOG)


def test_currents_are_asked_for_their_constant(tmp_path: Path) -> None:
    header = ["time", *names("velocity_{}"), *names("motor_current_{} [A]")]
    source = open_source([written(tmp_path, joined(header, rows(LOG)))])
    assert "torque_constant" in source.undecided[0]
    # Without it a log has no efforts rather than wrong ones.
    found = import_source(source)
    assert list(found.made.channels) == ["velocity"]
    assert any("torque_constant" in finding.message for finding in found.findings)


def test_aliases_of_yaml_are_not_followed(tmp_path: Path) -> None:
    lines = ["header: {stamp: {sec: 1, nanosec: 2}}", "a: &a [1, 1]", "name: []", "velocity: []"]
    lines += [
        f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]"
        for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    ]
    with pytest.raises(InputError, match="looks like echoed messages and is no YAML"):
        imported(written(tmp_path, "\n".join([*lines, "---", ""])))


def test_efforts_that_are_zero_were_not_measured(tmp_path: Path) -> None:
    body = [[*row[:5], *["0.0"] * 4] for row in rows(LOG)]
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    _, found = imported(written(tmp_path, joined(header, body)))
    assert "effort" not in found.made.channels


def test_the_stock_drivers_signs_are_turned(tmp_path: Path) -> None:
    signs = np.array([-1.0, 1.0, -1.0, 1.0])
    values = np.column_stack([LOG.time, LOG.velocity * signs, LOG.effort * signs])
    body = [[f"{number:.5f}" for number in row] for row in values]
    header = ["time", *names("wheel_joint_{}/velocity"), *names("wheel_joint_{}/effort")]
    source, found = imported(written(tmp_path, joined(header, body)))
    assert not source.undecided
    assert np.allclose(found.made.channels["velocity"], LOG.velocity, atol=1e-4)
    assert np.allclose(found.made.channels["effort"], LOG.effort, atol=1e-4)


def test_speeds_that_no_wheel_has_are_asked(tmp_path: Path) -> None:
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    source = open_source([written(tmp_path, joined(header, rows(LOG, 30 / np.pi)))])
    assert "unit and gear" in source.undecided[0]
    assert "rpm" in source.undecided[0]


def test_positions_tell_the_counts_of_a_turn(tmp_path: Path) -> None:
    angle = np.cumsum(LOG.velocity, axis=0) / LOG.rate
    counts = np.round(angle / (2 * np.pi) * 4096).astype(int)
    body = [
        [*row[:5], *(str(n) for n in line)] for row, line in zip(rows(LOG), counts, strict=True)
    ]
    header = ["time", *names("velocity_{}"), *names("encoder_{}")]
    source, found = imported(written(tmp_path, joined(header, body)))
    assert source.chosen.position is not None
    assert source.chosen.position.counts_per_turn == pytest.approx(4096, rel=0.01)
    moved = found.made.channels["position"] - found.made.channels["position"][0]
    assert np.abs(moved - (angle - angle[0])).max() < 0.05


@pytest.mark.parametrize(("per_turn", "unit"), [(4096, "count"), (None, "rad")])
def test_positions_alone_become_speeds(per_turn: int | None, unit: str, tmp_path: Path) -> None:
    angle = np.cumsum(LOG.velocity, axis=0) / LOG.rate
    given = np.round(angle / (2 * np.pi) * per_turn) if per_turn else angle
    body = [
        [row[0], *(f"{n:.6g}" for n in line), *row[5:]]
        for row, line in zip(rows(LOG), given, strict=True)
    ]
    path = written(tmp_path, joined(["time", *names("enc_{}"), *names("torque_{}")], body))
    source = open_source([path])
    proposed = source.chosen
    if per_turn:
        assert "how many are a turn" in source.undecided[0]
        with pytest.raises(InputError, match="need counts_per_turn"):
            import_source(source)
        proposed = replace(proposed, velocity=replace(proposed.velocity, counts_per_turn=per_turn))
    asked = tmp_path / "map.toml"
    asked.write_text(map_text(proposed))
    made = import_source(open_source([path], read_map(asked))).made
    assert proposed.velocity.unit == unit
    off = made.channels["velocity"] - np.gradient(angle, 1 / LOG.rate, axis=0)
    assert np.sqrt((off**2).mean()) < (0.15 if per_turn else 5e-3)


def test_parquet_with_other_names(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {"stamp": (1_700_000_000_000 + 1e3 * LOG.time).round().astype("datetime64[ms]")}
    for k, wheel in enumerate(("fl", "fr", "rl", "rr")):
        columns[f"w_{wheel}"] = LOG.velocity[:, k]
        columns[f"tau_{wheel}"] = LOG.effort[:, k]
    parquet.write_table(pyarrow.table(columns), tmp_path / "foreign.parquet")
    source, found = imported(tmp_path / "foreign.parquet")
    assert not source.undecided
    assert np.allclose(found.made.channels["velocity"], LOG.velocity)
    assert np.allclose(found.made.channels["effort"], LOG.effort)
    assert found.made.time[0] == pytest.approx(1_700_000_000.01)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\n \n", "is empty"),
        (b"hello world\n", "holds no row of numbers"),
        (b"a,b\nx,y\n", "holds no row of numbers"),
        (b"time,a\n0,1\n1,2\n", "no four columns look like wheel speeds among time, a"),
        (b"\x1f\x8bxx", "the compressed file is damaged"),
        (b"\x01\x02\x03\x04 binary", "holds binary data of an unknown kind"),
        (b"PAR1xxxx", "is no sound Parquet file"),
        (b"\x28\xb5\x2f\xfdxx", "is compressed by zstd as a whole"),
    ],
)
def test_what_cannot_be_read_is_one_line(content: bytes, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InputError, match=message) as caught:
        imported(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


HEADERS = sorted((DATA / "field" / "headers").glob("*.csv.gz"))
GUESSED = ("epoch_excel", "epoch_float32")


@needs_data
@pytest.mark.parametrize("path", HEADERS, ids=lambda path: path.name.split(".")[0])
def test_one_log_as_other_tools_export_it(path: Path, tmp_path: Path) -> None:
    name = path.name.split(".")[0]
    source, found = imported(path)
    # Two of them hold one time for all rows: the rate is a guess, and is asked.
    assert bool(source.undecided) == (name in GUESSED)
    parts = {"velocity"} if name == "denormal_effort" else {"velocity", "effort"}
    assert set(found.made.channels) == parts
    assert len(found.made.time) in (1499, 1500)
    usual = DATA / "field" / "headers" / "capital.csv.gz"
    true = import_source(open_source([usual])).made.channels
    # One of them starts at the first row that has efforts too, and one has fewer digits.
    same = true["velocity"][1500 - len(found.made.time) :]
    assert np.abs(found.made.channels["velocity"] - same).max() < 6e-4
    for k, piece in enumerate(found.made.pieces() if parts == {"velocity", "effort"} else []):
        target = tmp_path / f"{name}_{k}.csv"
        write_imported(target, piece)
        assert read_log(target).joints == WHEELS


def test_efforts_beside_speeds_of_a_motor_are_left_out_until_their_unit_is_said(
    tmp_path: Path,
) -> None:
    """They may be amperes: taken for newton metres they would make a wrong model in silence."""
    time = LOG.time
    place = [f"{np.sin(t):.5f}" for t in time]
    body = [
        [*row, p, "0.0", "0.0"] for row, p in zip(rows(LOG, 25.84 * 30 / np.pi), place, strict=True)
    ]
    header = ["time", *names("velocity_{}"), *names("effort_{}"), "x", "y", "yaw"]
    source, found = imported(written(tmp_path, joined(header, body)))
    assert not source.undecided and source.proposal is not None
    assert any("kinematics" in doubt for doubt in source.proposal.doubts)
    assert any("torque_constant" in doubt for doubt in source.proposal.doubts)
    assert set(found.made.channels) == {"velocity", "pose"}
