"""Rollers in X or O: both are measured, and told apart where the geometry says the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.kinematics import Motion, estimate_kinematics
from identification.kinematics.arrangement import in_x, other, partners
from tests.identification.kinematics.made_platforms import Made, made
from youbot_env.physics.geometry import WHEELS, Geometry

WIDE = Geometry(l=0.3, h=0.16, R=0.0499)
LONG = Geometry(l=0.15, h=0.235, R=0.0499)


def motion_of(geometry: Geometry, **what: object) -> Motion:
    """A motion of a robot whose front left wheel is 3 % larger."""
    made_of = Made(
        geometry=geometry, slip=0.005, delay=0.04, frame_yaw=0.05, radii=(1.03, 1.0, 1.0, 1.0)
    )
    return made(replace(made_of, **what), 1)  # type: ignore[arg-type]


@pytest.mark.parametrize("lengths", [WIDE, LONG], ids=["track longer", "base longer"])
@pytest.mark.parametrize("stands", ["X", "O"])
@pytest.mark.parametrize("said", ["X", "O"])
def test_the_arrangement_is_found_with_all_that_follows(lengths: Geometry, stands: str, said: str):
    true = replace(lengths, arrangement=stands)
    found = estimate_kinematics([motion_of(true)], replace(lengths, arrangement=said))
    assert found.geometry.arrangement == stands
    radius, arm = found.parameters["R"], found.parameters["L"]
    assert radius.value == pytest.approx(true.R * 1.0075, rel=0.005)
    assert arm.value == pytest.approx(true.L, rel=0.02)
    assert found.geometry.L == pytest.approx(true.L, rel=0.02)
    assert found.geometry.l == pytest.approx(true.l, rel=0.02)
    assert found.parameters["frame_yaw"].value == pytest.approx(0.05, abs=0.01)
    assert found.parameters["delay"].value == pytest.approx(0.04, abs=0.005)
    assert max(WHEELS, key=lambda wheel: found.wheels[wheel].radius[0]) == "fl"
    for i, wheel in enumerate(WHEELS):
        angle = found.wheels[wheel].roller_angle
        assert angle and angle[0] == pytest.approx(np.arctan(true.tangents[i]), abs=0.03)
    errors = [f for f in found.findings if f.level == "error"]
    assert len(errors) == (stands != said)
    for error in errors:
        assert f"the rollers stand in {stands}, in {said} by the geometry" in error.message
        assert f'"arrangement": "{stands}"' in error.cure


def test_exchanged_columns_are_not_taken_for_rollers():
    motion = motion_of(WIDE, radii=(1.0,) * 4)
    exchanged = replace(motion, velocity=motion.velocity[:, [2, 3, 0, 1]])
    found = estimate_kinematics([exchanged], WIDE)
    told = " ".join(f.message for f in found.findings if f.level == "error")
    assert "exchanged" in told or "pose_y" in told
    assert found.geometry.arrangement == "X"


def test_without_a_geometry_both_are_named():
    found = estimate_kinematics([motion_of(replace(WIDE, arrangement="O"))])
    told = next(f.message for f in found.findings if f.level == "error")
    assert "the rollers stand in O" in told and "front and back wheels are exchanged" in told


def test_without_turns_neither_is_preferred():
    motion = motion_of(replace(WIDE, arrangement="O"), turning=0.003)
    found = estimate_kinematics([motion], WIDE)
    told = next(f.message for f in found.findings if f.level == "error")
    assert "or the rollers stand in O" in told
    assert found.geometry.arrangement == "X"


def test_rollers_at_another_angle_are_written_into_the_geometry():
    angles = tuple(np.radians([45.0, 45.0, 41.0, 45.0]).tolist())
    found = estimate_kinematics([motion_of(WIDE, roller_angle=angles, radii=(1.0,) * 4)], WIDE)
    assert found.geometry.roller_angles[2] == pytest.approx(angles[2], abs=0.01)
    assert found.geometry.roller_angles[:2] == (np.pi / 4, np.pi / 4)
    assert found.geometry.L == pytest.approx(found.parameters["L"].value)
    again = estimate_kinematics([motion_of(WIDE, roller_angle=angles)], found.geometry)
    assert not any("rollers of wheel bl" in f.message for f in again.findings)


@pytest.mark.parametrize("lengths", [WIDE, LONG])
def test_a_log_in_o_is_one_in_x(lengths: Geometry):
    """The law of the module: columns exchanged, the arm is |l - h|, the motion stays."""
    stands = replace(lengths, arrangement="O")
    motion = motion_of(stands, radii=(1.0,) * 4, slip=0.0, speed_noise=0.0, delay=0.0)
    arm = abs(lengths.l - lengths.h)
    in_its_place = Geometry(l=arm / 2, h=arm / 2, R=lengths.R)
    twist = stands.body_twist(motion.velocity)
    np.testing.assert_allclose(
        in_x(motion, stands).velocity, in_its_place.wheel_speeds(twist), atol=1e-9
    )
    assert other(stands) == lengths
    assert sorted(partners(lengths)) == [0, 1, 2, 3]
