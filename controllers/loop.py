"""The closed loop: controllers that drive platforms along motions, called once a sample time.

Recording, evaluation and tuning all run :func:`instants`; training and the environments run the
same :class:`~youbot_env.tracking.sampled_plant.SampledPlant` below a task of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Array, Controller, Loop, Observation, Reference
from youbot_env.errors import InputError
from youbot_env.motions.base import Motion
from youbot_env.physics.hardware import ENCODER_TICKS
from youbot_env.simulation.platforms import POSE, TWIST, Platforms
from youbot_env.tracking.actuation import AT_LIMIT
from youbot_env.tracking.sampled_plant import SampledPlant
from youbot_env.tracking.sensors import Sensors

Progress = Callable[[float], None]
"""Told the seconds of motion that have been driven since it was last told."""

WINDOW_ROUNDING = 1e-6
"""Sample times by which twice the measurement's delay may miss a whole number of them."""

PROGRESS_STEPS = 500
"""Instants between two calls of ``progress``: a second of recording at 500 Hz."""


class Instant(NamedTuple):
    """What n platforms show at one control instant; no array is written to again.

    Attributes
    ----------
    index, time : control periods and seconds [s] since the start
    states : (n, S) true
    wheel_speed, body_twist : (n, 4) [rad/s], (n, 3) [m/s, m/s, rad/s], as measured
    last_command : (n, 4) torques [N m] commanded until now; zero at the start
    """

    index: int
    time: float
    states: Array
    wheel_speed: Array
    body_twist: Array
    last_command: Array


BatchLaw = Callable[[Instant], Array]
"""Wheel torques (n, 4) [N m] of n platforms at an instant."""


def instants(
    sampled: SampledPlant, law: BatchLaw, count: int, torque_limit: float = math.inf
) -> Iterator[tuple[Instant, Array]]:
    """The closed loop, instant by instant; the plant has been put at its start.

    Each instant is yielded with the commands (n, 4) [N m] that are held until the next one, before
    the plant moves on. So the caller can read both, or end the loop.

    Parameters
    ----------
    law : is asked once an instant; its torques must be C-contiguous
    count : instants, the start among them
    torque_limit : [N m] to which commands are cut, inf for none
    """
    states = sampled.plant.states
    rows, elapsed = (0, len(states)), 0
    command = np.zeros((len(states), 4))
    for index in range(count):
        # New arrays: an ``Instant`` that was handed out must not change.
        wheel_speed, body_twist = np.empty((len(states), 4)), np.empty((len(states), 3))
        sampled.measure(wheel_speed, body_twist, rows, elapsed)
        time = index * sampled.period
        now = Instant(index, time, states.copy(), wheel_speed, body_twist, command)
        torque = law(now)
        command = torque if torque_limit == math.inf else limited(torque, torque_limit)
        yield now, command
        # The last command is never applied: nothing is measured after it.
        if index < count - 1:
            sampled.apply(command)
            elapsed = 1


def limited(torque: Array, limit: float) -> Array:
    """Torques (n, 4) cut to +-``limit`` [N m].

    Computed as a share of the limit, as the action of an environment is: then a loop and an
    environment with the same controller agree to the bit.
    """
    share = torque / limit
    np.maximum(share, -1.0, out=share)
    np.minimum(share, 1.0, out=share)
    share *= limit
    return share


def at_limit(command: Array, limit: float) -> NDArray[np.bool_]:
    """Whether torques (..., 4) are at +-``limit`` [N m], but for rounding."""
    return np.abs(command) >= AT_LIMIT * limit


def sensors_of(loop: Loop) -> Sensors:
    """Encoders whose speeds are as old as the loop says; exact speeds where they have no age.

    Counts over a window are the mean speed over it, so half the window old.

    Raises
    ------
    InputError
        If the age is none that encoders have.
    """
    window = 2 * loop.measurement_delay / loop.sample_time
    # A mean over a window is half the window old, so the window is twice the age.
    if abs(window - round(window)) > WINDOW_ROUNDING:
        raise InputError(
            f"loop measurement_delay: {loop.measurement_delay:g} s is no multiple of half "
            "the sample time, as encoders have that are counted over whole samples"
        )
    if not round(window):
        return Sensors(loop.speed_noise)
    return Sensors(loop.speed_noise, ENCODER_TICKS, round(window))


def started(plant: Platforms, loop: Loop, noise: Sequence[Array]) -> SampledPlant:
    """Platforms that stand at their start, in a loop.

    ``noise``: of each platform's wheel speeds, (count, 4) [rad/s] for as many instants as there
    will be.
    """
    sampled = SampledPlant(plant, sensors_of(loop), loop.sample_time, len(noise[0]), loop.delay)
    sampled.begin(slice(None), np.stack(noise))
    return sampled


class ReferenceTable:
    """A motion at the instants of a loop, and ``ahead`` more.

    Attributes
    ----------
    twist, acceleration : (count + ahead, 3)
    """

    def __init__(self, motion: Motion, period: float, count: int, ahead: int) -> None:
        self.twist, self.acceleration = motion.evaluate(period * np.arange(count + ahead))
        self._ahead = ahead

    def at(self, index: int) -> Reference:
        """What a controller is told at an instant; no preview where none is wanted."""
        twist, acceleration = self.twist[index], self.acceleration[index]
        if not self._ahead:
            return Reference(twist, acceleration)
        coming = slice(index + 1, index + 1 + self._ahead)
        return Reference(twist, acceleration, self.twist[coming], self.acceleration[coming])


