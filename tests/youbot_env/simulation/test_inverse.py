"""The generated inverse dynamics says what the model says, for every effect of the catalogue."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from tests.sparing import mostly_slow
from tests.youbot_env.structures import CASES, model, random_instant
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant
from youbot_env.simulation.compiled import inverse_kernel
from youbot_env.simulation.generated_code import MOTION


def row(at: Instant) -> np.ndarray:
    values = (*at.twist, *at.acceleration, *at.pose, *at.wheel_angle, at.time)
    assert len(values) == len(MOTION)
    return np.array([values])


def interface_torque(code: Any, found: Model, at: Instant, guess: float = 0.0) -> np.ndarray:
    torque, out = np.full((1, 4), guess), np.empty(4)
    code.acting(row(at), found.lengths, found.theta, 1e-13, torque)
    code.interface(
        *(torque[0], np.array(at.torque_rate), np.array(at.torque_second_rate)),
        *(row(at)[0], found.lengths, found.theta, out),
    )
    return out


def stated(found: Model, at: Instant) -> np.ndarray:
    return found.inverse_dynamics(
        at.twist,
        at.acceleration,
        pose=at.pose,
        wheel_angle=at.wheel_angle,
        torque_rate=at.torque_rate,
        torque_second_rate=at.torque_second_rate,
        time=at.time,
    )


@pytest.mark.parametrize("case", mostly_slow(CASES, (CASES[0], CASES[-1], *CASES[1:8])))
def test_the_generated_source_is_the_models_inverse_dynamics(case: str) -> None:
    found = model(case)
    code, rng = inverse_kernel(found.structure, dynamics), np.random.default_rng(1)
    for _ in range(100):
        at = random_instant(rng)
        np.testing.assert_allclose(interface_torque(code, found, at), stated(found, at), atol=1e-11)


def test_it_is_found_again_from_a_pickle_and_its_addresses_are_not_carried() -> None:
    code = inverse_kernel(model("base").structure, dynamics)
    assert pickle.loads(pickle.dumps(code)).structure == code.structure
    with pytest.raises(TypeError, match="found again"):
        pickle.dumps(code.held)


@pytest.mark.parametrize("guess", [1.0, -3.0, 1e9, np.nan])
def test_a_first_guess_does_not_matter(guess: float) -> None:
    found = model("load_dependent_friction")
    code, at = inverse_kernel(found.structure, dynamics), random_instant(np.random.default_rng(3))
    torque = interface_torque(code, found, at, guess)
    np.testing.assert_allclose(torque, stated(found, at), atol=1e-11)
