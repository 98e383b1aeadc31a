"""Kinematics by wheels and pose alone: found where it is, silent where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.errors import NoiseLevel
from identification.fitting.gauge import gauge_basis
from identification.fitting.kinematic_evidence import (
    KinematicEvidence,
    KinematicFit,
    held_by,
    kinematic_effects,
    leaders_of,
    slipping_wheels,
)
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.registry import MECHANISMS
from tests.identification.recordings import recording
from tests.sparing import mostly_slow
from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.geometry import Geometry

PAPER = load_model("paper")
BASE = Mecanum(Geometry())
ODD = (("error_fl", 0.02), ("error_fr", -0.01), ("error_bl", 0.0), ("error_br", -0.01))
WORN = tuple((key, value / 4) for key, value in ODD)


def fitted(log: Log, name: str) -> KinematicFit:
    evidence = KinematicEvidence(BASE, PAPER.theta, [BASE.samples(log)])
    mechanism = BASE.extended(name)
    return evidence.fitted(mechanism, mechanism.extend_theta(PAPER.theta, name, {}), [name])


def explained(log: Log, name: str) -> float:
    """Share of the squares that an effect explains, held out."""
    evidence = KinematicEvidence(BASE, PAPER.theta, [BASE.samples(log)])
    return 1.0 - fitted(log, name).square / evidence.at(BASE, PAPER.theta).square


@pytest.mark.parametrize("pose", [True, False])
@pytest.mark.parametrize("size", mostly_slow([ODD, WORN], [WORN]))
def test_uneven_radii_come_back_within_their_intervals(size, pose: bool):
    log = recording(effects=(("wheel_radius_error", size),))
    log = log if pose else replace(log, pose=None)
    found = fitted(log, "wheel_radius_error")
    apart = found.theta[found.own] - np.array([value for _, value in size])
    assert (np.abs(apart) < 4 * np.sqrt(np.diag(found.covariance)) + 1e-12).all()
    assert np.abs(apart).max() < 0.02 * np.ptp([value for _, value in size])
    assert found.p_value < 1e-6 and explained(log, "wheel_radius_error") > 0.9


def rolled(error: np.ndarray) -> Log:
    """A minute of wheels whose radii differ, as their speeds alone show it."""
    time, rng = np.arange(0, 60, 0.02), np.random.default_rng(1)
    waves = np.sin(np.outer(time, [1.1, 0.7, 0.9]) + [0.0, 1.0, 2.0]) * [0.3, 0.3, 0.8]
    rates = dynamics.joint_rates(np, BASE.structure, BASE.geometry, PAPER.theta, tuple(waves.T))
    speed = np.stack(rates, axis=1) / (1.0 + error) + 0.01 * rng.standard_normal((len(time), 4))
    return Log("minute", BASE.joints, time, speed, 0.0 * speed)


@pytest.mark.parametrize("signs", [(1, -1, 1, -1), (1, -1, -1, 1)])
def test_a_worn_set_is_named_beside_roller_angles_too_small_to_matter(signs):
    # Wheels of one side, or of a diagonal, that differ by 1 % from the others: without a pose,
    # rollers that stand askew by a third of a degree explain their speeds as well.
    log = rolled(0.005 * np.array(signs))
    names = ("wheel_radius_error", "speed_gain_error", "roller_angle_error")
    tried = {name: fitted(log, name) for name in names}
    before = KinematicEvidence(BASE, PAPER.theta, [BASE.samples(log)]).at(BASE, PAPER.theta)
    assert tried["roller_angle_error"].size < 0.2
    assert tried["roller_angle_error"].square < 1.02 * tried["wheel_radius_error"].square
    assert set(leaders_of(before, tried)) == set(names)


def test_radius_and_gain_explain_the_wheels_alike_and_nothing_else_does():
    log = replace(recording(effects=(("wheel_radius_error", ODD),)), pose=None)
    radius, gain = (explained(log, name) for name in ("wheel_radius_error", "speed_gain_error"))
    assert abs(radius - gain) < 1e-3
    for name in ("roller_angle_error", "speed_filter", "wheel_creep"):
        assert explained(log, name) < radius - 0.05


def test_filtered_speeds_are_late_beside_a_pose_and_alone_they_are_not_seen():
    log = recording(effects=(("speed_filter", (("time_constant", 0.05),)),))
    found = fitted(log, "speed_filter")
    assert found.theta[-1] == pytest.approx(0.05, abs=0.002)
    assert explained(log, "speed_filter") > 0.9
    alone = fitted(replace(log, pose=None), "speed_filter")
    assert len(alone.seen) == 0 and alone.p_value == 1.0


@pytest.mark.slow
def test_rollers_of_another_angle_are_seen_by_the_pose():
    size = tuple((f"error_{wheel}", -0.035) for wheel in ("fl", "fr", "bl", "br"))
    found = fitted(recording(effects=(("roller_angle_error", size),)), "roller_angle_error")
    np.testing.assert_allclose(found.theta[found.own], -0.035, atol=5e-4)


def test_a_pose_of_another_scale_direction_and_place_is_no_kinematics():
    log = recording()
    assert log.pose is not None
    c, s = np.cos(log.pose[:, 2]), np.sin(log.pose[:, 2])
    tracked = log.pose[:, :2] + np.column_stack([0.1 * c - 0.05 * s, 0.1 * s + 0.05 * c])
    moved = replace(log, pose=np.column_stack([1.05 * tracked, log.pose[:, 2] + 0.03]))
    for name in kinematic_effects(BASE):
        found = fitted(moved, name)
        assert found.size < 0.1 or found.p_value > 0.001, name


def test_nothing_is_found_where_nothing_is():
    for log in (recording(), replace(recording(), pose=None)):
        for name in kinematic_effects(BASE):
            found = fitted(log, name)
            assert found.size < 0.1 or not len(found.seen), name
            assert explained(log, name) < 0.2, name


def test_what_wheels_settle_is_left_alone_by_forces():
    log = replace(recording(effects=(("wheel_radius_error", ODD),)), pose=None)
    found = fitted(log, "wheel_radius_error")
    held = held_by(found, "wheel_radius_error")
    assert len(held.directions) == 3
    free = gauge_basis(found.mechanism.holding([held]))
    assert np.abs(free[-4:]).max() < 1e-9 and free.shape[1] == 7
    # The wheels do not see an angle that all rollers share, nor one of front against back.
    angle = fitted(log, "roller_angle_error")
    held = held_by(angle, "roller_angle_error")
    basis = gauge_basis(angle.mechanism.holding([held]))
    assert basis.shape[1] == 9
    for unseen in ((1, 1, 1, 1), (1, 1, -1, -1)):
        assert np.abs(np.array(held.directions) @ unseen).max() < 0.01


def slipping(log: Log, size: float) -> Log:
    """The log with one wheel that turns too fast in every tenth second."""
    bursts = (np.floor(log.time) % 10 == 0)[:, None] * np.array([0.0, 1.0, 0.0, 0.0])
    return replace(log, velocity=log.velocity + size * bursts)


def test_slip_is_seen_when_it_is_there_and_only_then():
    for size, most, seen in ((0.0, 1e-3, 0.0), (2.0, 0.2, 0.1)):
        samples = BASE.samples(slipping(recording(), size))
        noise = [NoiseLevel.of(samples).speed]
        found = slipping_wheels(BASE, PAPER.theta, [samples], noise)
        assert found.share <= most and (found.share > 0.01) == (size > 0)
        assert np.mean(found.slips[0]) == pytest.approx(seen, abs=0.02)


def test_slip_that_a_radius_explains_is_none():
    samples = BASE.samples(recording(effects=(("wheel_radius_error", ODD),)))
    noise = [NoiseLevel.of(samples).speed]
    assert slipping_wheels(BASE, PAPER.theta, [samples], noise).share > 0.005
    model = PAPER.with_effect("wheel_radius_error", **dict(ODD))
    known = BASE.with_effects(["wheel_radius_error"])
    assert slipping_wheels(known, model.theta, [samples], noise).share < 1e-3


def test_one_axis_has_no_such_evidence():
    conventions = MECHANISMS["axis"]().conventions
    assert not conventions.kind.internal(conventions.kind.geometry)
