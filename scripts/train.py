"""Train a policy: PPO, SAC or TD3, alone or upon a controller."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import show
from youbot_scripts.training import require_learning
from youbot_scripts.training.settings import MOST_ENVS, MOST_STEPS, SHARE
from youbot_scripts.training.tables import progress_line, summary_line, tested

EXAMPLES = (
    "youbot train ppo --model model.json --output trained/",
    "youbot train ppo --output trained/ --resume",
    "youbot train sac --steps 100000 --set gamma=0.95 --set reward_margins.yaw_rate=0.03",
    "youbot train ppo --residual computed_torque --effect wheel_coulomb_friction:torque=0.15",
    "youbot train ppo --import model.zip --output imported/",
)


class Algorithm(StrEnum):
    """Learners of Stable-Baselines3."""

    PPO = "ppo"
    SAC = "sac"
    TD3 = "td3"


def main(
    algorithm: Annotated[Algorithm, typer.Argument(metavar="ALGO", help="ppo, sac or td3.")],
    model: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Model file; default: paper.")
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_STEPS, metavar="N", help="Control periods, of all platforms."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Seed of all random numbers; default 0.")
    ] = None,
    envs: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_ENVS, metavar="N", help="Platforms side by side."),
    ] = None,
    randomise: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="Plants: covariance (of the model), none, or m0=90%:110%,aX=-0.02:0.02 and so "
            "on. Default: the covariance; if the model has none, all parameters by 5 %.",
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME:P=VALUE,...", help="Add an effect to the plant, not to what is believed."
        ),
    ] = None,
    delay: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Periods of delay; default 1.")
    ] = None,
    lag: Annotated[
        float | None, typer.Option(metavar="S", help="Time constant of the drives [s].")
    ] = None,
    residual: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Learn on top of this controller, built on MODEL."),
    ] = None,
    share: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=1.0, help=f"Its share of the torque limit then; default {SHARE:g}."
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Any setting of learner or environment."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder of the run; default trained/ALGO."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run in --output, to its total.")
    ] = False,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Write DIR/tensorboard too.")
    ] = False,
    device: Annotated[str, typer.Option(help="Of torch; the CPU is faster here.")] = "cpu",
    import_: Annotated[
        Path | None,
        typer.Option(
            "--import",
            metavar="ZIP",
            help="Turn a Stable-Baselines3 zip into a policy file. LOADING ONE CAN RUN ANY CODE: "
            "only what you made yourself or trust.",
        ),
    ] = None,
    effects: common.EffectsOption = None,
    json: common.JsonOption = None,
) -> None:
    """Train a policy on the tracking environment; write it as policy.json and policy.safetensors.

    Many platforms, each with a model of its own, follow random multisines; wheel speeds have
    noise and come from encoder counts. The policy is judged on held-out references all along, the
    best one kept; at the end it drives 20 further references beside the stock controller. Errors
    are true ones: rms of reference - twist over the reference's rms. Checkpoints go to the folder;
    --resume continues from the last one. A policy file cannot run code, and plays without torch.
    """
    require_learning()
    out = common.console(json)
    folder = output or Path("trained") / algorithm.value
    options = {"model": model, "steps": steps, "seed": seed, "envs": envs, "randomise": randomise}
    options |= {"effect": effect, "delay": delay, "lag": lag, "residual": residual}
    options |= {"share": share, "set": set_}
    given = {name: value for name, value in options.items() if value is not None}
    if import_ is not None:
        from youbot_scripts.training.exporting import import_policy

        _say_where(out, import_policy(algorithm.value, import_, folder, given))
        return
    # Imported here, after require_learning: it needs torch and Stable-Baselines3.
    from youbot_scripts.training.learning import train_policy

    result = train_policy(
        algorithm.value,
        folder,
        given,
        resume,
        tensorboard,
        device,
        report=lambda row: out.print(progress_line(row)),
    )
    record = result["training"]
    show(out, [tested(record)])
    out.print(summary_line(record))
    _say_where(out, Path(result["policy"]))
    common.write_result(json, result, record["seed"])


def _say_where(out: Any, policy: Path) -> None:
    out.print(f"Policy: {policy} and {policy.with_suffix('.safetensors').name}", soft_wrap=True)
    beside = shlex.quote(f"kinematic_tuned,computed_torque,{policy}")
    out.print(f"Next: youbot evaluate --controllers {beside}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
