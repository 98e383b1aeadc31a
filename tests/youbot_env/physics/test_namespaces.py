"""The same physics in every arithmetic: floats, numpy, torch, sympy and the compiled kernels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, model, random_instant, state_of
from youbot_env.model.model import Model
from youbot_env.physics import effect as effects, inverse_dynamics as dynamics
from youbot_env.physics.effect import CATALOGUE, WHEEL, Parameter, effect
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.physics.mechanism import Instant, ModelStructure
from youbot_env.physics.namespaces import floats, symbols, tensors
from youbot_env.simulation.compiled import derivative
from youbot_env.simulation.lane_kernel import stepper

COUNT = 7


def results(xp: Any, m: Model, theta: Any, at: Instant) -> list[Any]:
    """All that is derived from the effects, in one list of components."""
    where = (xp, m.structure, m.geometry, theta)
    rows = dynamics.mass_matrix(*where, at)
    state = state_of(m.structure, at)
    return [
        *dynamics.wrench(*where, at),
        *dynamics.forward_dynamics(*where, at),
        *(entry for row in rows for entry in row),
        *dynamics.interface_torque(*where, at),
        *dynamics.state_derivative(*where, state, at.torque),
    ]


def by_floats(m: Model, at: Instant) -> np.ndarray:
    """(C, COUNT) results, one platform and one number at a time."""
    theta = [float(v) for v in m.theta]
    return np.array([results(floats, m, theta, pick(at, k)) for k in range(COUNT)], float).T


def pick(at: Instant, k: int) -> Instant:
    fields = {}
    for name, value in vars(at).items():
        is_tuple = isinstance(value, tuple)
        fields[name] = tuple(float(v[k]) for v in value) if is_tuple else float(value[k])
    return replace(at, **fields)


def batch() -> Instant:
    return random_instant(np.random.default_rng(11), COUNT)


def stacked(components: list[Any]) -> np.ndarray:
    return np.array([np.broadcast_to(np.asarray(c, float), COUNT) for c in components])


@pytest.mark.parametrize("case", CASES)
def test_an_array_is_its_rows(case: str):
    m, at = model(case), batch()
    expected = by_floats(m, at)
    together = stacked(results(np, m, m.theta, at))
    np.testing.assert_allclose(together, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_tensors_are_arrays(case: str):
    torch = pytest.importorskip("torch")
    m, at = model(case), batch()
    lifted = replace(
        at,
        **{
            name: tuple(torch.tensor(v) for v in value)
            if isinstance(value, tuple)
            else torch.tensor(value)
            for name, value in vars(at).items()
        },
    )
    for theta in (torch.tensor(m.theta), [float(v) for v in m.theta]):
        found = stacked(results(tensors(), m, theta, lifted))
        np.testing.assert_allclose(found, by_floats(m, at), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_tensors_carry_gradients(case: str):
    torch = pytest.importorskip("torch")
    m = model(case)
    theta = torch.tensor(m.theta, requires_grad=True)
    at = random_instant(np.random.default_rng(0))
    fx, fy, moment = dynamics.wrench(tensors(), m.structure, m.geometry, theta, at)
    (fx + fy + moment).backward()
    assert theta.grad is not None
    for i in range(7):
        step = 1e-6 * max(abs(m.theta[i]), 0.1)
        ends = [m.theta + sign * step * np.eye(len(m.theta))[i] for sign in (1, -1)]
        ahead, behind = (sum(dynamics.wrench(np, m.structure, m.geometry, end, at)) for end in ends)
        slope = (ahead - behind) / (2 * step)
        assert float(theta.grad[i]) == pytest.approx(slope, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_symbols_evaluate_to_the_numbers(case: str):
    import sympy

    m, at = model(case), pick(batch(), 0)
    names = {
        "twist": 3,
        "acceleration": 3,
        "pose": 3,
        "wheel_angle": 4,
        "torque": 4,
        "torque_rate": 4,
        "torque_second_rate": 4,
    }
    symbolic = {n: tuple(sympy.symbols(f"{n}0:{k}", real=True)) for n, k in names.items()}
    time, start = sympy.symbols("time start", real=True)
    theta = sympy.symbols(f"theta0:{len(m.theta)}", real=True)
    found = results(symbols(), m, theta, Instant(**symbolic, time=time, start=start))
    arguments = [time, start, *theta, *(s for group in symbolic.values() for s in group)]
    numbers = [at.time, at.start, *m.theta, *(v for name in symbolic for v in getattr(at, name))]
    values = sympy.lambdify(arguments, found, modules="math", cse=True)(*numbers)
    np.testing.assert_allclose(values, by_floats(m, batch())[:, 0], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("case", CASES)
def test_the_compiled_derivative_is_the_same(case: str):
    m, at = model(case), batch()
    torque = np.array(at.torque)
    states = np.array([np.broadcast_to(v, COUNT) for v in state_of(m.structure, at)])
    rates = derivative(m.structure)
    compiled = np.array(
        [rates(states[:, k], torque[:, k], m.lengths, m.theta) for k in range(COUNT)]
    )
    plain = m.state_derivative(states.T, torque.T)
    np.testing.assert_allclose(compiled, plain, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("case", CASES)
def test_a_compiled_step_is_a_runge_kutta_step_of_the_derivative(case: str):
    m, at = model(case), batch()
    torque = np.array(at.torque).T.copy()
    states = np.array([np.broadcast_to(v, COUNT) for v in state_of(m.structure, at)]).T.copy()
    dt = 1e-3
    a = m.state_derivative(states, torque)
    b = m.state_derivative(states + dt / 2 * a, torque)
    c = m.state_derivative(states + dt / 2 * b, torque)
    d = m.state_derivative(states + dt * c, torque)
    expected = states + dt / 6 * (a + 2 * b + 2 * c + d)
    theta = np.tile(m.theta, (COUNT, 1))
    stepper(m.structure)(states, torque, m.lengths, theta, dt, 1)
    np.testing.assert_allclose(states, expected, rtol=1e-12, atol=1e-12)


# --- the namespace itself --------------------------------------------------------------------


@pytest.fixture
def everything_xp_offers(monkeypatch: pytest.MonkeyPatch) -> ModelStructure:
    """An effect that uses each function an effect may use, registered for one test."""
    monkeypatch.setattr(effects.CATALOGUE, "_effects", dict(effects.CATALOGUE._effects))

    @effect(
        acts_at=WHEEL,
        parameters=[Parameter("a", "N m"), Parameter("b", "rad/s", default=0.7, lower=0.1)],
        source="a test",
        recognise="A test.",
    )
    def all_functions(xp, wheel, a, b):
        """Nothing physical."""
        x = wheel.rate
        smooth = xp.tanh(x / b) + xp.exp(-(x**2)) + xp.sin(x) * xp.cos(b) + xp.sqrt(x**2 + 0.25)
        edges = xp.abs(x) + xp.sign(x) + xp.maximum(x, 0.1) + xp.minimum(x, 0.2)
        return a * (smooth + edges + xp.where(x > 0.5, x, 3.0 * b) + xp.maximum(0.0, x))

    assert CATALOGUE["all_functions"].function is all_functions
    return mecanum_structure(("all_functions",))


def test_every_function_an_effect_may_use_works_everywhere(everything_xp_offers: ModelStructure):
    torch = pytest.importorskip("torch")
    m = Model(model("base").geometry, model("base").parameters).with_effect("all_functions", a=2.0)
    at = batch()
    expected = by_floats(m, at)
    np.testing.assert_allclose(stacked(results(np, m, m.theta, at)), expected, rtol=1e-12)
    single = pick(at, 0)
    theta = [float(v) for v in m.theta]
    tensor = [torch.as_tensor(v, dtype=torch.float64) for v in results(tensors(), m, theta, single)]
    np.testing.assert_allclose(torch.stack(tensor).numpy(), expected[:, 0], rtol=1e-12)
    states = state_of(m.structure, single)
    rates = derivative(m.structure)
    compiled = rates(states, single.torque, m.lengths, m.theta)
    np.testing.assert_allclose(compiled, expected[-len(states) :, 0], rtol=1e-10)
    standing = np.zeros(len(states))
    still = rates(standing, np.zeros(4), m.lengths, m.theta)
    np.testing.assert_allclose(still, m.state_derivative(standing, np.zeros(4)), atol=1e-12)


def test_numbers_among_tensors_keep_their_precision():
    torch = pytest.importorskip("torch")
    xp = tensors()
    x = torch.tensor(0.05, dtype=torch.float64)
    assert float(xp.maximum(x, 0.1)) == 0.1
    assert float(xp.where(x > 0.1, x, 0.3)) == 0.3
    assert float(xp.where(torch.tensor(True), x, 0.3)) == 0.05
    assert xp.sin(0.018) == math.sin(0.018)
    assert xp.where(True, 0.1, 0.2) == 0.1
    assert torch.as_tensor(xp.tanh(x.float())).dtype == torch.float32


def test_namespaces_agree_on_their_names():
    pytest.importorskip("torch")
    assert set(vars(floats)) == set(vars(symbols())) == set(vars(tensors()))
    assert all(hasattr(np, name) for name in vars(floats))
