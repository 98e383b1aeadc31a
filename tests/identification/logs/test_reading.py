"""Logs: what is written is read again, and healthy data pass untouched."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from identification.logs.checks import noise_estimate
from identification.logs.log import AXIS, Log
from identification.logs.parsing import _parse_cells, _parse_regular
from identification.logs.reading import (
    log_name,
    log_table,
    read_log,
    read_logs,
    read_usable_logs,
    write_log,
)
from identification.logs.repair import find_outliers
from identification.logs.timebase import bridge, interpolate_at
from tests.identification.healthy import EFFORT_NOISE, SPEED_NOISE, healthy_log
from youbot_env.errors import InputError
from youbot_env.physics.geometry import WHEELS, Geometry

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
SHARED_LOGS = sorted(SHARED.glob("*/*.csv"))
ENDINGS = (".csv", ".csv.gz", ".parquet")


def levels(log: Log) -> set[str]:
    return {finding.level for finding in log.findings}


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("extras", [False, True])
def test_a_log_survives_the_round_trip(ending: str, extras: bool, tmp_path: Path) -> None:
    log = healthy_log(extras=extras)
    write_log(tmp_path / f"run.1{ending}", log)
    again = read_log(tmp_path / f"run.1{ending}")
    assert again.name == "run.1"
    assert levels(again) == {"info"}
    names, values = log_table(log)
    names_again, values_again = log_table(again)
    assert names_again == names
    tolerance = 0 if ending == ".parquet" else 0.5000001e-6
    assert np.abs(values_again - values).max() <= tolerance
    assert again.valid.all() and np.array_equal(again.file_time, again.time)


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_same_log_is_the_same_bytes(ending: str, tmp_path: Path) -> None:
    hashes = set()
    for name in ("a", "b"):
        write_log(tmp_path / f"{name}{ending}", healthy_log(extras=True))
        hashes.add(read_log(tmp_path / f"{name}{ending}").sha256)
    assert len(hashes) == 1


def test_what_is_written_again_changes_no_more(tmp_path: Path) -> None:
    write_log(tmp_path / "a.csv", healthy_log(extras=True))
    write_log(tmp_path / "b.csv", read_log(tmp_path / "a.csv"))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_a_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("precious")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("identification.logs.writing.os.replace", fail)
    with pytest.raises(InputError, match=r"a\.csv: cannot be written \(No space left"):
        write_log(path, healthy_log())
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "words"), [("no/a.csv", "no folder"), ("a.txt", "unknown kind")])
def test_a_path_that_cannot_be_written_is_refused(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        write_log(tmp_path / name, healthy_log())


@pytest.mark.parametrize("with_position", [False, True])
def test_the_log_of_one_axis(with_position: bool, tmp_path: Path) -> None:
    time = np.arange(2000) / 200
    position = 0.2 * np.sin(1.5 * time)[:, None]
    velocity = 0.3 * np.cos(1.5 * time)[:, None]
    force = 200 * velocity - 0.45 * 95 * np.sin(1.5 * time)[:, None]
    log = Log("axis", AXIS, time, velocity, force, position=position if with_position else None)
    write_log(tmp_path / "axis.csv", log)
    header = (tmp_path / "axis.csv").read_text().splitlines()[0]
    assert header == "time,velocity,effort" + ",position" * with_position
    again = read_log(tmp_path / "axis.csv", AXIS)
    assert again.findings == ()
    assert again.velocity.shape == (2000, 1)
    assert (again.position is not None) == with_position
    with pytest.raises(InputError, match="--mechanism axis"):
        read_log(tmp_path / "axis.csv")


@pytest.mark.parametrize("rate", [20, 50, 100, 250, 300, 400, 600, 1000])
@pytest.mark.parametrize("decimals", [3, 4, 6])
def test_any_rate_is_regular_at_any_rounding(rate: int, decimals: int, tmp_path: Path) -> None:
    log = healthy_log(rate=rate, duration=8.0)
    write_log(tmp_path / "a.csv", log, decimals=decimals)
    again = read_log(tmp_path / "a.csv")
    assert levels(again) == {"info"}
    assert len(again) == len(log)
    assert again.rate == pytest.approx(rate, rel=1e-3)
    assert np.array_equal(again.time, np.round(log.time, decimals))


def test_epoch_times_keep_their_precision(tmp_path: Path) -> None:
    log = healthy_log(rate=1000, duration=5.0)
    late = Log("late", WHEELS, 1.7e9 + log.time, log.velocity, log.effort)
    write_log(tmp_path / "late.csv", late)
    again = read_log(tmp_path / "late.csv")
    assert levels(again) == {"info"}
    assert again.dt == pytest.approx(1e-3, rel=1e-6)
    assert np.abs(again.time - late.time).max() < 1e-6


def test_yaw_is_unwrapped(tmp_path: Path) -> None:
    log = healthy_log(extras=True)
    assert log.pose is not None
    wrapped = log.pose.copy()
    wrapped[:, 2] = (wrapped[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped[:, 2])).max() > 6
    write_log(
        tmp_path / "a.csv", Log("a", WHEELS, log.time, log.velocity, log.effort, pose=wrapped)
    )
    again = read_log(tmp_path / "a.csv")
    assert again.pose is not None
    assert np.abs(np.diff(again.pose[:, 2] - log.pose[:, 2])).max() < 2e-6


@pytest.mark.parametrize("seed", range(4))
def test_noise_free_steps_and_chatter_are_no_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.arange(3000) / 100
    steps = np.repeat(rng.choice([-1.0, 0.0, 2.0], size=60), 50)
    chatter = np.where(time > 20, 0.5 * (-1.0) ** np.arange(3000), np.sin(time))
    contact = np.sin(time) + np.where(np.arange(3000) % 500 < 4, 0.2, 0)
    for signal in (steps, chatter, contact, np.zeros(3000), np.abs(np.sin(3 * time))):
        assert find_outliers(signal) == []


def test_outliers_are_found_where_they_are() -> None:
    log = healthy_log(seed=3)
    signal = log.velocity[:, 0].copy()
    signal[[100, 700, 701, 1500, 1501, 1502]] += [3.0, -4.0, -5.0, 9.0, 8.0, 9.0]
    assert find_outliers(signal) == [(100, 101), (700, 702), (1500, 1503)]


def test_a_bridge_follows_a_cubic_exactly() -> None:
    index = np.arange(40.0)
    cubic = 1 - 0.3 * index + 0.02 * index**2 - 0.0004 * index**3
    damaged = cubic.copy()
    damaged[18:22] = np.nan
    bridge(damaged, 18, 22)
    assert np.abs(damaged - cubic).max() < 1e-9


def test_interpolation_to_a_grid_follows_a_cubic_exactly() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0, 5, 60))
    grid = np.linspace(time[0], time[-1], 97)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.7, 0.3])
    error = interpolate_at(grid, time, cubic(time)[:, None])[:, 0] - cubic(grid)
    assert np.abs(error).max() < 1e-9


@pytest.mark.parametrize("template", ["{:.4f}", "{:.17g}", "{:.3e}", "{:+.0f}", "{:g}", "{!r}"])
def test_the_fast_and_the_slow_parser_agree_to_the_bit(template: str) -> None:
    rng = np.random.default_rng(7)
    values = (rng.normal(size=(300, 5)) * 10.0 ** rng.integers(-12, 12, size=(300, 5))).tolist()
    rows = [",".join(template.format(value) for value in row) for row in values]
    text = "\n".join(["a,b,c,d,e", *rows, ""])
    fast, slow = _parse_regular(text.encode()), _parse_cells("x", text)
    assert fast is not None
    assert fast.names == slow.names
    assert np.array_equal(fast.values, slow.values)
    assert np.array_equal(fast.lines, slow.lines)


@pytest.mark.parametrize("seed", range(300))
def test_what_the_fast_parser_takes_the_slow_one_reads_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = bytearray(b"a,b,c\n1.5,2,3\n-4.25,5e1,6\n7,.8,9.\n")
    for _ in range(rng.integers(1, 4)):
        text[rng.integers(6, len(text))] = rng.choice(list(b"0123456789.,+-eE\n \t\"'#_xnaif\x0b"))
    fast = _parse_regular(bytes(text))
    if fast is not None:
        slow = _parse_cells("x", text.decode())
        assert np.array_equal(fast.values, slow.values)
        assert np.array_equal(fast.lines, slow.lines)


@pytest.mark.parametrize("rate", [50.0, 250.0])
def test_noise_is_estimated_beside_the_motion(rate: float) -> None:
    speed, effort = noise_estimate(healthy_log(rate=rate, duration=60.0))
    assert speed == pytest.approx(SPEED_NOISE, rel=0.07)
    assert effort == pytest.approx(EFFORT_NOISE, rel=0.07)


def test_repairs_do_not_count_as_noise(tmp_path: Path) -> None:
    log = healthy_log(duration=60.0)
    keep = np.arange(len(log)) % 40 > 2
    cut = Log("cut", WHEELS, log.time[keep], log.velocity[keep], log.effort[keep])
    write_log(tmp_path / "cut.csv", cut)
    again = read_log(tmp_path / "cut.csv")
    assert again.valid.sum() == keep.sum() - 0 and len(again) == len(log) - 3
    assert noise_estimate(again)[0] == pytest.approx(SPEED_NOISE, rel=0.07)


def test_logs_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    paths = [tmp_path / "a.csv", tmp_path / "b" / "a.csv.gz"]
    for path in paths:
        write_log(path, healthy_log())
    assert [log.name for log in read_logs(paths[:1])] == ["a"]
    with pytest.raises(InputError, match="has the name of"):
        read_logs(paths)
    with pytest.raises(InputError, match="no log given"):
        read_logs([])


@pytest.mark.parametrize("ending", [*ENDINGS, ".CSV"])
def test_a_name_is_the_file_without_its_ending(ending: str) -> None:
    assert log_name(f"/x.csv/run.7{ending}") == "run.7"


def test_a_log_is_checked_when_made() -> None:
    log = healthy_log()
    with pytest.raises(InputError, match="effort has shape"):
        Log("x", WHEELS, log.time, log.velocity, log.effort[:, :3])
    with pytest.raises(InputError, match="NaN"):
        Log("x", WHEELS, log.time, log.velocity * np.nan, log.effort)
    with pytest.raises(InputError, match="time does not increase"):
        Log("x", WHEELS, log.time[::-1], log.velocity, log.effort)
    with pytest.raises(ValueError, match="read-only"):
        log.velocity[0] = 0


def test_limits_can_be_raised(tmp_path: Path) -> None:
    log = healthy_log()
    fast = Log("fast", WHEELS, log.time, 8 * log.velocity, log.effort)
    write_log(tmp_path / "fast.csv", fast)
    with pytest.raises(InputError, match="cannot be"):
        read_log(tmp_path / "fast.csv")
    assert len(read_log(tmp_path / "fast.csv", max_speed=200.0)) == len(log)


def test_reading_csv_loads_neither_pyarrow_nor_pandas_nor_scipy() -> None:
    code = (
        "import sys, identification.logs.reading; "
        "print([m for m in ('pyarrow', 'pandas', 'scipy', 'numba') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr


def test_parquet_without_pyarrow_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(InputError, match=r"youbot\[parquet\]"):
        read_log(tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"youbot\[parquet\]"):
        write_log(tmp_path / "b.parquet", healthy_log())


@pytest.mark.parametrize("decimals", [2, 4, 6])
@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 2), (1, 0, 2.594), (1, 1, 1)])
def test_logs_without_noise_are_not_repaired(
    direction: tuple[float, float, float], decimals: int, tmp_path: Path
) -> None:
    time = np.arange(1200) / 100
    course = np.where((time > 1) & (time < 10.425), 0.4 * np.sin(2 * (time - 1)), 0)
    twist = course[:, None] * np.array(direction)
    speed = Geometry().wheel_speeds(twist)
    effort = 0.1 * speed + 0.3 * np.sign(np.round(speed, 9)) + 0.02 * course[:, None]
    write_log(tmp_path / "a.csv", Log("a", WHEELS, time, speed, effort), decimals=decimals)
    log = read_log(tmp_path / "a.csv")
    assert levels(log) <= {"info", "warning"}
    assert log.valid.all() and len(log) == 1200


@pytest.mark.skipif(not SHARED_LOGS, reason="the shared logs are not here")
@pytest.mark.parametrize("path", SHARED_LOGS, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_shared_logs_are_healthy(path: Path) -> None:
    log = read_log(path)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert levels(log) == {"info"}
    assert log.valid.all()
    assert np.array_equal(log.time, table[:, 0])
    assert np.array_equal(np.hstack([log.velocity, log.effort]), table[:, 1:9])


@pytest.mark.skipif(not SHARED_LOGS, reason="the shared logs are not here")
@pytest.mark.parametrize("platform", ["nominal_1", "nominal_2", "nominal_3"])
def test_noise_of_the_nominal_logs(platform: str) -> None:
    truth = json.loads((SHARED / platform / "truth.json").read_text())
    for path in sorted((SHARED / platform).glob("*.csv")):
        speed, effort = noise_estimate(read_log(path))
        assert speed == pytest.approx(truth["speed_noise"], rel=0.1)
        assert effort == pytest.approx(truth["torque_noise"], rel=0.1)


def test_wheels_that_are_dragged_along_are_not_taken_for_wrong_signs():
    """In motion I the left wheels hardly turn; what power they take back is no fault."""
    from identification.logs.wheel_checks import power_share
    from tests.identification.recordings import recording

    share = power_share(recording("I"))
    assert np.isnan(share[[0, 2]]).all() and (share[[1, 3]] > 0.5).all()


def test_the_same_measurements_do_not_count_twice(tmp_path: Path) -> None:
    log = healthy_log()
    part = slice(200, 1500)
    cut = Log("cut", WHEELS, log.time[part] + 5.0, log.velocity[part], log.effort[part])
    other = healthy_log(seed=3)
    for name, one in (("a", log), ("b", log), ("cut", cut), ("other", other)):
        write_log(tmp_path / f"{name}.csv", one)
    paths = [tmp_path / f"{name}.csv" for name in ("a", "b", "cut", "other")]
    read, aside = read_usable_logs(paths)
    assert [one.name for one in read] == ["a", "other"]
    assert all("must not count twice" in one.reason for one in aside)
    with pytest.raises(InputError, match="must not count twice; give each log once"):
        read_logs(paths)


@pytest.mark.parametrize(
    ("wheels", "drive"),
    [(("left", "right"), "a differential drive"), (("1", "2", "3"), "three wheels")],
)
def test_other_drives_are_told_plainly(tmp_path: Path, wheels: tuple[str, ...], drive: str) -> None:
    names = [f"{kind}_{wheel}" for kind in ("velocity", "effort") for wheel in wheels]
    rows = "\n".join(",".join(["0.01"] * (len(names) + 1)) for _ in range(3))
    (tmp_path / "log.csv").write_text(f"time,{','.join(names)}\n{rows}\n")
    with pytest.raises(InputError, match=f"{drive}.*not this tool"):
        read_log(tmp_path / "log.csv")


def test_a_log_given_twice_is_told(tmp_path: Path) -> None:
    write_log(tmp_path / "a.csv", healthy_log())
    with pytest.raises(InputError, match="is given twice"):
        read_logs([tmp_path / "a.csv", tmp_path / "a.csv"])
