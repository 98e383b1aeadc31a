"""One controller on one plant along one reference; many of them, planned and taken up again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from controllers import registry
from controllers.loop import Trace, closed_loop
from controllers.recording import generator
from youbot_env import __version__
from youbot_env.model.model import Model
from youbot_env.model.model_file import model_from_dict, model_to_dict
from youbot_env.motions.base import Motion
from youbot_env.motions.multisine import multisine
from youbot_env.tracking.randomisation import episode_streams
from youbot_env.tracking.task import TrackingTask
from youbot_scripts.evaluation.knowledge import ModelSource
from youbot_scripts.evaluation.loop_settings import LoopSettings
from youbot_scripts.evaluation.metrics import judge
from youbot_scripts.evaluation.plants import PlantSource
from youbot_scripts.shared.results_folder import Record, resumed

Advance = Callable[[], None]


@dataclass(frozen=True)
class ReferenceMotion:
    """The random references of a band, as ``motions.multisine`` draws them.

    Attributes
    ----------
    band : lowest and highest frequency [rad/s]
    amplitude : peaks of VX, VY [m/s] and W [rad/s]
    duration : [s] that is judged, after the ramp
    ramp : [s] from rest to the full motion
    """

    band: tuple[float, float]
    amplitude: tuple[float, float, float] = (0.22, 0.18, 0.6)
    duration: float = 20.0
    ramp: float = 1.5

    @property
    def length(self) -> float:
        """[s] from rest to the end of what is judged, before the motion slows down again."""
        return self.ramp + self.duration

    def motion(self, plant: PlantSource, seed: int, index: int) -> Motion:
        """The reference of one seed, the same for every controller, model and loop."""
        name = f"{self.band[0]:g}-{self.band[1]:g}"
        return multisine(
            generator(seed, str(index), name),
            band=self.band,
            amplitude=self.amplitude,
            duration=self.duration + 2 * self.ramp,
            ramp=self.ramp,
            geometry=plant.truth.geometry,
            name=name,
        )

    def __str__(self) -> str:
        return f"{self.band[0]:g}-{self.band[1]:g} rad/s"


@dataclass(frozen=True)
class Condition:
    """What all controllers are compared under: a plant, a model of it, and a loop."""

    plant: PlantSource
    knowledge: ModelSource
    loop: LoopSettings

    def to_dict(self) -> dict[str, Any]:
        """JSON form, for people."""
        loop = {**asdict(self.loop), "lag": self.plant.lag}
        return {"plant": str(self.plant), "model": str(self.knowledge), "loop": loop}


@dataclass(frozen=True)
class Learning:
    """The task of finding a condition's model."""

    plant: PlantSource
    knowledge: ModelSource
    seed: int

    @cached_property
    def key(self) -> str:
        """The same whenever the result is."""
        return digest("model", self.plant.recorded.to_dict(), self.knowledge.how, self.seed)

    def __call__(self) -> Record:
        found = self.knowledge.of(self.plant, self.seed)
        return {"key": self.key, "model": model_to_dict(found)}


@dataclass(frozen=True)
class Designing:
    """The task of finding a controller's settings on a model, for a loop."""

    controller: str
    model: Model
    loop: LoopSettings

    @cached_property
    def key(self) -> str:
        """The same whenever the result is."""
        return digest("design", self.controller, model_to_dict(self.model), asdict(self.loop))

    def __call__(self) -> Record:
        design = registry.entry(self.controller).design
        assert design is not None
        settings = design(self.model, self.loop.known())
        return {"key": self.key, "controller": self.controller, "settings": dict(settings)}


