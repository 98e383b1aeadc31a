"""Write the calibration motions as set points for a real robot."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.recording.named_motions import DEFAULT_MOTIONS
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import Table, columns, show

if TYPE_CHECKING:
    from youbot_env.motions.set_points import SetPoints
    from youbot_env.physics.geometry import Geometry

EXAMPLES = (
    "youbot motions drive/",
    "youbot motions drive/ --geometry my_robot.json --rate 50 --wheel-speed 8",
    "youbot motions drive/ --next-motion next.json",
)


def main(
    out_dir: Annotated[
        Path, typer.Argument(metavar="OUT_DIR", help="Folder for the files; made if missing.")
    ],
    geometry: common.GeometryOption = None,
    rate: Annotated[
        float, typer.Option(metavar="HZ", min=1, max=1000, help="Of the set points.")
    ] = 100.0,
    motions: Annotated[
        str,
        typer.Option(
            metavar="A,B,...",
            help="calibration, I, II, III, IV, multisine_..., or JSON files that hold a motion.",
        ),
    ] = DEFAULT_MOTIONS,
    next_motion: Annotated[
        Path | None,
        typer.Option(
            "--next-motion",
            metavar="FILE",
            help="That alone: a file of `diagnose --next-motion`.",
        ),
    ] = None,
    wheel_speed: Annotated[
        float | None,
        typer.Option(
            metavar="LIMIT",
            help="Largest speed of a wheel [rad/s]; default: 12, or what the geometry allows.",
        ),
    ] = None,
    body_speed: Annotated[
        float | None,
        typer.Option(
            metavar="LIMIT",
            help="Largest speed of the robot [m/s]; default: 0.8, or what the geometry allows.",
        ),
    ] = None,
    rest: Annotated[
        float, typer.Option(metavar="S", min=0, help="Standing still before and after [s].")
    ] = 2.0,
    effects: common.EffectsOption = None,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Write motions as set points for a real robot: a CSV each, a picture each, and the floor.

    A row holds the time, the body twist (VX, VY, W in the robot's frame) and the four wheel speeds
    that make it without slip; send one or the other. A motion that passes a limit is slowed as a
    whole. How to drive them and what to log: docs/your_robot.md.
    """
    from identification.logs.writing import write_table
    from youbot_env.model.model_file import load_geometry
    from youbot_env.motions.limits import MotionLimits
    from youbot_env.motions.set_points import COLUMNS, set_points
    from youbot_env.physics.geometry import Geometry
    from youbot_scripts.recording.named_motions import motions_named

    lengths = load_geometry(geometry) if geometry else Geometry()
    given = {"wheel_speed": wheel_speed, "body_speed": body_speed}
    known = {name: value for name, value in given.items() if value is not None}
    limits = replace(MotionLimits.of(lengths), **known)
    named = str(next_motion) if next_motion else motions
    chosen = motions_named(named, lengths, seed)
    made = [set_points(m, lengths, rate=rate, limits=limits, rest=rest) for m in chosen]
    common.make_folder(out_dir)
    for points in made:
        write_table(out_dir / f"{points.name}.csv", COLUMNS, points.table)
    pictures = _draw(out_dir, made, lengths)
    result = {
        "settings": {
            "rate": rate,
            "wheel_speed": limits.wheel_speed,
            "body_speed": limits.body_speed,
        },
        "motions": {points.name: points.to_dict() for points in made},
        "described": [motion.to_dict() for motion in chosen],
    }
    common.write_result(out_dir / "motions.json", result, seed)
    common.write_result(json, result, seed)
    out = common.console(json)
    show(out, [_table(out_dir, made)])
    for points in made:
        if points.scale < 1:
            share = f"{100 * points.scale:.0f} %"
            out.print(f"{points.name}: slowed to {share} of its speed by the limits")
    if not pictures:
        out.print("no pictures: pip install 'youbot[plots]' draws the floor plans", soft_wrap=True)


def _draw(out_dir: Path, made: list[SetPoints], geometry: Geometry) -> bool:
    """Draw each motion, where matplotlib is installed; whether it is."""
    from youbot_env.errors import InputError

    try:
        from identification.figures.set_points import set_points_figure
        from identification.figures.style import matplotlib, write_figures

        matplotlib()
    except InputError:
        return False
    write_figures(out_dir, [(points.name, set_points_figure(points, geometry)) for points in made])
    return True


def _table(out_dir: Path, made: list[SetPoints]) -> Table:
    rows: list[tuple[object, ...]] = []
    for points in made:
        found: dict[str, Any] = points.to_dict()
        (along, aside), (behind, right) = points.floor.size, points.floor.start
        rows.append(
            (
                points.name,
                f"{found['duration']:.1f}",
                f"{found['peak_wheel_speed']:.2f}",
                f"{found['peak_speed']:.3f}",
                f"{found['peak_yaw_rate']:.2f}",
                f"{along:.1f} x {aside:.1f}",
                f"{behind:.1f}, {right:.1f}",
            )
        )
    headers = ("duration s", "wheels rad/s", "robot m/s", "turns rad/s", "floor m", "start m")
    return Table(
        f"Set points in {out_dir}",
        columns("motion", *headers),
        tuple(rows),
        (
            "floor: along and across the start's heading, with 0.3 m on each side",
            "start: of the robot's centre, from the back and from the right edge of that floor",
        ),
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
