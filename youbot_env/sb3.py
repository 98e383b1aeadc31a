"""Copies of YouBotTracking-v0 for Stable-Baselines3, in one compiled control period.

::

    from stable_baselines3 import PPO
    from youbot_env.sb3 import make_vec_env

    env = make_vec_env(1024, delay=1, randomise={"m0": ("80%", "120%")})
    PPO("MlpPolicy", env).learn(1_000_000)

Needs the extra ``rl``.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.tracking.actuation import whole_number
from youbot_env.tracking.batch import Batch, keys_of
from youbot_env.tracking.options import refuse_unknown, tracking_setup

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise InputError("youbot_env.sb3 needs Stable-Baselines3: pip install 'youbot[rl]'") from None

Array = NDArray[np.float64]


def make_vec_env(
    n_envs: int = 1,
    seed: int | None = None,
    *,
    stagger: bool = True,
    threads: int | None = None,
    **options: Any,
) -> TrackingVecEnv:
    """A vector environment of ``n_envs`` copies; ``options`` are those of ``YouBotTracking-v0``.

    Parameters
    ----------
    seed : copy i has the episodes of the single environment with seed + i; None: any
    stagger : the first episodes end early, each at a different time, so that a batch of steps
        always holds all parts of an episode
    threads : most threads; None takes ``YOUBOT_THREADS``, or a thread a core

    Raises
    ------
    InputError
        If an option cannot be, or Stable-Baselines3 is missing.
    """
    count = whole_number("n_envs", n_envs, least=1)
    refuse_unknown(options)
    setup = tracking_setup(**options)
    if setup.contact is not None:
        raise InputError(
            "plant: copies with real contacts are moved by MuJoCo one by one; use "
            "stable_baselines3's own make_vec_env"
        )
    found = TrackingVecEnv(Batch(setup, count, reports=False, threads=threads), stagger=stagger)
    found.seed(seed)
    return found


class TrackingVecEnv(VecEnv):
    """Rows of a ``Batch`` as a vector environment of Stable-Baselines3.

    A finished episode is followed by a new one at once. The ``info`` of a copy whose episode has
    ended holds "terminal_observation", "TimeLimit.truncated" and, as `Monitor` writes them,
    "episode" with return "r", length "l" and time "t" [s] since this object was made. No step has a
    Python loop over copies, only over the episodes that end in it.

    Parameters
    ----------
    rows : with autoreset ``NEVER``: here each episode's end is told before the next begins
    stagger : see ``make_vec_env``
    """

    def __init__(self, rows: Batch, *, stagger: bool = True) -> None:
        self.rows = rows
        count, steps = rows.platforms, rows.setup.steps
        self._steps, self._stagger = steps, stagger
        self._limit = np.full(count, steps)
        self._sum, self._length = np.zeros(count), np.zeros(count, np.int64)
        self._infos: list[dict[str, Any]] = [{} for _ in range(count)]
        self._told: list[int] = []
        self._begun, self._made = False, time.time()
        super().__init__(count, *self._spaces())
        self._action: NDArray[Any] = np.zeros((count, 4), np.float32)

    def _spaces(self) -> tuple[spaces.Box, spaces.Box]:
        task = self.rows.setup.task
        limit = task.twist_limit
        return (
            spaces.Box(-limit, limit, (task.observation_size,), np.float32),
            spaces.Box(-1.0, 1.0, (4,), np.float32),
        )

    # What a subclass may see and do otherwise ---------------------------------------------------

    def observe(self) -> NDArray[np.float32]:
        """Observations (n, D) of all copies now."""
        return self.rows.observation

    def act(self, actions: NDArray[Any]) -> None:
        """One control period under the network's actions (n, A)."""
        self.rows.step(np.ascontiguousarray(actions))

    def begin(self, chosen: NDArray[np.bool_], keys: NDArray[np.int64] | None) -> None:
        """Begin episodes of the copies chosen (n,); see ``Batch.begin``."""
        self.rows.begin(chosen, keys)

    # The interface of VecEnv --------------------------------------------------------------------

    def reset(self) -> NDArray[np.float32]:
        everyone, seeds = np.ones(self.num_envs, np.bool_), self._seeds
        if any(seed is not None for seed in seeds):
            self.begin(everyone, keys_of([0 if seed is None else seed for seed in seeds]))
        else:
            self.begin(everyone, None)
        self._reset_seeds()
        self._sum[:], self._length[:], self._limit[:] = 0.0, 0, self._steps
        if self._stagger and not self._begun:
            self._limit -= self._steps * np.arange(self.num_envs) // self.num_envs
        self._begun = True
        return self.observe()

    def step_async(self, actions: NDArray[Any]) -> None:
        self._action = actions

    def step_wait(self) -> Any:
        self.act(np.clip(self._action, -1.0, 1.0))
        rows = self.rows
        reward = rows.reward.astype(np.float32)
        self._sum += rows.reward
        self._length += 1
        done = rows.terminated | (self._length >= self._limit)
        seen = self.observe()
        for copy in self._told:  # the dictionaries are kept from step to step
            self._infos[copy] = {}
        self._told = np.flatnonzero(done).tolist()
        if self._told:
            self._tell_ends(seen, rows.terminated)
            self.begin(done, None)
            self._sum[done], self._length[done], self._limit[done] = 0.0, 0, self._steps
            seen = self.observe()
        return seen, reward, done, list(self._infos)

    def _tell_ends(self, seen: NDArray[np.float32], terminated: NDArray[np.bool_]) -> None:
        since = round(time.time() - self._made, 6)
        for copy in self._told:
            self._infos[copy] = {
                "terminal_observation": seen[copy].copy(),
                "TimeLimit.truncated": not terminated[copy],
                "episode": {
                    "r": float(self._sum[copy]),
                    "l": int(self._length[copy]),
                    "t": since,
                },
            }

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        known = {
            "model": self.rows.model,
            "reference": self.rows.reference,
            "state": self.rows.state,
        }
        copies = self._get_indices(indices)
        if attr_name in known:
            return [known[attr_name](copy) for copy in copies]
        return [getattr(self, attr_name, None) for _ in copies]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name}: these copies have no attributes to set")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        if method_name != "to_action":
            raise AttributeError(f"{method_name}: these copies have no methods of their own")
        found = self.rows.setup.actuation.to_action(*method_args, **method_kwargs)
        return [found for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        # The statistics that Monitor adds are there.
        return [issubclass(Monitor, wrapper_class) for _ in self._get_indices(indices)]


def spread_keys(seed: Sequence[int], count: int) -> NDArray[np.int64]:
    """Keys (n,) of random numbers from a sequence of whole numbers."""
    return np.random.SeedSequence(list(seed)).generate_state(count, np.uint64).view(np.int64)
