"""Compare controllers on a plant: errors, effort, pictures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from controllers.policy.policy_file import shipped_policies
from controllers.registry import CONTROLLERS
from youbot_scripts.cli import run_script
from youbot_scripts.evaluation.conditions import BASIC, MOST_SEEDS
from youbot_scripts.evaluation.evaluation import Evaluation, evaluate
from youbot_scripts.evaluation.suites import SUITES, settings_from_options
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import show

EXAMPLES = (
    "youbot evaluate",
    "youbot evaluate --suite late --resume late/ --report late.html",
    "youbot evaluate --plant model.json --model model.json --controllers pid,computed_torque",
    "youbot evaluate --controllers kinematic_tuned,computed_torque,my_controller.py",
    "youbot evaluate --effect floor_tilt:tilt_x=0.02 --model identified,diagnosed --bands 0.5-3",
)


def main(
    suite: Annotated[
        str,
        typer.Option(metavar="NAME", help=f"Set of options to start from: {', '.join(SUITES)}."),
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
        str | None,
        typer.Option(
            metavar="A,B,...",
            help=f"Of {', '.join((*CONTROLLERS, *shipped_policies()))}; or a gains file of `tune`, "
            f"a policy of `train`, your own FILE.py. Default: {', '.join(BASIC)}.",
        ),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option("--bands", metavar="LOW-HIGH,...", help="Reference frequencies [rad/s]."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_SEEDS, metavar="N", help="References for each band: 5."),
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
    effects: common.EffectsOption = None,
    jobs: common.JobsOption = 2,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep each result here, and do not do again those here."),
    ] = None,
    plots: common.PlotsOption = None,
    report: common.ReportOption = None,
    brief: Annotated[
        bool, typer.Option("--brief", help="Print and draw the comparison alone, no details.")
    ] = False,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Compare controllers that were built on a model, on a plant that is not that model.

    Each follows random multisine references, a band of frequencies at a time, from noisy encoders
    and through a delay, and is judged by the platform's true motion. The model is identified in
    the run, from noisy logs of the plant. Time, noise and references of one seed are the same for
    every controller. A suite is a set of options under a name; options beside it go first.
    """
    given = {"plants": plant, "effects": effect, "surprises": surprise, "models": model}
    given |= {"controllers": controllers, "bands": band, "seeds": seeds, "amplitude": peaks}
    given |= {"duration": duration, "rate": rate, "delay": delay, "lag": lag, "noise": noise}
    given |= {"pose": pose, "against": against}
    chosen = settings_from_options(suite, given)
    common.check_pictures(plots, report)
    found = evaluate(chosen, seed=seed, jobs=jobs, folder=resume)
    out = common.console(json)
    for words in found.warnings:
        out.print(f"warning: {words}", style="yellow", soft_wrap=True, markup=False)
    show(out, found.tables(brief))
    if plots or report:
        _draw(out, found, brief, plots, report)
    common.write_result(json, found.to_dict(), seed)


def _draw(out: Any, found: Evaluation, brief: bool, plots: Path | None, page: Path | None) -> None:
    from identification.figures.style import write_figures
    from youbot_scripts.shared.report_page import write_page

    if plots:
        for path in write_figures(plots, found.figures(brief).items()):
            out.print(f"figure: {path}", soft_wrap=True)
    if page:
        write_page(page, "Controllers compared", found.page(brief), found.trials[0].seed)
        out.print(f"report: {page}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
