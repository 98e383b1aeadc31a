"""Compare a model with logs: errors, and where the model fails."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.common import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    ModelArgument,
    PlotsOption,
    SeedOption,
    console,
    percent,
    progress,
    show_table,
    write_result,
)

if TYPE_CHECKING:
    from rich.console import Console

    from identification.comparison import Comparison

EXAMPLES = (
    "youbot compare model.json runs/multisine_b.csv",
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
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Print force error and velocity error by log and axis beside the noise floor.

    Force error: filtered generalised forces, measured torques against the model's demand. Velocity
    error: free run from a log's first sample, driven by its torques alone. Logs that the model was
    fitted on are marked and stay out of the totals, unless all are.
    """
    from identification.comparison import compare
    from identification.logs import read_logs
    from youbot_env.model_file import load_geometry, load_model

    loaded = load_model(model)
    lengths = load_geometry(geometry) if geometry else None
    read = read_logs(logs, geometry=lengths or loaded.geometry)
    with progress(len(read), "compare") as advance:
        result = compare(loaded, read, geometry=lengths, seed=seed, progress=advance)
    out = console(json)
    _print(out, result)
    if predictions:
        _write_predictions(out, result, predictions)
    write_result(json, result.to_dict(), seed)
    if plots:
        from identification.plots import plot_comparison

        for path in plot_comparison(result, plots, lengths):
            out.print(f"plot written to {path}", soft_wrap=True)


def _print(out: Console, result: Comparison) -> None:
    found = result.to_dict()
    axes = ("VX", "VY", "W")
    for kind, title in (("force", "Force error"), ("velocity", "Velocity error (free run)")):
        rows = []
        for name, entry in found["logs"].items():
            mark = " (fitted on)" if entry["seen_in_fit"] else ""
            by_axis = [percent(entry[f"{kind}_error_by_axis"][axis]) for axis in axes]
            floor = percent(entry["noise_floor"][f"{kind}_error"])
            rows.append((name + mark, *by_axis, percent(entry[f"{kind}_error"]), floor))
        total, floor = (found[key][f"{kind}_error"] for key in ("total", "noise_floor"))
        if len(rows) > 1:
            rows.append(("total", "", "", "", percent(total), percent(floor)))
        show_table(out, title, ("log", *axes, "all", "noise floor"), rows)
    rows = [
        (row["log"], row["axis"], f"{row['from']:.1f}-{row['to']:.1f} s",
         percent(row["force_error"]), percent(row["share"]))
        for row in found["where"]
    ]  # fmt: skip
    headers = ("log", "axis", "stretch", "force error", "share of all")
    show_table(out, "Where the residual is largest", headers, rows, left=("axis",))


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
