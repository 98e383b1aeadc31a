"""Fit the model to logs: parameters, intervals, observability."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common, result_tables
from youbot_scripts.shared.inputs import next_diagnosis, read_logs_to_fit
from youbot_scripts.shared.tables import Table, percent, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.fitting.identify import Identification
    from identification.logs.log import Log
    from youbot_scripts.shared.report_page import Part

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
    given.tell(out)
    _print(out, result)
    if output:
        save_any_model(output, result.model)
        out.print(f"model written to {output}", soft_wrap=True)
    common.write_result(json, {**result.to_dict(), **given.to_dict()}, seed)
    if plots:
        from identification.figures.figures import plot_identification

        for path in plot_identification(result, plots, given.logs):
            out.print(f"plot written to {path}", soft_wrap=True)
    if report:
        from youbot_scripts.shared.report_page import write_page

        title = f"Model identified: {result.model.name}"
        write_page(report, title, _page(result, given.logs, seed), seed)
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
    show(out, _tables(result))
    out.print(line)
    for warning in result.warnings[len(result.first_warnings) :]:
        out.print(f"warning: {warning}", style="yellow")


def _tables(result: Identification) -> list[Table]:
    """Parameters, and what each motion shows of them."""
    found = result.to_dict()
    return [
        result_tables.parameters(found["combinations"] | found["parameters"]),
        result_tables.observability(found["observability"], result.mechanism.scaling),
    ]


def _page(result: Identification, read: Sequence[Log], seed: int) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.figures.charts import charts_of_identification, residual_charts
    from identification.mechanisms.registry import quantities_of
    from identification.residual_map.residual_map import residual_map
    from youbot_scripts.shared.effect_tables import equations_with
    from youbot_scripts.shared.report_page import Charts, Words, groups_of

    errors = result.model.errors
    floor = errors["noise_floor"]
    yield Words([result_tables.verdict(errors["force_error"], floor["force_error"])], "verdict")
    yield Words(result.warnings, "warning")
    rows = [("the model, on its own logs", errors), ("noise floor", floor)]
    yield result_tables.errors("Errors", rows)
    yield from _tables(result)
    where = residual_map(result.mechanism, result.fit.theta, result.samples, seed=seed)
    yield result_tables.residual("What the force residual depends on", where.to_list())
    for chart in residual_charts([("", where)], quantities_of(result.model).forces):
        yield Charts([chart])
    charts = {chart.name: chart for chart in charts_of_identification(result)}
    yield Charts([charts.pop("forces_0")])
    yield from groups_of(charts)
    yield equations_with(result.model.mechanism.name, result.mechanism.structure.effects)
    yield result_tables.logs(read)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
