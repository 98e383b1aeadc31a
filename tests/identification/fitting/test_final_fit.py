"""The last fit where speeds are coarse, and intervals where the model is not the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.errors import NoiseLevel
from identification.fitting.final_fit import coarse_speed_warnings, final_fit, without_noise_bias
from identification.fitting.least_squares import Fit, fit
from identification.fitting.noise_bias import extrapolated_fit
from identification.fitting.observability import combinations
from identification.fitting.settings import FitSettings
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import counted, recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")
TILT = (("floor_tilt", (("tilt_x", 0.03), ("tilt_y", 0.02))),)


def deviations(found: Fit, truth: np.ndarray) -> np.ndarray:
    """(F,) error over stated deviation."""
    return (found.theta - truth)[found.free] / found.std


def last(mechanism, samples, start) -> Fit:
    return final_fit(mechanism, samples, [NoiseLevel.of(item) for item in samples], start, 0)


@pytest.mark.parametrize(("counts", "jitter"), [(200, 0.0), (500, 0.001), (4096, 0.0)])
def test_counted_speeds_leave_the_parameters_within_their_deviations(counts, jitter):
    mechanism = Mecanum(PAPER.geometry)
    samples = [mechanism.samples(counted(recording(), counts, jitter))]
    found = last(mechanism, samples, PAPER.theta)
    assert found.in_free_run
    assert np.abs(deviations(found, PAPER.theta)).max() < 3.0
    # The intervals are not just wide: with fine speeds they are 0.3 kg.
    assert found.std[0] < 1.0


def test_a_plain_fit_of_counted_speeds_would_be_off():
    mechanism, short = Mecanum(PAPER.geometry), FitSettings(min_stretches=1000)
    log = counted(recording(), 500, jitter=0.001)

    def off(samples) -> float:
        found = fit(mechanism, [samples], PAPER.theta, settings=short)
        return float(np.abs(deviations(found, PAPER.theta)).max())

    assert off(mechanism.conventions.samples(log, mechanism.geometry, mechanism.settings)) > 3.5
    assert off(mechanism.samples(log)) < 3.0


def test_dry_friction_comes_back_from_counted_speeds():
    effects = (("wheel_coulomb_friction", (("torque", 0.3),)),)
    truth = PAPER.with_effect("wheel_coulomb_friction", torque=0.3)
    mechanism = Mecanum(PAPER.geometry, mecanum_structure(("wheel_coulomb_friction",)))
    samples = [mechanism.samples(counted(recording("I", effects), 1000))]
    noise = [NoiseLevel.of(item) for item in samples]
    start = fit(mechanism, samples, truth.theta)
    found = without_noise_bias(mechanism, samples, noise, start, 0)
    place = list(found.free).index(7)
    assert abs(deviations(found, truth.theta)[place]) < 3.0
    assert found.std[place] < 0.01


def test_counted_speeds_are_said_with_their_step():
    mechanism = Mecanum(PAPER.geometry)
    samples = [mechanism.samples(counted(recording("I"), 500)), mechanism.samples(recording("III"))]
    found = fit(mechanism, samples, PAPER.theta)
    (line,) = coarse_speed_warnings(samples, replace(found, in_free_run=True))
    assert "steps of 1.26 rad/s" in line and "free run" in line
    assert coarse_speed_warnings(samples[1:], found) == []


def test_fine_speeds_stay_as_they_are():
    samples = Mecanum(PAPER.geometry).samples(recording())
    assert samples.angle_noise is None
    assert samples.for_fit is samples


def test_counted_speeds_are_taken_half_a_row_earlier():
    mechanism, log = Mecanum(PAPER.geometry), recording()
    true = mechanism.samples(log).twist[500:9000, 2]
    found = mechanism.samples(counted(log, 4096)).twist[500:9000, 2]
    # The slope of the error on the acceleration is the delay.
    rate = np.gradient(true, log.dt)
    assert abs((found - true) @ rate / (rate @ rate)) < 3e-4


def test_intervals_widen_where_something_is_missing():
    log = recording("calibration", TILT)
    narrow = FitSettings(min_stretches=1000)
    mechanism = Mecanum(PAPER.geometry)
    samples = [mechanism.samples(log)]
    plain = fit(mechanism, samples, PAPER.theta, settings=narrow)
    widened = last(mechanism, samples, PAPER.theta)
    assert (widened.std >= plain.std * 0.999).all()
    assert widened.std[0] > 2.0 * plain.std[0]


def test_intervals_hardly_widen_where_the_model_is_true():
    mechanism = Mecanum(PAPER.geometry)
    samples = [mechanism.samples(recording())]
    plain = fit(mechanism, samples, PAPER.theta, settings=FitSettings(min_stretches=1000))
    widened = last(mechanism, samples, PAPER.theta)
    assert (widened.std / plain.std).mean() < 1.3


def test_sums_are_told_where_their_members_do_not_separate():
    mechanism = Mecanum(PAPER.geometry)
    found = fit(mechanism, [mechanism.samples(recording())], PAPER.theta)
    assert combinations(mechanism, found) == {}, "all parameters are well known"
    names = [mechanism.parameter_names[k] for k in found.free]
    mass, spin = names.index("m0"), names.index("I1")
    factor = 4 / PAPER.geometry.R**2
    apart = np.zeros(len(names))
    apart[mass], apart[spin] = 2.0, -2.0 / factor
    told = combinations(
        mechanism, replace(found, covariance=found.covariance + np.outer(apart, apart))
    )
    assert list(told) == ["m0 + 4 I1/R^2"]
    value, std, unit = told["m0 + 4 I1/R^2"]
    assert value == pytest.approx(found.theta[mass] + factor * found.theta[spin])
    assert std < 0.3 and unit == "kg"


def test_what_two_fits_differ_by_by_chance_widens_no_interval():
    """Noise of a true model makes the fits of forces and of the free run differ a little."""
    mechanism = Mecanum(PAPER.geometry)
    widened = []
    for seed in range(3):
        samples = [mechanism.samples(recording("calibration", seed=seed))]
        noise = [NoiseLevel.of(item) for item in samples]
        found = fit(mechanism, samples, PAPER.theta)
        undone = extrapolated_fit(mechanism, samples, noise, found, 0)
        widened.append(last(mechanism, samples, PAPER.theta).std / undone.std)
    # With the whole difference it is 1.11.
    assert np.mean(widened) < 1.06


def test_offsets_that_wander_are_in_the_intervals_of_one_calibration_motion():
    """Two waves in a log: centripetal forces are constant too, and masses take what is left."""
    mechanism, settings = Mecanum(PAPER.geometry), FitSettings()
    short = replace(settings, min_stretches=1000)
    log = recording("calibration")
    turns = np.arange(len(log.time)) / len(log.time)
    off: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(6):
        phase = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (2, 4))
        waves = sum(np.sin(2 * np.pi * k * turns[:, None] + phase[k - 1]) for k in (1, 2))
        samples = [mechanism.samples(replace(log, effort=log.effort + 0.02 * waves))]
        for wide in off:
            found = fit(mechanism, samples, PAPER.theta, settings=settings if wide else short)
            off[wide].append(float(np.sqrt(np.mean(deviations(found, PAPER.theta) ** 2))))
    assert np.mean(off[False]) > 2.0
    # Not 1: a wave of 140 s is longer than a stretch.
    assert np.mean(off[True]) < 1.5
