"""How a log was made: each fault at several sizes, none of them on sound logs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from controllers.recording import record
from identification.fitting.identify import identify
from identification.logs.checks import check, limits_for
from identification.logs.log import Log
from identification.logs.logger_checks import counted_step
from identification.logs.reading import read_log, write_log
from identification.signals.filters import integral_of
from tests.identification.recordings import recording
from tests.identification.shared_data import DATA, needs_data
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.geometry import Geometry

PAPER = load_model("paper")


@pytest.fixture(scope="module")
def free() -> Log:
    motion = multisine(np.random.default_rng(5), duration=40.0)
    return record(PAPER, [motion], rate=100.0, seed=4, torque_noise=0.03, speed_noise=0.01)[0]


def told(log: Log, level: str = "") -> list[str]:
    found = check(log, limits_for(log, None, None, None))
    return [str(f) for f in found if f.level != "info" and level in f.level]


def pose_of(log: Log, scale: float) -> np.ndarray:
    """What the wheels say, travelled and turned ``scale`` times."""
    twist = scale * Geometry().body_twist(log.velocity)
    yaw = integral_of(twist[:, 2], log.dt)
    c, s = np.cos(yaw), np.sin(yaw)
    world = np.column_stack([c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]])
    return np.column_stack([integral_of(world, log.dt), yaw])


def test_sound_logs_are_not_doubted(free: Log):
    for log in (free, recording(), recording("I"), recording(rate=50.0)):
        assert told(log) == []
        assert told(replace(log, pose=pose_of(log, 1.003))) == []


def late(log: Log, delays: tuple[float, ...]) -> Log:
    """The log with each wheel's speed late by so much [s]."""
    shifted = [
        np.interp(log.time - d, log.time, v) for d, v in zip(delays, log.velocity.T, strict=True)
    ]
    return replace(log, velocity=np.column_stack(shifted))


@pytest.mark.parametrize("delay", [0.008, 0.05, -0.02])
def test_one_wheel_that_comes_late(free: Log, delay: float):
    (line,) = [x for x in told(late(free, (0, 0, delay, 0))) if "other wheels" in x]
    said = float(line.split(" comes ")[1].split(" ms ")[0])
    assert said == pytest.approx(1e3 * abs(delay), rel=0.12)
    assert "velocity_bl" in line and line.count("velocity_") == 1
    assert ("after" if delay > 0 else "before") in line


def test_drives_that_are_asked_one_after_the_other(free: Log):
    (line,) = [x for x in told(late(free, (0, 0.006, 0.012, 0.018))) if "other wheels" in x]
    assert "velocity_fl comes" in line and "velocity_br comes" in line
    assert line.index("before") < line.index("after")


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_a_number_that_overflows(free: Log, share: float):
    span = share * np.abs(free.velocity).max()
    velocity = free.velocity.copy()
    velocity[:, 1] = (velocity[:, 1] + span) % (2 * span) - span
    (line,) = [x for x in told(replace(free, velocity=velocity), "error") if "overflows" in x]
    leap = float(line.split("leaps by ")[1].split(" ")[0])
    assert "velocity_fr" in line and leap == pytest.approx(2 * span, rel=0.05)


def test_a_torque_that_switches_between_two_ends_does_not_overflow(free: Log):
    rng = np.random.default_rng(1)
    effort = np.sign(free.effort) + 0.03 * rng.standard_normal(free.effort.shape)
    assert not [x for x in told(replace(free, effort=effort)) if "overflows" in x]


@pytest.mark.parametrize("order", [o for o in permutations(range(4)) if o != (0, 1, 2, 3)])
def test_efforts_in_another_order(free: Log, order: tuple[int, ...]):
    (line,) = [x for x in told(replace(free, effort=free.effort[:, order])) if "order" in x]
    assert "another order than the speeds" in line


@pytest.mark.parametrize("wheels", [[0], [3], [1, 2], [0, 1, 2, 3]])
@pytest.mark.parametrize("sign", [1, -1])
def test_efforts_without_their_sign(free: Log, wheels: list[int], sign: int):
    effort = free.effort.copy()
    effort[:, wheels] = sign * np.abs(effort[:, wheels])
    lines = told(replace(free, effort=effort), "error")
    assert sum("it has lost its sign" in line for line in lines) == len(wheels)


