"""Compare controllers on a plant: errors, effort, pictures."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_env.model import Model
from youbot_scripts import common
from youbot_scripts.cli import run_script
from youbot_scripts.evaluation import tables
from youbot_scripts.evaluation.settings import (
    SUITES,
    Settings,
    amplitude,
    bands,
    settings,
    words,
)
from youbot_scripts.evaluation.summary import (
    Result,
    by_condition,
    gather,
    in_words,
    ratios,
    unscored,
)
from youbot_scripts.evaluation.trials import (
    Condition,
    Trial,
    design,
    learn,
    needs_design,
    plan,
    run_all,
)
from youbot_scripts.journal import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXAMPLES = (
    "youbot evaluate",
    "youbot evaluate --suite late --resume late/ --report late.html",
    "youbot evaluate --plant model.json --model model.json --controllers pid,computed_torque",
    "youbot evaluate --effect floor_tilt:tilt_x=0.02 --model identified,diagnosed --bands 0.5-3",
)

COURSES = 4
"""Controllers in the picture of time courses, at most."""


def main(
    suite: Annotated[
        str, typer.Option(metavar="NAME", help=f"Where to start from: {', '.join(SUITES)}.")
    ] = "paper",
    plant: Annotated[
        list[str] | None,
        typer.Option(
            metavar="P", help="What moves, as `record` takes it: paper, a model file, contact."
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:P=VALUE,...", help="Hide an effect in the plant, as `record` does."
        ),
    ] = None,
    surprise: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:P=VALUE,...", help="The same, but in no log: put on for the runs."
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="M,...",
            help="What the controllers are built on: identified (from noisy logs of the plant; "
            "identified+EFFECT with one more effect), diagnosed, known (the truth), or a file.",
        ),
    ] = None,
    controllers: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Names; see the README.")
    ] = None,
    band: Annotated[
        str | None,
        typer.Option("--bands", metavar="LOW-HIGH,...", help="Reference frequencies [rad/s]."),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="References for each band: 5.")
    ] = None,
    peaks: Annotated[
        str | None,
        typer.Option(
            "--amplitude", metavar="VX,VY,W", help="Peaks of the reference: 0.22,0.18,0.6."
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Judged time [s]: 20, or once around a band's slowest tone."),
    ] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Control rate: 100.")] = None,
    delay: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Samples by which commands act late: 1.")
    ] = None,
    lag: Annotated[
        float | None, typer.Option(metavar="S", help="Time constant of the drives: 0.")
    ] = None,
    noise: Annotated[
        float | None, typer.Option(help="Of a measured wheel speed [rad/s]: 0.01.")
    ] = None,
    pose: Annotated[
        bool | None, typer.Option("--pose/--no-pose", help="Show the controllers the true pose.")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="NAME", help="Measure the others by this one.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, metavar="N", help="Processes.")] = 2,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep each result here, and do not do again those here."),
    ] = None,
    plots: common.PlotsOption = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="F.html",
            callback=common.check_output,
            help="Write tables and pictures as one web page (extra: plots).",
        ),
    ] = None,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Compare controllers that were built on a model, on a plant that is not that model.

    Each follows random multisine references, a band of frequencies at a time, from noisy encoders
    and through a delay, and is judged by the platform's true motion. The model is identified in
    the run, from noisy logs of the plant. Time, noise and references of one seed are the same for
    every controller. A suite is a set of options under a name; options beside it go first.
    """
    chosen = settings(
        suite,
        {
            "plants": tuple(plant) if plant else None,
            "effects": tuple(effect) if effect else None,
            "surprises": tuple(surprise) if surprise else None,
            "models": words("model", model),
            "controllers": words("controllers", controllers),
            "bands": bands(band),
            "seeds": seeds,
            "amplitude": amplitude(peaks),
            "duration": duration,
            "rate": rate,
            "delay": delay,
            "lag": lag,
            "noise": noise,
            "pose": pose,
            "against": against,
        },
    )
    if plots or report:
        _check_plots(plots)
    found = evaluate(chosen, seed=seed, jobs=jobs, folder=resume)
    out = common.console(json)
    tables.show(out, found.tables())
    if plots or report:
        _draw(found, plots, report, out)
    common.write_result(json, found.to_dict(), seed)


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
    trials: list[Trial]
    records: list[Record]
    results: list[Result]

    def tables(self) -> list[tables.Table]:
        """As printed."""
        return tables.tables(self.results, self.settings.against)

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

    def figures(self) -> dict[str, Figure]:
        """The pictures by name: two for each condition, of the first seed where one must do."""
        from youbot_scripts.evaluation.figures import error_by_frequency, time_courses

        drawn, names = {}, self.settings.controllers
        groups = by_condition(self.results)
        for n, (group, condition) in enumerate(zip(groups, self.models, strict=True)):
            number = f"_{n + 1}" if len(groups) > 1 else ""
            drawn[f"error_by_frequency{number}"] = error_by_frequency(group)
            shown = self._shown(group, condition)
            course = shown[0].course
            stated = f"{in_words(group[0].place)}; {course}, seed 0"
            traces = {trial.controller: trial.trace() for trial in shown}
            drawn[f"time_courses{number}"] = time_courses(traces, stated, names)
        return drawn

    def _shown(self, group: Sequence[Result], condition: Condition) -> list[Trial]:
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


def _check_plots(folder: Path | None) -> None:
    """Refuse what cannot be drawn before anything is computed."""
    from identification.plot_style import matplotlib
    from youbot_env.errors import InputError

    matplotlib()
    try:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None


def _draw(found: Evaluation, plots: Path | None, report: Path | None, out: Any) -> None:
    from youbot_scripts.evaluation.figures import write_all
    from youbot_scripts.evaluation.report import page

    figures = found.figures()
    if plots:
        for path in write_all(plots, figures):
            out.print(f"figure: {path}", soft_wrap=True)
    if report:
        made = common.provenance(found.trials[0].seed)
        facts = {"version": made["version"], "seed": made["seed"], **made["versions"]}
        command = shlex.join(["youbot", *sys.argv[1:]])
        common.write_text(report, page(command, found.tables(), figures, facts))
        out.print(f"report: {report}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
