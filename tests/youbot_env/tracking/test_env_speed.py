"""One step costs no more than three of CartPole's, measured in the same run in the same way."""

from __future__ import annotations

import time

import gymnasium as gym
import numpy as np
import pytest

import youbot_env  # noqa: F401 - registers the environment

LIMIT = 3.0
STEPS, ROUNDS, ATTEMPTS = 500, 15, 5


def seconds_per_step(env, actions) -> float:
    env.reset(seed=0)
    start = time.perf_counter()
    for i in range(STEPS):
        _, _, terminated, truncated, _ = env.step(actions[i & 1])
        if terminated or truncated:
            env.reset()
    return (time.perf_counter() - start) / STEPS


@pytest.mark.parametrize("unwrapped", [False, True], ids=["made", "unwrapped"])
def test_costs_at_most_three_cartpole_steps(unwrapped):
    peer = gym.make("CartPole-v1", disable_env_checker=True)
    ours = gym.make("YouBotTracking-v0", disable_env_checker=True)
    torque = np.full(4, 0.2, np.float32)
    pair = [(peer, (0, 1)), (ours, (torque, -torque))]
    if unwrapped:
        pair = [(env.unwrapped, actions) for env, actions in pair]
    ratio = np.inf
    for _ in range(ATTEMPTS):
        # Turn by turn, so that a busy machine slows both; the least of many is the true cost.
        rounds = [[seconds_per_step(*case) for case in pair] for _ in range(ROUNDS)]
        cartpole, youbot = np.min(rounds, axis=0)
        ratio = min(ratio, youbot / cartpole)
        if ratio <= LIMIT:
            break
    print(f"{1e6 * youbot:.1f} us a step, CartPole {1e6 * cartpole:.1f} us: {ratio:.2f} times")
    assert ratio <= LIMIT
