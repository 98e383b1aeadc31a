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

from controllers.interface import Array, Controller, Observation
from controllers.loop import ReferenceTable, preview_needed
from controllers.policy.inputs import Layout
from controllers.policy.policy import FEATURE_LIMIT, combined_action
from youbot_env.model.model import Model
from youbot_env.sb3 import TrackingVecEnv, spread_keys
from youbot_env.tracking.batch import INFO, Batch
from youbot_env.tracking.options import tracking_setup
from youbot_env.tracking.randomisation import Ranges
from youbot_env.tracking.setup import Setup
from youbot_env.tracking.task import twist_scale
from youbot_scripts.training.conditions import Conditions

MakeBase = Callable[[], Controller]
"""Makes the base controller, one for each platform."""


class BaseControllers:
    """Base controllers, one for each row of ``rows``, which report.

    They get the same observations as in ``policy.without_torque``.

    Attributes
    ----------
    action : (n, 4) torques that they command now, over the torque limit
    """

    def __init__(self, make: MakeBase, rows: Batch) -> None:
        self._rows = rows
        self._controllers = [make() for _ in range(rows.platforms)]
        self._ahead = preview_needed(self._controllers)
        self._tables: dict[int, ReferenceTable] = {}
        self.action = np.zeros((rows.platforms, 4))

    def begin(self, chosen: NDArray[np.bool_]) -> None:
        """Reset the controllers of the rows that have been reset."""
        setup, clock = self._rows.setup, self._rows.clock
        for row in np.flatnonzero(chosen).tolist():
            motion = self._rows.reference(row)
            assert motion is not None
            self._tables[row] = ReferenceTable(motion, setup.period, setup.steps + 1, self._ahead)
            self._controllers[row].reset()
            self._ask(row, clock)

    def follow(self) -> None:
        """Compute the actions of all controllers, after a step."""
        clock = self._rows.clock
        for row in range(len(self._controllers)):
            self._ask(row, clock)

    def _ask(self, row: int, clock: NDArray[np.int64]) -> None:
        setup, line = self._rows.setup, self._rows.results.report[row]
        observation = Observation(
            float(clock[row]) * setup.period,
            *(line[INFO[name]] for name in ("wheel_speed", "measured_twist", "pose")),
        )
        torque = self._controllers[row](observation, self._tables[row].at(int(clock[row])))
        self.action[row] = torque / setup.actuation.torque_limit


class PlatformBatch:
    """Platforms that a policy drives, alone or added to a base controller.

    Parameters
    ----------
    setup : of the platforms
    count : how many
    make_base : makes the base controllers; None for a policy alone
    share : largest share of the torque limit that the policy may use
    reports : whether steps fill ``rows.results.report``; base controllers need it
    """

    def __init__(
        self,
        setup: Setup,
        count: int,
        make_base: MakeBase | None = None,
        share: float = 1.0,
        reports: bool = True,
    ) -> None:
        self.rows = Batch(setup, count, reports=reports or make_base is not None)
        self.share = share
        self._beneath = None if make_base is None else BaseControllers(make_base, self.rows)

    @property
    def layout(self) -> Layout:
        """Of what ``observe`` gives."""
        task, scale = self.rows.setup.task, twist_scale(self.rows.geometry)
        base = self._beneath is not None
        return Layout(tuple(scale.tolist()), task.preview, task.action_history, base)

    def begin(
        self, chosen: NDArray[np.bool_] | None = None, keys: NDArray[np.int64] | None = None
    ) -> None:
        """Begin episodes of the rows chosen; see ``Batch.begin``."""
        self.rows.begin(chosen, keys)
        if self._beneath is not None:
            everyone = np.ones(self.rows.platforms, np.bool_)
            self._beneath.begin(everyone if chosen is None else chosen)

    def step(self, action: Array) -> None:
        """One control period under the policy's wheel actions (n, 4)."""
        base = None if self._beneath is None else self._beneath.action
        self.rows.step(np.ascontiguousarray(combined_action(self.share * action, base)))
        if self._beneath is not None:
            self._beneath.follow()

    def observe(self) -> Array:
        """Observations (n, D) as ``controllers.policy.inputs.Layout`` has them."""
        seen = self.rows.observation.astype(np.float64)
        return seen if self._beneath is None else np.hstack([seen, self._beneath.action])


class FeatureVecEnv(TrackingVecEnv):
    """Platforms as a vector environment of Stable-Baselines3, with features as observations.

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
        super().__init__(fleet.rows)
        self._keys: NDArray[np.int64] | None = spread_keys(seed, self.num_envs)

    def _spaces(self) -> tuple[spaces.Box, spaces.Box]:
        return (
            spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (len(self._features),), np.float32),
            spaces.Box(-1.0, 1.0, (self._mix.shape[1],), np.float32),
        )

    def observe(self) -> NDArray[np.float32]:
        found = self._fleet.observe() @ self._features.T
        return np.clip(found, -FEATURE_LIMIT, FEATURE_LIMIT).astype(np.float32)

    def act(self, actions: NDArray[Any]) -> None:
        self._fleet.step(actions.astype(np.float64) @ self._mix.T)

    def begin(self, chosen: NDArray[np.bool_], keys: NDArray[np.int64] | None) -> None:
        # The run's own seed counts, not the one that Stable-Baselines3 hands on; once.
        self._fleet.begin(chosen, self._keys)
        self._keys = None


def platform_setup(
    conditions: Conditions, model: Model, ranges: Ranges | str | None = None
) -> Setup:
    """Setup of the platforms; with ``ranges`` each episode draws a new model."""
    return tracking_setup(model, randomise=ranges, **conditions.to_dict())
