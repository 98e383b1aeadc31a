"""The environment's fast platforms as a vector environment of Stable-Baselines3.

Observations are turned into features and outputs into wheel actions here, so that the network in
training sees what the exported policy will see.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from controllers.interface import Array, Controller, Observation
from controllers.loop import ReferenceTable, preview_needed
from controllers.policy.inputs import Layout
from controllers.policy.policy import FEATURE_LIMIT, combined_action
from youbot_env.errors import finite
from youbot_env.model.model import Model
from youbot_env.tracking.actuation import Actuation
from youbot_env.tracking.randomisation import Ranges, source
from youbot_env.tracking.sensors import Sensors
from youbot_env.tracking.stepper import Setup, Stepper, episode_steps
from youbot_env.tracking.task import TrackingTask, twist_scale
from youbot_scripts.training.conditions import Conditions

MakeBase = Callable[[], Controller]
"""Makes the base controller, one for each platform."""


class BaseControllers:
    """Base controllers, one for each platform of ``stepper``.

    They get the same observations as in ``policy.without_torque``.

    Attributes
    ----------
    action : (n, 4) torques that they command now, over the torque limit
    """

    def __init__(self, make: MakeBase, stepper: Stepper) -> None:
        self._stepper = stepper
        count = len(stepper.clock)
        self._controllers = [make() for _ in range(count)]
        self._ahead = preview_needed(self._controllers)
        self._tables: dict[int, ReferenceTable] = {}
        self.action = np.zeros((count, 4))

    def begin(self, row: int) -> None:
        """Reset the controller of a platform that has been reset."""
        setup, motion = self._stepper.setup, self._stepper.references[row]
        assert motion is not None
        self._tables[row] = ReferenceTable(motion, setup.period, setup.steps + 1, self._ahead)
        self._controllers[row].reset()
        self._ask(row)

    def follow(self) -> None:
        """Compute the actions of all controllers, after a step."""
        for row in range(len(self._controllers)):
            self._ask(row)

    def _ask(self, row: int) -> None:
        _, _, info = self._stepper.result(row)
        observation = Observation(
            info["time"], info["wheel_speed"], info["measured_twist"], info["pose"]
        )
        reference = self._tables[row].at(int(self._stepper.clock[row]))
        torque = self._controllers[row](observation, reference)
        self.action[row] = torque / self._stepper.setup.actuation.torque_limit


class PlatformBatch:
    """Platforms that a policy drives, alone or added to a base controller.

    Parameters
    ----------
    setup : of the platforms
    count : how many
    make_base : makes the base controllers; None for a policy alone
    share : largest share of the torque limit that the policy may use
    """

    def __init__(
        self, setup: Setup, count: int, make_base: MakeBase | None = None, share: float = 1.0
    ) -> None:
        self.stepper = Stepper(setup, count)
        self.share = share
        self._beneath = None if make_base is None else BaseControllers(make_base, self.stepper)

    @property
    def layout(self) -> Layout:
        """Of what ``observe`` gives."""
        setup, scale = self.stepper.setup, twist_scale(self.stepper.plant.geometry)
        task, base = setup.task, self._beneath is not None
        return Layout(tuple(scale.tolist()), task.preview, task.action_history, base)

    def reset(self, row: int, rng: np.random.Generator) -> None:
        """Begin an episode of one platform."""
        self.stepper.reset(row, rng)
        if self._beneath is not None:
            self._beneath.begin(row)

    def step(self, action: Array) -> None:
        """One control period under the policy's wheel actions (n, 4)."""
        base = None if self._beneath is None else self._beneath.action
        self.stepper.step(combined_action(self.share * action, base))
        if self._beneath is not None:
            self._beneath.follow()

    def observe(self) -> Array:
        """Observations (n, D) as ``controllers.policy.inputs.Layout`` has them."""
        seen = self.stepper.observation.astype(np.float64)
        return seen if self._beneath is None else np.hstack([seen, self._beneath.action])


