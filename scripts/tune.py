"""Tune kinematic or PID control within stability margins."""

from __future__ import annotations

import importlib.util
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from controllers.interface import Loop
from controllers.tuning.gains_file import gains_to_dict, save_gains
from controllers.tuning.trials import TuningTrial, references
from controllers.tuning.tunable_laws import TunableKinematic, TunablePID
from controllers.tuning.tuning import (
    ROUNDS,
    TORQUE_RATE_SHARE,
    Bench,
    Requirements,
    Tuned,
    allowed_torque_rate,
)
from youbot_env.errors import InputError, finite
from youbot_env.model.model_file import load_model
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE, STOCK_INTEGRAL, STOCK_PROPORTIONAL
from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import (
    Column,
    Table,
    columns,
    decimals,
    number,
    percent,
    show,
    text,
)

EXAMPLES = (
    "youbot tune paper -o gains.json",
    "youbot tune model.json --delay 3 --lag 0.03 --lead",
    "youbot tune model.json --controller pid --phase-margin 60",
)

NO_LEAD = 1e-9
"""No lead [s] as a point of the search, whose logarithm is taken."""

MOST_SECONDS = 2000.0
"""Of references: a search of an hour."""


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
        float, typer.Option(metavar="N_M", help="At each wheel.")
    ] = MAX_WHEEL_TORQUE,
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
    loop = Loop(period, delay * period, 0.5 * period, torque_limit, noise)
    motions = references(plant, count=runs, duration=duration, seed=seed)
    trial = TuningTrial(plant, loop, motions, duration, seed)
    margins = {"gain_margin": gain_margin, "phase_margin": phase_margin}
    with common.progress(3 * ROUNDS + 1, "tuning") as advance:
        limit = torque_rate or allowed_torque_rate(plant, loop, trial)
        wanted = Requirements(**margins, torque_rate=limit)
        if controller is TunedKind.PID:
            structure = TunablePID(plant, loop, **margins)
        else:
            structure = TunableKinematic(plant, loop, lead=lead)
        advance(1)
        bench = Bench(structure, trial)
        kept = {"tuned": wanted, "any rate": Requirements(**margins), "free": None}
        found = {name: bench.best(keep, advance) for name, keep in kept.items()}
    if controller is TunedKind.KINEMATIC:
        stock = [STOCK_PROPORTIONAL, STOCK_INTEGRAL, NO_LEAD]
        found["stock"] = bench.tuned(np.array(stock[: len(structure.names)]))
    gains = {
        name: structure.gains(np.array(list(one.point.values()))) for name, one in found.items()
    }
    how = {"loop": vars(loop), "model": plant.name}
    result = {
        **how,
        "references": [motion.to_dict() for motion in motions],
        "requirements": {
            **vars(wanted),
            "torque_rate_source": "asked" if torque_rate else "computed torque",
        },
        **gains_to_dict(gains["tuned"]),
        "results": {n: {**one.to_dict(), **gains_to_dict(gains[n])} for n, one in found.items()},
    }
    if output is not None:
        save_gains(output, gains["tuned"], **how, provenance=common.provenance(seed))
    common.write_result(json, result, seed)
    console = common.console(json)
    _show_results(console, f"{controller} control of {plant.name}", found)
    _show_gains(console, gains)
    _show_loop(console, bench, found["tuned"])
    source = "" if torque_rate else f" ({TORQUE_RATE_SHARE:g} times computed torque's)"
    console.print(
        f"Kept: gain margin >= {gain_margin:g} dB, phase margin >= {phase_margin:g} degrees, "
        f"torque rate <= {limit:.3f} N m/s{source}",
        soft_wrap=True,
    )
    if output is not None:
        console.print(f"Gains: {output}", soft_wrap=True)
        beside = shlex.quote(f"kinematic,computed_torque,{output}")
        console.print(f"Next: youbot evaluate --controllers {beside}", soft_wrap=True)


def _show_results(console: Any, title: str, found: dict[str, Tuned]) -> None:
    shown = (
        *(Column(axis, percent) for axis in ("VX", "VY", "W")),
        Column("N m/s", decimals(3)),
        Column("gain dB", decimals(2)),
        Column("phase deg", decimals(1)),
        Column("saturated", percent),
    )
    rows = tuple(
        (
            name,
            *one.error.tolist(),
            one.torque_rate,
            one.margins.gain.min(),
            one.margins.phase.min(),
            one.saturated,
        )
        for name, one in found.items()
    )
    show(console, [Table(title, columns("gains", *shown), rows)])


def _show_gains(console: Any, gains: dict[str, Any]) -> None:
    files = {name: gains_to_dict(one)["gains"] for name, one in gains.items()}
    rows = tuple(
        (key, *(file[key]["value"] for file in files.values()), entry["unit"])
        for key, entry in files["tuned"].items()
    )
    shown = (*(Column(name, number) for name in files), text("unit"))
    show(console, [Table("Gains", columns("name", *shown), rows)])


def _show_loop(console: Any, bench: Bench, best: Tuned) -> None:
    """Margins of each axis, with python-control's beside them where it is installed, and poles."""
    values = [best.margins.gain, best.margins.phase]
    headers = ["gain dB", "phase deg"]
    if importlib.util.find_spec("control"):
        theirs = bench.python_controls(np.array(list(best.point.values())))
        values += [theirs.gain, theirs.phase]
        headers += ["python-control: dB", "deg"]
    axes = ("VX", "VY", "W")
    rows = tuple((axis, *(value[i] for value in values)) for i, axis in enumerate(axes))
    shown = (Column(header, decimals(2)) for header in headers)
    show(console, [Table("Margins of the tuned loop", columns("axis", *shown), rows)])
    poles = [pole for pole in best.poles[np.isfinite(best.poles)].tolist() if pole.imag >= 0]
    console.print("Slowest poles [1/s]: " + ", ".join(map(_pole, poles[:8])), soft_wrap=True)


def _pole(pole: complex) -> str:
    return f"{pole.real:.3g}" if abs(pole.imag) < 1e-9 else f"{pole.real:.3g} ± {pole.imag:.3g}j"


if __name__ == "__main__":
    sys.exit(run_script(__file__))
