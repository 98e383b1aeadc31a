"""Logs of known plants, recorded once for all tests of a run."""

from dataclasses import replace
from functools import cache

import numpy as np

from controllers.recording import record
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.signals.filters import integral_of
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration, motion_i, motion_iii
from youbot_env.physics.mecanum import mecanum_structure

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


def held_by_the_logger(log: Log, rows: int) -> Log:
    """The log of a logger that gets a new effort every ``rows`` rows and repeats it in between."""
    return replace(log, effort=_held(log.effort, rows))


def held_by_the_drive(
    log: Log,
    rows: int,
    effects: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = (),
    seed: int = 0,
) -> Log:
    """What the paper's platform (with effects) does under the log's efforts, held by the drive."""
    plant = load_model("paper")
    for name, values in effects:
        plant = plant.with_effect(name, **dict(values))
    mechanism = Mecanum(plant.geometry, mecanum_structure(tuple(name for name, _ in effects)))
    effort, fine = _held(log.effort, rows), 10
    # A step stands half a row before the row that shows it: there a straight line has its middle.
    at = np.arange((len(log) - 1) * fine + 1)
    samples = replace(
        mechanism.samples(log),
        time=at * log.dt / fine,
        dt=log.dt / fine,
        torque=effort[(at + fine // 2) // fine],
    )
    twist = mechanism.free_run(plant.theta, samples)[::fine] / mechanism.speed_scale
    noise = 0.01 * np.random.default_rng(seed).standard_normal(log.velocity.shape)
    return replace(log, velocity=plant.geometry.wheel_speeds(twist) + noise, effort=effort)


def _held(effort: np.ndarray, rows: int) -> np.ndarray:
    return np.repeat(effort[::rows], rows, axis=0)[: len(effort)]
