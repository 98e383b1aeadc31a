"""Check logs: faults, repairs, and what they can show."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.cli import run_script
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.options import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    LogsOfOption,
    UnitOption,
    console,
    write_result,
)
from youbot_scripts.shared.tables import show

if TYPE_CHECKING:
    from rich.console import Console

EXAMPLES = (
    "youbot doctor runs/*.csv",
    "youbot doctor my_log.csv --json checks.json",
    "youbot doctor drive.csv --mechanism axis --unit m",
)

NUMERALS = {4: "four", 7: "seven"}
"""Number of a base model's parameters in words: 4 of an axis, 7 of a platform."""


def main(
    logs: LogsArgument,
    geometry: GeometryOption = None,
    mechanism: LogsOfOption = "mecanum",
    unit: UnitOption = "rad",
    json: JsonOption = None,
) -> None:
    """Run the data checks alone: what is wrong with a log, what was repaired, what it can show.

    Reports every log; the exit status is 2 if one of them cannot be used.
    """
    # Imported here: `youbot doctor --help` does without numpy and scipy.
    from identification.doctor import examine_log
    from identification.importing.importing import import_command
    from identification.mechanisms.registry import kind
    from youbot_env.errors import InputError
    from youbot_env.model.model_file import load_geometry

    of, lengths = kind(mechanism), load_geometry(geometry) if geometry else None
    out = console(json)
    reports: dict[str, dict[str, Any]] = {}
    for path in logs:
        reports[str(path)] = examine_log(path, of, geometry=lengths, unit=unit).to_dict()
        if not reports[str(path)]["usable"] and mechanism == "mecanum":
            reports[str(path)]["import"] = import_command(path)
        _print(out, path, reports[str(path)])
    write_result(json, {"logs": reports})
    broken = [path for path, report in reports.items() if not report["usable"]]
    if broken:
        raise InputError(f"{len(broken)} of {len(reports)} logs cannot be used: {broken[0]}")


def _print(out: Console, path: Path, report: dict[str, Any]) -> None:
    if report["usable"]:
        noise, units = report["noise"], report["units"]
        out.print(
            f"{path}: {report['rows']} rows, {report['duration']:.1f} s at {report['rate']:.4g} Hz,"
            f" noise {noise['speed']:.2g} {units['speed']},"
            f" {noise['torque']:.2g} {units['torque']}",
            soft_wrap=True,
        )
    else:
        out.print(f"{path}: cannot be used", style="red", soft_wrap=True)
    for finding in report["findings"]:
        place = f"row {finding['row']}: " if finding.get("row") is not None else ""
        named = finding.get("column") or ""
        told = not named or finding["message"].startswith(f"{named} ")
        column = "" if told else f"column {named}: "
        cure = f"; {finding['cure']}" if finding.get("cure") else ""
        out.print(
            f"  {finding['level']}: {place}{column}{finding['message']}{cure}", soft_wrap=True
        )
    if report.get("import"):
        out.print(f"  this reads it: {report['import']}", soft_wrap=True)
    if report["usable"]:
        _print_shows(out, report["shows"])


def _print_shows(out: Console, shows: dict[str, Any]) -> None:
    show(out, [result_tables.motions_of_log(shows)])
    if any(p["blind"] for p in shows["parts"]):
        legend = result_tables.x_legend(shows["names"], shows["scaling"])
        out.print(f"  {legend}", soft_wrap=True)
    motions = shows.get("motion_that_shows")
    for k, (direction, cure) in enumerate(zip(shows["blind"], shows["cures"], strict=True)):
        if motions:
            cure = f"motion {motions[k]} would (youbot record --motions)"
        out.print(f"  cannot show {direction}: {cure}")
    if not shows["blind"]:
        out.print(f"  shows all {NUMERALS[shows['rank']]} parameters of the base model")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
