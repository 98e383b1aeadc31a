"""The stepper behind every environment: platforms that track references side by side.

Every array has a leading row per platform, and one platform is a batch of one: the same code.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.simulation.plant import Plant
from youbot_env.simulation.platforms import Platforms
from youbot_env.tracking.actuation import reject, take
from youbot_env.tracking.randomisation import episode_streams
from youbot_env.tracking.sampled_plant import SampledPlant
from youbot_env.tracking.setup import Setup, checked_start, integration_steps
from youbot_env.tracking.task import (
    ENDED,
    REPORT,
    REPORT_WIDTH,
    REWARD,
    REWARD_TERMS,
    TERMS,
    assess,
    reference_table,
)

Array = NDArray[np.float64]


class Shown:
    """Results of a call. New arrays each time, so that results handed out before do not change."""

    __slots__ = (
        *("observation", "report", "wheel_speed", "body_twist"),
        *("commanded", "applied", "saturated"),
    )

    def __init__(self, count: int, observation_size: int) -> None:
        self.observation = np.empty((count, observation_size), np.float32)
        self.report = np.empty((count, REPORT_WIDTH))
        self.wheel_speed = np.empty((count, 4))
        self.body_twist = np.empty((count, 3))
        self.commanded = np.empty((count, 4))
        self.applied = self.commanded
        self.saturated = np.empty((count, 4), np.bool_)

    def copy(self) -> Shown:
        """The same values in arrays of their own."""
        twin = object.__new__(Shown)
        for name in self.__slots__:
            setattr(twin, name, getattr(self, name).copy())
        return twin


class Stepper:
    """``platforms`` rows of one setup.

    Attributes
    ----------
    setup : what it was built from
    plant : the platforms
    clock : (n,) control periods since each platform's reset
    references : the motion that each follows
    """

    def __init__(self, setup: Setup, platforms: int = 1) -> None:
        self.setup = setup
        task, samples = setup.task, setup.steps + 1
        model = setup.source.draw(np.random.default_rng(0))
        checked_start(setup.start, task.largest_twist(model.geometry))
        if setup.reference is None:  # so that what cannot be shows here, not at the first reset
            task.reference(np.random.default_rng(0), samples * setup.period, model.geometry)
        self.plant = self._plant(model, platforms)
        self._sampled = SampledPlant(
            self.plant, setup.sensors, setup.period, samples, setup.actuation.delay * setup.period
        )
        self.clock = self._sampled.clock
        self.references: list[Motion | None] = [setup.reference] * platforms
        self._parameters: list[dict[str, float]] = [model.values] * platforms
        self._numbers = task.numbers(model.geometry)
        self._shape = (task.preview, task.action_history)
        self._table = np.zeros((platforms, samples + task.preview, 6))
        # The smoothness term reads the last two actions, even if fewer are observed.
        self._past = np.zeros((platforms, max(task.action_history, 2), 4))
        self._all = (0, platforms)
        self._shown = Shown(platforms, task.observation_size)

    def _plant(self, model: Model, platforms: int) -> Platforms:
        if self.setup.contact is None:
            return Plant(model, platforms=platforms, substeps=integration_steps(self.setup))
        from youbot_env.contact.plant import ContactPlant

        return ContactPlant(model, self.setup.contact, platforms=platforms)

    def reset(
        self,
        row: int,
        rng: np.random.Generator,
        start: Mapping[str, ArrayLike] | None = None,
        reference: Motion | None = None,
    ) -> None:
        """Begin an episode of one platform.

        Model, reference and noise draw from streams of their own, so that switching one on leaves
        the others as they were under the same seed.
        """
        streams = episode_streams(rng)
        setup, geometry = self.setup, self.plant.geometry
        chosen = checked_start({**setup.start, **(start or {})}, setup.task.largest_twist(geometry))
        model = setup.source.draw(streams.model)
        samples = self._table.shape[1]
        motion = reference or setup.reference
        if motion is None:
            motion = setup.task.reference(streams.reference, samples * setup.period, geometry)
        self.plant.reset(model, row=row, **chosen)
        self._parameters[row] = model.values
        self.references[row] = motion
        self._table[row] = reference_table(motion, setup.period, samples)
        self._sampled.begin(row, setup.sensors.noise(streams.noise, setup.steps + 1))
        self._past[row] = 0.0
        # A copy: earlier results belong to the caller, and the other rows keep their values.
        shown = self._shown = self._shown.copy()
        shown.commanded[row] = 0.0
        shown.saturated[row] = False
        self._look((row, row + 1), 0)

    def step(self, action: Array) -> None:
        """One control period under actions (n, 4), C-contiguous, in [-1, 1].

        Raises
        ------
        InputError
            If an action is NaN or out of bounds; nothing has moved then.
        """
        shown = Shown(len(action), self._shown.observation.shape[1])
        limit = self.setup.actuation.torque_limit
        # ``shown`` replaces the last results only after the actions have been accepted.
        refused = take(action, self._past, limit, shown.commanded, shown.saturated)
        if refused >= 0:
            raise reject(action, refused)
        self._shown = shown
        self._sampled.apply(shown.commanded)
        self._look(self._all, 1)

    def _look(self, rows: tuple[int, int], elapsed: int) -> None:
        """Measure and assess the platforms ``rows[0]`` to ``rows[1] - 1``."""
        shown = self._shown
        shown.applied = self.plant.acting_torque(self._sampled.delivered)
        self._sampled.measure(shown.wheel_speed, shown.body_twist, rows, elapsed)
        assess(
            rows,
            self.plant.states,
            shown.body_twist,
            self._past,
            self._table,
            self.clock,
            self._numbers,
            self._shape,
            shown.observation,
            shown.report,
        )

    @property
    def shown(self) -> Shown:
        """Results of the last call."""
        return self._shown

    @property
    def observation(self) -> NDArray[np.float32]:
        """(n, D) float32."""
        return self._shown.observation

    @property
    def reward(self) -> Array:
        """(n,), each in [0, 1]."""
        return self._shown.report[:, REWARD]

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """(n,): whether the twist has diverged, see ``TrackingTask.twist_limit``."""
        return self._shown.report[:, ENDED] != 0

    def result(self, row: int) -> tuple[float, bool, dict[str, Any]]:
        """Reward, whether terminated, and ``info`` of one platform."""
        shown = self._shown
        report = shown.report[row]
        info: dict[str, Any] = {name: report[where] for name, where in REPORT.items()}
        info["measured_twist"] = shown.body_twist[row]
        info["wheel_speed"] = shown.wheel_speed[row]
        info["commanded_torque"] = shown.commanded[row]
        info["applied_torque"] = shown.applied[row]
        info["saturated"] = shown.saturated[row]
        *terms, reward, ended = report[TERMS.start :].tolist()
        info["reward_terms"] = dict(zip(REWARD_TERMS, terms, strict=True))
        info["parameters"] = self._parameters[row].copy()
        info["time"] = float(self.clock[row]) * self.setup.period
        return reward, ended != 0.0, info
