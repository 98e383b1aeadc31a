"""The linear loop: exact between its samples, and margins that mean what they say."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.interface import Loop
from controllers.kinematic import Gains
from controllers.linear.linear_system import (
    LinearSystem,
    closed,
    continuous_response,
    held,
    sampled,
    sampled_platform,
    twist_dynamics,
)
from controllers.linear.margins import control_margins, frequency_grid, margins
from controllers.tuning.tunable_laws import wheel_loops
from youbot_env.model.model_file import load_model
from youbot_env.simulation.plant import Plant

PAPER = load_model("paper")
LAGGED = PAPER.with_effect("actuator_lag", time_constant=0.03)
LOOP = Loop(0.01, delay=0.033, measurement_delay=0.005)
FINE = 0.0005


def fine_course(system: LinearSystem, command: np.ndarray, delay: float) -> np.ndarray:
    """Outputs every 0.5 ms of a continuous system under late, held commands: brute force."""
    a, b = held(system.a, system.b, FINE)
    state, course = np.zeros(len(a)), [system.c @ np.zeros(len(a))]
    for i in range(len(command) * 20):
        k = int(np.floor((i * FINE - delay) / 0.01 + 1e-6))
        state = a @ state + b @ (command[k] if k >= 0 else np.zeros(3))
        course.append(system.c @ state)
    return np.array(course)


@pytest.mark.parametrize("model", [PAPER, LAGGED], ids=["base", "lag"])
@pytest.mark.parametrize(
    ("delay", "age"),
    [(0.0, 0.0), (0.01, 0.005), (0.033, 0.005), (0.0035, 0.0085), (0.02, 0.01), (0.0075, 0.0235)],
)
def test_the_sampled_loop_is_exact_for_any_delays(model, delay: float, age: float) -> None:
    plant = twist_dynamics(model)
    loop = sampled(plant, 0.01, delay, age)
    command = np.random.default_rng(0).standard_normal((30, 3))
    course = fine_course(plant, command, delay)
    state = np.zeros(len(loop.a))
    for k, u in enumerate(command):
        at = 20 * k - round(age / FINE)
        expected = course[at] if at >= 0 else np.zeros(3)
        np.testing.assert_allclose(loop.c @ state, expected, atol=1e-12)
        state = loop.a @ state + loop.b @ u


def test_a_small_force_moves_the_platform_as_its_linear_model_says() -> None:
    plant, loop = Plant(LAGGED), sampled(twist_dynamics(LAGGED, (0, 0, 0)), 0.01)
    state = np.zeros(len(loop.a))
    for force in 1e-3 * np.random.default_rng(1).standard_normal((50, 3)):
        plant.step(LAGGED.geometry.wheel_torque(force), 0.01)
        state = loop.a @ state + loop.b @ force
        np.testing.assert_allclose(plant.twist, loop.c @ state, atol=1e-9)


def test_past_its_kink_dry_friction_is_no_wall() -> None:
    rough = PAPER.with_effect("wheel_coulomb_friction", torque=0.2)
    at_rest, moving = twist_dynamics(rough, (0, 0, 0)).a, twist_dynamics(rough).a
    assert at_rest[0, 0] < 5 * moving[0, 0] < 0
    np.testing.assert_allclose(moving, twist_dynamics(PAPER).a, rtol=0.02, atol=0.02)


def test_about_rest_the_base_model_is_what_its_mean_over_both_directions_is() -> None:
    np.testing.assert_allclose(
        twist_dynamics(PAPER).a, twist_dynamics(PAPER, (0, 0, 0)).a, atol=1e-6
    )


def test_sampled_and_continuous_responses_agree_below_the_sample_rate() -> None:
    slow = np.array([0.1, 1.0, 3.0, 10.0])
    exact = sampled_platform(LAGGED, LOOP).response(slow)
    np.testing.assert_allclose(
        exact, continuous_response(LAGGED, LOOP, slow), atol=1e-4 * np.abs(exact).max()
    )


def test_response_is_the_steady_answer_to_a_sine() -> None:
    loop, w = sampled_platform(PAPER, LOOP), 7.0
    force = np.array([1.0, -0.5, 0.2])
    state, outputs = np.zeros(len(loop.a)), []
    for k in range(1200):
        outputs.append(loop.c @ state)
        state = loop.a @ state + loop.b @ (force * np.cos(w * 0.01 * k))
    phase = np.exp(1j * w * 0.01 * np.arange(1200))
    expected = ((loop.response([w])[0] @ force)[None] * phase[:, None]).real
    np.testing.assert_allclose(outputs[800:], expected[800:], atol=1e-9)


# --- margins ---------------------------------------------------------------------------------

GAINS = Gains(0.3, 1.5)


def loop_of(gains: Gains) -> tuple[LinearSystem, LinearSystem]:
    return sampled_platform(LAGGED, LOOP), wheel_loops(gains, LAGGED.geometry, 0.01)


def loop_gain(gains: Gains, frequency: np.ndarray) -> np.ndarray:
    plant, controller = loop_of(gains)
    return controller.response(frequency) @ plant.response(frequency)


def scaled(controller: LinearSystem, axis: int, factor: complex) -> LinearSystem:
    """The controller with one axis' force command multiplied."""
    by = np.diag([factor if i == axis else 1.0 for i in range(3)])
    return LinearSystem(controller.a, controller.b, by @ controller.c, by @ controller.d, 0.01)


