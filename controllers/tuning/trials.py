"""Many closed loops side by side, for tuning: tracking error and torque rate of a law's gains.

Every row is one platform with one set of gains on one reference. It is simulated with the full
model, encoders with noise, delayed commands and saturation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from controllers.interface import Array, Controller, Loop
from controllers.loop import (
    BatchLaw,
    ControllerRows,
    at_limit,
    instants,
    sensors_of,
    started,
)
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.effect import CATALOGUE, CLOCK
from youbot_env.simulation.plant import Plant
from youbot_env.simulation.platforms import TWIST
from youbot_env.tracking.task import TrackingTask

Advance = Callable[[float], None]


class Law(Protocol):
    """Wheel torques of many rows at once, from their wheel speeds and references alone.

    Attributes
    ----------
    lead : (n,) [s] by which each row reads the reference ahead (behind, where negative)
    """

    lead: Array

    def __call__(self, wheel_speed: Array, reference: Array) -> Array:
        """Torques (n, 4) [N m] at measured wheel speeds (n, 4) and led reference twists (n, 3)."""
        ...


@dataclass(frozen=True)
class Score:
    """Results of each set of gains; arrays with a leading axis of candidates.

    Attributes
    ----------
    error : (c, 3) rms of the true twist's error over the rms of the reference, VX, VY, W, mean over
        the references; inf for a run that diverged
    torque_rate : (c,) rms of the commands' change [N m/s], over wheels, time and references
    saturated : (c,) share of wheel commands at the limit
    """

    error: Array
    torque_rate: Array
    saturated: Array

    @property
    def mean_error(self) -> Array:
        """(c,) mean over the axes."""
        return self.error.mean(axis=-1)


@dataclass(frozen=True)
class TuningTrial:
    """One condition: platform, loop and the references to follow, with their measurement noise.

    The plant's own delay is added to the loop's: the motion is the same.

    Attributes
    ----------
    model, loop : what is simulated; ``loop.delay`` may end within a sample
    motions : references, all of at least ``duration``
    duration : [s] of each run, from rest
    seed : of the noise

    Raises
    ------
    InputError
        If the loop's measurement is none that encoders give.
    """

    model: Model
    loop: Loop
    motions: Sequence[Motion]
    duration: float = 10.0
    seed: int = 0

    def __post_init__(self) -> None:
        late = [name for name in self.model.effects if CATALOGUE[name].acts_at is CLOCK]
        if late:
            effects = {k: v for k, v in self.model.effects.items() if k not in late}
            loop = replace(self.loop, delay=self.loop.delay + max(self.model.delay, 0.0))
            bare = replace(self.model, effects=effects, covariance=None, covariance_names=())
            object.__setattr__(self, "loop", loop)
            object.__setattr__(self, "model", bare)
        sensors_of(self.loop)  # refuses a loop that no encoders make

    @property
    def steps(self) -> int:
        """Control periods in a run."""
        return round(self.duration / self.loop.sample_time)

    @cached_property
    def _time(self) -> Array:
        return np.asarray(self.loop.sample_time * np.arange(self.steps + 1), np.float64)

    @cached_property
    def _reference(self) -> Array:
        return np.stack([motion.twist(self._time) for motion in self.motions])

    @cached_property
    def _noise(self) -> list[Array]:
        """(steps + 1, 4) [rad/s] for each motion: every candidate meets the same."""
        sensors, rng = sensors_of(self.loop), np.random.default_rng(self.seed)
        return [sensors.noise(rng, self.steps + 1) for _ in self.motions]

    def score(self, law: Law, advance: Advance | None = None) -> Score:
        """Run a law whose rows are candidate after candidate, each on every motion."""
        seen = self._led(law.lead)
        return self._score(
            lambda now: law(now.wheel_speed, seen[:, now.index]), len(law.lead), advance
        )

    def score_controller(self, make: Callable[[], Controller]) -> Score:
        """The same for one controller, built anew for each motion by ``make()``."""
        controllers = [make() for _ in self.motions]
        period = self.loop.sample_time
        law = ControllerRows(controllers, self.motions, period, self.steps + 1)
        return self._score(law, len(controllers))

    def _score(self, law: BatchLaw, count: int, advance: Advance | None = None) -> Score:
        """What ``count`` rows, candidate after candidate, make of the motions under a law."""
        motions = len(self.motions)
        if count % motions:
            raise ValueError(f"{count} rows are no multiple of {motions} motions")
        candidates = count // motions
        reference = np.tile(self._reference, (candidates, 1, 1))
        sampled = started(Plant(self.model, platforms=count), self.loop, self._noise * candidates)
        sums = _Sums(count, self.loop.torque_limit)
        with np.errstate(all="ignore"):  # rows that diverge are told by their error, inf
            for now, command in instants(sampled, law, self.steps + 1, self.loop.torque_limit):
                if now.index:  # the start has no error yet
                    sums.add_error(now.states[:, TWIST] - reference[:, now.index])
                if now.index < self.steps:  # the last command acts after the run
                    sums.add_effort(command)
                if advance is not None and now.index:
                    advance(1.0 / self.steps)
            size = np.sqrt((reference[:, 1:] ** 2).mean(axis=1))
            # NaN marks an axis that the reference does not move; see ``_mean_of_moving``.
            error = np.sqrt(sums.squares / self.steps) / np.where(size > 0, size, np.nan)
        error = np.where(np.isfinite(sums.squares), error, np.inf)
        rate = (sums.changes / (4 * self.steps)).reshape(candidates, motions).mean(axis=1)
        return Score(
            _mean_of_moving(error.reshape(candidates, motions, 3)),
            np.sqrt(rate) / self.loop.sample_time,
            sums.saturated.reshape(candidates, motions).mean(axis=1) / (4 * self.steps),
        )

    def _led(self, lead: Array) -> Array:
        """(n, steps + 1, 3): the reference that each row reads, ``lead`` [s] ahead."""
        motions = len(self.motions)
        if not lead.any():
            return np.tile(self._reference, (len(lead) // motions, 1, 1))
        rows = [
            self.motions[row % motions].twist(self._time + ahead)
            for row, ahead in enumerate(lead.tolist())
        ]
        return np.stack(rows)


class _Sums:
    """Sums of a score, row by row, while the loops run, so that no states need be kept."""

    def __init__(self, count: int, torque_limit: float) -> None:
        self.squares, self.changes = np.zeros((count, 3)), np.zeros(count)
        self.saturated = np.zeros(count)
        self._before, self._limit = np.zeros((count, 4)), torque_limit

    def add_error(self, error: Array) -> None:
        """(n, 3) of the true twist."""
        self.squares += error**2

    def add_effort(self, command: Array) -> None:
        """(n, 4) torques [N m]; the first change is that from none."""
        self.changes += ((command - self._before) ** 2).sum(axis=1)
        self.saturated += at_limit(command, self._limit).sum(axis=1)
        self._before = command


def _mean_of_moving(error: Array) -> Array:
    """Mean over motions (c, m, 3), by axis; an axis that no reference moves has no error."""
    moving = ~np.isnan(error)
    total = np.where(moving, error, 0.0).sum(axis=1)
    return total / np.maximum(moving.sum(axis=1), 1)


def references(
    model: Model,
    *,
    count: int = 4,
    duration: float = 10.0,
    band: tuple[float, float] = (0.5, 3.0),
    amplitude: ArrayLike = (0.22, 0.18, 0.6),
    seed: int = 0,
) -> list[Motion]:
    """Random multisines as the tracking task draws them; band [rad/s], peaks [m/s, m/s, rad/s]."""
    task = TrackingTask(band=band, amplitude=tuple(np.asarray(amplitude, float).tolist()))
    seeds = np.random.SeedSequence(seed).spawn(count)
    return [task.reference(np.random.default_rng(s), duration, model.geometry) for s in seeds]
