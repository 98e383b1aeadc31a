"""A mechanism from outside simulates, is identified and diagnosed by the code of all others."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from identification.comparison import compare
from identification.diagnosis.diagnose import diagnose
from identification.fitting.identify import identify
from identification.logs.log import Log
from identification.mechanisms.registry import MECHANISMS, Entry, mechanism_of
from tests.identification.mechanisms import omni_platform as omni
from youbot_env.model.model import Estimate, Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant
from youbot_env.simulation.free_run import simulate_theta


def platform(**effects: dict[str, float]) -> Model[omni.Lengths]:
    """A platform of 9 kg, with effects at given values."""
    values, lengths = {"mass": 9.0, "inertia": 0.3, "spin": 0.004, "viscous": 0.05}, omni.Lengths()
    declared = omni.OMNI.base_parameters(lengths)
    base = {name: Estimate(values[name], known.unit) for name, known in declared.items()}
    found = Model(lengths, base, name="omni", mechanism=omni.OMNI)
    for name, of in effects.items():
        found = found.with_effect(name, **of)
    return found


RATE, SECONDS = 50.0, 60.0


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setitem(
        MECHANISMS, "omni", lambda: Entry(omni.CONVENTIONS, lambda logs, unit: platform())
    )
    yield


def driven(model: Model[Any], seed: int, noise: float = 1.0) -> Log:
    """A log of the model in free run under torques that move it every way, with usual noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    tones = 2 * np.pi * rng.uniform(0.08, 0.5, (3, 4))
    phase = rng.uniform(0, 2 * np.pi, (3, 4))
    torque = 0.35 * np.sin(time[:, None, None] * tones + phase).sum(axis=2)
    start = np.zeros(len(model.structure.state_names))
    states = simulate_theta(
        model.structure, model.geometry, model.theta, np.diff(time), torque, start
    )
    speed = np.array(omni.wheel_rates(model.geometry, tuple(states[:, :3].T))).T
    return Log(
        f"drive_{seed}",
        omni.JOINTS,
        time,
        speed + noise * 0.01 * rng.standard_normal(speed.shape),
        torque + noise * 0.01 * rng.standard_normal(torque.shape),
        pose=states[:, 3:6],
    )


def test_forward_after_inverse_is_the_identity():
    model = platform(slope={"slope_x": 2.0, "slope_y": -1.0}, dry_friction={"torque": 0.1})
    where = (model.structure, model.geometry, model.theta)
    at = Instant((0.3, -0.2, 0.5), (0.4, 0.5, -0.6), (0.1, 0.2, 0.7))
    torque = dynamics.inverse_dynamics(np, *where, at)
    state = [*at.twist, *at.pose, 0.0]
    rates = dynamics.state_derivative(np, *where, state, torque)
    np.testing.assert_allclose(rates[:3], at.acceleration, rtol=1e-12)
    np.testing.assert_allclose(
        model.inverse_dynamics(at.twist, at.acceleration, pose=at.pose), torque
    )


def test_planted_parameters_come_back_and_predict():
    truth = platform()
    found = identify([driven(truth, 1)], start=platform().with_values({"mass": 5.0}))
    for name, value in truth.values.items():
        estimate = found.model.parameters[name]
        assert estimate.std is not None and abs(estimate.value - value) < 3 * estimate.std
        assert estimate.std < 0.05 * value
    errors = compare(found.model, [driven(truth, 2)]).to_dict()
    assert errors["total"]["velocity_error"] < 1.5 * errors["noise_floor"]["velocity_error"]


@pytest.mark.parametrize(
    ("effect", "values"),
    [("slope", {"slope_x": 2.0, "slope_y": -1.0}), ("dry_friction", {"torque": 0.1})],
)
def test_a_hidden_effect_is_named(effect: str, values: dict[str, float]):
    truth = platform(**{effect: values})
    found = diagnose(platform(), [driven(truth, 3), driven(truth, 4)])
    assert found.verdict == "effect" and found.missing == (effect,)
    for name, value in values.items():
        estimate = found.model.effects[effect][name]
        assert estimate.std is not None and abs(estimate.value - value) < 3 * estimate.std


def test_nothing_hidden_is_called_adequate():
    assert diagnose(platform(), [driven(platform(), 5), driven(platform(), 6)]).missing == ()


def test_its_structure_is_found_again_from_a_pickle():
    structure = platform().structure
    assert pickle.loads(pickle.dumps(structure)) == structure
    assert mechanism_of(platform()).joints == omni.JOINTS
