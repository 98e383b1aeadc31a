"""What coarse channels leave of the true model, and what only a missing effect leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.coarse_channels import (
    are_coarse,
    are_counted,
    measured_again,
    rounded,
    step_beyond_noise,
)
from identification.fitting.least_squares import fit
from identification.fitting.predictability import Predictability, predictability
from identification.fitting.settings import PredictabilitySettings
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import counted, recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.mecanum import mecanum_structure

SETTINGS = PredictabilitySettings()
COULOMB = "wheel_coulomb_friction"
PAPER = load_model("paper")
TRUTH = PAPER.with_effect(COULOMB, torque=0.3)
LOG = ("calibration", ((COULOMB, (("torque", 0.3),)),))


def left_by(effects: tuple[str, ...], counts: int = 500) -> tuple[Predictability, Predictability]:
    """What is predictable of a fit, without and with the knowledge of the counting."""
    mechanism = Mecanum(PAPER.geometry, mecanum_structure(effects))
    samples = [mechanism.samples(counted(recording(*LOG), counts))]
    start = TRUTH.theta if effects else PAPER.theta
    fitted = fit(mechanism, samples, start)
    plain = predictability(mechanism, fitted.rows, samples)
    return plain, predictability(mechanism, fitted.rows, samples, theta=fitted.theta)


def test_creeping_wheels_make_a_true_model_s_residual_predictable_and_that_is_known():
    plain, informed = left_by((COULOMB,))
    assert not plain.is_noise and plain.share > 0.15
    assert informed.is_noise and informed.share == plain.share
    assert informed.systematic_share == 0.0


def test_what_is_missing_is_no_matter_of_counting():
    _, informed = left_by(())
    assert not informed.is_noise
    assert informed.share_of_motion > 0.4


def test_a_run_is_counted_like_the_log():
    mechanism = Mecanum(PAPER.geometry, mecanum_structure((COULOMB,)))
    samples = [mechanism.samples(counted(recording(*LOG), 500)), mechanism.samples(recording(*LOG))]
    assert are_counted(samples) and not are_counted(samples[1:])
    runs = measured_again(mechanism, TRUTH.theta, samples, 0, SETTINGS)
    assert runs is not None
    # Half steps, since a speed at a sample is the mean of two differences.
    step = np.pi / 500 / samples[0].dt
    places = runs[0].wheel_speed[1:-1] / step
    size = np.median(np.abs(np.diff(np.unique(np.round(places, 3)))))
    assert size == pytest.approx(1.0, rel=0.1)
    errors = [runs[k].wheel_speed - samples[1].wheel_speed for k in (0, 1)]
    assert errors[0].std() > 5 * errors[1].std()
    assert runs[0].torque is samples[0].torque


def test_a_run_that_diverges_tells_nothing():
    mechanism = Mecanum(PAPER.geometry)
    samples = [mechanism.samples(counted(recording("I"), 500))]
    pushed = PAPER.theta.copy()
    pushed[mechanism.parameter_names.index("mu1")] = -1e3
    assert measured_again(mechanism, pushed, samples, 0, SETTINGS) is None


def coarse(log: Log, step: float) -> Log:
    """The log with torques in steps [N m]."""
    return replace(log, effort=rounded(log.effort, step))


@pytest.mark.parametrize(("noise", "step", "found"), [(0.02, 0.2, 0.2), (1.0, 0.02, 0.0)])
def test_steps_matter_where_noise_is_smaller(noise: float, step: float, found: float):
    log = coarse(recording("I", noise=noise), step)
    assert step_beyond_noise(log.effort, SETTINGS) == pytest.approx(found)
    samples = [Mecanum(PAPER.geometry).samples(log)]
    assert are_coarse(samples, SETTINGS) == bool(found)
    assert step_beyond_noise(recording("I").effort, SETTINGS) == 0.0


def test_torques_in_steps_are_noise_and_what_is_missing_is_not():
    mechanism = Mecanum(PAPER.geometry)
    for effects, noise in (((), True), (((COULOMB, (("torque", 0.3),)),), False)):
        log = coarse(recording("calibration", effects, noise=0.02), 0.2)
        samples = [mechanism.samples(log)]
        fitted = fit(mechanism, samples, PAPER.theta)
        informed = predictability(mechanism, fitted.rows, samples, theta=fitted.theta)
        assert informed.is_noise == noise
        # Without the knowledge of the steps even the true model would seem to lack something.
        assert informed.share > SETTINGS.max_noise_share
