"""Records a plant under the stock kinematic control, or another, as logs like those of a robot."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Controller, Loop
from controllers.kinematic import KinematicControl
from controllers.loop import Progress, Trace, at_limit, closed_loop
from identification.logs.log import Log
from identification.signals.filters import accumulate
from youbot_env.errors import InputError, count, finite
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.geometry import WHEELS
from youbot_env.simulation.free_run import substeps
from youbot_env.simulation.plant import Plant
from youbot_env.simulation.platforms import Platforms

Array = NDArray[np.float64]

CONTROL_RATE = 500.0
"""About how often [Hz] the stock loop runs in simulation; a multiple of the log's rate."""

SLOWEST, FASTEST = 20.0, 1000.0
"""Rates [Hz] that a log may have (README, Log files)."""

MAX_TICKS = 2_000_000
"""Control ticks in one run: an hour at 500 Hz, half a gigabyte of states."""

MIN_SHARE_OF_MOTION = 0.1
"""Of the speeds that a motion asks for (rms): a platform that reaches less of them is held."""

TORQUE_NOISE, SPEED_NOISE = 0.03, 0.01
"""White noise of a logged torque [N m] and of a measured wheel speed [rad/s]."""


def generator(seed: int, *names: str) -> np.random.Generator:
    """Random numbers for one purpose; they do not depend on other draws with the same seed."""
    # crc32, because Python's hash of a text differs from process to process.
    return np.random.default_rng([seed, *(zlib.crc32(name.encode()) for name in names)])


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


def coloured(white: Array, step: float, correlation: float) -> Array:
    """First-order autoregressive noise of variance 1 from white noise (N, W) of variance 1.

    ``step`` between rows [s]; ``correlation``: time [s] after which it resembles itself by 1 / e.
    """
    if correlation == 0.0:
        return white
    memory = np.exp(-step / correlation)
    fresh = np.sqrt(1.0 - memory**2) * white
    fresh[0] = white[0]  # it has been going on for long when the log begins
    return accumulate(fresh, memory)[1:]


