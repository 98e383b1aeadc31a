"""Records a plant under the stock kinematic control, motion by motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.kinematic import KinematicControl
from identification.logs.log import Log
from youbot_env.errors import finite
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.simulation.plant import Platforms
from youbot_scripts.recording.driving import (
    SPEED_NOISE,
    TORQUE_NOISE,
    Progress,
    Run,
    control_step,
    run,
)
from youbot_scripts.recording.named_motions import generator


@dataclass(frozen=True, eq=False)
class Recording:
    """One run of the plant, and the log that it left; the torque limit [N m] was the loop's."""

    run: Run
    log: Log
    torque_limit: float

    def summary(self) -> dict[str, Any]:
        """Numbers for a table: SI units, shares of time, true peaks (noise left out)."""
        command, reached = np.abs(self.run.command), 1.0 - 1e-9
        saturated = (command >= reached * self.torque_limit).any(axis=1)
        return {
            "duration": len(self.log) * self.log.dt,
            "rows": len(self.log),
            "peak_wheel_speed": float(np.abs(self.log.velocity).max()),
            "peak_torque": float(command.max()),
            "saturated": float(saturated.mean()),
        }


def recordings(
    plant: Model | Platforms,
    motions: Sequence[Motion],
    *,
    rate: float = 100.0,
    seed: int = 0,
    torque_noise: float = TORQUE_NOISE,
    speed_noise: float = SPEED_NOISE,
    progress: Progress | None = None,
) -> Iterator[Recording]:
    """Drive a plant along each motion with the stock kinematic control, one after another.

    The noise of a log depends on the seed and the motion's name alone, not on the other motions.
    See :func:`record`.
    """
    step = control_step(rate)
    finite("torque noise", torque_noise, least=0.0)
    finite("speed noise", speed_noise, least=0.0)
    for motion in motions:
        controller = KinematicControl(plant.geometry, sample_time=step)
        rng = generator(seed, motion.name, "noise")
        found = run(
            plant,
            motion,
            controller,
            rate=rate,
            speed_noise=speed_noise,
            rng=rng,
            progress=progress,
        )
        yield Recording(found, found.log(torque_noise, rng), controller.torque_limit)


def record(
    plant: Model | Platforms,
    motions: Sequence[Motion],
    *,
    rate: float = 100.0,
    seed: int = 0,
    torque_noise: float = TORQUE_NOISE,
    speed_noise: float = SPEED_NOISE,
    progress: Progress | None = None,
) -> list[Log]:
    """Logs of a plant that the stock kinematic control drives along the motions.

    Parameters
    ----------
    plant : a model, effects included, or one platform (``ContactPlant``)
    rate : of the logs [Hz], 20 to 1000; the loop runs at a multiple of it near 500 Hz
    seed : of the noise; the noise of a log depends on it and on the motion's name alone
    torque_noise, speed_noise : standard deviations of white noise [N m], [rad/s]
    progress : told the seconds of motion driven since it was last told

    Raises
    ------
    InputError
        If the rate or a noise cannot be, or a run diverges.
    """
    found = recordings(
        plant,
        motions,
        rate=rate,
        seed=seed,
        torque_noise=torque_noise,
        speed_noise=speed_noise,
        progress=progress,
    )
    return [recording.log for recording in found]
