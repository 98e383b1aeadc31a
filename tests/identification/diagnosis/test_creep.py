"""Wheels that creep in a simulator of its own: told as that alone, and as no change of a robot."""

from dataclasses import replace

import pytest

from identification import identify
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.report import Diagnosis
from identification.logs.log import Log
from tests.identification.creeping_platform import creeping_logs
from youbot_env.model.model_file import load_model


@pytest.fixture(scope="module")
def creeping() -> list[Log]:
    """2000 N s/m: 0.44 rad/s of a wheel for each N m that the floor takes."""
    return creeping_logs(2000.0)


@pytest.fixture(scope="module")
def found(creeping: list[Log]) -> Diagnosis:
    return diagnose(identify(creeping).model, creeping)


def test_creep_is_all_that_is_missing(found: Diagnosis):
    """By the force on the floor, not by the torque of the catalogue's creep: what that leaves looks
    like rollers that stand askew, and is none."""
    assert found.verdict == "effect" and found.missing == ("wheel_creep",)
    # The floor takes the torque less the friction of the joint, so the size lies below.
    assert 0.2 < found.model.values["wheel_creep.slip"] < 0.44


def test_what_only_the_pose_shows_is_no_fall_of_the_force_error(found: Diagnosis):
    assert found.steps[-1].force_error > 0.98 * found.steps[0].force_error
    told = "The model lacks wheel creep: the wheel speeds and the pose show it; the force error is"
    assert found.summary().startswith(told)
    assert "falls" not in found.summary()


def test_a_model_of_the_same_logs_has_not_changed(found: Diagnosis):
    """Mass and friction are others with the creep in the model; the robot is the same."""
    assert found.changes.rows
    mass = next(row for row in found.changes.rows if row.name == "m0")
    assert abs(mass.size) > 3 * mass.std
    assert found.changes.sentences == []


@pytest.mark.slow
def test_logs_without_a_pose_say_nothing_of_creep_alone(creeping: list[Log]):
    """Forces hold it as rollers askew or late torques do: a set, or nothing; never one name."""
    logs = [replace(log, pose=None) for log in creeping]
    found = diagnose(identify(logs).model, logs)
    assert found.verdict in ("adequate", "ambiguous")
    assert found.steps[-1].force_error > 0.9 * found.steps[0].force_error


@pytest.mark.slow
def test_a_creep_with_which_forces_fit_worse_is_left_out_and_said():
    """The torque of a dry friction jumps where the wheel turns round; the floor's force does not,
    and so the creep does not either."""
    found = diagnose(load_model("paper"), creeping_logs(6000.0, coulomb=0.15, seed=14))
    assert found.verdict == "effect" and found.missing == ("wheel_coulomb_friction",)
    torque = found.model.values["wheel_coulomb_friction.torque"]
    assert torque == pytest.approx(0.15, rel=0.03)
    assert "speak for wheel creep" in found.first_warnings[0] and found.proposal is None
