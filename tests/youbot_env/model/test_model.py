"""A model's own checks, its uncertainty, and its linearisation."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, model
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.simulation.free_run import initial_state

BASE = model("base")


def with_covariance(m: Model, **std: float) -> Model:
    names = tuple(name.replace("__", ".") for name in std)
    return replace(m, covariance=np.diag(np.square([*std.values()])), covariance_names=names)


# --- linearisation ---------------------------------------------------------------------------


def test_linearisation_of_the_base_model_at_rest_is_analytic():
    """At rest no Coriolis term is left: A = -M^-1 D for the twist, and the twist moves the rest."""
    A, B = BASE.linearise(initial_state(BASE, pose=(1.0, 2.0, 0.7)), np.zeros(4))
    v, g = BASE.values, BASE.geometry
    wheel, roller = 4 * v["mu1"] / g.R**2, 8 * v["mu2"] / g.r**2
    damping = np.diag([wheel, wheel + roller, wheel * g.L**2 + roller * g.h**2])
    mass = BASE.mass_matrix()
    np.testing.assert_allclose(A[:3, :3], -np.linalg.solve(mass, damping), atol=1e-9)
    np.testing.assert_allclose(A[:3, 3:], 0.0, atol=1e-9)
    np.testing.assert_allclose(B[:3], np.linalg.solve(mass, g.wheel_jacobian.T), atol=1e-9)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(A[3:6, :3], [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(A[6:10, :3], g.wheel_jacobian, atol=1e-8)
    np.testing.assert_allclose(A[10], 0.0)
    np.testing.assert_allclose(B[3:], 0.0)


def test_linearisation_of_the_base_model_in_motion_is_analytic():
    """The derivative of the Coriolis and centrifugal terms, by hand."""
    twist = vx, vy, w = 0.4, -0.3, 0.8
    A, _ = BASE.linearise(initial_state(BASE, twist=twist, pose=(0, 0, 0.7)), np.full(4, 0.5))
    at_rest, _ = BASE.linearise(initial_state(BASE), np.zeros(4))
    m0, mx, my = BASE.theta[0], BASE.theta[2], BASE.theta[3]
    coriolis = np.array(
        [
            [0.0, -m0 * w, -m0 * vy - 2 * mx * w],
            [m0 * w, 0.0, m0 * vx - 2 * my * w],
            [mx * w, my * w, mx * vx + my * vy],
        ]
    )
    expected = at_rest[:3, :3] - np.linalg.solve(BASE.mass_matrix(), coriolis)
    np.testing.assert_allclose(A[:3, :3], expected, atol=1e-9)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(A[3:5, 5], [-s * vx - c * vy, c * vx - s * vy], atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_linearisation_predicts_small_changes(case: str):
    m = model(case)
    state = initial_state(m, twist=(0.4, 0.05, 0.1), pose=(0.1, 0.2, 0.3), torque=(0.4,) * 4)
    torque = np.array([0.5, 0.4, 0.6, 0.5])
    A, B = m.linearise(state, torque)
    rng = np.random.default_rng(0)
    dx, du = 1e-5 * rng.normal(size=len(state)), 1e-5 * rng.normal(size=4)
    change = m.state_derivative(state + dx, torque + du) - m.state_derivative(state, torque)
    np.testing.assert_allclose(A @ dx + B @ du, change, rtol=0, atol=1e-8)
    assert np.abs(change).max() > 1e-5


def test_linearisation_of_a_drive_is_its_lag():
    m = model("actuator_lag")
    A, B = m.linearise(initial_state(m), np.zeros(4))
    lag = m.values["actuator_lag.time_constant"]
    np.testing.assert_allclose(A[11:, 11:], -np.eye(4) / lag, atol=1e-7)
    np.testing.assert_allclose(B[11:], np.eye(4) / lag, atol=1e-7)


# --- uncertainty -----------------------------------------------------------------------------


def test_samples_have_the_covariance():
    std = {"m0": 0.5, "I0": 0.1, "aX": 0.002}
    m = with_covariance(BASE, **std)
    correlated = np.array(m.covariance)
    correlated[0, 1] = correlated[1, 0] = 0.8 * std["m0"] * std["I0"]
    m = replace(m, covariance=correlated)
    rng = np.random.default_rng(0)
    drawn = [m.sample(rng) for _ in range(2000)]
    values = np.array([[d.values[name] for name in std] for d in drawn])
    mean = [m.values[name] for name in std]
    spread = np.sqrt(np.diag(correlated))
    np.testing.assert_allclose((values.mean(0) - mean) / spread, 0.0, atol=4 / np.sqrt(2000))
    np.testing.assert_allclose(
        np.cov(values.T) / np.outer(spread, spread), correlated / np.outer(spread, spread), atol=0.1
    )
    assert all(d.values["mu1"] == m.values["mu1"] for d in drawn[:5])
    assert drawn[0].covariance is None


def test_same_seed_same_sample():
    m = with_covariance(BASE, m0=0.5, I0=0.1)
    first, second = (m.sample(np.random.default_rng(3)).values for _ in range(2))
    assert first == second


def test_samples_are_physical():
    """An uncertainty that reaches below zero: what cannot be is drawn again."""
    m = with_covariance(
        model("wheel_coulomb_friction"), mu2=0.02, I1=0.01, wheel_coulomb_friction__torque=0.3
    )
    rng = np.random.default_rng(0)
    drawn = [m.sample(rng).values for _ in range(200)]
    for name in m.covariance_names:
        assert min(d[name] for d in drawn) >= 0
        assert np.std([d[name] for d in drawn]) > 0


def test_sampling_needs_a_covariance_that_reaches_physical_values():
    with pytest.raises(InputError, match="no covariance"):
        BASE.sample(np.random.default_rng(0))
    with pytest.raises(InputError, match="far past physical"):
        with_covariance(BASE, aX=1e6, aY=1e6).sample(np.random.default_rng(0))


# --- what a model refuses --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"m0": -1.0}, "must be positive"),
        ({"m0": 5.0}, "four wheels"),
        ({"I0": 0.0}, "must be positive"),
        ({"mu1": -1e-3}, "must not be negative"),
        ({"aX": np.nan}, "not a finite number"),
        ({"aX": 2.0}, "positive definite"),
        ({"typo": 1.0}, "no parameter 'typo'"),
    ],
)
def test_values_that_cannot_be_are_refused(values: dict[str, float], message: str):
    with pytest.raises(InputError, match=message):
        BASE.with_values(values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"torque": -0.1}, "outside"),
        ({"torque": np.nan}, "not a finite"),
        ({"smoothing": 0.0}, "outside"),
        ({"typo": 1.0}, "no parameter 'typo'"),
    ],
)
def test_effects_out_of_bounds_are_refused(values: dict[str, float], message: str):
    with pytest.raises(InputError, match=message):
        BASE.with_effect("wheel_coulomb_friction", **values)


def test_an_unknown_effect_is_refused_with_those_known():
    with pytest.raises(InputError, match="unknown effect 'rust': .*known are .*floor_tilt"):
        BASE.with_effect("rust")


@pytest.mark.parametrize(
    ("names", "matrix", "message"),
    [
        (("m0", "mass"), np.eye(2), "each once"),
        (("m0", "m0"), np.eye(2), "each once"),
        (("m0",), np.eye(2), "1 x 1"),
        (("m0", "I0"), np.array([[1.0, 0.5], [0.0, 1.0]]), "symmetric"),
        (("m0", "I0"), np.array([[1.0, 0.0], [0.0, -1.0]]), "variances"),
        (("m0", "I0"), np.array([[1.0, 2.0], [2.0, 1.0]]), "positive semidefinite"),
    ],
)
def test_a_covariance_that_is_none_is_refused(names, matrix, message: str):
    with pytest.raises(InputError, match=message):
        replace(BASE, covariance=matrix, covariance_names=names)


def test_a_covariance_of_rank_one_and_of_many_scales_is_accepted():
    """As fits of barely observable parameters give it."""
    direction = np.array([30.0, 1e-3, 1e-5, 0.0])
    names = ("m0", "I1", "mu2", "aX")
    m = replace(BASE, covariance=np.outer(direction, direction), covariance_names=names)
    assert m.covariance is not None


def test_theta_and_values_are_each_others_inverse():
    m = model("everything")
    again = m.with_theta(m.theta)
    assert again.values == pytest.approx(m.values, rel=1e-14)
    np.testing.assert_allclose(again.theta, m.theta, rtol=1e-14)
    with pytest.raises(InputError, match="four wheels"):
        m.with_theta(np.concatenate([[5.6], m.theta[1:]]))


def test_changes_leave_the_model_alone():
    before = dict(BASE.values)
    more = BASE.with_effect("floor_tilt", tilt_x=0.01).with_values({"m0": 40.0})
    assert more.values["floor_tilt.tilt_x"] == 0.01 and more.values["floor_tilt.tilt_y"] == 0.0
    assert BASE.values == before and not BASE.effects
    assert more.without_effects().effects == {}


def test_a_model_survives_pickling():
    m = with_covariance(model("everything"), m0=0.1)
    again = pickle.loads(pickle.dumps(m))
    assert again.values == m.values and again.structure == m.structure
    np.testing.assert_array_equal(again.theta, m.theta)


def test_evaluation_takes_any_leading_shape():
    rng = np.random.default_rng(0)
    twist, acceleration = rng.normal(size=(2, 3, 4, 3))
    force = BASE.wrench(twist, acceleration)
    assert force.shape == (3, 4, 3)
    np.testing.assert_array_equal(force[1, 2], BASE.wrench(twist[1, 2], acceleration[1, 2]))
    torque = BASE.inverse_dynamics(twist, acceleration)
    assert torque.shape == (3, 4, 4)
    np.testing.assert_allclose(BASE.forward_dynamics(twist, torque), acceleration, atol=1e-12)
    with pytest.raises(InputError, match="unknown argument 'poses'"):
        BASE.wrench(twist, acceleration, poses=twist)
