"""Compare a model with logs: errors, and where the model fails."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.inputs import next_diagnosis, read_inputs
from youbot_scripts.shared.options import (
    EffectsOption,
    GeometryOption,
    JsonOption,
    LogsArgument,
    ModelArgument,
    PlotsOption,
    ReportOption,
    SeedOption,
    StrictOption,
    check_pictures,
    console,
    progress,
    write_result,
)
from youbot_scripts.shared.tables import show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.comparison import Comparison

EXAMPLES = (
    "youbot compare model.json runs/multisine_b.csv --report fails.html",
    "youbot compare paper runs/*.csv --predictions predicted/ --json errors.json",
)


def main(
    model: ModelArgument,
    logs: LogsArgument,
    predictions: Annotated[
        Path | None,
        typer.Option(
            "--predictions",
            metavar="DIR",
            help="Write the free run's wheel speeds [rad/s] here, one CSV a log.",
        ),
    ] = None,
    effects: EffectsOption = None,
    geometry: GeometryOption = None,
    plots: PlotsOption = None,
    report: ReportOption = None,
    strict: StrictOption = False,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Print force error and velocity error beside the noise floor, and where the model fails.

    Force error: filtered generalised forces, measured torques against the model's demand. Velocity
    error: free run from a log's first sample, driven by its torques alone. Logs that the model was
    fitted on are marked and stay out of the totals, unless all are. Where it fails: the share of
    the force residual that depends on each variable, and the worst stretches.
    """
    # Imported here: `youbot compare --help` does without numpy and scipy.
    from identification.comparison import compare
    from identification.fitting.misfit import NEXT_COMMAND

    check_pictures(plots, report)
    given = read_inputs(model, logs, geometry=geometry, strict=strict)
    with progress(len(given.logs) + 1, "compare") as advance:
        result = compare(
            given.model, given.logs, geometry=given.geometry, seed=seed, progress=advance
        )
    out, found = console(json), {**result.to_dict(), **given.to_dict()}
    if found["misfit"]:
        found["misfit"] = found["misfit"].replace(NEXT_COMMAND, next_diagnosis(model, logs))
    given.tell(out)
    given.tell_doubts(out)
    _print(out, found)
    if predictions:
        _write_predictions(out, result, predictions)
    write_result(json, found, seed)
    if plots:
        from identification.figures.figures import plot_comparison

        for path in plot_comparison(result, plots, given.geometry):
            out.print(f"plot written to {path}", soft_wrap=True)
    if report:
        from youbot_scripts.shared.pages import write_comparison

        write_comparison(report, result, found, seed)
        out.print(f"report written to {report}", soft_wrap=True)


def _print(out: Console, found: dict[str, Any]) -> None:
    if found["misfit"]:
        out.print(f"warning: {found['misfit']}", style="yellow", soft_wrap=True)
    for sentence in found["kinematics"]:
        out.print(f"warning: {sentence}", style="yellow", soft_wrap=True)
    for name in found["diverges"]:
        line = f"{name}: the model's free run diverges, so it has no velocity error"
        out.print(f"warning: {line}", style="yellow", soft_wrap=True)
    show(out, [*result_tables.errors_by_axis(found), *result_tables.slip(found["logs"])])
    where = result_tables.residual("What the force residual depends on", found["where"])
    if where.rows:
        show(out, [where])
    else:
        out.print(f"The force residual: {found['where_words']}.\n")
    show(out, [result_tables.stretches(found)])
    for sentence in (*found["clock"], *found["changes"]["words"]):
        out.print(f"- {sentence}", soft_wrap=True)


def _write_predictions(out: Console, result: Comparison, folder: Path) -> None:
    from identification.comparison import write_predictions
    from youbot_env.errors import InputError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    for item in result.logs:
        path = folder / f"{item.log.name}.csv"
        write_predictions(path, item)
        out.print(f"predictions written to {path}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
