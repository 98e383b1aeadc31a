"""The torch module is the model: derivative, steps, runs; and its gradients are true."""

from __future__ import annotations

import copy
import io
import operator
import sys
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, drive, model, random_instant, state_of
from youbot_env import (
    InputError,
    Model,
    Parameter,
    Plant,
    effect,
    effects,
    initial_state,
    load_model,
    to_torch,
)
from youbot_env.effects import WHEEL
from youbot_env.exports.control_system import steady
from youbot_env.simulate import simulate

torch: Any = pytest.importorskip("torch")

COUNT = 7
TWIST = (0.3, -0.2, 0.4)
TILTED = load_model("paper").with_effect("floor_tilt", tilt_x=0.02, tilt_y=-0.01)


def instants(m: Model) -> tuple[Any, Any]:
    """States (COUNT, S) and torques (COUNT, 4) within the platform's range."""
    at = random_instant(np.random.default_rng(5), COUNT)
    states = np.array([np.broadcast_to(v, COUNT) for v in state_of(m.structure, at)]).T
    return torch.tensor(states), torch.tensor(np.array(at.torque).T)


def course(m: Model, samples: int = 11, period: float = 0.02) -> tuple[Any, Any]:
    """A first state (S,) and torques (N, 4) for a run."""
    torque = drive(period * np.arange(samples))
    return torch.tensor(initial_state(m, twist=TWIST)), torch.tensor(torque)


def to_torch_at(m: Model, name: str, value: float) -> Any:
    """A platform with one parameter elsewhere, out of bounds if need be."""
    platform = to_torch(m)
    with torch.no_grad():
        platform.get_parameter(name).fill_(value)
    return platform


@pytest.mark.parametrize("case", CASES)
def test_the_derivative_is_the_models(case: str):
    m = model(case)
    states, torques = instants(m)
    expected = m.state_derivative(states.numpy(), torques.numpy())
    with torch.no_grad():
        found = to_torch(m)(states, torques).numpy()
        single = to_torch(m, dtype=torch.float32)(states.float(), torques.float())
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    assert single.dtype == torch.float32
    # The phase of a ripple that turns with 50 rad keeps five digits.
    np.testing.assert_allclose(single.numpy(), expected, rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("case", CASES)
def test_its_slope_is_the_linearisation(case: str):
    m = model(case)
    state, torque = (torch.tensor(v) for v in steady(m, TWIST))
    slopes = torch.func.jacrev(to_torch(m), argnums=(0, 1))(state, torque)
    for found, expected in zip(slopes, m.linearise(state.numpy(), torque.numpy()), strict=True):
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-6, atol=1e-8 * scale)


@pytest.mark.parametrize("case", CASES)
def test_gradients_of_every_parameter(case: str):
    """Against central differences of the model itself, in the form that people state."""
    m = model(case)
    platform = to_torch(m)
    states, torques = instants(m)
    weights = torch.linspace(-1.0, 1.0, states.shape[-1], dtype=torch.float64)
    (platform(states, torques) @ weights).sum().backward()
    for name, value in m.values.items():
        step = 1e-6 * max(abs(value), 0.01)
        ends = [{name: torch.tensor(value + sign * step, dtype=torch.float64)} for sign in (1, -1)]
        with torch.no_grad():
            ahead, behind = (
                (torch.func.functional_call(platform, end, (states, torques)) @ weights).sum()
                for end in ends
            )
        slope = float(ahead - behind) / (2 * step)
        grad = platform.get_parameter(name).grad
        found = 0.0 if grad is None else float(grad)
        assert found == pytest.approx(slope, rel=1e-4, abs=1e-5), name


def test_gradients_of_a_step_by_torchs_own_check():
    platform = to_torch(TILTED, trainable=())
    state, torque = course(TILTED)
    inputs = [state.requires_grad_(), torque[3].clone().requires_grad_()]
    assert torch.autograd.gradcheck(lambda x, u: platform.step(x, u, 0.1, substeps=2), inputs)


def test_parameters_are_the_models():
    platform = to_torch(TILTED)
    assert {k: v.item() for k, v in platform.named_parameters()} == TILTED.values
    np.testing.assert_allclose([v.item() for v in platform.theta()], TILTED.theta, rtol=1e-15)
    assert platform.get_parameter("floor_tilt.tilt_x").item() == 0.02


