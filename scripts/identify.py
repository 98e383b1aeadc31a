"""Fit the model to logs: parameters, intervals, observability."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.inputs import next_diagnosis, read_logs_to_fit
from youbot_scripts.shared.tables import percent, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.fitting.identify import Identification

EXAMPLES = (
    "youbot identify runs/calibration.csv -o model.json --report model.html",
    "youbot identify runs/I.csv runs/II.csv --output-error --json result.json",
    "youbot identify runs/calibration.csv --model model.json -o again.json",
    "youbot identify drive.csv --mechanism axis --unit m -o axis.json",
)


def main(
    logs: common.LogsArgument,
    output: common.OutputModelOption = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", metavar="MODEL", help="Fit this model's effects too (default: base model)."
        ),
    ] = None,
    effects: common.EffectsOption = None,
    geometry: common.GeometryOption = None,
    mechanism: common.LogsOfOption = "mecanum",
    unit: common.UnitOption = "rad",
    output_error: Annotated[
        bool, typer.Option("--output-error", help="Refine in free run after the fit on forces.")
    ] = False,
    robust: Annotated[
        bool, typer.Option("--robust", help="Huber weights, for logs with outliers.")
    ] = False,
    plots: common.PlotsOption = None,
    report: common.ReportOption = None,
    strict: common.StrictOption = False,
    json: common.JsonOption = None,
    seed: common.SeedOption = 0,
) -> None:
    """Fit m0 [kg], I0, I1 [kg m^2], aX, aY [m], mu1, mu2 [N m s] to logs by least squares.

    With --mechanism axis: inertia, viscous and Coulomb friction and offset of one axis, from logs
    with the columns time, velocity, effort and, where there is one, position.

    Prints each parameter with its standard deviation and 95 % interval (true for correlated
    residuals), what each motion in the logs can show, and what looks implausible. Where the model
    lacks something it is fitted within physical limits, without intervals, and a warning says so.
    """
    # Imported here: `youbot identify --help` does without numpy and scipy.
    from identification.fitting.identify import identify
    from identification.mechanisms.registry import save_any_model

    common.check_pictures(plots, report)
    given = read_logs_to_fit(logs, model, geometry, mechanism, unit, strict)
    made = common.provenance(seed)
    with common.progress(60 if output_error else 2, "identify") as advance:
        result = identify(
            given.logs,
            geometry=given.geometry,
            start=given.model,
            output_error=output_error,
            robust=robust,
            seed=seed,
            name=output.stem if output else "model",
            provenance=made | {"command": "identify", "output_error": output_error},
            progress=advance,
        )
    known = model or ("paper" if mechanism == "mecanum" and not geometry else "MODEL")
    result = result.with_next_command(next_diagnosis(str(output or known), logs))
    out = common.console(json)
    # Before anything is printed: a reader that closes its pipe (`| head`) must not cost the model.
    if output:
        save_any_model(output, result.model)
    given.tell(out)
    _print(out, result)
    if output:
        out.print(f"model written to {output}", soft_wrap=True)
    common.write_result(json, {**result.to_dict(), **given.to_dict()}, seed)
    if plots:
        from identification.figures.figures import plot_identification

        for path in plot_identification(result, plots, given.logs):
            out.print(f"plot written to {path}", soft_wrap=True)
    if report:
        from youbot_scripts.shared.pages import write_identification

        write_identification(report, result, given.logs, seed)
        out.print(f"report written to {report}", soft_wrap=True)


def _print(out: Console, result: Identification) -> None:
    errors = result.model.errors
    floor = percent(errors["noise_floor"]["force_error"])
    line = f"force error {percent(errors['force_error'])} on these logs (noise floor {floor})"
    if "velocity_error" in errors:
        line += f", velocity error {percent(errors['velocity_error'])}"
    # What is wrong with logs or fit comes before the numbers that it makes doubtful.
    for warning in result.first_warnings:
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    from youbot_scripts.shared.pages import tables_of_identification

    show(out, tables_of_identification(result))
    out.print(line)
    for warning in result.warnings[len(result.first_warnings) :]:
        out.print(f"warning: {warning}", style="yellow")
    if told := _geometry_line(result.mechanism.geometry):
        out.print(told, soft_wrap=True)


def _geometry_line(geometry: object) -> str:
    """The lengths that were taken for true; "" of what is no platform."""
    from youbot_env.physics.geometry import Geometry

    if not isinstance(geometry, Geometry):
        return ""
    g = geometry
    degrees = sorted({round(57.29578 * angle, 2) for angle in g.roller_angles})
    rollers = f", rollers in {g.arrangement}" if g.arrangement != "X" else ""
    if degrees != [45.0]:
        rollers += f", at {' / '.join(f'{angle:g}' for angle in degrees)} degrees"
    whose = " (the youBot's; another robot's: --geometry)" if g == Geometry() else ""
    return (
        f"with l = {g.l:.4g}, h = {g.h:.4g}, R = {g.R:.4g}, r = {g.r:.4g} m, m1 = {g.m1:.4g} kg"
        f"{rollers} taken for true{whose}"
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
