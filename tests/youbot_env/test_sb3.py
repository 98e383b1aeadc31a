"""The copies as Stable-Baselines3 sees them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from youbot_env import InputError
from youbot_env.tracking.env import YouBotTrackingEnv

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize  # noqa: E402

from youbot_env.sb3 import make_vec_env  # noqa: E402

NOISY = {
    "wheel_speed_noise": 0.02,
    "encoder_ticks": 4000,
    "delay": 1,
    "randomise": {"m0": ("80%", "120%")},
    "episode_length": 0.1,
}


def test_copies_are_single_environments():
    many, single = make_vec_env(4, seed=5, stagger=False, **NOISY), YouBotTrackingEnv(**NOISY)
    seen: Any = many.reset()
    alone, _ = single.reset(seed=7)
    assert np.array_equal(seen[2], alone)
    rng, total = np.random.default_rng(0), 0.0
    for _ in range(25):
        action = rng.uniform(-1.5, 1.5, (4, 4)).astype(np.float32)
        found: Any = many.step(action)
        seen, reward, done, infos = found
        alone, gain, terminated, truncated, _ = single.step(np.clip(action[2], -1, 1))
        total += gain
        assert reward[2] == np.float32(gain) and done[2] == (terminated or truncated)
        if not done[2]:
            assert infos[2] == {}
        else:
            assert np.array_equal(infos[2]["terminal_observation"], alone)
            assert infos[2]["TimeLimit.truncated"] and infos[2]["episode"]["l"] == 10
            assert infos[2]["episode"]["r"] == pytest.approx(total)
            assert infos[2]["episode"]["t"] >= 0
            alone, _ = single.reset()
            total = 0.0
        assert np.array_equal(seen[2], alone)


def test_first_episodes_end_one_after_another():
    many = make_vec_env(5, seed=0, **NOISY)
    many.reset()
    ends = np.array([many.step(np.zeros((5, 4)))[2] for _ in range(20)])
    assert ends.argmax(axis=0).tolist() == [9, 7, 5, 3, 1]
    assert (np.diff(np.flatnonzero(ends[:, 4])) == 10).all()


def test_wrappers_and_statistics_work():
    made = make_vec_env(3, seed=0, **NOISY)
    assert made.env_is_wrapped(Monitor) == [True] * 3
    with pytest.warns(UserWarning, match="already wrapped"):
        wrapped = VecNormalize(VecMonitor(made))
    wrapped.reset()
    seen = []
    for _ in range(30):
        found, _, done, infos = wrapped.step(np.zeros((3, 4)))
        assert isinstance(found, np.ndarray) and found.shape == (3, 25)
        seen += [infos[copy]["episode"]["l"] for copy in np.flatnonzero(done)]
    assert seen.count(10) >= 6


def test_ppo_learns_on_it():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = PPO("MlpPolicy", make_vec_env(8, **NOISY), n_steps=16, batch_size=64, n_epochs=1)
        model.learn(256)
        rewards, lengths = evaluate_policy(
            model, make_vec_env(2, seed=1, stagger=False, **NOISY), 4, return_episode_rewards=True
        )
    assert lengths == [10] * 4 and np.min(rewards) > 0
    assert model.ep_info_buffer


def test_a_wrong_option_is_one_clear_line():
    for options, words in (
        ({"wheel_noise": 1}, "did you mean"),
        ({"n_envs": 0}, "n_envs"),
        ({"plant": "contact"}, "MuJoCo"),
    ):
        with pytest.raises(InputError) as caught:
            make_vec_env(**{"n_envs": 2, **options})
        assert words in str(caught.value) and "\n" not in str(caught.value)