class ControllerRows:
    """Controllers, one a platform, as a law for all of them. They are reset.

    Parameters
    ----------
    controllers, motions : one a platform
    period : sample time [s]
    count : instants of the loop
    preview : coming reference samples that are shown at least; never fewer than a controller's
        ``preview_needed``
    show_pose : whether the controllers see the true pose; otherwise they have their wheels alone
    """

    def __init__(
        self,
        controllers: Sequence[Controller],
        motions: Sequence[Motion],
        period: float,
        count: int,
        *,
        preview: int = 0,
        show_pose: bool = False,
    ) -> None:
        self._controllers, self._show_pose = controllers, show_pose
        ahead = max(preview, preview_needed(controllers))
        self.tables = [ReferenceTable(motion, period, count, ahead) for motion in motions]
        for controller in controllers:
            controller.reset()

    def __call__(self, now: Instant) -> Array:
        torque = np.empty((len(self.tables), 4))
        for row, controller in enumerate(self._controllers):
            pose = now.states[row, POSE] if self._show_pose else None
            # The last command, not the acting torque: a controller cannot know what the drives do.
            seen = Observation(
                now.time, now.wheel_speed[row], now.body_twist[row], pose, now.last_command[row]
            )
            torque[row] = controller(seen, self.tables[row].at(now.index))
        return torque


def preview_needed(controllers: Sequence[Controller]) -> int:
    """The largest number of coming reference samples that one of the controllers reads."""
    return max(int(getattr(controller, "preview_needed", 0)) for controller in controllers)


@dataclass(frozen=True, eq=False)
class Trace:
    """What happened in one closed loop, at its N control instants.

    Attributes
    ----------
    period : [s] between instants
    reference : (N, 3) VX, VY, W [m/s, m/s, rad/s] that were asked for
    states : (N, S) true states in the order of ``model.structure.state_names``
    wheel_speed : (N, 4) as measured, so with noise [rad/s]
    command : (N, 4) torque commanded at an instant and held until the next [N m], within the
        limit
    torque_limit : [N m], the loop's
    diverged : [s] when the twist left its bound, or the controller asked for no number; None if
        it never did. A diverged trace ends before that.
    """

    period: float
    reference: Array
    states: Array
    wheel_speed: Array
    command: Array
    torque_limit: float
    diverged: float | None = None

    @property
    def time(self) -> Array:
        """(N,) [s]."""
        return np.asarray(self.period * np.arange(len(self.states)), np.float64)

    @property
    def twist(self) -> Array:
        """(N, 3) true VX, VY, W [m/s, m/s, rad/s]."""
        return self.states[:, TWIST]

    @property
    def pose(self) -> Array:
        """(N, 3) true x, y, yaw [m, m, rad]."""
        return self.states[:, POSE]

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(N,) whether a wheel's command is at the limit."""
        return np.any(at_limit(self.command, self.torque_limit), axis=1)


def closed_loop(
    plant: Platforms,
    controller: Controller,
    motion: Motion,
    loop: Loop,
    rng: np.random.Generator,
    *,
    count: int | None = None,
    preview: int = 0,
    show_pose: bool = False,
    bound: Array | None = None,
    progress: Progress | None = None,
) -> Trace:
    """Drive one platform along a motion, from rest at (0, 0, 0).

    Parameters
    ----------
    plant : one platform, which is reset; the controller knows of it only what it was built with
    controller : is reset, then called at each instant; its command is held until the next
    loop : its times, its torque limit and its noise; speeds come from the youBot's encoders where
        they have an age, else they are exact
    rng : of the measurement noise
    count : instants, the start among them; to the motion's end by default
    preview, show_pose : see ``ControllerRows``
    bound : (3,) twist beyond which the loop has diverged and ends; None goes on with any numbers
    progress : told the seconds driven since it was last told

    Raises
    ------
    InputError
        If the loop's measurement is none that encoders give.
    """
    period = loop.sample_time
    # round: the duration over the period may miss a whole number by rounding.
    count = count or round(motion.duration / period)
    law = ControllerRows(
        [controller], [motion], period, count, preview=preview, show_pose=show_pose
    )
    plant.reset()
    sampled = started(plant, loop, [sensors_of(loop).noise(rng, count)])
    states = np.empty((count, *plant.states.shape))
    wheel_speed, command = np.empty((count, 1, 4)), np.empty((count, 1, 4))
    diverged, done = None, count
    for now, given in instants(sampled, law, count, loop.torque_limit):
        k = now.index
        states[k], wheel_speed[k], command[k] = now.states, now.wheel_speed, given
        if bound is not None and not _within(now.states, given, bound):
            diverged, done = now.time, k
            break
        if progress is not None and k % PROGRESS_STEPS == PROGRESS_STEPS - 1:
            progress(PROGRESS_STEPS * period)
    if progress is not None:
        progress(count % PROGRESS_STEPS * period)
    return Trace(
        period,
        law.tables[0].twist[:done],
        states[:done, 0],
        wheel_speed[:done, 0],
        command[:done, 0],
        loop.torque_limit,
        diverged,
    )


def _within(states: Array, command: Array, bound: Array) -> bool:
    """Whether all twists are within the bound and all commands are numbers (NaN is neither)."""
    return bool((np.abs(states[:, TWIST]) <= bound).all() and np.isfinite(command).all())
