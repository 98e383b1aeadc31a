"""Drive a plant through the calibration motions and write logs."""

from __future__ import annotations

import hashlib
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from controllers.recording import SPEED_NOISE, TORQUE_NOISE, control_step, record, recordings
from identification.logs.formats import import_parquet
from identification.logs.reading import write_log
from identification.logs.writing import DECIMALS
from youbot_scripts.cli import run_script
from youbot_scripts.recording.held_platform import held_platform
from youbot_scripts.recording.named_motions import DEFAULT_MOTIONS, motions_named
from youbot_scripts.recording.named_plants import Driven, plant_named
from youbot_scripts.shared import options as common
from youbot_scripts.shared.result_tables import recorded_logs
from youbot_scripts.shared.tables import show

__all__ = ["main", "record"]

EXAMPLES = (
    "youbot record runs/",
    "youbot record runs/ --plant model.json --rate 250 --seed 3",
    "youbot record runs/ --motions I,III,multisine_c --format csv.gz",
    "youbot record runs/ --effect wheel_coulomb_friction:torque=0.25",
    "youbot record runs/ --plant contact:friction=0.5 --effect floor_tilt:tilt_x=0.02",
)


class Format(StrEnum):
    """Kinds of log files, by their ending."""

    CSV = "csv"
    CSV_GZ = "csv.gz"
    PARQUET = "parquet"


def main(
    out_dir: Annotated[
        Path, typer.Argument(metavar="OUT_DIR", help="Folder for the logs; made if missing.")
    ],
    plant: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            help="What is driven: a model file, 'paper', or 'contact[:SETTING=VALUE,...]', MuJoCo "
            "with real rollers. Settings: model, friction, rollers, timestep, com_height.",
        ),
    ] = "paper",
    motions: Annotated[
        str,
        typer.Option(
            metavar="A,B,...",
            help="calibration, I, II, III, IV, multisine_..., or JSON files that hold a motion.",
        ),
    ] = DEFAULT_MOTIONS,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:P=VALUE,...",
            help="Add an effect to the plant (SI units); NAME alone: at its catalogue size.",
        ),
    ] = None,
    effects: common.EffectsOption = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Log rate, 20 to 1000 Hz.")] = 100.0,
    torque_noise: Annotated[
        float, typer.Option(help="Standard deviation of a logged torque's noise [N m].")
    ] = TORQUE_NOISE,
    speed_noise: Annotated[
        float, typer.Option(help="Standard deviation of a wheel speed's noise [rad/s].")
    ] = SPEED_NOISE,
    noise_correlation: Annotated[
        float, typer.Option(metavar="S", help="Time over which the torque's noise lasts; 0: white.")
    ] = 0.0,
    format: Annotated[
        Format, typer.Option(case_sensitive=False, help="Kind of file.")
    ] = Format.CSV,
    decimals: Annotated[
        int, typer.Option(min=4, max=12, help="Digits after the point in CSV files.")
    ] = DECIMALS,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Drive a plant through the calibration motions and write one log for each.

    The stock kinematic control (inverse kinematics, wheel-speed PI) runs at about 500 Hz and
    reads noisy wheel speeds. A row holds the wheel speeds at its instant, the torques commanded
    around it, both with noise, and the true pose. The seed draws the noise and the multisines;
    one seed gives the same files, byte by byte. record.json beside the logs says how they were
    made. Each log is written when it is finished, so Ctrl-C keeps those before.

    A plant 'contact' (extra mujoco) has bodies with the model's parameters, which roll on the
    floor with friction and slip. Slopes, payloads, dragging wheels, dry friction, lags and delays
    are effects there too. It runs some eight times as fast as real time.
    """
    driven = plant_named(plant, effect or [])
    chosen = motions_named(motions, driven.model.geometry, seed)
    noise = {
        "torque_noise": torque_noise,
        "speed_noise": speed_noise,
        "noise_correlation": noise_correlation,
    }
    how = {
        **driven.to_dict(),
        "settings": {"rate": rate, "control_rate": 1.0 / control_step(rate), **noise},
        "motions": [motion.to_dict() for motion in chosen],
        "logs": {},
    }
    if format is Format.PARQUET:
        import_parquet(str(out_dir))  # raises now if pyarrow is missing, not after the simulation
    platform = driven.platform()
    moved = dict[str, float]()
    common.make_folder(out_dir)
    with common.progress(sum(motion.duration for motion in chosen), "driving") as advance:
        found = recordings(platform, chosen, rate=rate, seed=seed, progress=advance, **noise)
        for recording in found:
            moved[recording.log.name] = recording.share_of_motion
            path = out_dir / f"{recording.log.name}.{format}"
            write_log(path, recording.log, decimals=decimals)
            # Of the bytes as written: `recorded_motion` compares it with those of the file it
            # reads.
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            how["logs"][path.name] = {**recording.summary(), "sha256": digest}
            # After each log, so that the record is right if the run is interrupted.
            common.write_result(out_dir / "record.json", how, seed)
    common.write_result(json, how, seed)
    out = common.console(json)
    for warning in held_platform(driven, chosen, moved, rate):
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    _show(out, driven, how["logs"], out_dir)


def _show(console: Any, driven: Driven, rows: dict[str, dict[str, Any]], out_dir: Path) -> None:
    show(console, [recorded_logs(f"Logs of {driven} in {out_dir}", rows)])
    console.print(f"How they were made: {out_dir / 'record.json'}", soft_wrap=True)
    logs = shlex.join(str(out_dir / name) for name in to_fit(list(rows)))
    console.print(f"Next: youbot identify {logs} -o model.json", soft_wrap=True)


def to_fit(names: list[str]) -> list[str]:
    """The logs to identify from: the calibration run, or all motions but the multisines."""
    for prefix in ("calibration.", ""):
        found = [n for n in names if n.startswith(prefix) and not n.startswith("multisine")]
        if found:
            return found
    return names


if __name__ == "__main__":
    sys.exit(run_script(__file__))