class TrackingVecEnv(VecEnv):
    """Platforms as a vector environment of Stable-Baselines3.

    A finished episode is followed by a new one at once. The first episodes end early, each at a
    different time, so that a batch always contains all parts of an episode.

    Parameters
    ----------
    fleet : the platforms
    features : (F, D) applied to observations, see ``controllers.policy.inputs``
    mix : (4, A) wheel actions of the network's outputs
    seed : of models, references and noise; a sequence of whole numbers
    """

    def __init__(
        self, fleet: PlatformBatch, features: Array, mix: Array, seed: Sequence[int]
    ) -> None:
        self._fleet, self._features, self._mix = fleet, features, mix
        count, steps = len(fleet.stepper.clock), fleet.stepper.setup.steps
        streams = np.random.SeedSequence(list(seed)).spawn(count)
        self._generators = [np.random.default_rng(stream) for stream in streams]
        self._steps = steps
        # Different lengths of the first episodes, spread evenly: see the class's docstring.
        self._left = steps - steps * np.arange(count) // count
        self._sum, self._length = np.zeros(count), np.zeros(count, int)
        self._action = np.zeros((count, mix.shape[1]))
        super().__init__(
            count,
            spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (len(features),), np.float32),
            spaces.Box(-1.0, 1.0, (mix.shape[1],), np.float32),
        )

    def _see(self) -> NDArray[np.float32]:
        found = self._fleet.observe() @ self._features.T
        return np.clip(found, -FEATURE_LIMIT, FEATURE_LIMIT).astype(np.float32)

    def reset(self) -> NDArray[np.float32]:
        for row, generator in enumerate(self._generators):
            self._fleet.reset(row, generator)
        return self._see()

    def step_async(self, actions: NDArray[Any]) -> None:
        self._action = np.clip(actions.astype(np.float64), -1.0, 1.0)

    def step_wait(self) -> Any:
        stepper = self._fleet.stepper
        self._fleet.step(self._action @ self._mix.T)
        # Copies: the resets below write into the stepper's arrays.
        reward, terminated = stepper.reward.copy(), stepper.terminated.copy()
        self._left -= 1
        self._sum += reward
        self._length += 1
        done = terminated | (self._left <= 0)
        seen = self._see()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(done).tolist():
            # Before the reset: a truncated episode is continued by the value of its last
            # observation.
            infos[row] = self._ended(row, seen[row], bool(terminated[row]))
            self._fleet.reset(row, self._generators[row])
        if done.any():
            seen = self._see()
        return seen, reward.astype(np.float32), done, infos

    def _ended(self, row: int, seen: NDArray[np.float32], terminated: bool) -> dict[str, Any]:
        total, length = float(self._sum[row]), int(self._length[row])
        self._left[row], self._sum[row], self._length[row] = self._steps, 0.0, 0
        return {
            "terminal_observation": seen.copy(),
            "TimeLimit.truncated": not terminated,
            "episode": {"r": total, "l": length, "t": 0.0},
        }

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name}: these platforms have no attributes to set")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        raise AttributeError(f"{method_name}: these platforms have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


def tracking_setup(
    conditions: Conditions, model: Model, ranges: Ranges | str | None = None
) -> Setup:
    """Setup of a ``Stepper``; with ``ranges`` each episode draws a new model."""
    added = {}
    if conditions.lag is not None:
        added["actuator_lag"] = {"time_constant": finite("lag", conditions.lag, positive=True)}
    period = 1.0 / finite("control_rate", conditions.control_rate, positive=True)
    return Setup(
        source=source(ranges, model, added),
        task=TrackingTask(
            conditions.band,
            conditions.tones,
            conditions.amplitude,
            conditions.ramp,
            conditions.preview,
            conditions.action_history,
            conditions.reward_weights,
            conditions.reward_margins,
        ),
        actuation=Actuation(conditions.torque_limit, conditions.delay),
        sensors=Sensors(conditions.wheel_speed_noise, conditions.encoder_ticks),
        period=period,
        steps=episode_steps(conditions.episode_length, period),
    )
