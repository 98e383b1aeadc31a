"""Compare a model with logs: errors, and where the model fails."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    """Print force error and velocity error beside the noise floor, and where the model fails.

    Force error: filtered generalised forces, measured torques against the model's demand. Velocity
    error: free run from a log's first sample, driven by its torques alone. Logs that the model was
    fitted on are marked and stay out of the totals, unless all are. Where it fails: the share of
    the force residual that depends on each variable, and the worst stretches.
    """
    from identification.comparison import compare
    from identification.logs import read_logs
    from identification.mechanisms import kind_of, load_any_model, refuse_figures
    from youbot_env.model_file import load_geometry

    loaded = load_any_model(model)
    lengths = load_geometry(geometry) if geometry else None
    of = kind_of(loaded)
    if plots:
        refuse_figures(of)
    read = read_logs(logs, of.joints, geometry=lengths or getattr(loaded, "geometry", None))
    with progress(len(read) + 1, "compare") as advance:
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
            rows.append(("total", "", "", "", percent(total), percent(floor)))
        show_table(out, title, ("log", *axes, "all", "noise floor"), rows)
    _print_slip(out, found["logs"])
    _print_where(out, result)
    rows = [
        (row["log"], row["axis"], f"{row['from']:.1f}-{row['to']:.1f} s",
         percent(row["force_error"]), percent(row["share"]))
        for row in found["stretches"]
    ]  # fmt: skip
    headers = ("log", "axis", "stretch", "force error", "share of all")
    show_table(out, "Where the residual is largest", headers, rows, left=("axis",))


def _print_slip(out: Console, logs: Mapping[str, Any]) -> None:
    rows = [
        (name, percent(slip["ratio"]), percent(slip["noise"]),
         "slip" if slip["exceeds_noise"] else "holds")
        for name, entry in logs.items()
        if (slip := entry.get("slip"))
    ]  # fmt: skip
    if rows:
        title = "No slip: phi_1' + phi_2' = phi_3' + phi_4' (share of wheel speeds)"
        headers = ("log", "off by", "noise alone", "identity")
        show_table(out, title, headers, rows)


def _print_where(out: Console, result: Comparison) -> None:
    """Variables that explain more of the residual than chance would."""
    shares = [share for share in result.where.shares if share.share > 0]
    if not shares:
        out.print("The force residual depends on no variable more than chance would have it.\n")
        return
    rows = [
        (
            share.variable + (f" ({share.cycles} times a turn)" if share.cycles else ""),
            percent(share.share),
        )
        for share in shares
    ]
    headers = ("variable (others: beyond the twist)", "held-out share of variance")
    show_table(out, "What the force residual depends on", headers, rows)


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
