"""Drives a plant along a motion under any controller, and logs what a robot would log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Controller, Observation, Reference
from identification.logs.log import Log
from youbot_env.errors import InputError, count, finite
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.geometry import WHEELS
from youbot_env.simulation.free_run import substeps
from youbot_env.simulation.plant import POSE, TWIST, Plant, Platforms

Array = NDArray[np.float64]
Progress = Callable[[float], None]
"""Told the seconds of motion that have been driven since it was last told."""

CONTROL_RATE = 500.0
"""About how often [Hz] the stock loop runs in simulation; a multiple of the log's rate."""

SLOWEST, FASTEST = 20.0, 1000.0
"""Rates [Hz] that a log may have (README, Log files)."""

MAX_TICKS = 2_000_000
"""Control ticks in one run: an hour at 500 Hz, half a gigabyte of states."""

TORQUE_NOISE, SPEED_NOISE = 0.03, 0.01
"""White noise of a logged torque [N m] and of a measured wheel speed [rad/s]."""


def ticks_per_row(rate: float) -> int:
    """Control ticks in one log row, so that the loop runs at a multiple of ``rate`` near 500 Hz.

    Raises
    ------
    InputError
        If no log may have this rate [Hz].
    """
    rate = finite("rate [Hz]", rate)
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(f"rate: {rate:g} Hz is outside {SLOWEST:g} to {FASTEST:g} Hz")
    return max(1, round(CONTROL_RATE / rate))


def control_step(rate: float) -> float:
    """Time between control ticks [s] for a log of ``rate`` [Hz]."""
    return 1.0 / (rate * ticks_per_row(rate))


@dataclass(frozen=True, eq=False)
class Run:
    """What happened in one drive, at the N + 1 control ticks.

    Attributes
    ----------
    name : of the motion
    dt : [s] between ticks
    ticks : in one log row
    reference : (N + 1, 3) twist that was asked for [m/s, m/s, rad/s]
    states : (N + 1, S) true states in the order of ``model.structure.state_names``
    wheel_speed : (N + 1, 4) as measured, so with noise [rad/s]
    command : (N + 1, 4) torque commanded at a tick and held until the next [N m]; with a delay
        in the plant it acts that much later
    """

    name: str
    dt: float
    ticks: int
    reference: Array
    states: Array
    wheel_speed: Array
    command: Array

    def log(self, torque_noise: float, rng: np.random.Generator) -> Log:
        """A row every ``ticks`` ticks, from the first one that has a command on both sides.

        A row holds the speeds measured at its instant, the mean of the two commands that meet
        there plus white noise [N m], and the true pose. The command alone would be the torque of
        half a tick later; speed and torque that far apart bias the wheels' inertia.
        """
        at = np.arange(self.ticks, len(self.states), self.ticks)
        effort = 0.5 * (self.command[at - 1] + self.command[at])
        return Log(
            name=self.name,
            joints=WHEELS,
            time=np.asarray(self.dt * at, np.float64),
            velocity=self.wheel_speed[at],
            effort=effort + torque_noise * rng.standard_normal(effort.shape),
            pose=self.states[at, 3:6],
        )


