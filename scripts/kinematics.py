"""Find lengths, delay and slip from wheels and pose alone."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import (
    GeometryOption,
    JsonOption,
    LogsArgument,
    ReportOption,
    check_output,
    check_pictures,
    console,
    write_json,
    write_result,
)
from youbot_scripts.shared.tables import Table, columns, percent, show, to_digit_of, unit, with_std

if TYPE_CHECKING:
    from rich.console import Console

    from identification.kinematics import Kinematics, Motion
    from identification.kinematics.kinematics import KinematicFinding

EXAMPLES = (
    "youbot kinematics runs/*.csv",
    "youbot kinematics my_robot.csv --geometry nominal.json -o geometry.json",
    "youbot identify my_robot.csv --geometry geometry.json",
)

STYLES = {"error": "red", "warning": "yellow"}


def main(
    logs: LogsArgument,
    geometry: GeometryOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="GEOMETRY",
            callback=check_output,
            help="Write the lengths here, as --geometry takes them.",
        ),
    ] = None,
    report: ReportOption = None,
    json: JsonOption = None,
) -> None:
    """Estimate R and L [m], the speeds' delay, the pose's frame, slip and each wheel's lengths.

    Needs time, velocity_* and pose_x, pose_y, pose_yaw, or gyro_z (then R/L alone); no effort_*.
    With --geometry the unit and gear of the speeds are found too.
    """
    # Imported here: `youbot kinematics --help` does without numpy and scipy.
    from identification.kinematics import estimate_kinematics
    from identification.logs.motion_reading import read_motions
    from youbot_env.model.model_file import geometry_to_dict, load_geometry

    check_pictures(None, report)
    read = read_motions(logs)
    nominal = load_geometry(geometry) if geometry else None
    found = estimate_kinematics([motion for motion, _ in read], nominal)
    out = console(json)
    for motion, findings in read:
        for finding in findings:
            if finding.level != "info":
                out.print(f"{finding.level}: {motion.name}: {finding}", soft_wrap=True)
    if output:
        lengths = geometry_to_dict(found.geometry)
        write_json(output, {"geometry": lengths, "logs": [motion.name for motion, _ in read]})
    starts = {motion.name: float(motion.time[0]) for motion, _ in read}
    _print(out, found, starts)
    if nominal and (line := _agreement(found, nominal.R)):
        out.print(line, soft_wrap=True)
    if output:
        whose = "" if geometry else "; r, m1 and l : h in it are the youBot's (yours: --geometry)"
        out.print(f"geometry written to {output}{whose}", soft_wrap=True)
    if report:
        _write_report(report, found, read)
        out.print(f"report written to {report}", soft_wrap=True)
    write_result(json, found.to_dict())


def _print(out: Console, found: Kinematics, starts: Mapping[str, float]) -> None:
    for finding in found.findings:
        out.print(_line(finding), style=STYLES.get(finding.level), soft_wrap=True)
    show(out, _tables(found))
    for line in _slip(found, starts):
        out.print(line, soft_wrap=True)
    if found.counts:
        out.print(f"position_*: {found.counts:.5g} counts a turn of the wheel")


def _agreement(found: Kinematics, nominal: float) -> str | None:
    """That unit and gear of the speeds are right, where the pose shows it."""
    radius = found.parameters["R"].value if "R" in found.parameters else None
    if radius is None or found.unit is not None:
        return None
    if any(f.level != "info" and f.message.startswith("R =") for f in found.findings):
        return None
    return (
        f"unit and gear of the speeds agree with the pose: R = {radius:.4g} m by it, "
        f"{nominal:.4g} m by the geometry"
    )


def _line(finding: KinematicFinding) -> str:
    cure = f"; {finding.cure}" if finding.cure else ""
    told = finding.column and finding.message.startswith(f"{finding.column} ")
    place = f"{finding.column}: " if finding.column and not told else ""
    return f"{finding.level}: {place}{finding.message}{cure}"


def _slip(found: Kinematics, starts: Mapping[str, float]) -> Iterator[str]:
    """The slip in all, and where there is most of it; ``starts``: first time [s] of each log."""
    slip = found.slip
    if slip.share is not None:
        yield f"slip: {percent(slip.share)} of the way of {found.travelled:.3g} m"
    for place in slip.where[:5]:
        row = f", row {place.row}" if place.row is not None else ""
        begin = starts.get(place.log, 0.0)
        yield (
            f"  {place.log}: {place.start - begin:.1f} to {place.end - begin:.1f} s from its "
            f"start{row}: up to {percent(place.share)} of the usual way"
        )


def _tables(found: Kinematics) -> list[Table]:
    rows = []
    for name, length in found.parameters.items():
        if length.value is None or length.std is None:
            rows.append((name, "not shown", "", length.unit))
            continue
        reach = 1.96 * length.std
        ends = (length.value - reach, length.value + reach)
        interval = " ... ".join(to_digit_of(end, length.std) for end in ends)
        rows.append((name, with_std(length.value, length.std), interval, length.unit))
    head = columns("name", "value", "95 % interval", unit())
    return [Table("Lengths", head, tuple(rows)), *([_wheels(found)] if found.wheels else [])]


def _wheels(found: Kinematics) -> Table:
    rows = []
    for name, wheel in found.wheels.items():
        angle = ""
        if wheel.roller_angle:
            angle = with_std(*(57.29578 * number for number in wheel.roller_angle))
        rows.append((name, with_std(*wheel.radius), angle))
    head = columns("wheel", "radius m", "roller angle, degrees")
    return Table("Each wheel", head, tuple(rows))


def _write_report(path: Path, found: Kinematics, read: Sequence[tuple[Motion, Any]]) -> None:
    from identification.figures.kinematic_charts import charts_of_kinematics, in_words
    from youbot_scripts.shared.report_page import Charts, Words, write_page

    starts = {motion.name: float(motion.time[0]) for motion, _ in read}
    lengths = ", ".join(
        f"{name} {in_words(length)}"
        for name, length in found.parameters.items()
        if name in ("R", "L", "delay", "R_over_L") and length.value is not None and length.std
    )
    faults = [f for f in found.findings if f.level != "info"]
    told = [_line(finding) for finding in faults]
    told += [
        f"{finding.level}: {motion.name}: {finding}"
        for motion, findings in read
        for finding in findings
        if finding.level != "info"
    ]
    parts = [
        Words([f"{lengths or 'No length is shown'} (95 %)", *_slip(found, starts)], "verdict"),
        Words(told, "warning"),
        Words([_line(finding) for finding in found.findings if finding.level == "info"]),
        *(Charts([chart]) for chart in charts_of_kinematics(found, [motion for motion, _ in read])),
        *_tables(found),
    ]
    write_page(path, "Lengths, delay and slip from wheels and pose", parts, None)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
