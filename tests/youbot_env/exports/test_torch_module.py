"""The torch module is the model: derivative, steps, runs; and it is a module as any other."""

from __future__ import annotations

import ast
import copy
import inspect
import io
import sys

import numpy as np
import pytest

from tests.youbot_env.exports.torch_cases import (
    COUNT,
    LATE,
    TILTED,
    TWIST,
    course,
    instants,
    to_torch_at,
    torch,
)
from tests.youbot_env.structures import CASES, drive, model, random_instant
from youbot_env import InputError, Parameter, Plant, effect, load_model, to_torch
from youbot_env.physics import effect as effects
from youbot_env.physics.effect import WHEEL
from youbot_env.simulation.free_run import simulate


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
    late = LATE

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

    def test_a_single_step_refuses_it(self):
        state, torque = course(self.late)
        with pytest.raises(InputError, match="torque_delay of 0.037 s; use rollout"):
            to_torch(self.late).step(state, torque[0], 0.02)
        prompt = self.late.with_effect("torque_delay", delay=0.0)
        with pytest.raises(InputError, match="cannot learn a delay"):
            to_torch(prompt).step(state, torque[0], 0.02)
        with torch.no_grad():
            to_torch(prompt, trainable=["m0"]).step(state, torque[0], 0.02)


def test_the_wrench_is_the_models():
    rng = np.random.default_rng(2)
    at = random_instant(rng, COUNT)
    twist, acceleration, pose = (np.array(v).T for v in (at.twist, at.acceleration, at.pose))
    motion = torch.tensor(twist), torch.tensor(acceleration)
    found = to_torch(TILTED).wrench(*motion, pose=torch.tensor(pose))
    expected = TILTED.wrench(twist, acceleration, pose=pose)
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-12, atol=1e-12)


def test_torch_compile_takes_it_whole():
    # The front end alone: generating and compiling C++ takes a minute.
    platform = to_torch(TILTED)
    states, torques = instants(TILTED)
    compiled = torch.compile(platform, backend="eager", fullgraph=True)
    with torch.no_grad():
        expected = platform(states, torques)
        np.testing.assert_allclose(compiled(states, torques), expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("case", CASES)
def test_no_device_is_built_in(case: str):
    """On torch's device without storage, which refuses to meet another one."""
    platform = to_torch(model(case), device="meta")
    state, torque = (part.to("meta") for part in course(model(case), 3))
    assert platform(state, torque).shape == (3, len(state))
    assert platform.rollout(state, torque, 0.02, substeps=1).device.type == "meta"


def test_the_code_says_nothing_twice():
    tree = ast.parse(inspect.getsource(to_torch("paper")._rates.func))
    steps = [node.value for node in ast.walk(tree) if isinstance(node, ast.Assign)]
    said = [ast.dump(step) for step in steps]
    assert len(said) > 10
    assert len(set(said)) == len(said)
    products = [
        (node.left, node.right)
        for node in ast.walk(tree)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)
    ]
    factors = [part.value for pair in products for part in pair if isinstance(part, ast.Constant)]
    assert not any(number in factors for number in (0, 1, -1))


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
