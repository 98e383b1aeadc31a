"""Tune kinematic or PID control within stability margins."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from controllers.interface import Loop
from controllers.tuning.controller_tuning import (
    STEPS,
    TunedController,
    TuningTask,
    tune_kinematic,
    tune_pid,
)
from controllers.tuning.gains_file import save_gains
from controllers.tuning.tuning import SearchSettings
from youbot_env.errors import InputError, finite
from youbot_env.model.model_file import load_model
from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common, tuning_tables
from youbot_scripts.shared.tables import show

if TYPE_CHECKING:
    from rich.console import Console

EXAMPLES = (
    "youbot tune paper -o gains.json",
    "youbot tune model.json --delay 3 --lag 0.03 --lead",
    "youbot tune model.json --controller pid --phase-margin 60",
)

MOST_SECONDS = 2000.0
"""Largest total duration of references [s]: the search then takes an hour."""


class TunedKind(StrEnum):
    """What can be tuned."""

    KINEMATIC = "kinematic"
    PID = "pid"


def main(
    model: common.ModelArgument,
    controller: Annotated[
        TunedKind, typer.Option(case_sensitive=False, help="Whose gains.")
    ] = TunedKind.KINEMATIC,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Rate of the loop.")] = 100.0,
    delay: Annotated[
        float,
        typer.Option(metavar="N", help="Samples by which commands act late; 1.5 is possible."),
    ] = 1.0,
    lag: Annotated[
        float | None, typer.Option(metavar="S", help="Add a drive's lag to the model [s].")
    ] = None,
    noise: Annotated[
        float, typer.Option(metavar="RAD/S", help="Standard deviation of a wheel speed's noise.")
    ] = 0.01,
    torque_limit: Annotated[
        float | None, typer.Option(metavar="N_M", help="At each wheel; default: the model's.")
    ] = None,
    lead: Annotated[
        bool,
        typer.Option(
            "--lead", help="Kinematic: may read the reference ahead, as no stock one does."
        ),
    ] = False,
    gain_margin: Annotated[float, typer.Option(metavar="DB", help="At least, each axis.")] = 6.0,
    phase_margin: Annotated[float, typer.Option(metavar="DEG", help="At least, each axis.")] = 45.0,
    torque_rate: Annotated[
        float | None,
        typer.Option(
            metavar="LIMIT", help="Largest rms [N m/s]; default: 1.1 times computed torque's."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(metavar="N", min=1, help="References.")] = 4,
    duration: Annotated[float, typer.Option(metavar="S", help="Of each reference.")] = 10.0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            callback=common.check_output,
            help="Gains file (JSON).",
        ),
    ] = None,
    effects: common.EffectsOption = None,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Find the gains that track multisines of 0.5 to 3 rad/s best.

    They are sought in simulation of MODEL with all its effects, encoders, noise and delay: "tuned"
    keeps the margins and the torque rate, "any rate" the margins alone, "free" is stable, no more.
    An error is the rms of the true twist's error over the rms of the reference. An axis' margin is
    that of its loop opened at its force with the other two closed, by the exact sampled model. The
    torque rate is the rms of the commands' change. The seed draws references and noise.
    """
    if lead and controller is TunedKind.PID:
        raise InputError("--lead: belongs to --controller kinematic")
    if finite("duration", duration, positive=True) * runs > MOST_SECONDS:
        raise InputError(f"--runs, --duration: more than {MOST_SECONDS:g} s of references in all")
    plant = load_model(model)
    if lag is not None:
        plant = plant.with_effect("actuator_lag", time_constant=finite("lag", lag, positive=True))
    period = 1.0 / finite("rate", rate, positive=True)
    if torque_limit is None:
        torque_limit = plant.geometry.max_wheel_torque
    # 0.5: encoder counts give the mean speed of a period, half a period old.
    loop = Loop(period, delay * period, 0.5 * period, torque_limit, noise)
    task = TuningTask(plant, loop, gain_margin, phase_margin, torque_rate, runs, duration, seed)
    with common.progress(STEPS, "tuning") as advance:
        if controller is TunedKind.PID:
            found = tune_pid(task, progress=advance)
        else:
            found = tune_kinematic(task, lead=lead, progress=advance)
    result = found.to_dict()
    if output is not None:
        how = {"loop": result["loop"], "model": result["model"]}
        save_gains(output, found.gains["tuned"], **how, provenance=common.provenance(seed))
    common.write_result(json, result, seed)
    out = common.console(json)
    _print(out, f"{controller} control of {plant.name}", found)
    if output is not None:
        out.print(f"Gains: {output}", soft_wrap=True)
        beside = shlex.quote(f"kinematic,computed_torque,{output}")
        out.print(f"Next: youbot evaluate --controllers {beside}", soft_wrap=True)


def _print(out: Console, title: str, found: TunedController) -> None:
    result, kept = found.to_dict(), found.task.requirements
    others = found.python_control_margins().to_dict() if find_spec("control") else None
    show(out, tuning_tables.tables(title, result, others))
    out.print(tuning_tables.poles(result), soft_wrap=True)
    times = f" ({SearchSettings.torque_rate_share:g} times computed torque's)"
    out.print(
        f"Kept: gain margin >= {kept.gain_margin:g} dB, "
        f"phase margin >= {kept.phase_margin:g} degrees, "
        f"torque rate <= {kept.torque_rate:.3f} N m/s{'' if found.task.torque_rate else times}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
