"""Many closed loops side by side, for tuning: what a law's gains cost in tracking and in torque.

Every row is one platform under one set of gains along one reference. It moves as the full model
says, is measured by encoders with noise, and its commands arrive late and saturate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from controllers.interface import Array, Controller, Loop, Observation, Reference
from controllers.linear.linear_system import split_delay
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.effect import CATALOGUE, CLOCK
from youbot_env.physics.hardware import ENCODER_TICKS
from youbot_env.simulation.plant import TWIST, WHEEL_ANGLE, Plant
from youbot_env.tracking.task import TrackingTask

Advance = Callable[[float], None]

PREVIEW_MARGIN = 2
"""Reference samples beyond those that a controller asks for, so that none runs out of them."""


class Law(Protocol):
    """Wheel torques of many rows at once.

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
    """What became of each set of gains; arrays with a leading axis of candidates.

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

    The plant's own delay is moved into the loop's, where it is the same to the motion.

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
        self._window()

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
    def _noise(self) -> Array:
        """(m, steps + 1, 4) [rad/s]: every candidate meets the same."""
        shape = (len(self.motions), self.steps + 1, 4)
        return self.loop.speed_noise * np.random.default_rng(self.seed).standard_normal(shape)

    def _window(self) -> int:
        """Periods over which encoders count: twice the age of the speed that they give; 0: none."""
        window = 2 * self.loop.measurement_delay / self.loop.sample_time
        if abs(window - round(window)) > 1e-6:
            raise InputError(
                f"loop measurement_delay: {self.loop.measurement_delay:g} s is no multiple of half "
                "the sample time, as encoders have that are counted over whole samples"
            )
        return round(window)

    def score(self, law: Law, advance: Advance | None = None) -> Score:
        """Run a law whose rows are candidate after candidate, each on every motion."""
        count, motions = len(law.lead), len(self.motions)
        if count % motions:
            raise ValueError(f"{count} rows are no multiple of {motions} motions")
        candidates = count // motions
        reference = np.tile(self._reference, (candidates, 1, 1))
        seen = self._led(law.lead)
        noise = np.tile(self._noise, (candidates, 1, 1))
        plant = Plant(self.model, platforms=count)
        sensor = _Encoders(plant, self._window(), self.loop.sample_time)
        pipe = _Pipe(self.loop, count)
        squares, changes = np.zeros((count, 3)), np.zeros(count)
        saturated, before = np.zeros(count), np.zeros((count, 4))
        limit = self.loop.torque_limit * (1 - 1e-9)
        with np.errstate(all="ignore"):  # rows that diverge are told by their error, inf
            for k in range(self.steps):
                torque = np.ascontiguousarray(law(sensor.speed() + noise[:, k], seen[:, k]))
                changes += ((torque - before) ** 2).sum(axis=1)
                saturated += (np.abs(torque) >= limit).sum(axis=1)
                before = torque
                for acting, piece in pipe.passed(torque):
                    plant.advance(acting, piece)
                squares += (plant.states[:, TWIST] - reference[:, k + 1]) ** 2
                if advance is not None:
                    advance(1.0 / self.steps)
            size = np.sqrt((reference[:, 1:] ** 2).mean(axis=1))
            error = np.sqrt(squares / self.steps) / np.where(size > 0, size, np.nan)
        error = np.where(np.isfinite(squares), error, np.inf).reshape(candidates, motions, 3)
        rate = (changes / (4 * self.steps)).reshape(candidates, motions).mean(axis=1)
        return Score(
            _mean_of_moving(error),
            np.sqrt(rate) / self.loop.sample_time,
            saturated.reshape(candidates, motions).mean(axis=1) / (4 * self.steps),
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

    def score_controller(self, make: Callable[[], Controller]) -> Score:
        """The same for one controller, built anew for each motion by ``make()``."""
        rows = Rows([make() for _ in self.motions], self)
        return self.score(rows)


def _mean_of_moving(error: Array) -> Array:
    """Mean over motions (c, m, 3), by axis; an axis that no reference moves has no error."""
    moving = ~np.isnan(error)
    total = np.where(moving, error, 0.0).sum(axis=1)
    return total / np.maximum(moving.sum(axis=1), 1)


class _Encoders:
    """Wheel speeds (n, 4) from whole counts over ``window`` periods; exact where window is 0."""

    def __init__(self, plant: Plant, window: int, period: float) -> None:
        self.plant = plant
        self.resolution = 2 * np.pi / ENCODER_TICKS
        self.span = window * period
        self.past = [self._counts()] * window

    def _counts(self) -> Array:
        return np.floor(self.plant.states[:, WHEEL_ANGLE] / self.resolution)

    def speed(self) -> Array:
        """Called once per sample."""
        if not self.past:
            return self.plant.geometry.wheel_speeds(self.plant.states[:, TWIST])
        counts = self._counts()
        found = (counts - self.past.pop(0)) * (self.resolution / self.span)
        self.past.append(counts)
        return found


class _Pipe:
    """Commands on their way: what acts during a period, for how long."""

    def __init__(self, loop: Loop, count: int) -> None:
        whole, self.rest = split_delay(loop.delay, loop.sample_time)
        self.period = loop.sample_time
        self.queue: list[Array] = [np.zeros((count, 4))] * (whole + 1)

    def passed(self, torque: Array) -> list[tuple[Array, float]]:
        """Torques (n, 4) that act, and how long [s], while ``torque`` is commanded."""
        self.queue.append(torque)
        older = self.queue.pop(0)
        if not self.rest:
            return [(self.queue[0], self.period)]
        return [(older, self.rest), (self.queue[0], self.period - self.rest)]


class Rows:
    """Controllers, one a row, as a law: for those that are not written for many rows at once."""

    def __init__(self, controllers: Sequence[Controller], trial: TuningTrial) -> None:
        self.controllers = controllers
        self.lead = np.zeros(len(controllers))
        wanted = max(int(getattr(c, "preview_needed", 0)) for c in controllers) + PREVIEW_MARGIN
        self.preview = wanted
        period = trial.loop.sample_time
        time = period * np.arange(trial.steps + 2 + wanted)
        motions = [trial.motions[row % len(trial.motions)] for row in range(len(controllers))]
        self.tables = [motion.evaluate(time) for motion in motions]
        self.period, self.clock = period, 0
        self.to_body = trial.model.geometry.body_twist
        self.torque: Array = np.zeros((len(controllers), 4))
        for controller in controllers:
            controller.reset()

    def __call__(self, wheel_speed: Array, reference: Array) -> Array:
        k = self.clock
        self.clock += 1
        twist = self.to_body(wheel_speed)
        coming = slice(k + 1, k + 1 + self.preview)
        rows = zip(self.controllers, self.tables, wheel_speed, twist, self.torque, strict=True)
        self.torque = np.array(
            [
                controller(
                    Observation(k * self.period, speed, body, wheel_torque=last),
                    Reference(value[k], slope[k], value[coming], slope[coming]),
                )
                for controller, (value, slope), speed, body, last in rows
            ]
        )
        return self.torque


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