@pytest.mark.parametrize("rows", [2, 5, 10])
def test_stale_efforts(free: Log, rows: int):
    held = free.effort[(np.arange(len(free)) // rows) * rows]
    (line,) = told(replace(free, effort=held), "warning")
    assert f"effort_* is new every {10 * rows} ms only" in line


@pytest.mark.parametrize("counts", [500, 1000])
@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_counted_speeds(free: Log, counts: int, jitter: float):
    angle = integral_of(free.velocity, free.dt)
    unit = 2 * np.pi / counts
    dt = free.dt * (1 + jitter * np.random.default_rng(0).uniform(-1, 1, len(free)))
    speed = np.diff(np.floor(angle / unit), axis=0, prepend=0) * unit / dt[:, None]
    assert counted_step(speed) == pytest.approx(unit / free.dt, rel=0.1)
    (line,) = [x for x in told(replace(free, velocity=speed), "warning") if "steps of" in x]
    assert "log the counts" in line


def test_speeds_of_so_few_counts_that_nothing_seems_to_move(free: Log):
    unit = 2 * np.pi / 48
    angle = integral_of(free.velocity, free.dt)
    speed = np.diff(np.floor(angle / unit), axis=0, prepend=0) * unit / free.dt
    (line,) = told(replace(free, velocity=speed), "error")
    assert "speeds come in steps of 13.1 rad/s" in line and "over a longer time" in line


@pytest.mark.parametrize(("start", "stop"), [(1000, 1600), (2400, 3900)])
def test_a_robot_that_is_pushed(free: Log, start: int, stop: int):
    effort = free.effort.copy()
    effort[start:stop] = 0.03 * np.random.default_rng(0).standard_normal((stop - start, 4))
    (line,) = told(replace(free, effort=effort), "error")
    assert "something else drives" in line
    first, last = (int(word) for word in line.split("rows ")[1].split(":")[0].split(" to "))
    assert abs(first - start) < 120 and abs(last - stop) < 120


@needs_data
@pytest.mark.parametrize("name", ["calibration", "multisine_a", "multisine_b"])
def test_a_push_is_not_taken_for_exchanged_wheels(name: str):
    with pytest.raises(InputError, match="something else drives"):
        read_log(DATA / "field" / "pushed_by_hand" / f"{name}.csv.gz")


@pytest.mark.parametrize("rows", [2, 4, 8])
@pytest.mark.parametrize("short", [2e-4, 1.5e-3])
def test_times_of_arrival_in_bursts(free: Log, rows: int, short: float, tmp_path: Path):
    k = np.arange(len(free))
    time = (k // rows + 1) * rows * free.dt + (k % rows) * short
    log = Log("burst", free.joints, time, free.velocity, free.effort)
    write_log(tmp_path / "burst.csv", log)
    with pytest.raises(InputError, match=r"times of arrival, in bursts.*header\.stamp"):
        read_log(tmp_path / "burst.csv")


@pytest.mark.parametrize("scale", [0.94, 1.05, 1.1])
def test_a_pose_tells_the_radius_with_its_interval(free: Log, scale: float):
    (line,) = told(replace(free, pose=pose_of(free, scale)), "warning")
    found = re.match(r"R = (\S+) \+- (\S+) m by the pose .*, 0.0475 m by the geometry", line)
    assert found, line
    radius, reach = map(float, found.groups())
    assert radius == pytest.approx(scale * 0.0475, rel=1e-3) and reach < 1e-3 * radius


@pytest.mark.parametrize("scale", [0.4, 0.5, 2.0])
def test_a_pose_tells_the_scale_of_time(free: Log, scale: float):
    (line,) = told(replace(free, pose=pose_of(free, scale)), "error")
    assert f"the time column runs {1 / scale:.3g} times as fast" in line


def test_a_pose_tells_the_unit_of_the_speeds(free: Log):
    log = replace(free, pose=pose_of(free, 1.0), velocity=free.velocity / (2 * np.pi))
    assert any("velocity_* look like turns/s" in line for line in told(log, "error"))


@pytest.mark.parametrize("make", [lambda log: log, lambda log: recording(rate=50.0)])
def test_speeds_in_turns_are_named_by_the_mass_that_they_make(
    free: Log, make: Callable[[Log], Log]
):
    log = make(free)
    turns = replace(log, velocity=log.velocity / (2 * np.pi))
    try:
        line = identify([turns], recursive=False).warnings[0]
    except InputError as error:
        line = str(error)
    assert "are velocity_* in turns/s?" in line and "motion IV" not in line