def test_a_subset_is_trainable():
    platform = to_torch(TILTED, trainable=["mu1", "floor_tilt.tilt_y"])
    free = {name for name, p in platform.named_parameters() if p.requires_grad}
    assert free == {"mu1", "floor_tilt.tilt_y"}
    with pytest.raises(InputError, match="no parameter 'mu3'; it has m0"):
        to_torch(TILTED, trainable=["mu3"])


@pytest.mark.parametrize("case", ["base", "wheel_coulomb_friction", "actuator_lag", "tether"])
def test_a_step_is_the_plants(case: str):
    m = model(case)
    platform, plant = to_torch(m), Plant(m)
    state = torch.tensor(plant.reset(twist=TWIST))
    for torque in drive(0.02 * np.arange(4)):
        with torch.no_grad():
            state = platform.step(state, torch.tensor(torque), 0.02)
        plant.step(torque, 0.02)
    np.testing.assert_allclose(state.numpy(), plant.state, rtol=0, atol=1e-12)


@pytest.mark.parametrize("case", ["base", "actuator_lag", "torque_gain_error"])
def test_a_rollout_is_a_simulated_log(case: str):
    m = model(case)
    state, torque = course(m)
    with torch.no_grad():
        found = to_torch(m).rollout(state, torque, 0.02)
        batch = to_torch(m).rollout(torch.stack([state, state]), torque, 0.02)
    expected = simulate(m, 0.02 * np.arange(len(torque)), torque.numpy(), state.numpy())
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(batch[1].numpy(), expected, rtol=0, atol=1e-12)


class TestDelay:
    late = load_model("paper").with_effect("torque_delay", delay=0.037)

    def test_a_rollout_is_late_by_it(self):
        state, torque = course(self.late, 16)
        with torch.no_grad():
            found = to_torch(self.late).rollout(state, torque, 0.02, substeps=8)
        time = 0.02 * np.arange(len(torque))
        expected = simulate(self.late, time, torque.numpy(), state.numpy())
        # Not to rounding: the simulation also cuts its steps where a late torque bends.
        np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=2e-6)
        prompt = simulate(load_model("paper"), time, torque.numpy(), state.numpy())
        assert np.abs(expected - prompt).max() > 1e-3

    def test_its_gradient_is_the_slope_of_the_run(self):
        platform = to_torch(self.late, trainable=["torque_delay.delay"])
        state, torque = course(self.late)

        def end(shift: float) -> Any:
            delay = torch.tensor(0.037 + shift, dtype=torch.float64, requires_grad=True)
            moved = {"torque_delay.delay": delay}
            run = torch.func.functional_call(
                _Run(platform), {f"of.{k}": v for k, v in moved.items()}, (state, torque)
            )
            return run[-1, 0], delay

        value, delay = end(0.0)
        value.backward()
        slope = (end(1e-5)[0] - end(-1e-5)[0]).item() / 2e-5
        assert float(delay.grad) == pytest.approx(slope, rel=1e-4)
        assert abs(slope) > 1e-3

    def test_a_single_step_refuses_it(self):
        state, torque = course(self.late)
        with pytest.raises(InputError, match="torque_delay of 0.037 s; use rollout"):
            to_torch(self.late).step(state, torque[0], 0.02)
        prompt = self.late.with_effect("torque_delay", delay=0.0)
        with pytest.raises(InputError, match="cannot learn a delay"):
            to_torch(prompt).step(state, torque[0], 0.02)
        with torch.no_grad():
            to_torch(prompt, trainable=["m0"]).step(state, torque[0], 0.02)


class _Run(torch.nn.Module):
    """A rollout as a module's call, so that functional_call can give it parameters."""

    def __init__(self, of: Any) -> None:
        super().__init__()
        self.of = of

    def forward(self, state: Any, torque: Any) -> Any:
        return self.of.rollout(state, torque, 0.02)


def test_the_wrench_is_the_models():
    rng = np.random.default_rng(2)
    at = random_instant(rng, COUNT)
    twist, acceleration, pose = (np.array(v).T for v in (at.twist, at.acceleration, at.pose))
    motion = torch.tensor(twist), torch.tensor(acceleration)
    found = to_torch(TILTED).wrench(*motion, pose=torch.tensor(pose))
    expected = TILTED.wrench(twist, acceleration, pose=pose)
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-12, atol=1e-12)


