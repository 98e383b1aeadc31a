"""python-control's systems are the model: their derivatives, courses and linearisations agree."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, drive, model, random_instant, state_of
from youbot_env import InputError, Plant, initial_state, linear_control, load_model, to_control
from youbot_env.exports.control_systems import TORQUES, WHEEL_SPEEDS, steady
from youbot_env.model.model import Model
from youbot_env.simulation.free_run import simulate

control: Any = pytest.importorskip("control")

TWIST = (0.3, -0.2, 0.4)
AT: dict[str, Any] = {"pose": (0.4, -0.2, 0.7), "wheel_angle": (1.0, 2.0, 3.0, 4.0), "time": 35.0}
EXACT: dict[str, Any] = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def prompt(m: Model) -> Model:
    """The model without its delay."""
    return m.with_effect("torque_delay", delay=0.0) if m.delay else m


def timeless(m: Model, array: np.ndarray) -> np.ndarray:
    """Without the entries that stay or are python-control's own t."""
    names = m.structure.state_names
    return np.delete(array, [names.index(n) for n in names if n in ("time", "start")], axis=-1)


@pytest.mark.parametrize("case", CASES)
def test_the_derivative_is_the_models(case: str):
    m = prompt(model(case))
    system, rng = to_control(m), np.random.default_rng(3)
    for _ in range(5):
        at = replace(random_instant(rng), start=0.0)
        state, torque = np.array(state_of(m.structure, at)), np.array(at.torque)
        found = system.dynamics(at.time, timeless(m, state), torque)
        expected = timeless(m, m.state_derivative(state, torque))
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("case", CASES)
def test_signals_have_the_models_names(case: str):
    m = prompt(model(case))
    for system in (to_control(m), linear_control(m, TWIST)):
        states = [name for name in m.structure.state_names if name not in ("time", "start")]
        assert list(system.state_labels) == list(system.output_labels) == states
        assert tuple(system.input_labels) == TORQUES
    assert dict(to_control(m).params) == m.values


@pytest.mark.parametrize("effects", [{}, {"floor_tilt": {"tilt_x": 0.02, "tilt_y": -0.01}}])
def test_it_runs_as_the_plant_does(effects: dict[str, dict[str, float]]):
    m = load_model("paper")
    for name, values in effects.items():
        m = m.with_effect(name, **values)
    torque = np.array([0.8, 1.0, 0.4, 0.6])
    time = np.array([0.0, 0.25, 0.5])
    plant = Plant(m, substeps=500)
    states = [plant.reset(twist=TWIST)]
    states += [plant.step(torque, 0.25) for _ in time[1:]]
    course = control.input_output_response(
        to_control(m),
        time,
        np.tile(torque[:, None], len(time)),
        states[0][:10],
        solve_ivp_kwargs=EXACT,
    )
    error = np.abs(course.states.T - np.array(states)[:, :10]).max()
    print(f"python-control and Plant differ by {error:.1e}")
    assert error < 1e-11


def test_it_runs_as_a_simulated_log():
    m = load_model("paper").with_effect("actuator_lag", time_constant=0.05)
    time = np.linspace(0.0, 0.5, 26)
    torque = drive(time)
    expected = timeless(m, simulate(m, time, torque, initial_state(m, twist=TWIST)))
    course = control.input_output_response(
        to_control(m), time, torque.T, expected[0], solve_ivp_kwargs={"rtol": 1e-8, "atol": 1e-9}
    )
    # The simulation's own steps leave so much beside a lag of 50 ms.
    np.testing.assert_allclose(course.states.T, expected, rtol=0, atol=2e-5)


def test_time_is_the_systems_own():
    m = load_model("paper").with_effect("payload_change", mass=20.0, time=30.0)
    system, state = to_control(m), np.zeros(10)
    before, after = (system.dynamics(time, state, np.ones(4))[0] for time in (29.0, 31.0))
    assert after < 0.7 * before


def test_parameters_can_be_given_to_a_run():
    m = load_model("paper").with_effect("tether", stiffness=5.0, anchor_x=1.0, anchor_y=0.5)
    other = {"m0": 40.0, "aX": -0.02, "tether.anchor_x": -1.0}
    system, state, torque = to_control(m), np.linspace(0.1, 1.0, 10), np.ones(4)
    expected = to_control(m.with_values(other)).dynamics(0.0, state, torque)
    found = system.dynamics(0.0, state, torque, params={**other, "a stranger's": 1.0})
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    again = system.dynamics(0.0, state, torque)
    np.testing.assert_allclose(again, to_control(m).dynamics(0.0, state, torque), rtol=1e-14)


def unsaturated(m: Model) -> Model:
    """The model with a limit that no wheel meets: at one a motion is not steady."""
    limit = "torque_saturation.limit"
    return m.with_values({limit: 20.0}) if limit in m.values else m


@pytest.mark.parametrize("case", CASES)
def test_a_steady_motion_needs_just_these_torques(case: str):
    m = unsaturated(prompt(model(case)))
    state, torque = steady(m, TWIST, **AT)
    rates = dict(zip(m.structure.state_names, m.state_derivative(state, torque), strict=True))
    still = [name for name in rates if name.startswith(("velocity", "yaw_rate", "torque"))]
    np.testing.assert_allclose([rates[name] for name in still], 0.0, atol=1e-11)


