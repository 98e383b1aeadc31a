"""Compare a model with logs: errors, and where the model fails."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    ModelArgument,
    PlotsOption,
    ReportOption,
    SeedOption,
    check_pictures,
    console,
    percent,
    progress,
    write_result,
    write_text,
)
from youbot_scripts.shared.tables import Table, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.comparison import Comparison
    from youbot_env.physics.geometry import Geometry
    from youbot_scripts.shared.report_page import Part

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
    geometry: GeometryOption = None,
    plots: PlotsOption = None,
    report: ReportOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Print force error and velocity error beside the noise floor, and where the model fails.

    Force error: filtered generalised forces, measured torques against the model's demand. Velocity
    error: free run from a log's first sample, driven by its torques alone. Logs that the model was
    fitted on are marked and stay out of the totals, unless all are. Where it fails: the share of
    the force residual that depends on each variable, and the worst stretches.
    """
    from identification.comparison import compare
    from identification.logs.reading import read_logs
    from identification.mechanisms.registry import kind_of, load_any_model, platform_geometry
    from youbot_env.model.model_file import load_geometry

    check_pictures(plots, report)
    loaded = load_any_model(model)
    lengths = load_geometry(geometry) if geometry else None
    of = kind_of(loaded)
    read = read_logs(logs, of.joints, geometry=lengths or platform_geometry(loaded))
    with progress(len(read) + 1, "compare") as advance:
        result = compare(loaded, read, geometry=lengths, seed=seed, progress=advance)
    out = console(json)
    _print(out, result)
    if predictions:
        _write_predictions(out, result, predictions)
    write_result(json, result.to_dict(), seed)
    if plots:
        from identification.figures.figures import plot_comparison

        for path in plot_comparison(result, plots, lengths):
            out.print(f"plot written to {path}", soft_wrap=True)
    if report:
        from youbot_scripts.shared.report_page import facts, page

        title = f"Model compared with logs: {loaded.name}"
        write_text(report, page(title, _parts(result, lengths), facts(seed)))
        out.print(f"report written to {report}", soft_wrap=True)


def _print(out: Console, result: Comparison) -> None:
    found = result.to_dict()
    show(out, [*_errors(result, found), *_slip(found["logs"])])
    where = _where(found)
    if where.rows:
        show(out, [where])
    else:
        out.print("The force residual depends on no variable more than chance would have it.\n")
    show(out, [_stretches(found)])


def _errors(result: Comparison, found: Mapping[str, Any]) -> Iterator[Table]:
    axes = result.logs[0].axes
    for kind, title in (("force", "Force error"), ("velocity", "Velocity error (free run)")):
        rows = []
        for name, entry in found["logs"].items():
            mark = " (fitted on)" if entry["seen_in_fit"] else ""
            by_axis = [percent(entry[f"{kind}_error_by_axis"][axis]) for axis in axes]
            floor = percent(entry["noise_floor"][f"{kind}_error"])
            rows.append((name + mark, *by_axis, percent(entry[f"{kind}_error"]), floor))
        total, floor = (found[key][f"{kind}_error"] for key in ("total", "noise_floor"))
        if len(rows) > 1:
            rows.append(("total", *[""] * len(axes), percent(total), percent(floor)))
        yield Table(title, ("log", *axes, "all", "noise floor"), tuple(rows))


def _slip(logs: Mapping[str, Any]) -> Iterator[Table]:
    rows = tuple(
        (name, percent(slip["ratio"]), percent(slip["noise"]),
         "slip" if slip["exceeds_noise"] else "holds")
        for name, entry in logs.items()
        if (slip := entry.get("slip"))
    )  # fmt: skip
    if rows:
        title = "No slip: phi_1' + phi_2' = phi_3' + phi_4' (share of wheel speeds)"
        yield Table(title, ("log", "off by", "noise alone", "identity"), rows)


def _where(found: Mapping[str, Any]) -> Table:
    from youbot_scripts.shared import tables as result_tables

    return result_tables.depends_on("What the force residual depends on", found["where"])


def _stretches(found: Mapping[str, Any]) -> Table:
    rows = tuple(
        (row["log"], row["axis"], f"{row['from']:.1f}-{row['to']:.1f} s",
         percent(row["force_error"]), percent(row["share"]))
        for row in found["stretches"]
    )  # fmt: skip
    headers = ("log", "axis", "stretch", "force error", "share of all")
    return Table("Where the residual is largest", headers, rows, left=("axis",))


def _parts(result: Comparison, geometry: Geometry | None) -> Iterator[Part]:
    """The web page: the verdict first, then how it came about."""
    from identification.figures.figures import figures_of_comparison
    from youbot_scripts.shared import tables as result_tables
    from youbot_scripts.shared.report_page import Words, pictures

    found = result.to_dict()
    error, floor = found["total"], found["noise_floor"]
    yield Words([result_tables.verdict(error["force_error"], floor["force_error"])], "verdict")
    yield Words(list(_warnings(result)), "warning")
    rows = [("the model", error), ("noise floor", floor)]
    yield result_tables.errors("Errors, all logs that count", rows)
    yield from _errors(result, found)
    yield result_tables.residual("What the force residual depends on", found["where"])
    yield _stretches(found)
    yield from _slip(found["logs"])
    yield from pictures(figures_of_comparison(result, geometry))
    yield result_tables.parameters(result_tables.of_model(result.model), "The model's parameters")
    yield result_tables.logs(item.log for item in result.logs)


def _warnings(result: Comparison) -> Iterator[str]:
    if all(item.seen_in_fit for item in result.logs):
        yield "The model was fitted on these very logs: compare on others to see what it can do."
    for item in result.logs:
        if item.slip is not None and item.slip.exceeds_noise:
            yield f"{item.log.name}: the wheels slip, or one is not what the geometry says."
        yield from item.log.warnings


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
