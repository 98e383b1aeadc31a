"""Add an effect to a model, fit it again, show the errors."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import (
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
    SeedOption,
    console,
    percent,
    progress,
    show_table,
    with_std,
    write_result,
)

if TYPE_CHECKING:
    from rich.console import Console

    from identification.diagnosis.add_effect import Addition

EXAMPLES = ("youbot add model.json floor_tilt runs/*.csv -o better.json",)


def main(
    model: ModelArgument,
    effect: Annotated[
        str, typer.Argument(metavar="EFFECT", help="Name, as `youbot effects` lists it.")
    ],
    logs: LogsArgument,
    output: OutputModelOption = None,
    effects: Annotated[
        Path | None,
        typer.Option("--effects", metavar="FILE.py", help="Your own effects; runs this file."),
    ] = None,
    mechanism: MechanismOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Add a named effect to a model, fit everything again, print held-out errors before and after.

    Says when it was not worth it (no material or significant fall, implausible sign or size), and
    does what was asked all the same.
    """
    from identification.diagnosis.add_effect import add_effect
    from identification.logs.reading import read_logs
    from identification.mechanisms.registry import (
        check_mechanism,
        kind_of,
        load_any_model,
        platform_geometry,
        save_any_model,
    )
    from youbot_env.plugins import load_effects

    if effects:
        load_effects(effects)
    loaded = load_any_model(model)
    check_mechanism(loaded, mechanism)
    read = read_logs(logs, kind_of(loaded).joints, geometry=platform_geometry(loaded))
    with progress(2 * len(read) + 2, "add") as advance:
        result = add_effect(loaded, effect, read, seed=seed, progress=advance)
    out = console(json)
    _print(out, result)
    if output:
        save_any_model(output, result.model)
        out.print(f"model written to {output}")
    write_result(json, result.to_dict(), seed)


def _print(out: Console, result: Addition) -> None:
    floor = result.noise_floor
    rows = [
        (name, percent(errors["force_error"]), percent(errors["velocity_error"]))
        for name, errors in (
            ("before", result.to_dict()["before"]),
            (f"with {result.effect}", result.to_dict()["after"]),
            ("noise floor", floor),
        )
    ]
    show_table(out, "Held-out errors", ("", "force error", "velocity error"), rows)
    entries = result.model.effects[result.effect]
    rows = [
        (name, with_std(e.value, e.std) if e.std else f"{e.value:.4g}", e.unit)
        for name, e in entries.items()
    ]
    show_table(out, result.effect, ("parameter", "value", "unit"), rows, left=("unit",))
    out.print(result.sentence)
    if result.worthwhile:
        out.print("Worth it: the error falls materially, and chance does not explain it.")
    else:
        out.print("Not worth it:", style="yellow")
        for reason in result.reasons:
            out.print(f"- {reason}", style="yellow")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
