"""Env steps a second of PPO in a user's own script: this package's copies beside Gymnasium's own.

Needs the extra ``rl``.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

from youbot_env.errors import optional_library

OPTIONS = {"delay": 1, "wheel_speed_noise": 0.01, "randomise": {"m0": ("95%", "105%")}}
"""Of the environments of README's example."""

README = (4096, 512, 5)
"""Of its learner: steps a round, samples a batch, epochs."""


@dataclass(frozen=True)
class LearningSpeed:
    """A row: env steps a second of a core, learning included.

    copies : side by side; a_round : steps between two updates; batch : samples a gradient step
    epochs : how often an update goes through a round's steps
    """

    name: str
    copies: int
    a_round: int
    batch: int
    epochs: int
    rate: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def learning_speeds(steps: int = 32_768) -> list[LearningSpeed]:
    """PPO on ``youbot_env.sb3`` as in README; on 8 copies in Stable-Baselines3's ``DummyVecEnv``.

    The latter with its own settings, and with README's. Processor seconds: other work on the
    machine counts less.
    """
    needed = ("rl", "the part training needs Stable-Baselines3", "leave it out")
    sb3 = optional_library("stable_baselines3", *needed)
    torch = optional_library("torch", *needed)
    from stable_baselines3.common.env_util import make_vec_env as copies_one_by_one

    from youbot_env.sb3 import make_vec_env

    many = make_vec_env(64, seed=0, threads=1, **OPTIONS)
    few = copies_one_by_one("youbot_env:YouBotTracking-v0", n_envs=8, env_kwargs=OPTIONS)
    cases = (
        ("youbot_env.sb3", many, *README),
        ("DummyVecEnv, its settings", few, 16_384, 64, 10),
        ("DummyVecEnv, README's settings", few, *README),
    )
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return [_measured(sb3.PPO, *case, steps) for case in cases]
    finally:
        torch.set_num_threads(before)


def _measured(
    algorithm: Any, name: str, env: Any, a_round: int, batch: int, epochs: int, steps: int
) -> LearningSpeed:
    learner = algorithm(
        "MlpPolicy",
        env,
        n_steps=a_round // env.num_envs,
        batch_size=batch,
        n_epochs=epochs,
        gamma=0.9,
        seed=0,
        device="cpu",
    )
    learner.learn(a_round)  # so that nothing is compiled or loaded while the clock runs
    start = time.process_time()
    learner.learn(max(steps, a_round))
    rate = learner.num_timesteps / (time.process_time() - start)
    return LearningSpeed(name, env.num_envs, a_round, batch, epochs, rate)