@pytest.mark.parametrize("axis", range(3))
def test_gain_margin_is_where_stability_ends(axis: int) -> None:
    plant, controller = loop_of(GAINS)
    found = margins(loop_gain(GAINS, frequency_grid(0.01))).gain[axis]
    factor = 10 ** (found / 20)
    assert closed(plant, scaled(controller, axis, 0.995 * factor)).is_stable
    assert not closed(plant, scaled(controller, axis, 1.005 * factor)).is_stable


@pytest.mark.parametrize("axis", range(3))
def test_phase_margin_is_where_stability_ends(axis: int) -> None:
    plant, controller = loop_of(GAINS)
    angle = np.radians(margins(loop_gain(GAINS, frequency_grid(0.01))).phase[axis])
    assert closed(plant, scaled(controller, axis, np.exp(-1j * (angle - 0.01)))).is_stable
    assert not closed(plant, scaled(controller, axis, np.exp(-1j * (angle + 0.01)))).is_stable


@pytest.mark.parametrize("gains", [GAINS, Gains(0.12, 0.3), Gains(0.5, 0.5), Gains(0.1, 2.0)])
def test_margins_are_python_controls(gains: Gains) -> None:
    pytest.importorskip("control")
    frequency = frequency_grid(0.01)
    gain = loop_gain(gains, frequency)
    found, theirs = margins(gain), control_margins(gain, frequency)
    np.testing.assert_allclose(found.gain, theirs.gain, atol=0.02)
    np.testing.assert_allclose(found.phase, theirs.phase, atol=0.1)


def test_margins_of_many_loops_are_those_of_each() -> None:
    frequency = frequency_grid(0.01)
    stack = np.stack([loop_gain(g, frequency) for g in (GAINS, Gains(0.2, 1.0))])
    np.testing.assert_array_equal(margins(stack).gain[1], margins(stack[1]).gain)
    np.testing.assert_array_equal(margins(stack).phase[0], margins(stack[0]).phase)


def test_a_slow_loop_has_no_gain_margin_to_lose() -> None:
    calm = margins(loop_gain(Gains(1e-6, 0.0), frequency_grid(0.01)))
    assert (calm.phase == np.inf).all()
    assert (calm.gain > 60).all()


def test_poles_are_the_platforms_and_python_controls() -> None:
    control = pytest.importorskip("control")
    loop = closed(*loop_of(GAINS))
    np.testing.assert_allclose(
        np.sort_complex(loop.to_control().poles()),
        np.sort_complex(np.linalg.eigvals(loop.a)),
        atol=1e-9,
    )
    assert loop.to_control().dt == 0.01
    plain = sampled(twist_dynamics(PAPER), 0.01)
    np.testing.assert_allclose(
        np.sort(plain.poles.real), np.sort(twist_dynamics(PAPER).poles.real), rtol=1e-9
    )
    assert control.ss(loop.to_control()).nstates == len(loop.a)