def run(
    plant: Model | Platforms,
    motion: Motion,
    controller: Controller,
    *,
    rate: float = 100.0,
    ticks: int | None = None,
    speed_noise: float = SPEED_NOISE,
    preview: int = 0,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
) -> Run:
    """Drive a plant from rest at (0, 0, 0) along a motion.

    Parameters
    ----------
    plant : a model, or one platform that stands for itself (``ContactPlant``); the controller knows
        of it only what it was built with
    controller : is reset, then called ``ticks`` times per log row at equal distances; each command
        is held until the next
    rate : of the log [Hz], 20 to 1000
    ticks : control ticks per log row; None is ``ticks_per_row(rate)``
    speed_noise : standard deviation [rad/s] of the white noise on the measured wheel speeds
    preview : how many coming twists the reference shows
    rng : of the noise

    Raises
    ------
    InputError
        If the rate cannot be, the run is too long, or it diverges: names motion and second.
    """
    ticks = count("ticks", ticks or ticks_per_row(rate))
    dt = 1.0 / (rate * ticks)
    total = int(np.ceil(motion.duration * rate - 1e-9)) * ticks
    if total > MAX_TICKS:
        raise InputError(
            f"motion '{motion.name}': {motion.duration:.4g} s are too long to drive at "
            f"{1 / dt:.4g} Hz; split it into motions below {MAX_TICKS * dt:.4g} s"
        )
    rng = rng or np.random.default_rng(0)
    twist, acceleration = motion.evaluate(dt * np.arange(total + 1 + preview))
    # Until its tick comes, a row holds the noise that will be added to it.
    speed = speed_noise * rng.standard_normal((total + 1, 4))
    platform = Plant(plant, substeps=substeps(plant, dt)) if isinstance(plant, Model) else plant
    platform.reset()
    states = np.empty((total + 1, platform.states.shape[1]))
    command = np.zeros((total + 1, 4))
    references, record = (twist, acceleration, preview), (states, speed, command)
    with np.errstate(all="ignore"):  # a run that diverges is told below, in one line
        _loop(platform, controller, dt, references, record, progress)
    _check_finite(platform.models[0], motion, dt, states, command)
    return Run(motion.name, dt, ticks, twist[: total + 1], states, speed, command)


def _loop(
    plant: Platforms,
    controller: Controller,
    dt: float,
    references: tuple[Array, Array, int],
    record: tuple[Array, Array, Array],
    progress: Progress | None,
) -> None:
    """Fill ``record``: states, measured wheel speeds (given: their noise) and commands."""
    twist, acceleration, preview = references
    states, speed, command = record
    to_wheels = plant.geometry.wheel_jacobian
    to_body = np.linalg.pinv(to_wheels)
    slips = len(plant.wheel_rates) > 0
    controller.reset()
    last = np.zeros(4)
    end = len(states) - 1
    for k in range(end + 1):
        state, measured = states[k], speed[k]
        state[:] = plant.states[0]
        measured += plant.wheel_rates[0] if slips else to_wheels @ state[TWIST]
        seen = Observation(k * dt, measured, to_body @ measured, state[POSE], last)
        coming = slice(k + 1, k + 1 + preview)
        ahead = (twist[coming], acceleration[coming]) if preview else (None, None)
        last = command[k]
        last[:] = controller(seen, Reference(twist[k], acceleration[k], *ahead))
        if k < end:
            plant.advance(last[None], dt)
        if progress is not None and k % 500 == 499:
            progress(500 * dt)
    if progress is not None:
        progress((end + 1) % 500 * dt)


def _check_finite(model: Model, motion: Motion, dt: float, states: Array, command: Array) -> None:
    bad = ~(np.isfinite(states).all(axis=1) & np.isfinite(command).all(axis=1))
    if bad.any():
        raise InputError(
            f"motion '{motion.name}': plant {model.name} and its controller diverge at "
            f"{bad.argmax() * dt:.3g} s; check the plant's parameters and the controller's gains"
        )


def drive(
    plant: Model | Platforms,
    motion: Motion,
    controller: Controller,
    *,
    rate: float = 100.0,
    torque_noise: float = TORQUE_NOISE,
    speed_noise: float = SPEED_NOISE,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
) -> Log:
    """Log of a plant that is driven along a motion: :func:`run`, then :meth:`Run.log`.

    Parameters
    ----------
    plant : see :func:`run`
    controller : called every ``control_step(rate)`` [s]
    rate : of the log [Hz], 20 to 1000
    torque_noise, speed_noise : standard deviations of the white noise [N m], [rad/s]
    rng : of the noise

    Raises
    ------
    InputError
        If the rate cannot be, or the run diverges.
    """
    rng = rng or np.random.default_rng(0)
    found = run(
        plant, motion, controller, rate=rate, speed_noise=speed_noise, rng=rng, progress=progress
    )
    return found.log(torque_noise, rng)
