"""Lags and delays: found without bias, and never at the price of the measured torque."""

import numpy as np
import pytest

from identification.fitting.errors import SumsOfSquares, force_traces, velocity_traces
from identification.fitting.identify import identify
from identification.fitting.least_squares import fit
from identification.logs.reading import read_log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.physical_parameters import fitted_model
from tests.identification.recordings import recording
from tests.identification.shared_data import DATA, needs_data, theta, truth
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")


def fitted(name, values, rate=100.0, noise=1.0, seed=3):
    log = recording(effects=((name, tuple(values.items())),), rate=rate, noise=noise, seed=seed)
    engine = Mecanum(Geometry(), mecanum_structure((name,)))
    samples = engine.samples(log)
    return engine, samples, fit(engine, [samples], PAPER.with_effect(name).theta)


@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0])
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("actuator_lag", {"time_constant": 0.03}),
        ("actuator_lag", {"time_constant": 0.1}),
        ("torque_delay", {"delay": 0.0137}),
        ("torque_delay", {"delay": 0.06}),
    ],
)
def test_late_torques_come_back_within_their_deviations(name, values, rate):
    _, _, found = fitted(name, values, rate)
    true = PAPER.with_effect(name, **values).theta
    assert (np.abs(found.theta - true) < 3.3 * found.std).all()
    assert found.std[-1] < 0.001, "a tenth of a sample"


@needs_data
def test_the_lag_of_a_given_platform():
    engine = Mecanum(Geometry(), mecanum_structure(("actuator_lag",)))
    samples = [engine.samples(read_log(DATA / "actuator_lag" / "calibration.csv"))]
    found = fit(engine, samples, PAPER.with_effect("actuator_lag").theta)
    lag = truth_of_lag()
    assert abs(found.theta[-1] - lag) < 3 * found.std[-1]
    assert (np.abs(found.theta[:-1] - theta(truth("actuator_lag"))) < 3 * found.std[:-1]).all()


def truth_of_lag() -> float:
    import json

    return json.loads((DATA / "actuator_lag" / "truth.json").read_text())["effects"]["lag"]


@pytest.mark.parametrize("name", ["actuator_lag", "torque_delay"])
def test_a_prompt_platform_is_found_prompt(name):
    """Neither a smoothed rate nor an interpolated force makes a lag out of noise."""
    engine = Mecanum(Geometry(), mecanum_structure((name,)))
    found = fit(engine, [engine.samples(recording(seed=4))], PAPER.with_effect(name).theta)
    assert abs(found.theta[-1]) < max(3 * found.std[-1], 1e-4)


def test_the_right_delay_reaches_the_noise_of_the_prompt_platform():
    late = recording(effects=(("torque_delay", (("delay", 0.0237),)),), seed=4)
    engine = Mecanum(Geometry(), mecanum_structure(("torque_delay",)))
    samples = engine.samples(late)
    errors = {}
    for delay in (0.0, 0.0237):
        at = PAPER.with_effect("torque_delay", delay=delay).theta
        errors[delay] = [
            SumsOfSquares.of(traces(engine, at, samples)).ratio
            for traces in (force_traces, velocity_traces)
        ]
    base = Mecanum(Geometry(), mecanum_structure())
    plain = base.samples(recording(seed=4))
    floor = [
        SumsOfSquares.of(traces(base, PAPER.theta, plain)).ratio
        for traces in (force_traces, velocity_traces)
    ]
    for k in range(2):
        assert errors[0.0237][k] == pytest.approx(floor[k], rel=0.1)
        assert errors[0.0][k] > 3 * floor[k]


def test_a_log_whose_torques_are_late_has_a_negative_delay():
    engine = Mecanum(Geometry(), mecanum_structure(("torque_delay",)))
    samples = engine.samples(recording(seed=5))
    moved = type(samples)(**{**vars(samples), "torque": np.roll(samples.torque, 3, axis=0)})
    found = fit(engine, [moved], PAPER.with_effect("torque_delay").theta)
    assert found.theta[-1] == pytest.approx(-0.03, abs=3 * found.std[-1])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tether", {"stiffness": 5.0, "anchor_x": 1.0, "anchor_y": -0.5}),
        ("torque_ripple", {"amplitude": 0.2, "phase_fl": 0.5, "phase_fr": 0.5, "cycles": 6.0}),
        ("torque_delay", {"delay": 0.02}),
    ],
)
def test_effects_in_a_form_of_their_own_are_identified_and_stored(name, values):
    log = recording(effects=((name, tuple(values.items())),), noise=0.5, seed=6)
    shapes = {key: value for key, value in values.items() if key == "cycles"}
    found = identify([log], start=PAPER.with_effect(name, **shapes), recursive=False).model
    for key, value in values.items():
        estimate = found.effects[name][key]
        assert (estimate.std is None) == (key == "cycles")
        assert estimate.value == pytest.approx(value, rel=0.1, abs=0.02)
    again = model_from_dict(model_to_dict(found))
    assert again.values == found.values and again.covariance_names == found.covariance_names


def test_a_constant_pull_is_a_tether_to_a_far_anchor():
    """A tilt is the limit of a tether; what is stored must say the same as what was fitted."""
    tilt = (("floor_tilt", (("tilt_x", 0.02), ("tilt_y", -0.01))),)
    engine = Mecanum(Geometry(), mecanum_structure(("tether",)))
    samples = engine.samples(recording(effects=tilt, seed=7))
    found = fit(engine, [samples], PAPER.with_effect("tether").theta)
    model = fitted_model(engine, found)
    np.testing.assert_allclose(model.theta, found.theta, rtol=1e-9)
    assert np.hypot(model.values["tether.anchor_x"], model.values["tether.anchor_y"]) > 20
    pull = found.theta[-2:]
    np.testing.assert_allclose(pull, [-0.02 * 35.3 * 9.807, 0.01 * 35.3 * 9.807], rtol=0.1)


def test_a_payload_that_is_not_there_is_found_light():
    engine = Mecanum(Geometry(), mecanum_structure(("payload_change",)))
    start = PAPER.with_effect("payload_change", time=70.0)
    found = fit(engine, [engine.samples(recording(rate=50.0, seed=8))], start.theta)
    model = fitted_model(engine, found)
    assert model.values["payload_change.mass"] < 1.0
    np.testing.assert_allclose(model.theta, found.theta, rtol=1e-9)
