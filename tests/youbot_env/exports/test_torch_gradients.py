"""Gradients of the torch module are true, and an optimiser can follow them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.youbot_env.exports.torch_cases import (
    LATE,
    TILTED,
    TWIST,
    course,
    instants,
    torch,
)
from tests.youbot_env.structures import CASES, model
from youbot_env import to_torch
from youbot_env.exports.control_systems import steady
from youbot_env.simulation.free_run import simulate


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


class _Run(torch.nn.Module):
    """A rollout as a module's call, so that functional_call can give it parameters."""

    def __init__(self, of: Any) -> None:
        super().__init__()
        self.of = of

    def forward(self, state: Any, torque: Any) -> Any:
        return self.of.rollout(state, torque, 0.02)


def test_the_gradient_of_a_delay_is_the_slope_of_the_run():
    platform = to_torch(LATE, trainable=["torque_delay.delay"])
    state, torque = course(LATE)

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
