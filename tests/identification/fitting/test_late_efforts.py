"""One effort that is logged later than the others is named, and nothing else is taken for it."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from identification.diagnosis.diagnose import diagnose
from identification.doctor import faults_of_joints
from identification.fitting.identify import identify
from identification.fitting.kinematic_evidence import TellingSlip
from identification.fitting.late_efforts import late_efforts
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.signals.resampling import low_passed
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import WHEELS
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")
BASE = Mecanum(PAPER.geometry)


def later(log: Log, wheels: str, delay: float) -> Log:
    """The log with the efforts of some wheels so much later [s]."""
    effort = log.effort.copy()
    for k in (WHEELS.index(wheel) for wheel in wheels.split()):
        effort[:, k] = np.interp(log.time - delay, log.time, effort[:, k])
    return replace(log, effort=effort)


def found_in(log: Log, mechanism: Mecanum = BASE, theta: np.ndarray = PAPER.theta):
    return late_efforts(mechanism, theta, [mechanism.samples(log)])


@pytest.mark.parametrize("wheel", ["fl", "br"])
@pytest.mark.parametrize("delay", [0.04, 0.08])
def test_a_late_effort_is_named_with_its_delay(wheel, delay):
    late = found_in(later(recording(), wheel, delay))
    assert late is not None and late.late == (f"effort_{wheel}",)
    assert abs(late.delay - delay) < 3.0 * late.std and late.std < 0.006
    assert f"effort_{wheel} comes" in late.words and "after the other efforts" in late.words


def test_an_effort_that_comes_too_soon_is_named_too():
    late = found_in(later(recording(), "fr", -0.05))
    assert late is not None and late.early == ("effort_fr",)
    assert abs(late.delay - 0.05) < 3.0 * late.std
    assert "effort_fr comes" in late.brief and "before the other efforts" in late.brief
    assert "of effort_fr the drives act late" in late.words


def test_two_late_efforts_are_named_together():
    late = found_in(later(recording(), "fl bl", 0.05))
    assert late is not None and late.late == ("effort_fl", "effort_bl")
    assert "effort_fl and effort_bl come" in late.brief
    assert late.brief.endswith("after effort_fr and effort_br")


@pytest.mark.parametrize("rate", [50.0, 500.0])
def test_the_rate_of_the_log_does_not_matter(rate):
    late = found_in(later(recording(rate=rate), "bl", 0.06))
    assert late is not None and late.late == ("effort_bl",)
    assert abs(late.delay - 0.06) < 3.0 * late.std


ELSE = (
    (),
    (("actuator_lag", (("time_constant", 0.08),)),),
    (("torque_delay", (("delay", 0.05),)),),
    (("wheel_coulomb_friction", (("torque", 0.25),)),),
    (("uneven_coulomb_friction", (("extra_fl", 0.2),)),),
    (("uneven_wheel_friction", (("extra_fr", 0.08),)),),
    (("torque_gain_error", (("gain_fl", 0.1), ("gain_fr", -0.1))),),
    (("roller_inertia", (("inertia", 1e-3),)),),
    (("floor_tilt", (("tilt_x", 0.02),)),),
)


@pytest.mark.parametrize("effects", ELSE)
def test_nothing_else_is_taken_for_a_late_effort(effects):
    assert found_in(recording(effects=effects)) is None


def test_all_efforts_late_by_one_time_are_no_fault_of_one():
    assert found_in(later(recording(), "fl fr bl br", 0.05)) is None


def test_coloured_noise_is_no_delay():
    log, rng = recording(), np.random.default_rng(5)
    noise = low_passed(rng.standard_normal(log.effort.shape), 1.0, log.dt)
    assert found_in(replace(log, effort=log.effort + 0.3 * noise / noise.std())) is None


def test_wheels_that_slip_now_and_then_are_no_late_effort():
    log, rng = recording(), np.random.default_rng(3)
    slips = (log.time % 10.0 < 0.7)[:, None] * (np.arange(4) == 1)
    speed = log.velocity * (1 + 0.3 * slips) + 0.0 * rng.standard_normal(log.velocity.shape)
    assert found_in(replace(log, velocity=speed)) is None


def test_a_known_lag_hides_no_late_effort():
    effects = (("actuator_lag", (("time_constant", 0.08),)),)
    model = PAPER.with_effect("actuator_lag", time_constant=0.08)
    mechanism = Mecanum(model.geometry, mecanum_structure(("actuator_lag",)))
    late = found_in(later(recording(effects=effects), "fl", 0.05), mechanism, model.theta)
    assert late is not None and late.late == ("effort_fl",)
    assert abs(late.delay - 0.05) < 3.0 * late.std


def test_a_motion_along_one_axis_tells_nothing():
    log = recording()
    speed = np.tile(log.velocity.mean(axis=1, keepdims=True), 4)
    effort = np.tile(log.effort.mean(axis=1, keepdims=True), 4)
    noise = 0.03 * np.random.default_rng(1).standard_normal(effort.shape)
    found_in(replace(log, velocity=speed, effort=effort + noise))


@pytest.mark.parametrize("rows", [30, 120, 400])
def test_short_logs_tell_nothing(rows):
    log = recording()
    short = replace(
        log,
        time=log.time[:rows],
        velocity=log.velocity[:rows],
        effort=log.effort[:rows],
        pose=None if log.pose is None else log.pose[:rows],
    )
    assert found_in(later(short, "fl", 0.04)) is None


def test_doctor_and_identify_say_it():
    log = later(recording(), "fl", 0.06)
    messages = [found.message for found in faults_of_joints(log, BASE, PAPER.theta)]
    assert len(messages) == 1 and "effort_fl comes" in messages[0]
    assert not faults_of_joints(recording(), BASE, PAPER.theta)
    found = identify([log], recursive=False)
    assert any("effort_fl comes" in line for line in found.first_warnings)


def test_doctor_says_that_a_speed_swings_with_its_wheel_or_comes_late():
    log = recording()
    samples, speed = BASE.samples(log), log.velocity.copy()
    speed[:, 1] *= 1 + 0.05 * np.cos(samples.wheel_angle[:, 1])
    messages = [
        found.message for found in faults_of_joints(replace(log, velocity=speed), BASE, PAPER.theta)
    ]
    assert len(messages) == 1
    assert "speeds swing with the wheel's own angle (front right by 5" in messages[0]


def test_diagnose_says_it_first_and_proposes_no_law():
    log = later(recording(), "fl", 0.08)
    found = diagnose(PAPER, [log], effects=["wheel_coulomb_friction"])
    assert found.late is not None and found.late.late == ("effort_fl",)
    assert found.proposal is None and found.slip is None
    assert found.first_warnings[0].startswith("effort_fl comes")
    if found.verdict == "unknown":
        assert found.summary().startswith("effort_fl comes")
    assert found.to_dict()["late"]["early"] == ["effort_fr", "effort_bl", "effort_br"]


def test_late_efforts_and_slip_are_told_in_one_order(monkeypatch):
    """In the headline, in words and in warnings alike; and no law is sought."""
    late = found_in(later(recording(), "fl", 0.08))
    slip = TellingSlip(0.04, imitators=("yaw_scrub",))
    module = import_module("identification.diagnosis.diagnose")
    monkeypatch.setattr(module, "telling_slip", lambda *_: slip)
    monkeypatch.setattr(module, "late_efforts_of", lambda *_: late)
    monkeypatch.setattr(module, "propose", None)
    tilted = recording(effects=(("floor_tilt", (("tilt_x", 0.02),)),))
    found = diagnose(PAPER, [tilted], effects=["roller_inertia"])
    assert late is not None and found.verdict == "unknown" and not found.missing
    told = [late.words, slip.words]
    assert "yaw scrub would act like it" in slip.words
    assert list(found.first_warnings[-2:]) == told and list(found.sentences[:2]) == told
    assert found.summary().startswith("effort_fl comes")
