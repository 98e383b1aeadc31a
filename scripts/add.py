"""Add an effect to a model, fit it again, show the errors."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.inputs import next_diagnosis, read_inputs
from youbot_scripts.shared.options import (
    EffectsOption,
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
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

EXAMPLES = (
    "youbot add model.json floor_tilt runs/*.csv -o better.json",
    "youbot add model.json residual:heading runs/*.csv -o better.json",
)


def main(
    model: ModelArgument,
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT",
            help="Name, as `youbot effects` lists it, or residual:VARIABLE (a smooth map).",
        ),
    ],
    logs: LogsArgument,
    output: OutputModelOption = None,
    effects: EffectsOption = None,
    mechanism: MechanismOption = None,
    report: ReportOption = None,
    strict: StrictOption = False,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Add a named effect to a model, fit everything again, print held-out errors before and after.

    `residual:heading` (or another variable that a residual map names) is a smooth map of whatever
    the model leaves over that variable, with error bars: it explains nothing, makes the error fall
    today, and is refused where the logs have not been.

    Says when it was not worth it (no material or significant fall, implausible sign or size), and
    does what was asked all the same.
    """
    # Imported here: `youbot add --help` does without numpy and scipy.
    from identification.diagnosis.add_effect import add_effect
    from identification.fitting.misfit import misfit_warning
    from identification.mechanisms.registry import save_any_model

    check_pictures(None, report)
    given = read_inputs(model, logs, mechanism=mechanism, strict=strict)
    with progress(2 * len(given.logs) + 2, "add") as advance:
        result = add_effect(given.model, effect, given.logs, seed=seed, progress=advance)
    out, found = console(json), {**result.to_dict(), **given.to_dict()}
    command = next_diagnosis(str(output or model), logs)
    found["misfit"] = misfit_warning(
        found["after"]["force_error"], found["noise_floor"]["force_error"], next_command=command
    )
    if found["misfit"]:
        found["parameters"] = {
            name: {**entry, "interval": None} for name, entry in found["parameters"].items()
        }
    if output:  # before anything is printed: see identify
        save_any_model(output, result.model)
    given.tell(out)
    given.tell_doubts(out)
    _print(out, found)
    if output:
        out.print(f"model written to {output}")
    write_result(json, found, seed)
    if report:
        from youbot_scripts.shared.pages import write_addition

        write_addition(report, result, found, given.logs, seed)
        out.print(f"report written to {report}", soft_wrap=True)


def _print(out: Console, found: dict[str, Any]) -> None:
    if found["misfit"]:
        out.print(f"warning: {found['misfit']}", style="yellow", soft_wrap=True)
    show(out, [result_tables.addition_errors(found), result_tables.added_parameters(found)])
    out.print(found["words"])
    if found["worthwhile"]:
        out.print("Worth it: the error falls materially, and chance does not explain it.")
    else:
        out.print("Not worth it:", style="yellow")
        for reason in found["reasons"]:
            out.print(f"- {reason}", style="yellow")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
