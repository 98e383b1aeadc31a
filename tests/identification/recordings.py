"""Logs of known plants, recorded once for all tests of a run."""

from dataclasses import replace
from functools import cache

import numpy as np

from controllers.recording import record
from identification.logs.log import Log
from identification.signals.filters import integral_of
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration, motion_i, motion_iii

MOTIONS = {"calibration": calibration, "I": motion_i, "III": motion_iii}


@cache
def recording(
    motion: str = "calibration",
    effects: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = (),
    rate: float = 100.0,
    seed: int = 1,
    noise: float = 1.0,
) -> Log:
    """A log of the paper's platform (with effects), with ``noise`` times the usual noise."""
    plant = load_model("paper")
    for name, values in effects:
        plant = plant.with_effect(name, **dict(values))
    logs = record(
        plant,
        [MOTIONS[motion]()],
        rate=rate,
        seed=seed,
        torque_noise=0.03 * noise,
        speed_noise=0.01 * noise,
    )
    return logs[0]


def counted(log: Log, counts: int, jitter: float = 0.0, seed: int = 0) -> Log:
    """The log with speeds as an encoder gives them: differences of counted angles over a row.

    counts : a turn; jitter : standard deviation [s] of the instants at which they are read
    """
    rng = np.random.default_rng(seed)
    step = 2 * np.pi / counts
    late = jitter * rng.standard_normal(len(log))[:, None]
    angle = integral_of(log.velocity, log.dt) + late * log.velocity + rng.uniform(0, step, 4)
    angle = step * np.floor(angle / step)
    speed = np.diff(angle, axis=0, prepend=angle[:1]) / log.dt
    return replace(log, velocity=speed)
