"""An evaluation as a whole: learn the models, design the controllers, drive them, gather."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_env.model.model import Model
from youbot_scripts.evaluation import tables
from youbot_scripts.evaluation.settings import Settings
from youbot_scripts.evaluation.summary import (
    Result,
    by_condition,
    by_plant,
    gather,
    in_words,
    models_of,
    ratios,
    unscored,
)
from youbot_scripts.evaluation.trials import (
    Condition,
    EvaluationTrial,
    design,
    learn,
    needs_design,
    plan,
    run_all,
)
from youbot_scripts.shared import options as common
from youbot_scripts.shared.results_folder import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COURSES = 4
"""Controllers in the picture of time courses, at most."""


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation found.

    Attributes
    ----------
    settings, models : what was evaluated, and the model that stood for each condition's plant
    trials, records : the closed loops, and what became of each
    results : the same over seeds
    """

    settings: Settings
    models: dict[Condition, Model]
    trials: list[EvaluationTrial]
    records: list[Record]
    results: list[Result]

    def tables(self, brief: bool = False) -> list[tables.Table]:
        """As printed; if ``brief``, one a plant."""
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
        """The pictures by name: one for each plant that was driven on several models, and two for
        each condition, of the first seed where one must do; if ``brief``, one a plant."""
        drawn = self._errors_by_plant(brief)
        return drawn if brief else drawn | self._by_condition()

    def _errors_by_plant(self, brief: bool) -> dict[str, Figure]:
        from youbot_scripts.evaluation.figures import error_by_frequency

        drawn, plants = {}, by_plant(self.results)
        for n, group in enumerate(plants):
            several = len(models_of(group)) > 1
            if several or brief:
                name = "error_by_model" if several else "error_by_frequency"
                drawn[_numbered(name, n, plants)] = error_by_frequency(group)
        return drawn

    def _by_condition(self) -> dict[str, Figure]:
        from youbot_scripts.evaluation.figures import error_by_frequency, time_courses

        drawn, names = {}, self.settings.controllers
        groups = by_condition(self.results)
        for n, (group, condition) in enumerate(zip(groups, self.models, strict=True)):
            drawn[_numbered("error_by_frequency", n, groups)] = error_by_frequency(group)
            shown = self._shown(group, condition)
            course = shown[0].course
            stated = f"{in_words(group[0].place)}; {course}, seed 0"
            traces = {trial.controller: trial.trace() for trial in shown}
            drawn[_numbered("time_courses", n, groups)] = time_courses(traces, stated, names)
        return drawn

    def _shown(self, group: Sequence[Result], condition: Condition) -> list[EvaluationTrial]:
        """Trials whose time courses are drawn: the first controller, the one that others are
        measured by, those that diverge, the best; in a band from the middle."""
        courses = self.settings.courses()
        course = courses[len(courses) // 2]
        results = [result for result in group if result.band == course.band]
        ranked = sorted(results, key=lambda r: (r.diverged > 0, r.mean("nrmse")))
        lost = [result.controller for result in results if result.diverged]
        first = [results[0].controller, self.settings.against, ranked[0].controller, *lost]
        names = list(dict.fromkeys([*first, *self.settings.controllers]))
        found = {
            trial.controller: trial
            for trial in self.trials
            if trial.condition == condition and trial.course == course and trial.index == 0
        }
        return [found[name] for name in names if name in found][:COURSES]


def _numbered(name: str, n: int, among: Sequence[object]) -> str:
    return f"{name}_{n + 1}" if len(among) > 1 else name


def evaluate(
    chosen: Settings, *, seed: int = 0, jobs: int = 1, folder: Path | None = None
) -> Evaluation:
    """Learn the models, design the controllers, drive them; a bar shows each of the three.

    Parameters
    ----------
    seed : of all random numbers
    jobs : processes; the result is the same to the bit
    folder : where results are kept as they are done, and taken up from

    Raises
    ------
    InputError
        If a plant, model or controller cannot be, or the folder holds something else.
    """
    conditions = chosen.conditions()
    learning = sum(condition.knowledge.learns for condition in conditions)
    with common.progress(learning, "learning models") as advance:
        models = learn(conditions, seed, jobs, folder, advance)
    trials = plan(models, chosen.controllers, chosen.courses(), seed, chosen.seeds)
    designs = len({trial.controller for trial in trials if needs_design(trial)}) * len(conditions)
    with common.progress(designs, "designing controllers") as advance:
        trials = design(trials, jobs, folder, advance)
    with common.progress(len(trials), "driving") as advance:
        records = run_all(trials, jobs, folder, advance)
    return Evaluation(chosen, models, trials, records, gather(records))