def test_many_platforms_by_vmap():
    platform = to_torch(TILTED)
    states, torques = instants(TILTED)
    masses = torch.tensor([30.0, 40.0, 50.0], dtype=torch.float64)

    def of_mass(m0: Any) -> Any:
        return torch.func.functional_call(platform, {"m0": m0}, (states, torques))

    found = torch.func.vmap(of_mass)(masses).detach().numpy()
    for row, mass in zip(found, masses.tolist(), strict=True):
        m = TILTED.with_values({"m0": mass})
        expected = m.state_derivative(states.numpy(), torques.numpy())
        np.testing.assert_allclose(row, expected, rtol=1e-12, atol=1e-12)


def test_torch_compile_takes_it_whole():
    # The front end alone: generating and compiling C++ takes a minute.
    platform = to_torch(TILTED)
    states, torques = instants(TILTED)
    compiled = torch.compile(platform, backend="eager", fullgraph=True)
    with torch.no_grad():
        expected = platform(states, torques)
        np.testing.assert_allclose(compiled(states, torques), expected, rtol=1e-14, atol=1e-14)


def test_the_trace_says_nothing_twice():
    graph = to_torch("paper")._rates.__self__.graph
    calls = [node for node in graph.nodes if node.op == "call_function"]
    keys = {(node.target, node.args) for node in calls}
    assert len(keys) == len(calls)
    products = [node.args for node in calls if node.target is operator.mul]
    assert not any(number in args for args in products for number in (0.0, 1.0, -1.0))


def test_what_an_optimiser_finds_becomes_a_model():
    truth = TILTED.with_values({"mu1": 0.15, "floor_tilt.tilt_x": -0.03})
    state, torque = course(truth, 11, 0.01)
    time = 0.01 * np.arange(len(torque))
    measured = torch.tensor(simulate(truth, time, torque.numpy(), state.numpy()))
    platform = to_torch(TILTED, trainable=["mu1", "floor_tilt.tilt_x"])
    optimiser = torch.optim.LBFGS(platform.parameters(), max_iter=8, line_search_fn="strong_wolfe")

    def loss() -> Any:
        optimiser.zero_grad()
        error = 1e3 * ((platform.rollout(state, torque, 0.01) - measured)[:, :3] ** 2).sum()
        error.backward()
        return error

    optimiser.step(loss)
    found = platform.to_model()
    assert found.values["mu1"] == pytest.approx(0.15, rel=1e-4)
    assert found.values["floor_tilt.tilt_x"] == pytest.approx(-0.03, rel=1e-4)
    assert found.values["m0"] == TILTED.values["m0"]
    assert found.covariance is None and found.logs == () and "mu1" in found.provenance["source"]


def test_back_to_a_model():
    assert to_torch(TILTED).to_model() is TILTED
    with pytest.raises(InputError, match="mu1 = -1 must not be negative"):
        to_torch_at(TILTED, "mu1", -1.0).to_model()


def test_it_is_copied_and_stored_as_any_module():
    platform = to_torch_at(TILTED, "m0", 40.0)
    state, torque = course(TILTED)
    expected = platform(state, torque[0])
    file = io.BytesIO()
    torch.save(platform.state_dict(), file)
    file.seek(0)
    stored = to_torch(TILTED)
    stored.load_state_dict(torch.load(file, weights_only=True))
    for other in (copy.deepcopy(platform), stored):
        assert torch.equal(other(state, torque[0]), expected)


def test_shapes_that_do_not_fit():
    platform = to_torch("paper")
    state, torque = torch.zeros(11), torch.zeros(4)
    for call in (
        lambda: platform(state[:10], torque),
        lambda: platform.step(state, torque[:3], 0.1),
        lambda: platform.rollout(state, torque, 0.1),
    ):
        with pytest.raises(InputError, match=r"needs states \(\.\.\., 11\) and torques"):
            call()


def test_names_that_torch_has_taken(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(effects.CATALOGUE, "_effects", dict(effects.CATALOGUE._effects))

    @effect(
        acts_at=WHEEL, parameters=[Parameter("half", "N m")], source="a test", recognise="A test."
    )
    def grip(xp, wheel, half):
        """Nothing physical."""
        return half * wheel.rate

    with pytest.raises(InputError, match="'half' is an attribute of torch modules"):
        to_torch(load_model("paper").with_effect("grip", half=0.1))


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"youbot\[rl\]"):
        to_torch("paper")
