"""Write a model and its controller as C, MuJoCo's XML or JSON."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common

EXAMPLES = (
    "youbot export model.json --to c -o robot/",
    "youbot export model.json --to c -o robot/ --rate 500 --delay 2 --name base",
    "youbot export model.json --to mjcf -o robot/",
)


class Target(StrEnum):
    """What a model can be written as."""

    C = "c"
    MJCF = "mjcf"
    JSON = "json"


def main(
    model: common.ModelArgument,
    to: Annotated[Target, typer.Option("--to", case_sensitive=False, help="Which form.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Folder of the files; made if missing."),
    ],
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Begins the files' names and all names in C.")
    ] = "youbot",
    rate: Annotated[
        float, typer.Option(metavar="HZ", help="c: rate of the loop that the controller runs in.")
    ] = 1000.0,
    delay: Annotated[
        float,
        typer.Option(
            metavar="N",
            help="c: samples by which commands act late, beside the model's own delay.",
        ),
    ] = 1.0,
    age: Annotated[
        float,
        typer.Option(
            metavar="N", help="c: age of a measured speed in samples; counts over one have half."
        ),
    ] = 0.5,
    noise: Annotated[
        float, typer.Option(metavar="RAD/S", help="c: noise of a wheel's speed.")
    ] = 0.01,
    torque_limit: Annotated[
        float | None, typer.Option(metavar="N_M", help="c: at each wheel; default: the youBot's.")
    ] = None,
    bandwidth: Annotated[
        float | None,
        typer.Option(metavar="RAD/S", help="c: of the feedback; default: by noise and delay."),
    ] = None,
    effects: common.EffectsOption = None,
    json: common.JsonOption = None,
) -> None:
    """Write MODEL, and a controller for it, for use outside Python.

    c: forward and inverse dynamics with all effects, a simulated plant, and computed torque with
    its delay compensation, as C99 that needs nothing and allocates nothing; a C++ class of one
    header in the shape of a ros2_control controller; a test driver that compares all of it with
    Python's numbers. mjcf: bodies, joints and rollers for MuJoCo. json: the model file.
    """
    from youbot_scripts.shared.exported_files import LoopOptions, exported, write_files

    if effects is not None:
        from youbot_env.plugins import load_effects

        load_effects(effects)  # before the model is read, since its file may name these effects
    loop = LoopOptions(rate, delay, age, noise, torque_limit, bandwidth)
    files = exported(model, to.value, name, loop)
    written = write_files(output, files)
    out = common.console(json)
    for path in written:
        out.print(str(path), soft_wrap=True)
    if to is Target.C:
        out.print(
            f"Try it: cd {output} && cc -std=c99 -O2 {name}_*.c -lm -o {name}_test "
            f"&& ./{name}_test",
            soft_wrap=True,
        )
    common.write_result(json, {"files": [str(path) for path in written]})


if __name__ == "__main__":
    sys.exit(run_script(__file__))
