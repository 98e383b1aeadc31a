"""Check logs: faults, repairs, and what they can show."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    LogsOfOption,
    UnitOption,
    console,
    write_result,
    x_legend,
)
from youbot_scripts.shared.tables import Table, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.logs.log import Log
    from identification.mechanisms.registry import Entry
    from youbot_env.physics.geometry import Geometry

EXAMPLES = (
    "youbot doctor runs/*.csv",
    "youbot doctor my_log.csv --json checks.json",
    "youbot doctor drive.csv --mechanism axis --unit m",
)

COUNTS = {4: "four", 7: "seven"}
"""Parameters of a base model: an axis', a platform's."""


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
    from identification.mechanisms.registry import kind
    from youbot_env.model.model_file import load_geometry

    of, lengths = kind(mechanism), load_geometry(geometry) if geometry else None
    out = console(json)
    reports, broken = {}, []
    for path in logs:
        report = _examine(path, of, lengths, unit)
        reports[str(path)] = report
        _print(out, path, report)
        if not report["usable"]:
            broken.append(str(path))
    write_result(json, {"logs": reports})
    if broken:
        from youbot_env.errors import InputError

        raise InputError(f"{len(broken)} of {len(reports)} logs cannot be used: {broken[0]}")


def _examine(path: Path, of: Entry, geometry: Geometry | None, unit: str) -> dict[str, Any]:
    from identification.logs.findings import LogError
    from identification.logs.reading import read_log
    from youbot_env.errors import InputError

    try:
        log = read_log(path, of.joints, geometry=geometry)
        start = of.start([log], unit)
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
        "units": _units(start),
        "shows": _shows(log, start, geometry),
    }


def _finding(finding: Any) -> dict[str, Any]:
    keys = ("level", "message", "row", "column", "cure")
    return {key: getattr(finding, key) for key in keys}


def _noise(log: Log) -> dict[str, float]:
    from identification.signals.noise import white_noise

    return {
        "speed": float(white_noise(log.velocity).mean()),
        "torque": float(white_noise(log.effort).mean()),
    }


def _units(start: Any) -> dict[str, str]:
    """Units of a joint's channels."""
    turns = getattr(start.geometry, "turns", True)
    return {"speed": "rad/s", "torque": "N m"} if turns else {"speed": "m/s", "torque": "N"}


def _shows(log: Log, start: Any, geometry: Geometry | None) -> dict[str, Any]:
    """What each motion of a log shows of the base model that ``start`` is."""
    import numpy as np

    from identification.fitting.observability import log_observability
    from identification.fitting.regression import regression
    from identification.mechanisms.registry import mechanism_of

    mechanism = mechanism_of(start, geometry)
    samples = mechanism.samples(log)
    rows = regression(mechanism, start.theta, samples, np.flatnonzero(mechanism.free))
    total = log_observability(mechanism, [rows])
    parts = []
    for part in mechanism.parts(samples):
        seen = log_observability(mechanism, [rows.between(part.start, part.end)])
        parts.append(
            {"kind": part.kind, "from": part.start, "to": part.end, "rank": seen.rank}
            | {"blind": seen.describe_blind()}
        )
    found = {
        "names": list(total.names),
        "scaling": mechanism.scaling,
        "rank": total.rank,
        "blind": total.describe_blind(),
        "cures": [mechanism.advice(direction) for direction in total.blind],
        "parts": parts,
    }
    name = mechanism.conventions.motion_that_shows
    if name is not None:
        found["motion_that_shows"] = [name(mechanism.geometry, d) for d in total.blind]
    return found


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
        column = f"column {finding['column']}: " if finding.get("column") else ""
        cure = f"; {finding['cure']}" if finding.get("cure") else ""
        out.print(
            f"  {finding['level']}: {place}{column}{finding['message']}{cure}", soft_wrap=True
        )
    if report["usable"]:
        _print_shows(out, report["shows"])


def _print_shows(out: Console, shows: dict[str, Any]) -> None:
    rows = tuple(
        (p["kind"], f"{p['from']:.0f}-{p['to']:.0f} s", p["rank"], ", ".join(p["blind"]) or "-")
        for p in shows["parts"]
    )
    show(out, [Table("", ("motion", "stretch", "rank", "blind to"), rows, left=("blind to",))])
    if any(p["blind"] for p in shows["parts"]):
        out.print(f"  {x_legend(shows['names'], shows['scaling'])}", soft_wrap=True)
    motions = shows.get("motion_that_shows")
    for k, (direction, cure) in enumerate(zip(shows["blind"], shows["cures"], strict=True)):
        if motions:
            cure = f"motion {motions[k]} would (youbot record --motions)"
        out.print(f"  cannot show {direction}: {cure}")
    if not shows["blind"]:
        out.print(f"  shows all {COUNTS[shows['rank']]} parameters of the base model")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