@dataclass(frozen=True)
class EvaluationTrial:
    """One closed loop: what it takes to run it again to the bit.

    Attributes
    ----------
    model, settings : that the controller is built from
    seed, index : of the run, and which of its references
    fingerprint : of a policy's file, see ``registry.fingerprint``
    """

    condition: Condition
    controller: str
    model: Model
    course: ReferenceMotion
    seed: int
    index: int
    settings: Mapping[str, Any] = field(default_factory=dict)
    fingerprint: str = ""

    @cached_property
    def key(self) -> str:
        """The same whenever the result is."""
        plant, loop = self.condition.plant.to_dict(), asdict(self.condition.loop)
        built = (self.controller, self.fingerprint, model_to_dict(self.model), dict(self.settings))
        return digest("trial", plant, loop, *built, asdict(self.course), self.seed, self.index)

    def trace(self) -> Trace:
        """Drive it."""
        plant, stated, course = self.condition.plant, self.condition.loop, self.course
        loop = stated.known()
        noise = int(generator(self.seed, str(self.index), "noise").integers(2**31))
        with np.errstate(all="ignore"):  # a loop that diverges is a result
            return closed_loop(
                plant.platform(),
                registry.build(self.controller, self.model, loop, **self.settings),
                course.motion(plant, self.seed, self.index),
                loop,
                # The noise of the tracking environment's episode of this seed.
                episode_streams(np.random.default_rng(noise)).noise,
                count=round(course.length * stated.rate),
                show_pose=stated.pose,
                bound=TrackingTask().largest_twist(plant.truth.geometry),
            )

    def __call__(self) -> Record:
        return {
            "key": self.key,
            **self.condition.to_dict(),
            "controller": self.controller,
            "band": list(self.course.band),
            "seed": self.index,
            **judge(self.trace(), self.course.ramp),
        }


Task = Learning | Designing | EvaluationTrial


def digest(*parts: Any) -> str:
    """A short word that stands for everything that a result depends on, this version included."""
    text = json.dumps([__version__, *parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def call(task: Task) -> Record:
    """A task's record (a plain function, so that another process can be handed it)."""
    return task()


def run_all(
    tasks: Sequence[Task], jobs: int, folder: Path | None, progress: Advance = lambda: None
) -> list[Record]:
    """The tasks' records in their order; see :func:`resumed`."""
    by_key = {task.key: task for task in tasks}
    found = resumed(call, by_key, _key, jobs=jobs, folder=folder, progress=progress)
    return [found[task.key] for task in tasks]


def _key(record: Record) -> str:
    return record["key"]


def learn(
    conditions: Sequence[Condition],
    seed: int,
    jobs: int = 1,
    folder: Path | None = None,
    progress: Advance = lambda: None,
) -> dict[Condition, Model]:
    """The model of each condition: recorded, identified, diagnosed as it asks for."""
    tasks = [Learning(c.plant, c.knowledge, seed) for c in conditions]
    costly = [task for task in tasks if task.knowledge.learns]
    records = run_all(costly, jobs, folder and folder / "models", progress)
    models = {r["key"]: model_from_dict(r["model"], "resumed model") for r in records}
    return {
        condition: models.get(task.key) or task.knowledge.of(task.plant, seed)
        for condition, task in zip(conditions, tasks, strict=True)
    }


def needs_design(trial: EvaluationTrial) -> bool:
    """Whether the controller has settings that have to be found first."""
    return registry.entry(trial.controller).design is not None


def design(
    trials: Sequence[EvaluationTrial],
    jobs: int = 1,
    folder: Path | None = None,
    progress: Advance = lambda: None,
) -> list[EvaluationTrial]:
    """The trials with the settings of those controllers that have to be designed first."""
    tasks = {
        n: Designing(trial.controller, trial.model, trial.condition.loop)
        for n, trial in enumerate(trials)
        if needs_design(trial)
    }
    records = run_all(list(tasks.values()), jobs, folder and folder / "designs", progress)
    settings = dict(zip(tasks, (record["settings"] for record in records), strict=True))
    return [replace(trial, settings=settings.get(n, {})) for n, trial in enumerate(trials)]


def plan(
    models: Mapping[Condition, Model],
    controllers: Sequence[str],
    courses: Sequence[ReferenceMotion],
    seed: int,
    seeds: int,
) -> list[EvaluationTrial]:
    """Every controller on every condition and course, the seeds outermost: a part of them is a
    fair sample."""
    prints = {controller: registry.fingerprint(controller) for controller in controllers}
    return [
        EvaluationTrial(
            condition, controller, model, course, seed, index, fingerprint=prints[controller]
        )
        for index in range(seeds)
        for condition, model in models.items()
        for course in courses
        for controller in controllers
    ]
