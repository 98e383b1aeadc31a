"""One platform with real contacts, with the interface of a batch of one."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.setup import Setup
from youbot_env.tracking.stepper import Stepper
from youbot_env.tracking.task import REPORT_WIDTH, REWARD, TERMS

Array = NDArray[np.float64]


class ContactRow:
    """A platform that MuJoCo moves; see ``batch.Batch`` for the meaning of its members."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._stepper = Stepper(setup)
        self.geometry = self._stepper.plant.geometry
        self.results: Any = None

    def begin_alone(
        self,
        seed: int | None,
        rng: np.random.Generator,
        start: Mapping[str, ArrayLike] | None = None,
        reference: Motion | None = None,
    ) -> None:
        """Begin an episode; all its numbers come from ``rng``."""
        self._stepper.reset(0, rng, start, reference)
        self._show()

    def step(self, action: Array) -> Any:
        """One control period under an action (1, 4)."""
        self._stepper.step(action.astype(float))
        return self._show()

    def _show(self) -> Any:
        stepper, shown = self._stepper, self._stepper.shown
        report = np.zeros((1, lanes.REPORT_COLUMNS))
        report[:, : TERMS.stop] = shown.report[:, : TERMS.stop]
        report[:, lanes.REWARD_AT : lanes.ENDED_AT + 1] = shown.report[:, REWARD:REPORT_WIDTH]
        for at, values in (
            (lanes.MEASURED_AT, shown.body_twist),
            (lanes.SPEED_AT, shown.wheel_speed),
            (lanes.COMMANDED_AT, shown.commanded),
            (lanes.APPLIED_AT, shown.applied),
            (lanes.SATURATED_AT, shown.saturated),
        ):
            report[:, at : at + values.shape[1]] = values
        report[:, lanes.TIME_AT] = stepper.clock * stepper.setup.period
        self.results = SimpleNamespace(
            observation=stepper.observation,
            reward=stepper.reward,
            over=np.stack([stepper.terminated, np.zeros(1, np.bool_)]),
            report=report,
        )
        return self.results

    @property
    def observation(self) -> NDArray[np.float32]:
        """(1, D) float32."""
        return self._stepper.observation

    def parameters(self, row: int) -> dict[str, float]:
        """This episode's parameters by full name."""
        return self.model(row).values.copy()

    def model(self, row: int) -> Model:
        """This episode's model."""
        return self._stepper.plant.models[row]

    def reference(self, row: int) -> Motion | None:
        """The motion that is followed; None before the first reset."""
        return self._stepper.references[row]

    def state(self, row: int) -> Array:
        """(S,), a copy."""
        return self._stepper.plant.states[row].copy()
