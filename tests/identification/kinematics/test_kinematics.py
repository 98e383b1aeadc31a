"""Lengths, delay, frame, slip and units from wheels and pose, on made motions."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.importing.delays import channel_delays
from identification.kinematics import Kinematics, Motion, estimate_kinematics
from identification.kinematics.motion import angles_at
from identification.kinematics.units import speed_units
from tests.identification.kinematics.made_platforms import Made, made, scaled
from youbot_env.errors import InputError
from youbot_env.physics.geometry import Geometry

PLATFORM = Geometry(l=0.16, h=0.22, R=0.0499)
USUAL = Made(
    geometry=PLATFORM, slip=0.01, delay=0.04, frame_yaw=0.05, lever=(0.1, -0.05), outliers=0.01
)


def value(found: Kinematics, name: str) -> float:
    """A parameter that is shown."""
    length = found.parameters[name].value
    assert length is not None
    return length


def spread(found: Kinematics, name: str) -> float:
    """Its standard deviation."""
    std = found.parameters[name].std
    assert std is not None
    return std


def said(found: Kinematics, level: str = "") -> str:
    """All messages of a level in one text."""
    return "\n".join(f.message for f in found.findings if f.level == level or not level)


def test_lengths_delay_frame_and_lever_within_their_intervals():
    found = estimate_kinematics([made(USUAL, 1)], Geometry())
    truth = {
        "R": PLATFORM.R,
        "L": PLATFORM.L,
        "delay": 0.04,
        "frame_yaw": 0.05,
        "lever_x": 0.1,
        "lever_y": -0.05,
    }
    for name, true in truth.items():
        length = found.parameters[name]
        assert length.value is not None and length.std is not None
        assert abs(length.value - true) < 3 * length.std, name
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005
    assert spread(found, "R") < 0.002 * PLATFORM.R
    assert spread(found, "delay") < 0.002
    assert found.geometry.L == pytest.approx(PLATFORM.L, rel=0.01)
    assert "R = 0.0499" in said(found, "warning") and "0.0475 m by the geometry" in said(found)
    assert found.slip.share == pytest.approx(0.01, abs=0.01)


def test_bursts_of_outliers_and_a_jump_of_the_pose_move_nothing():
    motion = made(replace(USUAL, outliers=0.0), 2)
    pose = np.array(motion.pose)
    pose[1000:1050] += (0.5, -0.3, 0.4)
    pose[4000:] += (0.2, 0.1, 0.0)
    pose[2000:2100] = np.nan
    found = estimate_kinematics([replace(motion, pose=pose)], PLATFORM)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005
    assert abs(value(found, "L") / PLATFORM.L - 1) < 0.02


def test_a_run_that_hardly_turns_does_not_show_the_arm():
    found = estimate_kinematics([made(replace(USUAL, turning=0.005), 3)], PLATFORM)
    assert found.parameters["L"].value is None
    assert "L is not shown: the platform turns by" in said(found)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005
    assert found.geometry.L == pytest.approx(PLATFORM.L)


@pytest.mark.parametrize(
    ("factor", "name"),
    [
        (60 * 5, "rad/min of the motor at 5:1"),
        (30 / np.pi, "rpm"),
        (30 / np.pi * 9405 / 364, "rpm of the motor at 25.84:1"),
        (180 / np.pi, "degrees/s"),
        (1 / (2 * np.pi), "turns/s"),
        (20.0, "rad/s of the motor at 20:1"),
    ],
)
def test_unit_and_gear_of_the_speeds(factor: float, name: str):
    nominal = replace(PLATFORM, R=0.048)
    found = estimate_kinematics([scaled(made(USUAL, 4), factor)], nominal)
    assert found.unit is not None and found.unit.name == name
    assert found.unit.factor == pytest.approx(factor)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005
    assert f"velocity_* look like {name}" in said(found)


def test_speeds_of_the_rim_take_the_radius_of_the_geometry():
    found = estimate_kinematics([scaled(made(USUAL, 4), PLATFORM.R)], PLATFORM)
    assert found.unit is not None and found.unit.unit == "m/s"
    assert found.parameters["R"].value == pytest.approx(PLATFORM.R, rel=0.005)


def test_units_are_ranked_by_radius_and_by_how_common_they_are():
    best, *others = speed_units(0.07 / (60 * 5), 0.07, True)
    assert best.name == "rad/min of the motor at 5:1" and others
    assert not speed_units(3.7e-9, 0.07, True)


def test_a_pose_in_millimetres_is_told_by_the_arm():
    motion = made(USUAL, 5)
    pose = np.array(motion.pose) * (1000, 1000, 1)
    found = estimate_kinematics([replace(motion, pose=pose)], PLATFORM)
    assert "pose_x and pose_y look like millimetres" in said(found, "error")
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005


def test_a_yaw_in_degrees():
    motion = made(USUAL, 5)
    pose = np.array(motion.pose) * (1, 1, 180 / np.pi)
    found = estimate_kinematics([replace(motion, pose=pose)], PLATFORM)
    (told,) = [one for one in found.findings if one.level == "error"]
    assert told.column == "pose_yaw" and told.message == "looks like degrees"


ORDERS = {
    "front and back wheels": [2, 3, 0, 1],
    "left and right wheels": [1, 0, 3, 2],
    "opposite corners": [3, 2, 1, 0],
}


@pytest.mark.parametrize("name", ORDERS)
def test_exchanged_columns_are_found_by_the_pose(name: str):
    motion = made(USUAL, 6)
    found = estimate_kinematics(
        [replace(motion, velocity=motion.velocity[:, ORDERS[name]])], PLATFORM
    )
    told = said(found, "error")
    assert name in told or (name.startswith("left") and "mirrored" in told)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p * (1, -1, 1), "pose_y has the wrong sign"),
        (lambda p: p * (-1, 1, 1), "pose_x has the wrong sign"),
        (lambda p: p * (1, 1, -1), "pose_yaw grows clockwise"),
        (lambda p: p[:, [1, 0, 2]], "pose_x and pose_y are exchanged"),
        (lambda p: p * (1, -1, -1), "the pose is mirrored"),
    ],
)
def test_wrong_axes_of_the_pose(change, message: str):
    motion = made(USUAL, 7)
    found = estimate_kinematics([replace(motion, pose=change(np.array(motion.pose)))], PLATFORM)
    assert message in said(found, "error")


def test_a_clock_of_its_own():
    motion = made(USUAL, 8)
    n = len(motion.time)
    assert motion.pose is not None
    late = Motion("late", motion.time[:-130], motion.velocity[: n - 130], motion.pose[130:])
    found = estimate_kinematics([late], PLATFORM)
    assert "the wheels' clock is 1.3" in said(found, "error")
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.01


def test_a_larger_wheel_and_turned_rollers_are_found():
    larger = replace(USUAL, radii=(1.0, 1.03, 1.0, 1.0))
    found = estimate_kinematics([made(larger, 9)], PLATFORM)
    # 3 % beyond the others is 2.2 % beyond the mean of the four.
    assert "wheel fr is 2." in said(found, "warning")
    mean = PLATFORM.R * 1.0075
    assert abs(value(found, "R") / mean - 1) < 0.005
    turned = replace(USUAL, roller_angle=(np.pi / 4, np.pi / 4, np.radians(40), np.pi / 4))
    found = estimate_kinematics([made(turned, 9)], PLATFORM)
    assert re.search("the rollers of wheel bl stand at (39.9|40.[01]) degrees", said(found))


def test_equal_wheels_are_no_finding():
    for seed in range(3):
        found = estimate_kinematics([made(USUAL, 20 + seed)], PLATFORM)
        assert "wheel " not in said(found) and not said(found, "error")


def test_a_slow_pose_that_is_held_is_used_where_it_is_new():
    motion = made(USUAL, 10)
    held = np.array(motion.pose)[(np.arange(len(motion.time)) // 10) * 10]
    found = estimate_kinematics([replace(motion, pose=held)], PLATFORM)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005
    assert abs(value(found, "delay") - 0.04) < 0.01


def test_where_wheels_slip_is_named():
    motion = made(replace(USUAL, slip=0.0, outliers=0.0), 11)
    speed = motion.velocity.copy()
    speed[3000:3200] *= 1.5
    found = estimate_kinematics([replace(motion, velocity=speed)], PLATFORM)
    assert found.slip.where
    assert any(place.start < 31 and place.end > 30 for place in found.slip.where)
    assert abs(value(found, "R") / PLATFORM.R - 1) < 0.005


def test_a_gyro_alone_shows_the_ratio():
    motion = made(replace(USUAL, lever=(0.0, 0.0)), 12)
    rng = np.random.default_rng(0)
    g = PLATFORM.R / PLATFORM.L
    clean = made(replace(USUAL, slip=0.0, delay=0.0, speed_noise=0.0), 12)
    rate = g * clean.velocity @ (-1, 1, -1, 1) / 4 + 0.01 + 0.005 * rng.standard_normal(6000)
    found = estimate_kinematics([replace(motion, pose=None, gyro_z=rate)], PLATFORM)
    ratio = found.parameters["R_over_L"]
    assert ratio.value is not None and ratio.std is not None
    assert abs(ratio.value - g) < 3 * ratio.std and ratio.std < 0.005 * g
    assert abs(value(found, "delay") - 0.04) < 0.005
    assert found.parameters["R"].value is None and "R is not shown" in said(found)


def test_what_tells_no_length_is_refused():
    motion = replace(made(USUAL, 13), pose=None)
    with pytest.raises(InputError, match=r"neither pose_x.*log a pose"):
        estimate_kinematics([motion])
    other = made(USUAL, 99)
    with pytest.raises(InputError, match="the pose does not follow the wheels"):
        estimate_kinematics([replace(motion, pose=other.pose)])


def test_counts_a_turn_of_the_wheel():
    motion = made(replace(USUAL, slip=0.0), 14)
    counts = np.floor(angles_at(motion, 0.0) * 210 / (2 * np.pi)) + 1000
    found = estimate_kinematics([replace(motion, position=counts)], PLATFORM)
    assert found.counts == pytest.approx(210, rel=0.01)


def test_angles_at_a_delay_are_exact_for_speeds_linear_between_samples():
    time = np.arange(0, 5, 0.01)
    speed = np.tile((3 + 2 * time)[:, None], 4)
    found = angles_at(Motion("m", time, speed), 0.0137)
    at = time + 0.0137
    np.testing.assert_allclose(found[:-2, 0], (3 * at + at**2)[:-2], rtol=1e-12)


@pytest.mark.parametrize("delay", [0.05, -0.03])
def test_the_delay_is_the_one_that_import_reports_by_the_same_sign(delay: float):
    motion = made(replace(USUAL, delay=delay, outliers=0.0, lever=(0.0, 0.0)), 1)
    assert motion.pose is not None
    found = estimate_kinematics([motion], PLATFORM)
    (told,) = channel_delays(motion.time, {"velocity": motion.velocity, "pose": motion.pose})
    assert value(found, "delay") == pytest.approx(delay, abs=3 * spread(found, "delay") + 5e-4)
    assert told.value == pytest.approx(value(found, "delay"), abs=5e-4)
    assert (told.channel, told.behind) == ("velocity", "pose")
