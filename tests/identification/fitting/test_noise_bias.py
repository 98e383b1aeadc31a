"""The last fit: sizes whose stated deviations are true."""

from __future__ import annotations

import numpy as np
import pytest

from identification.fitting.errors import NoiseLevel
from identification.fitting.final_fit import final_fit
from identification.fitting.least_squares import fit
from identification.fitting.noise_bias import joint_fit
from identification.fitting.settings import FitSettings
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.mecanum import mecanum_structure

COULOMB = (("wheel_coulomb_friction", (("torque", 0.3),)),)
STRIBECK = (
    (
        "wheel_stribeck_friction",
        (("torque", 0.15), ("breakaway", 0.2), ("stribeck_speed", 0.8)),
    ),
)


def at_hand(effects, seeds=(1, 2)):
    """Mechanism, samples, noise levels and the true theta of recordings with effects."""
    truth = load_model("paper")
    for name, values in effects:
        truth = truth.with_effect(name, **dict(values))
    mechanism = Mecanum(truth.geometry, mecanum_structure(tuple(name for name, _ in effects)))
    logs = [recording("calibration", effects, seed=seed) for seed in seeds]
    samples = [mechanism.samples(log) for log in logs]
    return mechanism, samples, [NoiseLevel.of(item) for item in samples], truth.theta


def off_by(found, truth, index):
    """Standard deviations by which a parameter is off."""
    place = list(found.free).index(index)
    return abs(found.theta[index] - truth[index]) / found.std[place]


def test_noise_on_the_speeds_no_longer_biases_dry_friction():
    mechanism, samples, noise, truth = at_hand(COULOMB)
    torque = 7
    plain = fit(mechanism, samples, truth)
    final = final_fit(mechanism, samples, noise, truth, seed=0)
    assert off_by(plain, truth, torque) > 3.5  # so that there is something to cure
    assert off_by(final, truth, torque) < 2.5


def test_a_searched_shape_is_fitted_and_carries_its_uncertainty():
    mechanism, samples, noise, truth = at_hand(STRIBECK)
    start = truth.copy()
    speed = mechanism.parameter_names.index("wheel_stribeck_friction.stribeck_speed")
    start[speed] = 0.65  # where a grid may have stopped
    free = joint_fit(mechanism, samples, start)
    assert speed in free.free and not mechanism.free[speed]
    assert free.theta[speed] == pytest.approx(0.8, abs=0.05)
    breakaway = mechanism.parameter_names.index("wheel_stribeck_friction.breakaway")
    final = final_fit(mechanism, samples, noise, start, seed=0)
    assert off_by(final, truth, breakaway) < 3.0


def test_the_last_fit_is_the_same_each_time():
    mechanism, samples, noise, truth = at_hand(COULOMB)
    first, again = (final_fit(mechanism, samples, noise, truth, seed=3) for _ in range(2))
    assert np.array_equal(first.theta, again.theta)
    assert np.array_equal(first.covariance, again.covariance)


def test_what_an_early_end_left_of_a_search_is_no_bias():
    mechanism, samples, _, truth = at_hand(STRIBECK, seeds=(1,))
    start = truth.copy()
    start[mechanism.parameter_names.index("wheel_stribeck_friction.stribeck_speed")] = 0.5
    early = FitSettings(max_steps=1)
    none = [NoiseLevel(np.zeros(4), np.zeros(4))]
    found = joint_fit(mechanism, samples, start, early)
    final = final_fit(mechanism, samples, none, start, seed=0, settings=early)
    np.testing.assert_allclose(final.theta, found.theta, rtol=1e-12)


def test_the_instant_of_a_load_comes_back_with_its_uncertainty():
    load = (("payload_change", (("mass", 8.0), ("x", 0.1), ("y", -0.05), ("time", 27.3))),)
    mechanism, samples, noise, truth = at_hand(load, seeds=(1,))
    time = list(mechanism.parameter_names).index("payload_change.time")
    start = truth.copy()
    start[time] += 0.3  # what a search over instants leaves
    found = final_fit(mechanism, samples, noise, start, seed=0)
    assert off_by(found, truth, time) < 3.0
    assert found.std[list(found.free).index(time)] < 0.1


def test_gains_come_back_though_torques_cancel_on_the_way():
    gains = {"gain_fl": 0.08, "gain_fr": 0.08, "gain_bl": 0.08, "gain_br": -0.24}
    effects = (("torque_gain_error", tuple(gains.items())),)
    mechanism, samples, noise, truth = at_hand(effects)
    final = final_fit(mechanism, samples, noise, truth, seed=0)
    assert final.theta[7:] - final.theta[7:].mean() == pytest.approx(list(gains.values()), abs=3e-3)


def test_columns_under_load_are_the_slopes_of_the_demand():
    effects = (("load_dependent_friction", (("share", 0.4),)), ("torque_gain_error", ()))
    mechanism, samples, _, truth = at_hand(effects, seeds=(1,))
    free = np.flatnonzero(mechanism.free)
    columns = mechanism.demand(truth, samples[0]).columns(free)
    for k, index in enumerate(free):
        step = 1e-4 / mechanism.scale[index]
        ends = []
        for sign in (1.0, -1.0):
            moved = truth.copy()
            moved[index] += sign * step
            ends.append(mechanism.demand(moved, samples[0]).force)
        slope = (ends[0] - ends[1]) / (2 * step)
        error = np.sqrt(np.mean((columns[k] - slope) ** 2) / np.mean(slope**2))
        assert error < 0.01, mechanism.parameter_names[index]
