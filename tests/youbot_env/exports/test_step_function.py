"""The plain function moves as the plant does and remembers nothing."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, drive, model
from youbot_env import InputError, Plant, initial_state, load_model, step_function

START = {"twist": (0.3, -0.1, 0.2), "pose": (0.5, 0.2, 1.0), "time": 29.9}


@pytest.mark.parametrize("case", CASES)
def test_it_is_the_plant(case: str):
    m = model(case)
    if m.delay:
        m = m.with_effect("torque_delay", delay=0.0)
    step, plant = step_function(m, 0.02), Plant(m)
    state = plant.reset(**START)
    for torque in drive(0.02 * np.arange(20)):
        state = step(state, torque)
        plant.step(torque, 0.02)
    np.testing.assert_allclose(state, plant.state, rtol=0, atol=1e-12)


def test_leading_axes_broadcast_and_arguments_stay():
    step = step_function("paper", 0.01)
    state = initial_state(load_model("paper"), **START)
    states, torque = np.stack([state, 2 * state]), drive(np.linspace(0, 3, 5))
    before = states.copy(), torque.copy()
    found = step(states[:, None], torque)
    assert found.shape == (2, 5, len(state))
    for i in range(2):
        for j in range(5):
            np.testing.assert_array_equal(found[i, j], step(states[i], torque[j]))
    np.testing.assert_array_equal(states, before[0])
    np.testing.assert_array_equal(torque, before[1])


def test_it_can_be_sent_to_another_process():
    step = step_function("paper", 0.01)
    state = initial_state(step.model, **START)
    again = pickle.loads(pickle.dumps(step))
    np.testing.assert_array_equal(again(state, np.ones(4)), step(state, np.ones(4)))


def test_it_refuses_what_a_state_cannot_hold():
    late = load_model("paper").with_effect("torque_delay", delay=0.05)
    with pytest.raises(InputError, match=r"torque_delay of 0.05 s; use youbot_env.Plant"):
        step_function(late, 0.01)
    step_function(late.with_effect("torque_delay", delay=0.0), 0.01)


@pytest.mark.parametrize("options", [{"duration": 0.0}, {"duration": float("nan")}])
def test_durations_that_cannot_be(options: dict):
    with pytest.raises(InputError, match="duration"):
        step_function("paper", **options)
    with pytest.raises(InputError, match="substeps"):
        step_function("paper", 0.01, substeps=0)


@pytest.mark.parametrize(("state", "torque"), [((10,), (4,)), ((11,), (3,)), ((), (4,))])
def test_shapes_that_do_not_fit(state: tuple[int, ...], torque: tuple[int, ...]):
    with pytest.raises(InputError, match=r"\(\.\.\., 11\).*\(\.\.\., 4\)"):
        step_function("paper", 0.01)(np.zeros(state), np.zeros(torque))
