"""Fit the model to logs: parameters, intervals, observability."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.common import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    OutputModelOption,
    PlotsOption,
    SeedOption,
    console,
    number,
    percent,
    progress,
    provenance,
    show_table,
    to_digit_of,
    with_std,
    write_result,
    x_legend,
)

if TYPE_CHECKING:
    from rich.console import Console

    from identification.fitting import Identification

EXAMPLES = (
    "youbot identify runs/calibration.csv -o model.json",
    "youbot identify runs/I.csv runs/II.csv --output-error --json result.json",
    "youbot identify runs/calibration.csv --model model.json -o again.json",
    "youbot identify drive.csv --mechanism axis --unit m -o axis.json",
)


def main(
    logs: LogsArgument,
    output: OutputModelOption = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", metavar="MODEL", help="Fit this model's effects too (default: base model)."
        ),
    ] = None,
    geometry: GeometryOption = None,
    mechanism: Annotated[
        str,
        typer.Option("--mechanism", metavar="NAME", help="What the logs are of: mecanum, axis."),
    ] = "mecanum",
    unit: Annotated[
        str,
        typer.Option("--unit", help="Of an axis' position: rad (rad/s, N m) or m (m/s, N)."),
    ] = "rad",
    output_error: Annotated[
        bool, typer.Option("--output-error", help="Refine in free run after the fit on forces.")
    ] = False,
    robust: Annotated[
        bool, typer.Option("--robust", help="Huber weights, for logs with outliers.")
    ] = False,
    plots: PlotsOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Fit m0 [kg], I0, I1 [kg m^2], aX, aY [m], mu1, mu2 [N m s] to logs by least squares.

    With --mechanism axis: inertia, viscous and Coulomb friction and offset of one axis, from logs
    with the columns time, velocity, effort and, where there is one, position.

    Prints each parameter with its standard deviation and 95 % interval (true for correlated
    residuals), what each motion in the logs can show, and what looks implausible.
    """
    from identification.fitting import identify
    from identification.logs import read_logs
    from identification.mechanisms import (
        kind,
        kind_of,
        load_any_model,
        refuse_figures,
        save_any_model,
    )
    from youbot_env.model_file import load_geometry

    start = load_any_model(model) if model else None
    lengths = load_geometry(geometry) if geometry else None
    of = kind_of(start) if start else kind(mechanism)
    if plots:
        refuse_figures(of)
    read = read_logs(logs, of.joints, geometry=lengths or getattr(start, "geometry", None))
    start = start or of.start(read, unit)
    with progress(60 if output_error else 2, "identify") as advance:
        result = identify(
            read,
            geometry=lengths,
            start=start,
            output_error=output_error,
            robust=robust,
            seed=seed,
            name=output.stem if output else "model",
            provenance=provenance(seed) | {"command": "identify", "output_error": output_error},
            progress=advance,
        )
    out = console(json)
    _print(out, result)
    if output:
        save_any_model(output, result.model)
        out.print(f"model written to {output}", soft_wrap=True)
    write_result(json, result.to_dict(), seed)
    if plots:
        from identification.plots import plot_identification

        for path in plot_identification(result, plots, read):
            out.print(f"plot written to {path}", soft_wrap=True)


def _print(out: Console, result: Identification) -> None:
    found = result.to_dict()
    rows = []
    for name, entry in found["parameters"].items():
        value, std, bounds = entry["value"], entry["std"], entry["interval"]
        shown, interval = number(value), "-"
        if std is not None and 0 < std < float("inf"):
            shown = with_std(value, std)
            interval = " ... ".join(to_digit_of(bound, std) for bound in bounds)
        rows.append((name, shown, interval, entry["unit"]))
    show_table(out, "Parameters", ("name", "value", "95 % interval", "unit"), rows, left=("unit",))
    _print_observability(out, found["observability"], result.mechanism.scaling)
    errors = found["errors"]
    floor = errors["noise_floor"]["force_error"]
    line = f"force error {percent(errors['force_error'])} on these logs"
    line += f" (noise floor {percent(floor)})"
    if "velocity_error" in errors:
        line += f", velocity error {percent(errors['velocity_error'])}"
    out.print(line)
    for warning in found["warnings"]:
        out.print(f"warning: {warning}", style="yellow")


def _print_observability(out: Console, seen: dict, scaling: str) -> None:
    names = {name: f"x{k + 1}" for k, name in enumerate(seen["total"]["names"])}
    rows = []
    for part in seen["parts"]:
        blocks = " ".join(
            "{" + ", ".join(names[n] for n in block) + "}" for block in part["blocks"]
        )
        stretch = f"{part['from']:.0f}-{part['to']:.0f} s"
        blind = ", ".join(part["blind"]) or "-"
        rows.append((part["log"], part["kind"], stretch, part["rank"], blind, blocks))
    show_table(
        out,
        "What each motion shows",
        ("log", "motion", "stretch", "rank", "blind to", "blocks"),
        rows,
        left=("motion", "blind to", "blocks"),
    )
    total = seen["total"]
    out.print(f"{x_legend(total['names'], scaling)}; all together: rank {total['rank']}")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
