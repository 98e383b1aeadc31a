"""Wheels against a pose: exchanged wheels, wrong axes, units, clocks and frames."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from controllers.recording import record
from identification.logs.log import Log
from tests.identification.logs.test_force_checks import PAPER, first
from tests.identification.logs.test_logger_checks import pose_of
from youbot_env.motions.multisine import multisine


@pytest.fixture(scope="module")
def tracked() -> Log:
    motion = multisine(np.random.default_rng(7), duration=40.0)
    log = record(PAPER, [motion], rate=50.0, seed=4, torque_noise=0.03, speed_noise=0.01)[0]
    noise = np.random.default_rng(0).standard_normal((len(log), 3)) * (0.002, 0.002, 0.004)
    return replace(log, pose=pose_of(log, 1.0) + noise, gyro_z=None)


def test_a_sound_pose_is_not_doubted(tracked: Log):
    assert first(tracked) == ""


@pytest.mark.parametrize("order", [o for o in permutations(range(4)) if o != (0, 1, 2, 3)])
def test_every_other_order_of_the_wheels(tracked: Log, order: tuple[int, ...]):
    chosen = list(order)
    swapped = replace(
        tracked, velocity=tracked.velocity[:, chosen], effort=tracked.effort[:, chosen]
    )
    assert "are exchanged" in first(swapped)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p * (1, -1, 1), "pose_y has the wrong sign"),
        (lambda p: p * (-1, 1, 1), "pose_x has the wrong sign"),
        (lambda p: p * (1, 1, -1), "pose_yaw grows clockwise"),
        (lambda p: p[:, [1, 0, 2]], "pose_x and pose_y are exchanged"),
        (lambda p: p * (1, -1, -1), "the pose is mirrored"),
        (lambda p: p * (1000, 1000, 1), "millimetres"),
        (lambda p: p * (100, 100, 1), "centimetres"),
        (lambda p: p * (1, 1, 180 / np.pi), "looks like degrees"),
        (lambda p: p + (0, 0, np.pi / 2), "-90 degrees off the pose's forward"),
        (lambda p: p[::-1], "the pose does not follow the wheels"),
    ],
)
def test_axes_units_and_frames_of_the_pose(tracked: Log, change, message: str):
    assert tracked.pose is not None
    assert message in first(replace(tracked, pose=change(np.array(tracked.pose))))


@pytest.mark.parametrize("angle", [0.2, -0.35])
def test_a_heading_that_is_measured_askew(tracked: Log, angle: float):
    """Told with its angle, and not as another radius, wherever the tracked point is."""
    assert tracked.pose is not None
    pose = np.array(tracked.pose)
    pose[:, :2] += 0.2 * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    assert first(replace(tracked, pose=pose)) == ""
    pose[:, 2] -= angle
    told = first(replace(tracked, pose=pose))
    assert told.endswith("youbot kinematics says it exactly") and "off the pose's forward" in told
    assert float(told.split("drives ")[1].split()[0]) == pytest.approx(np.degrees(angle), abs=1.5)


def test_tracking_that_is_lost(tracked: Log):
    assert tracked.pose is not None
    still = np.array(tracked.pose)
    still[500:600] = still[500]
    told = first(replace(tracked, pose=still))
    assert "the pose stands still for 2 s while the wheels roll" in told and "row 502" in told
    leap = np.array(tracked.pose)
    leap[700:, 1] += 0.3
    told = first(replace(tracked, pose=leap))
    assert "the pose leaps by 0.3 m (1 such)" in told and "row 702" in told


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1.5, -2.0, 0.3)])
def test_a_pose_that_never_moves(tracked: Log, place: tuple[float, ...]):
    told = first(replace(tracked, pose=np.tile(place, (len(tracked), 1))))
    assert "is 0 times what the wheels say" in told


def test_a_pose_that_is_slower_than_the_log_is_not_lost(tracked: Log):
    assert tracked.pose is not None
    held = tracked.pose[np.arange(len(tracked)) // 5 * 5]
    assert "stands still" not in first(replace(tracked, pose=held))


@pytest.mark.parametrize("rows", [40, -60])
def test_another_clock(tracked: Log, rows: int):
    assert tracked.pose is not None
    late = replace(tracked, pose=np.roll(tracked.pose, rows, axis=0))
    told = first(late)
    word = "earlier" if rows > 0 else "later"
    assert "the wheels' clock is" in told and word in told
    assert float(told.split("clock is ")[1].split()[0]) == pytest.approx(abs(rows) / 50, abs=0.1)


def test_a_driver_that_counts_the_other_way(tracked: Log):
    told = first(replace(tracked, velocity=-tracked.velocity))
    assert "the sign of velocity_fl and velocity_fr and velocity_bl and velocity_br" in told


@pytest.mark.parametrize("rows", [-14, -4, 5, 12])
def test_speeds_and_pose_that_are_out_of_step(tracked: Log, rows: int):
    """Told with their lag, and not as another radius."""
    assert tracked.pose is not None
    at = np.clip(np.arange(len(tracked)) + rows, 0, len(tracked) - 1)
    late = replace(tracked, pose=tracked.pose[at])
    told = first(late)
    which = "the speeds come" if rows > 0 else "the pose comes"
    assert which in told
    assert float(told.split(" s later")[0].split()[-1]) == pytest.approx(
        abs(rows) * tracked.dt, abs=0.015
    )


@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize("gain", [0.95, 1.1])
def test_one_wheel_that_is_not_like_the_others(tracked: Log, wheel: int, gain: float):
    speed = tracked.velocity.copy()
    speed[:, wheel] *= gain
    told = first(replace(tracked, velocity=speed))
    name = f"velocity_{('fl', 'fr', 'bl', 'br')[wheel]}"
    assert "beside the pose and the other wheels" in told and name in told
    found = float(told.split(f"{name} ")[1].split()[0])
    assert found == pytest.approx(gain, abs=0.015)


def test_a_channel_that_is_clipped(tracked: Log):
    most = 0.6 * np.abs(tracked.velocity).max()
    told = first(replace(tracked, velocity=np.clip(tracked.velocity, -most, most)))
    assert "the channel is clipped" in told


def test_counts_of_whole_radians_a_second_are_no_standstill(tracked: Log):
    told = first(replace(tracked, velocity=np.round(tracked.velocity)))
    assert "stands still" not in told and "steps of 1 rad/s" in told
