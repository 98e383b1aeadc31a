"""The environment that the README tells a stranger to write moves exactly as ours does."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from youbot_env import Plant, load_model
from youbot_env.tracking.env import YouBotTrackingEnv


class HoldSpeed(gym.Env):
    """Drive straight on at 0.3 m/s although the floor slopes."""

    action_space = gym.spaces.Box(-2, 2, (4,))
    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float64)

    def __init__(self, model):
        model = load_model(model).with_effect("floor_tilt", tilt_x=0.02, tilt_y=-0.01)
        self.plant = Plant(model)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.plant.reset(twist=(0.1, 0.0, 0.0))
        return self.plant.twist, {}

    def step(self, action):
        self.plant.step(action, 0.01)
        error = self.plant.twist - (0.3, 0.0, 0.0)
        return self.plant.twist, -float(error @ error), False, False, {}


@pytest.mark.parametrize("randomise", [None, {"m0": (40.0, 40.0), "mu1": ("110%", "110%")}])
def test_equals_ours_over_an_episode(randomise):
    start = {"twist": (0.1, 0.0, 0.0)}
    ours = YouBotTrackingEnv(
        effects={"floor_tilt": {"tilt_x": 0.02, "tilt_y": -0.01}},
        randomise=randomise,
        initial_state=start,
    )
    ours.reset(seed=1)
    theirs = HoldSpeed(ours.model.without_effects())
    theirs.reset(seed=1)
    rng, truncated, worst, moved = np.random.default_rng(0), False, 0.0, 0.0
    while not truncated:
        _, _, _, truncated, info = ours.step(rng.uniform(-1, 1, 4))
        twist, *_ = theirs.step(info["commanded_torque"])
        worst = max(worst, np.abs(theirs.plant.state - ours.state).max())
        worst = max(worst, np.abs(twist - info["twist"]).max())
        moved = max(moved, np.abs(info["twist"]).max())
    assert worst <= 1e-12
    assert moved > 0.05


def test_the_effect_matters():
    plain, tilted = Plant("paper"), HoldSpeed("paper").plant
    for _ in range(100):
        plain.step((0.3, 0.3, 0.3, 0.3), 0.01)
        tilted.step((0.3, 0.3, 0.3, 0.3), 0.01)
    assert abs(plain.twist[0] - tilted.twist[0]) > 0.01
