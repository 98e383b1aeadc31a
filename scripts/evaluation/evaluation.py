"""An evaluation: the models of its plants, the controllers built on them, and the closed loops.

Models, designs and trials are tasks: plain data with a key, so that another process can run them,
and a folder can keep their results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers import registry
from controllers.loop import Trace, closed_loop
from controllers.recording import generator, record
from controllers.user_file import is_user_file, left_out
from identification.logs.log import Log
from youbot_env import __version__
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict
from youbot_env.tracking.randomisation import episode_streams
from youbot_env.tracking.task import TrackingTask
from youbot_scripts.evaluation import tables
from youbot_scripts.evaluation.conditions import (
    DIAGNOSED,
    KNOWN,
    LAG,
    Condition,
    LoopSettings,
    ModelSource,
    PlantSource,
    ReferenceMotion,
    Settings,
)
from youbot_scripts.evaluation.metrics import judge
from youbot_scripts.evaluation.summary import (
    Result,
    TimeCourse,
    by_condition,
    by_plant,
    gather,
    headline,
    in_words,
    models_of,
    ratios,
    unscored,
)
from youbot_scripts.recording.named_motions import motions_named
from youbot_scripts.shared import options as common
from youbot_scripts.shared.results_folder import Record, resumed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from youbot_scripts.shared.report_page import Part

Advance = Callable[[], None]

MOTIONS = "calibration,multisine_a"
"""Motions that are recorded to identify a plant: the paper's, and a multisine."""

ENOUGH_SEEDS = 5
"""Runs from which on an interval by Student's t is not much wider than what it is of."""

FEW_SEEDS = (
    "An interval of {} runs is wide, whatever they show: Student's t takes 12.7 standard errors "
    "for 2 runs, 4.3 for 3, 2.8 for 5 (--seeds 5)."
)

MAX_TIME_COURSES = 4
"""Largest number of controllers in the figure of time courses."""


def model_of(source: ModelSource, plant: PlantSource, seed: int = 0) -> Model:
    """The model that a source gives for a plant.

    Raises
    ------
    InputError
        If the file cannot be read, or the logs do not show what has to be fitted.
    """
    if source.how == KNOWN:
        return plant.truth
    if not source.learns:
        return load_model(source.how)
    motions = motions_named(MOTIONS, plant.truth.geometry, seed)
    logs = record(plant.recorded.platform(), motions, seed=seed)
    found = _fitted(source, plant, logs, seed)
    # Through JSON: a resumed run reads the model from a file, and must get the same numbers.
    return model_from_dict(json.loads(json.dumps(model_to_dict(found))), source.how)


def _fitted(source: ModelSource, plant: PlantSource, logs: Sequence[Log], seed: int) -> Model:
    start = replace(load_model("paper"), geometry=plant.truth.geometry)
    if plant.lag:
        start = start.with_effect(LAG)
    if source.how == DIAGNOSED:
        from identification.diagnosis.diagnose import diagnose

        return diagnose(start, logs, seed=seed).model
    from identification.fitting.identify import identify

    for effect in source.how.split("+")[1:]:
        start = start.with_effect(effect)
    return identify(logs, start=start, recursive=False, seed=seed).model


@dataclass(frozen=True)
class ModelTask:
    """The task of finding a condition's model."""

    plant: PlantSource
    source: ModelSource
    seed: int

    @cached_property
    def key(self) -> str:
        """Hash of everything that the result depends on: equal keys mean equal results."""
        return digest("model", self.plant.recorded.to_dict(), self.source.how, self.seed)

    def __call__(self) -> Record:
        found = model_of(self.source, self.plant, self.seed)
        return {"key": self.key, "model": model_to_dict(found)}