@pytest.mark.parametrize("case", CASES)
def test_the_linear_system_is_the_slope_of_the_nonlinear_one(case: str):
    m = unsaturated(prompt(model(case)))
    state, torque = steady(m, TWIST, **AT)
    found = linear_control(m, TWIST, **AT)
    slope = control.linearize(to_control(m), timeless(m, state), torque, t=AT["time"], eps=1e-7)
    scale = np.abs(found.A).max()
    np.testing.assert_allclose(found.A, slope.A, rtol=1e-5, atol=1e-5 * scale)
    np.testing.assert_allclose(found.B, slope.B, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found.C, slope.C, atol=1e-6)
    a, b = m.linearise(state, torque)
    np.testing.assert_array_equal(found.A, timeless(m, timeless(m, a).T).T)
    np.testing.assert_array_equal(found.B, timeless(m, b.T).T)


@pytest.mark.parametrize("case", ["base", "actuator_lag", "wheel_coulomb_friction"])
def test_the_twist_alone_moves_the_same(case: str):
    m = model(case)
    whole, twist = (to_control(m, twist_only=only) for only in (False, True))
    kept = [whole.state_labels.index(name) for name in twist.state_labels]
    assert list(twist.state_labels[:3]) == ["velocity_x", "velocity_y", "yaw_rate"]
    assert len(kept) == (7 if m.structure.has_actuator else 3)
    state, torque = np.linspace(0.3, 1.0, whole.nstates), np.array([1.0, 0.5, 0.2, -0.3])
    expected = whole.dynamics(0.0, state, torque)[kept]
    np.testing.assert_allclose(twist.dynamics(0.0, state[kept], torque), expected, rtol=1e-13)
    linear = linear_control(m, TWIST, twist_only=True)
    np.testing.assert_array_equal(linear.A, linear_control(m, TWIST).A[np.ix_(kept, kept)])


@pytest.mark.parametrize("case", ["floor_tilt", "tether", "torque_ripple"])
def test_the_twist_alone_is_refused_where_it_is_not_enough(case: str):
    with pytest.raises(InputError, match="take all states"):
        to_control(model(case), twist_only=True)


def test_outputs_are_chosen_by_name():
    m = load_model("paper")
    names = ["yaw", *WHEEL_SPEEDS]
    system, state = to_control(m, outputs=names), np.linspace(0.1, 1.0, 10)
    expected = [state[5], *m.geometry.wheel_speeds(state[:3])]
    np.testing.assert_allclose(system.output(0.0, state, np.zeros(4)), expected, rtol=1e-14)
    assert system.output_labels == linear_control(m, outputs=names).output_labels == names
    np.testing.assert_allclose(linear_control(m, outputs=names).C @ state, expected, rtol=1e-14)
    with pytest.raises(InputError, match="unknown signal 'speed'; known are velocity_x"):
        to_control(m, outputs=["speed"])


class TestDelay:
    late = load_model("paper").with_effect("torque_delay", delay=0.05)

    def test_it_is_never_left_out_unsaid(self):
        for make in (to_control, linear_control):
            with pytest.raises(InputError, match="use pade=ORDER"):
                make(self.late)
        with pytest.raises(InputError, match="order of at least 1"):
            to_control(self.late, pade=0)

    def test_the_response_is_late_by_it(self):
        frequency = np.array([0.5, 3.0, 20.0])
        late = linear_control(self.late, TWIST, twist_only=True, pade=4)
        prompt = linear_control(load_model("paper"), TWIST, twist_only=True)
        shift = np.exp(-0.05j * frequency)
        np.testing.assert_allclose(
            late(1j * frequency), prompt(1j * frequency) * shift, rtol=1e-8, atol=1e-8
        )

    def test_a_run_follows_the_plant_with_that_delay(self):
        system, plant = to_control(self.late, pade=6), Plant(self.late)
        time = np.linspace(0.0, 1.0, 101)
        # Smooth, because an approximated delay rings after a step.
        torque = np.outer(np.sin(np.pi * time) ** 2, [1.0, 0.8, 0.6, 0.9])
        course = control.input_output_response(system, time, torque.T, 0.0)
        for row in 0.5 * (torque[1:] + torque[:-1]):
            plant.step(row, 0.01)
        np.testing.assert_allclose(course.states[:3, -1], plant.twist, atol=1e-4)
        assert np.abs(plant.twist).max() > 0.05

    def test_the_linear_system_is_the_slope_of_the_nonlinear_one(self):
        system, linear = (make(self.late, pade=2) for make in (to_control, linear_control))
        rest = np.zeros(system.nstates)
        slope = control.linearize(system, rest, np.zeros(4), eps=1e-7)
        assert linear.state_labels == system.state_labels
        np.testing.assert_allclose(linear.A, slope.A, rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(linear.B, slope.B, rtol=1e-5, atol=1e-4)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"youbot\[control\]"):
        to_control("paper")
