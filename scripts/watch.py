"""Watch controllers drive: a view from above, as GIF or MP4."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import Column, Table, columns, percent, show

EXAMPLES = (
    "youbot watch -o drive.gif",
    "youbot watch --controllers kinematic,ppo --effect floor_tilt:tilt_x=0.03 -o slope.gif",
    "youbot watch --controllers trained/policy.json --plant contact -o policy.mp4",
)

MOST_SECONDS, MOST_FPS, MOST_VIEWS = 300.0, 60.0, 4
"""More makes a file that nobody plays; pictures are kept in memory until they are written."""


def main(
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="F",
            callback=common.check_output,
            help="Write the animation here: .gif, or .mp4 (extra: video).",
        ),
    ],
    controllers: Annotated[
        str,
        typer.Option(metavar="A,B,...", help="Side by side, as `evaluate` takes them; up to four."),
    ] = "kinematic,computed_torque",
    plant: Annotated[
        str, typer.Option(metavar="P", help="What moves: paper, a model file, contact.")
    ] = "paper",
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME:P=VALUE,...", help="Hide an effect in the plant."),
    ] = None,
    model: Annotated[
        str,
        typer.Option(metavar="M", help="What controllers believe: known (the truth), or a file."),
    ] = "known",
    band: Annotated[
        str, typer.Option(metavar="LOW-HIGH", help="Frequencies of the reference [rad/s].")
    ] = "0.5-3",
    seconds: Annotated[
        float, typer.Option(min=1.0, max=MOST_SECONDS, help="Length [s] after a start of 1.5 s.")
    ] = 10.0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Control rate.")] = 100.0,
    delay: Annotated[
        int, typer.Option(min=0, metavar="N", help="Samples by which commands act late.")
    ] = 1,
    lag: Annotated[float, typer.Option(metavar="S", help="Time constant of the drives.")] = 0.0,
    fps: Annotated[float, typer.Option(min=1.0, max=MOST_FPS, help="Pictures a second.")] = 10.0,
    height: Annotated[
        int, typer.Option(min=160, max=1080, metavar="PX", help="Of each view.")
    ] = 320,
    effects: common.EffectsOption = None,
    seed: common.SeedOption = 0,
) -> None:
    """Drive a plant along a random multisine and draw it from above, a view for each controller.

    Blue is the platform, orange the reference: arrows are velocities, lines the ways on the floor.
    Bars beside the wheels are torques, red at the limit. Seed, sensors and loop are those of
    `youbot evaluate`. Needs the extra `render`; .mp4 needs `video`.
    """
    # Imported here: `youbot watch --help` does without numpy and scipy.
    from youbot_env.errors import InputError
    from youbot_env.tracking.rendering import load_pygame
    from youbot_scripts.evaluation.animation import check_ending, frames, write_animation
    from youbot_scripts.evaluation.conditions import LoopSettings, PlantSource, ReferenceMotion
    from youbot_scripts.evaluation.metrics import AXES, judge
    from youbot_scripts.evaluation.suites import bands, words
    from youbot_scripts.evaluation.watching import drive

    load_pygame()
    check_ending(output)
    names = words("controllers", controllers) or ()
    if len(names) > MOST_VIEWS:
        raise InputError(f"--controllers: {len(names)} views; {MOST_VIEWS} are the most")
    (frequencies, *more) = bands(band) or ((0.5, 3.0),)
    if more:
        raise InputError("--band: one band, such as 0.5-3")
    moved = PlantSource(plant, tuple(effect or ()), lag=lag)
    reference = ReferenceMotion(frequencies, duration=seconds)
    loop = LoopSettings(rate, delay)
    with common.progress(len(names) * reference.length, "driving") as advance:
        traces = drive(moved, model, names, loop, reference, seed, advance)
    pictures = list(frames(traces, moved.truth.geometry, fps, height))
    write_animation(output, pictures, fps)
    out = common.console()
    rows = []
    for name, trace in traces.items():
        found = judge(trace, reference.ramp)
        rows.append((name, *(found.get("nrmse") or [float("nan")] * len(AXES))))
    shares = (Column(axis, percent) for axis in AXES)
    show(
        out, [Table("Error over the reference (rms)", columns("controller", *shares), tuple(rows))]
    )
    out.print(f"animation: {output}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