@dataclass(frozen=True)
class DesignTask:
    """The task of finding a controller's settings on a model, for a loop."""

    controller: str
    model: Model
    loop: LoopSettings

    @cached_property
    def key(self) -> str:
        """Hash of everything that the result depends on: equal keys mean equal results."""
        return digest("design", self.controller, model_to_dict(self.model), asdict(self.loop))

    def __call__(self) -> Record:
        design = registry.entry(self.controller).design
        assert design is not None
        settings = design(self.model, self.loop.known(self.model.geometry))
        return {"key": self.key, "controller": self.controller, "settings": dict(settings)}


@dataclass(frozen=True)
class EvaluationTrial:
    """One closed loop, with everything that is needed to repeat it exactly.

    Attributes
    ----------
    model, settings : that the controller is built from
    seed, index : of the run, and which of its references
    fingerprint : of a policy's file, see ``registry.fingerprint``
    """

    condition: Condition
    controller: str
    model: Model
    reference: ReferenceMotion
    seed: int
    index: int
    settings: Mapping[str, Any] = field(default_factory=dict)
    fingerprint: str = ""

    @cached_property
    def key(self) -> str:
        """Hash of everything that the result depends on: equal keys mean equal results."""
        plant, loop = self.condition.plant.to_dict(), asdict(self.condition.loop)
        built = (self.controller, self.fingerprint, model_to_dict(self.model), dict(self.settings))
        return digest("trial", plant, loop, *built, asdict(self.reference), self.seed, self.index)

    def trace(self) -> Trace:
        """Run the closed loop."""
        plant, stated, reference = self.condition.plant, self.condition.loop, self.reference
        loop = stated.known(plant.truth.geometry)
        noise = int(generator(self.seed, str(self.index), "noise").integers(2**31))
        with np.errstate(all="ignore"):  # a loop that diverges is a result
            return closed_loop(
                plant.platform(),
                registry.build(self.controller, self.model, loop, **self.settings),
                reference.motion(plant, self.seed, self.index),
                loop,
                # The same stream of noise as an episode of the tracking environment with this seed.
                episode_streams(np.random.default_rng(noise)).noise,
                count=round(reference.length * stated.rate),
                show_pose=stated.pose,
                bound=TrackingTask().largest_twist(plant.truth.geometry),
            )

    def __call__(self) -> Record:
        return {
            "key": self.key,
            **self.condition.to_dict(),
            "controller": self.controller,
            "band": list(self.reference.band),
            "seed": self.index,
            **judge(self.trace(), self.reference.ramp),
        }


Task = ModelTask | DesignTask | EvaluationTrial


