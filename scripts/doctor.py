"""Check logs: faults, repairs, and what they can show."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.cli import run_script
from youbot_scripts.common import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    console,
    show_table,
    write_result,
    x_legend,
)

if TYPE_CHECKING:
    from rich.console import Console

    from identification.logs import Log
    from youbot_env.geometry import Geometry

EXAMPLES = ("youbot doctor runs/*.csv", "youbot doctor my_log.csv --json checks.json")


def main(logs: LogsArgument, geometry: GeometryOption = None, json: JsonOption = None) -> None:
    """Run the data checks alone: what is wrong with a log, what was repaired, what it can show.

    Reports every log; the exit status is 2 if one of them cannot be used.
    """
    from youbot_env.model_file import load_geometry

    lengths = load_geometry(geometry) if geometry else None
    out = console(json)
    reports, broken = {}, []
    for path in logs:
        report = _examine(path, lengths)
        reports[str(path)] = report
        _print(out, path, report)
        if not report["usable"]:
            broken.append(str(path))
    write_result(json, {"logs": reports})
    if broken:
        from youbot_env.errors import InputError

        raise InputError(f"{len(broken)} of {len(reports)} logs cannot be used: {broken[0]}")


def _examine(path: Path, geometry: Geometry | None) -> dict[str, Any]:
    from identification.findings import LogError
    from identification.logs import read_log
    from youbot_env.errors import InputError

    try:
        log = read_log(path, geometry=geometry)
    except LogError as error:
        return {"usable": False, "findings": [_finding(f) for f in error.findings]}
    except InputError as error:
        return {"usable": False, "findings": [{"level": "error", "message": str(error)}]}
    return {
        "usable": True,
        "rows": len(log),
        "rate": log.rate,
        "duration": log.duration,
        "findings": [_finding(finding) for finding in log.findings],
        "noise": _noise(log),
        "shows": _shows(log, geometry),
    }


def _finding(finding: Any) -> dict[str, Any]:
    keys = ("level", "message", "row", "column", "cure")
    return {key: getattr(finding, key) for key in keys}


def _noise(log: Log) -> dict[str, float]:
    from identification.noise import white_noise

    return {
        "speed": float(white_noise(log.velocity).mean()),
        "torque": float(white_noise(log.effort).mean()),
    }


def _shows(log: Log, geometry: Geometry | None) -> dict[str, Any]:
    import numpy as np

    from identification.mecanum import Mecanum
    from identification.observability import log_observability, motion_that_shows
    from identification.regression import regression_rows
    from identification.segments import parts_of
    from youbot_env.dynamics import Structure
    from youbot_env.geometry import Geometry
    from youbot_env.model_file import load_model

    mechanism = Mecanum(geometry or Geometry(), Structure())
    samples = mechanism.samples(log)
    theta = load_model("paper").theta
    rows = regression_rows(mechanism, theta, samples, np.flatnonzero(mechanism.free))
    total = log_observability(mechanism, [rows])
    parts = []
    for part in parts_of(samples):
        seen = log_observability(mechanism, [rows.between(part.start, part.end)])
        blind = seen.describe_blind()
        parts.append(
            {"kind": part.kind, "from": part.start, "to": part.end, "rank": seen.rank}
            | {"blind": blind}
        )
    return {
        "names": list(total.names),
        "rank": total.rank,
        "blind": total.describe_blind(),
        "motion_that_shows": [motion_that_shows(mechanism, d) for d in total.blind],
        "parts": parts,
    }


def _print(out: Console, path: Path, report: dict[str, Any]) -> None:
    if report["usable"]:
        noise = report["noise"]
        out.print(
            f"{path}: {report['rows']} rows, {report['duration']:.1f} s at {report['rate']:.4g} Hz,"
            f" noise {noise['speed']:.2g} rad/s, {noise['torque']:.2g} N m",
            soft_wrap=True,
        )
    else:
        out.print(f"{path}: cannot be used", style="red", soft_wrap=True)
    for finding in report["findings"]:
        place = f"row {finding['row']}: " if finding.get("row") is not None else ""
        column = f"column {finding['column']}: " if finding.get("column") else ""
        cure = f"; {finding['cure']}" if finding.get("cure") else ""
        out.print(
            f"  {finding['level']}: {place}{column}{finding['message']}{cure}", soft_wrap=True
        )
    if report["usable"]:
        _print_shows(out, report["shows"])


def _print_shows(out: Console, shows: dict[str, Any]) -> None:
    rows = [
        (p["kind"], f"{p['from']:.0f}-{p['to']:.0f} s", p["rank"], ", ".join(p["blind"]) or "-")
        for p in shows["parts"]
    ]
    show_table(out, "", ("motion", "stretch", "rank", "blind to"), rows, left=("blind to",))
    if any(p["blind"] for p in shows["parts"]):
        out.print(f"  {x_legend(shows['names'])}", soft_wrap=True)
    for direction, motion in zip(shows["blind"], shows["motion_that_shows"], strict=True):
        out.print(f"  cannot show {direction}: motion {motion} would (youbot record --motions)")
    if not shows["blind"]:
        out.print("  shows all seven parameters of the base model")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
