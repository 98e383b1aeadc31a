"""LQI: poles and margins where promised, delays in the state, limits and lost torques survived."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest

from controllers.interface import Controller, Loop, Observation, Reference
from controllers.linear.linear_system import closed, sampled_platform
from controllers.linear.margins import control_margins, frequency_grid
from controllers.lqi.design import LQISettings, Weights, fastest, linear_lqi, lqi, lqi_margins
from controllers.lqi.lqi import LQI
from controllers.pid.pid import PID
from controllers.tuning.trials import TuningTrial, references
from tests.controllers.pid.test_pid import drive, want
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.simulation.plant import Plant

pytest.importorskip("control")

PAPER = load_model("paper")
LAGGED = PAPER.with_effect("actuator_lag", time_constant=0.03)
LOOP = Loop(0.01, delay=0.01, measurement_delay=0.005)
SLOW = Loop(0.01, delay=0.03, measurement_delay=0.005)
ODD = Loop(0.01, delay=0.0133, measurement_delay=0.0127)
CONDITIONS = pytest.mark.parametrize(
    ("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW), (LAGGED, ODD)], ids=["a", "b", "odd"]
)


def test_without_delay_or_friction_the_poles_are_the_weights() -> None:
    smooth = PAPER.with_values({"mu1": 0.0, "mu2": 0.0, "aX": 0.0, "aY": 0.0})
    design = lqi(smooth, Loop(1e-3), Weights(10.0, 0.8))
    size = len(design.plant.a)
    a = np.block([[design.plant.a, np.zeros((size, 3))], [-1e-3 * np.eye(3, size), np.eye(3)]])
    b = np.vstack([design.plant.b, np.zeros((3, 3))])
    poles = np.log(np.linalg.eigvals(a - b @ np.hstack([design.gain, design.integral])) + 0j) / 1e-3
    np.testing.assert_allclose(np.abs(poles), 10.0, rtol=0.02)
    np.testing.assert_allclose(poles.real, -8.0, rtol=0.02)


@CONDITIONS
def test_its_own_model_separates_the_poles(model: Model, loop: Loop) -> None:
    """Closed loop = optimal regulator + the platform's own (stable) poles + pure delays."""
    design = lqi(model, loop, Weights(8.0))
    found = np.abs(np.linalg.eigvals(closed(design.plant, linear_lqi(design)).a))
    size = len(design.plant.a)
    a = np.block([[design.plant.a, np.zeros((size, 3))], [-0.01 * np.eye(3, size), np.eye(3)]])
    b = np.vstack([design.plant.b, np.zeros((3, 3))])
    regulator = np.abs(np.linalg.eigvals(a - b @ np.hstack([design.gain, design.integral])))
    for pole in regulator[regulator > 0.2]:
        assert np.abs(found - pole).min() < 1e-6


@CONDITIONS
def test_the_default_keeps_the_margins_to_the_last(model: Model, loop: Loop) -> None:
    weights = fastest(model, loop)
    design = lqi(model, loop, weights)
    found, stable = lqi_margins(design)
    assert stable
    assert min(found.gain.min() - 6.0, found.phase.min() - 45.0) == pytest.approx(0.0, abs=0.05)
    frequency = frequency_grid(0.01)
    gain = linear_lqi(design).response(frequency) @ design.plant.response(frequency)
    theirs = control_margins(gain, frequency)
    np.testing.assert_allclose(found.gain, theirs.gain, atol=0.05)
    np.testing.assert_allclose(found.phase, theirs.phase, atol=0.2)


@CONDITIONS
def test_the_controller_is_its_linear_system(model: Model, loop: Loop) -> None:
    weights = Weights(6.0)
    control, system = LQI(model, loop, weights), linear_lqi(lqi(model, loop, weights))
    state = np.zeros(len(system.a))
    for k, twist in enumerate(1e-3 * np.random.default_rng(0).standard_normal((40, 3))):
        observation = Observation(0.01 * k, model.geometry.wheel_speeds(twist), twist)
        torque = control(observation, Reference(np.zeros(3), np.zeros(3)))
        force = system.c @ state - system.d @ twist
        np.testing.assert_allclose(model.geometry.body_force(torque), force, atol=1e-9)
        state = system.a @ state - system.b @ twist


def test_a_constant_reference_needs_no_integral() -> None:
    """N_x and N_u are exact: on the model itself the integral stays empty."""
    control, plant = LQI(PAPER, Loop(0.01)), Plant("paper")
    wanted = want(0.1, 0.0, 0.0)
    plant.reset(twist=wanted.twist)
    twist = drive(control, wanted, 1.0, plant)
    np.testing.assert_allclose(twist[0], wanted.twist, atol=2e-4)
    assert np.abs(control._integral).max() < 1e-5