def digest(*parts: Any) -> str:
    """Short hash of everything that a result depends on, the package's version included."""
    text = json.dumps([__version__, *parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def call(task: Task) -> Record:
    """A task's record (a module-level function, since processes can only pickle these)."""
    return task()


def run_all(
    tasks: Sequence[Task], jobs: int, folder: Path | None, progress: Advance = lambda: None
) -> list[Record]:
    """The tasks' records in their order; see :func:`resumed`."""
    # Equal tasks have one key and are done once.
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
    """The model of each condition, identified or diagnosed from recorded logs where needed."""
    tasks = [ModelTask(c.plant, c.model_source, seed) for c in conditions]
    # Known models and files cost nothing: they need neither a process nor a place in the folder.
    costly = [task for task in tasks if task.source.learns]
    records = run_all(costly, jobs, folder and folder / "models", progress)
    models = {r["key"]: model_from_dict(r["model"], "resumed model") for r in records}
    return {
        condition: models.get(task.key) or model_of(task.source, task.plant, seed)
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
        n: DesignTask(trial.controller, trial.model, trial.condition.loop)
        for n, trial in enumerate(trials)
        if needs_design(trial)
    }
    records = run_all(list(tasks.values()), jobs, folder and folder / "designs", progress)
    settings = dict(zip(tasks, (record["settings"] for record in records), strict=True))
    return [replace(trial, settings=settings.get(n, {})) for n, trial in enumerate(trials)]


def plan(
    models: Mapping[Condition, Model],
    controllers: Sequence[str],
    references: Sequence[ReferenceMotion],
    seed: int,
    seeds: int,
) -> list[EvaluationTrial]:
    """Every controller on every condition and reference.

    Seeds are the outermost loop, so that the first part of the trials covers all conditions.
    """
    prints = {controller: registry.fingerprint(controller) for controller in controllers}
    return [
        EvaluationTrial(
            condition, controller, model, reference, seed, index, fingerprint=prints[controller]
        )
        for index in range(seeds)
        for condition, model in models.items()
        for reference in references
        for controller in controllers
    ]


def _in_words(n: int, groups: Sequence[Sequence[Result]]) -> str:
    """Plant, models and loop of a group of results, counted where there are several."""
    group = groups[n]
    place = {**group[0].place, "model": ", ".join(models_of(group))}
    number = f"{n + 1} of {len(groups)}: " if len(groups) > 1 else ""
    return f"{number}{in_words(place)}; {max(result.runs for result in group)} runs a band"


@dataclass(frozen=True)
class Evaluation:
    """Result of an evaluation.

    Attributes
    ----------
    settings, models : what was evaluated, and the model that stood for each condition's plant
    trials, records : the closed loops, and the result of each
    results : the records, averaged over seeds
    """

    settings: Settings
    models: dict[Condition, Model]
    trials: list[EvaluationTrial]
    records: list[Record]
    results: list[Result]

    @cached_property
    def warnings(self) -> list[str]:
        """What keeps a user's own controllers from all that their model knows."""
        found = [
            words
            for condition, model in self.models.items()
            for name in self.settings.controllers
            if is_user_file(name)
            for loop in [condition.loop.known(condition.plant.truth.geometry)]
            if (words := left_out(name, model, loop, show_pose=condition.loop.pose))
        ]
        return list(dict.fromkeys(found))

    def tables(self, brief: bool = False) -> list[tables.Table]:
        """Tables for printing; if ``brief``, one for each plant."""
        made = tables.brief if brief else tables.tables
        return made(self.results, self.settings.against)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "settings": asdict(self.settings),
            "conditions": [
                {
                    **condition.to_dict(),
                    "truth": condition.plant.truth.values,
                    "believed": model.values,
                }
                for condition, model in self.models.items()
            ],
            "designs": self._designs(),
            "results": [result.to_dict() for result in self.results],
            "warnings": self.warnings,
            "comparisons": [self._comparison(group) for group in by_condition(self.results)],
            "trials": self.records,
        }

    def _designs(self) -> list[dict[str, Any]]:
        found = [
            {**t.condition.to_dict(), "controller": t.controller, "settings": dict(t.settings)}
            for t in self.trials
            if t.settings
        ]
        return [one for n, one in enumerate(found) if one not in found[:n]]

    def _comparison(self, group: Sequence[Result]) -> dict[str, Any]:
        against = self.settings.against
        found, reasons = ratios(group, against), unscored(group)
        bands = dict.fromkeys(result.band for result in group)
        return {
            **group[0].place,
            "against": against,
            "bands": [
                {
                    "band": list(band),
                    "unscored": reasons.get(band),
                    "worst_axis_ratio": found.get(band, {}),
                }
                for band in bands
            ],
        }

    def figures(self, brief: bool = False) -> dict[str, Figure]:
        """Figures by name.

        One for each plant with several models, and two for each condition (time courses: of the
        first seed). If ``brief``, one for each plant.
        """
        from youbot_scripts.evaluation import figures

        drawn = figures.errors_by_plant(self.results, brief)
        return drawn if brief else drawn | self._figures_by_condition()

    def _figures_by_condition(self) -> dict[str, Figure]:
        from youbot_scripts.evaluation.figures import error_by_frequency, numbered, time_courses

        drawn: dict[str, Figure] = {}
        groups = by_condition(self.results)
        for n, (group, course) in enumerate(zip(groups, self._courses, strict=True)):
            drawn[numbered("error_by_frequency", n, groups)] = error_by_frequency(group)
            drawn[numbered("time_courses", n, groups)] = time_courses(
                course.traces, f"{course.condition}; {course.reference}", self.settings.controllers
            )
        return drawn

    @cached_property
    def _courses(self) -> list[TimeCourse]:
        """The closed loops of each condition that are drawn over time, run once more."""
        found = []
        for group, condition in zip(by_condition(self.results), self.models, strict=True):
            chosen = self._drawn_trials(group, condition)
            traces = {trial.controller: trial.trace() for trial in chosen}
            reference = f"{chosen[0].reference}, seed 0"
            found.append(TimeCourse(in_words(group[0].place), reference, traces))
        return found

    def page(self, brief: bool = False) -> Iterator[Part]:
        """The parts of the web page: who tracks best, then charts and tables.

        If ``brief``, the errors alone, without time courses.
        """
        from youbot_scripts.evaluation import charts
        from youbot_scripts.shared.report_page import Charts, Words

        groups, plants = by_condition(self.results), by_plant(self.results)
        yield Words([headline(group, self.settings.against) for group in groups], "verdict")
        yield Words(self.warnings, "warning")
        if 1 < self.settings.seeds < ENOUGH_SEEDS:
            yield Words([FEW_SEEDS.format(self.settings.seeds)])
        for n, same in enumerate(plants):
            yield Words([_in_words(n, plants)])
            yield Charts([charts.frequency_chart(f"frequency_{n}", same)])
        for n, group in enumerate(groups):
            if len(groups) > 1:  # one alone is named above
                yield Words([_in_words(n, groups)])
            yield Charts([charts.controllers_chart(f"controllers_{n}", group)])
            if not brief:
                yield Charts([charts.costs_chart(f"costs_{n}", group)], folded=n > 0)
                course = self._courses[n]
                for chart in charts.course_charts(n, course, self.settings.controllers):
                    yield Charts([chart], folded=n > 0)
        yield from self.tables(brief)

    def _drawn_trials(self, group: Sequence[Result], condition: Condition) -> list[EvaluationTrial]:
        """Trials whose time courses are drawn, in the middle band.

        First come the first controller, the reference controller, the best one and those that
        diverge; then the others, up to the largest number.
        """
        references = self.settings.references()
        reference = references[len(references) // 2]
        results = [result for result in group if result.band == reference.band]
        ranked = sorted(results, key=lambda r: (r.diverged > 0, r.mean("nrmse")))
        lost = [result.controller for result in results if result.diverged]
        first = [results[0].controller, self.settings.against, ranked[0].controller, *lost]
        names = list(dict.fromkeys([*first, *self.settings.controllers]))
        found = {
            trial.controller: trial
            for trial in self.trials
            if trial.condition == condition and trial.reference == reference and trial.index == 0
        }
        return [found[name] for name in names if name in found][:MAX_TIME_COURSES]


def evaluate(
    chosen: Settings, *, seed: int = 0, jobs: int = 1, folder: Path | None = None
) -> Evaluation:
    """Learn the models, design the controllers, drive them; a bar shows each of the three.

    Parameters
    ----------
    seed : of all random numbers
    jobs : processes; the result is the same to the bit
    folder : keeps each result when it is done; results in it are not computed again

    Raises
    ------
    InputError
        If a plant, model or controller cannot be used, or the folder holds other files.
    """
    for controller in chosen.controllers:
        registry.check(controller)  # now, not after hours of work
    conditions = chosen.conditions()
    learning = sum(condition.model_source.learns for condition in conditions)
    with common.progress(learning, "learning models") as advance:
        models = learn(conditions, seed, jobs, folder, advance)
    trials = plan(models, chosen.controllers, chosen.references(), seed, chosen.seeds)
    designs = len({trial.controller for trial in trials if needs_design(trial)}) * len(conditions)
    with common.progress(designs, "designing controllers") as advance:
        trials = design(trials, jobs, folder, advance)
    with common.progress(len(trials), "driving") as advance:
        records = run_all(trials, jobs, folder, advance)
    return Evaluation(chosen, models, trials, records, gather(records))
