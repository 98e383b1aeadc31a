"""Rows that are moved in blocks: as alone to the bit, full blocks or not."""

from __future__ import annotations

import numpy as np
import pytest

from youbot_env import load_model
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.lane_kernel import stepper
from youbot_env.simulation.lane_layout import LANES, TOGETHER


def rows(count):
    """Models with a dry friction that differ: their states, torques and parameters."""
    model = load_model("paper").with_effect("wheel_coulomb_friction", torque=0.2)
    rng = np.random.default_rng(0)
    states = np.array([initial_state(model, twist=rng.normal(size=3)) for _ in range(count)])
    theta = model.theta * rng.uniform(0.9, 1.1, (count, 1))
    return model, states, rng.normal(size=(count, 4)), theta


@pytest.mark.parametrize("count", [1, TOGETHER + 1, LANES, 2 * LANES + 13])
def test_rows_move_as_alone_to_the_bit(count):
    """Whether a block is full, or a loop ends amid a vector."""
    model, states, torque, theta = rows(count)
    advance, alone = stepper(model.structure), states.copy()
    for k in range(count):
        here = slice(k, k + 1)
        advance(alone[here], torque[here], model.lengths, theta[here], 0.02, 7)
    advance(states, torque, model.lengths, theta, 0.02, 7)
    np.testing.assert_array_equal(states, alone)


def test_arrays_that_do_not_lie_side_by_side_are_refused():
    """Their numbers would be read beside them."""
    model, states, torque, theta = rows(20)
    wide = np.zeros((20, 8))
    wide[:, ::2] = torque
    for wrong in (
        (np.asfortranarray(states), torque, model.lengths, theta),
        (states, wide[:, ::2], model.lengths, theta),
        (states, torque, model.lengths, np.asfortranarray(theta)),
        (states, torque.astype(np.float32), model.lengths, theta),
    ):
        with pytest.raises(TypeError):
            stepper(model.structure)(*wrong, 0.01, 2)


def test_a_duration_of_zero_changes_nothing():
    model, states, torque, theta = rows(3)
    moved = states.copy()
    stepper(model.structure)(moved, torque, model.lengths, theta, 0.0, 1)
    np.testing.assert_array_equal(moved, states)