@pytest.mark.parametrize(("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW)], ids=["a", "b"])
def test_knowing_what_is_on_its_way_it_beats_pid(model: Model, loop: Loop) -> None:
    run = TuningTrial(model, loop, references(model, count=1, duration=6.0), 6.0)
    error = run.score_controller(lambda: LQI(model, loop)).error
    assert (error < 0.8 * run.score_controller(lambda: PID(model, loop)).error).all()


@pytest.mark.parametrize("signs", list(itertools.product([0.8, 1.2], repeat=2)))
@pytest.mark.parametrize(("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW)], ids=["a", "b"])
def test_stable_on_another_platform(model: Model, loop: Loop, signs: tuple[float, float]) -> None:
    """Masses and frictions off by 20 %, each way."""
    masses, frictions = signs
    factor = {"m0": masses, "I0": masses, "I1": masses, "mu1": frictions, "mu2": frictions}
    other = model.with_values({name: f * model.values[name] for name, f in factor.items()})
    controller = linear_lqi(lqi(model, loop, fastest(model, loop)))
    assert closed(sampled_platform(other, loop), controller).is_stable


# --- what a loop meets -----------------------------------------------------------------------


def calm(model: Model = PAPER, **loop: float) -> LQI:
    return LQI(model, Loop(0.01, **loop), Weights(8.0))


def test_it_is_a_controller_that_reaches_its_reference_on_another_platform() -> None:
    control = calm()
    assert isinstance(control, Controller)
    assert control.preview_needed == 0
    other = PAPER.with_values({"m0": 42.0, "mu1": 0.14})
    twist = drive(control, want(0.2, -0.1, 0.3), 5.0, Plant(other))
    np.testing.assert_allclose(twist[-1], [0.2, -0.1, 0.3], atol=2e-3)


def test_saturation_leaves_no_windup() -> None:
    twist = drive(calm(torque_limit=0.5), want(0.2, 0.0, 0.0), 8.0, Plant("paper"))[:, 0]
    free = drive(calm(), want(0.2, 0.0, 0.0), 8.0, Plant("paper"))[:, 0]
    assert twist[10] < 0.8 * free[10], "it was saturated"
    assert twist[-1] == pytest.approx(0.2, rel=1e-2)
    assert twist.max() < max(1.02 * free.max(), 1.05 * 0.2)


def test_a_reference_out_of_reach_is_left_at_once() -> None:
    control, plant = calm(torque_limit=0.3), Plant("paper")
    drive(control, want(2.0, 0.0, 0.0), 20.0, plant)
    after = drive(control, want(0.0, 0.0, 0.0), 3.0, plant)[:, 0]
    assert after[50] < 0.5 * after[0]
    assert after.min() > -0.1 * after[0]
    assert abs(after[-1]) < 0.01


@pytest.mark.parametrize("knows", [True, False], ids=["torque known", "torque unknown"])
def test_seconds_without_torque_are_recovered_from(knows: bool) -> None:
    wanted = want(0.2, 0.1, 0.2)
    twist = drive(calm(), wanted, 10.0, Plant("paper"), dead=(3.0, 5.0), knows=knows)
    assert np.abs(twist[499]).max() < 0.02, "friction has stopped it"
    np.testing.assert_allclose(twist[-1], wanted.twist, atol=2e-3)
    assert (twist[500:] / wanted.twist).max() - 1.0 < (0.15 if knows else 1.0)


def test_lost_measurements_poison_nothing() -> None:
    twist = drive(calm(), want(0.2, 0.0, 0.0), 6.0, Plant("paper"), lost=(2.0, 2.3))
    np.testing.assert_allclose(twist[-1], [0.2, 0.0, 0.0], atol=2e-3)
    assert np.abs(twist[200:230, 0] - 0.2).max() < 0.03


def test_reset_starts_over_to_the_bit() -> None:
    control = calm(LAGGED, delay=0.013, measurement_delay=0.005)
    first = drive(control, want(0.1, 0.1, 0.1), 1.0, Plant("paper"))
    control.reset()
    assert np.array_equal(first, drive(control, want(0.1, 0.1, 0.1), 1.0, Plant("paper")))


def test_a_mistake_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="LQI damping: 0.5 must be at least 0.707"):
        Weights(3.0, 0.5)
    with pytest.raises(InputError, match="no bandwidth from 0.3 rad/s on keeps"):
        fastest(PAPER, LOOP, LQISettings(gain_margin=200.0))
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"pip install 'youbot\[control\]'"):
        LQI(PAPER, LOOP)
