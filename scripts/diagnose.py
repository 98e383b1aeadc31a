"""Say which physical effect a model lacks on logs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.common import (
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
    SeedOption,
    console,
    number,
    percent,
    progress,
    show_table,
    write_result,
)

if TYPE_CHECKING:
    from rich.console import Console

    from identification.diagnosis import Diagnosis

EXAMPLES = (
    "youbot diagnose model.json runs/*.csv -o better.json",
    "youbot diagnose paper runs/*.csv --effects my_effects.py --json diagnosis.json",
)


def main(
    model: ModelArgument,
    logs: LogsArgument,
    output: OutputModelOption = None,
    effects: Annotated[
        Path | None,
        typer.Option("--effects", metavar="FILE.py", help="Your own effects; runs this file."),
    ] = None,
    next_motion: Annotated[
        Path | None,
        typer.Option(
            "--next-motion", metavar="FILE", help="Write the proposed motion here, for `record`."
        ),
    ] = None,
    mechanism: MechanismOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Rank the catalogue's effects by held-out error and name what is missing, or say it cannot.

    MODEL's structure is the start; its parameters are fitted again. Each log in turn is held out
    (one log alone: five blocks). Prints the error as it falls, beside the noise floor.
    """
    from identification.diagnosis import diagnose
    from identification.logs import read_logs
    from identification.mechanisms import check_mechanism, kind_of, load_any_model, save_any_model
    from youbot_env.plugins import load_effects

    if effects:
        load_effects(effects)
    loaded = load_any_model(model)
    check_mechanism(loaded, mechanism)
    read = read_logs(logs, kind_of(loaded).joints, geometry=getattr(loaded, "geometry", None))
    with progress(40, "diagnose") as advance:
        result = diagnose(loaded, read, seed=seed, progress=advance)
    out = console(json)
    _print(out, result)
    if output:
        save_any_model(output, result.model)
        out.print(f"model written to {output}")
    if next_motion and result.next_experiment:
        from youbot_scripts.common import write_json

        write_json(next_motion, result.next_experiment["motion"])
        out.print(f"motion written to {next_motion}")
    write_result(json, result.to_dict(), seed)


def _print(out: Console, result: Diagnosis) -> None:
    floor = result.noise_floor
    rows = [
        (
            step.effect or "the model, refitted",
            percent(step.force_error),
            percent(step.velocity_error),
        )
        for step in result.steps
    ]
    rows.append(("noise floor", percent(floor["force_error"]), percent(floor["velocity_error"])))
    show_table(out, "The error as it falls", ("with", "force error", "velocity error"), rows)
    rows = [
        (row["effect"], percent(row["force_error"]), number(row["p_value"], 2), _sizes(row))
        for row in result.candidates[:4]
    ]
    headers = ("effect", "force error", "p", "at")
    show_table(out, "Candidates, best first", headers, rows, left=("at",))
    shares = [row for row in result.where if row["share"] > 0][:6]
    if shares:
        rows = [(row["variable"], percent(row["share"])) for row in shares]
        show_table(out, "Residual by variable", ("variable", "share of it"), rows)
    out.print(f"Verdict: {result.verdict}", style="bold")
    for sentence in result.sentences:
        out.print(f"- {sentence}")
    if result.next_experiment:
        proposal = result.next_experiment
        apart = " and ".join(proposal["separates"])
        out.print(f"Next experiment: motion {proposal['name']} tells {apart} apart")
    for warning in result.warnings:
        out.print(f"warning: {warning}", style="yellow")


def _sizes(row: dict) -> str:
    return ", ".join(
        f"{name} {number(entry['value'], 3)}" for name, entry in row["parameters"].items()
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