@dataclass(frozen=True, eq=False)
class Run:
    """One drive along a motion.

    Attributes
    ----------
    name : of the motion
    ticks : control instants in one log row
    trace : what happened at the instants; with a delay in the plant a command acts that much later
    """

    name: str
    ticks: int
    trace: Trace

    def log(
        self, torque_noise: float, rng: np.random.Generator, noise_correlation: float = 0.0
    ) -> Log:
        """A row every ``ticks`` ticks, from the first one that has a command on both sides.

        A row holds the speeds measured at its instant, the mean of the two commands that meet
        there plus noise [N m], and the true pose. The command alone would be the torque of
        half a tick later; speed and torque that far apart bias the wheels' inertia.
        ``noise_correlation`` [s]: time after which the noise resembles itself by 1 / e; 0: white.
        """
        trace = self.trace
        at = np.arange(self.ticks, len(trace.states), self.ticks)
        effort = 0.5 * (trace.command[at - 1] + trace.command[at])
        noise = coloured(
            rng.standard_normal(effort.shape), self.ticks * trace.period, noise_correlation
        )
        return Log(
            name=self.name,
            joints=WHEELS,
            time=np.asarray(trace.period * at, np.float64),
            velocity=trace.wheel_speed[at],
            effort=effort + torque_noise * noise,
            pose=trace.pose[at],
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

    Speeds are exact but for the noise, commands act at once and without a limit: what a log shows
    of a robot's loop is the plant's (effects ``torque_delay``, ``actuator_lag``) and the
    controller's own limit.

    Parameters
    ----------
    plant : a model, or one platform that stands for itself (``ContactPlant``)
    controller : is called ``ticks`` times per log row at equal distances, and shown the true pose
    rate : of the log [Hz], 20 to 1000
    ticks : control ticks per log row; None is ``ticks_per_row(rate)``
    speed_noise : standard deviation [rad/s] of the white noise on the measured wheel speeds
    preview : how many coming twists the reference shows at least
    rng : of the noise

    Raises
    ------
    InputError
        If the rate cannot be, the run is too long, or it diverges: names motion and second.
    """
    ticks = count("ticks", ticks or ticks_per_row(rate))
    dt = 1.0 / (rate * ticks)
    # Whole rows; 1e-9, so that rounding adds none.
    total = int(np.ceil(motion.duration * rate - 1e-9)) * ticks
    if total > MAX_TICKS:
        raise InputError(
            f"motion '{motion.name}': {motion.duration:.4g} s are too long to drive at "
            f"{1 / dt:.4g} Hz; split it into motions below {MAX_TICKS * dt:.4g} s"
        )
    platform = Plant(plant, substeps=substeps(plant, dt)) if isinstance(plant, Model) else plant
    with np.errstate(all="ignore"):  # a run that diverges is told below, in one line
        trace = closed_loop(
            platform,
            controller,
            motion,
            Loop(dt, torque_limit=np.inf, speed_noise=speed_noise),
            rng or np.random.default_rng(0),
            count=total + 1,  # the start, then one a tick
            preview=preview,
            show_pose=True,
            progress=progress,
        )
    _check_finite(platform.models[0], motion, trace)
    return Run(motion.name, ticks, trace)


def _check_finite(model: Model, motion: Motion, trace: Trace) -> None:
    kept = np.isfinite(trace.states).all(axis=1) & np.isfinite(trace.command).all(axis=1)
    if not kept.all():
        raise InputError(
            f"motion '{motion.name}': plant {model.name} and its controller diverge at "
            f"{kept.argmin() * trace.period:.3g} s; check the plant's parameters and the "
            "controller's gains"
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


def share_of_motion(trace: Trace) -> float:
    """True speeds over those that were asked for, root mean square; 1 where none were."""
    asked = float((trace.reference**2).sum())
    return float(np.sqrt((trace.twist**2).sum() / asked)) if asked else 1.0


def holding_effects(plant: Model, motion: Motion, *, rate: float = 100.0) -> tuple[str, ...]:
    """Of the effects of a plant that hardly moves, those without which it does; () if none alone.

    Each is left out in turn, and the motion driven without noise.
    """
    found = list[str]()
    for name in plant.effects:
        others = {other: plant.effects[other] for other in plant.effects if other != name}
        free = replace(plant, effects=others, covariance=None, covariance_names=())
        controller = KinematicControl(free.geometry, sample_time=control_step(rate))
        try:
            trace = run(free, motion, controller, rate=rate, speed_noise=0.0).trace
        except InputError:  # it diverges, so it moves
            found.append(name)
            continue
        if share_of_motion(trace) >= MIN_SHARE_OF_MOTION:
            found.append(name)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Recording:
    """One run of the plant, and the log that it left; the torque limit [N m] was the loop's."""

    run: Run
    log: Log
    torque_limit: float

    @property
    def share_of_motion(self) -> float:
        """True speeds over those that were asked for, root mean square; 1 where none were."""
        return share_of_motion(self.run.trace)

    def summary(self) -> dict[str, Any]:
        """Numbers for a table: SI units, shares of time, true peaks (noise left out)."""
        command = self.run.trace.command
        return {
            "duration": len(self.log) * self.log.dt,
            "rows": len(self.log),
            "peak_wheel_speed": float(np.abs(self.log.velocity).max()),
            "peak_torque": float(np.abs(command).max()),
            "saturated": float(at_limit(command, self.torque_limit).any(axis=1).mean()),
        }


def recordings(
    plant: Model | Platforms,
    motions: Sequence[Motion],
    *,
    rate: float = 100.0,
    seed: int = 0,
    torque_noise: float = TORQUE_NOISE,
    speed_noise: float = SPEED_NOISE,
    noise_correlation: float = 0.0,
    progress: Progress | None = None,
) -> Iterator[Recording]:
    """Drive a plant along each motion with the stock kinematic control, one after another.

    The noise of a log depends on the seed and the motion's name alone, not on the other motions.
    See :func:`record`.
    """
    step = control_step(rate)
    finite("torque noise", torque_noise, least=0.0)
    finite("speed noise", speed_noise, least=0.0)
    finite("noise correlation", noise_correlation, least=0.0)
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
        yield Recording(
            found, found.log(torque_noise, rng, noise_correlation), controller.torque_limit
        )


def record(
    plant: Model | Platforms,
    motions: Sequence[Motion],
    *,
    rate: float = 100.0,
    seed: int = 0,
    torque_noise: float = TORQUE_NOISE,
    speed_noise: float = SPEED_NOISE,
    noise_correlation: float = 0.0,
    progress: Progress | None = None,
) -> list[Log]:
    """Logs of a plant that the stock kinematic control drives along the motions.

    Parameters
    ----------
    plant : a model, effects included, or one platform (``ContactPlant``)
    rate : of the logs [Hz], 20 to 1000; the loop runs at a multiple of it near 500 Hz
    seed : of the noise; the noise of a log depends on it and on the motion's name alone
    torque_noise, speed_noise : standard deviations of the noise [N m], [rad/s]
    noise_correlation : time [s] after which the torque noise resembles itself by 1 / e; 0: white
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
        noise_correlation=noise_correlation,
        progress=progress,
    )
    return [recording.log for recording in found]
