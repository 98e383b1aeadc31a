"""Logs of a mecanum platform: motion, wheel angles and torques on a uniform time base."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.signals.filters import integral_of
from identification.signals.noise import white_noise
from identification.signals.resampling import smoothed
from youbot_env.errors import InputError
from youbot_env.physics.geometry import WHEELS, Geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MecanumSamples:
    """One log as motion and torque on a uniform time base.

    name : of the log; time (N,) [s] from the log's start; dt [s]
    twist (N, 3) body frame [m/s, m/s, rad/s]; pose (N, 3) world [m, m, rad]
    wheel_angle, wheel_speed (N, 4) [rad, rad/s]; torque (N, 4) as logged [N m]
    internal (N,): the part of the torque that does not move the platform, see INTERNAL [N m]
    angle_measured : whether the angles have columns of their own, or are integrated
    """

    name: str
    time: Array
    dt: float
    twist: Array
    pose: Array
    wheel_angle: Array
    wheel_speed: Array
    torque: Array
    angle_measured: bool = False

    def __len__(self) -> int:
        return len(self.time)

    @property
    def channels(self) -> tuple[Array, Array]:
        """Wheel speeds and torques (N, 4)."""
        return self.wheel_speed, self.torque

    @cached_property
    def internal(self) -> Array:
        """(N,) how much of ``INTERNAL`` the logged torques hold [N m]."""
        return internal_of(self.torque, self.dt)


INTERNAL = np.array([1.0, 1.0, -1.0, -1.0])
"""Four torques that exert no force: what a motion demands settles three, and leaves this free."""

INTERNAL_SMOOTHING = 0.05
"""Window [s] over which the internal torque is averaged: its noise would enter the columns."""


def internal_of(torque: Array, dt: float) -> Array:
    """(N,) how much of ``INTERNAL`` torques (N, 4) hold, smoothed [N m]."""
    return smoothed(torque @ INTERNAL / 4.0, INTERNAL_SMOOTHING / dt)


SLIPPING = 4.0
"""Deviations of the random walk that noise on a wheel's speed makes; beyond them it slips."""

ROUGH = 0.02
"""Angle [rad] that a pose may be off by rounding and by turning between samples."""


def _wheel_angles(log: Log, geometry: Geometry, dt: float) -> tuple[Array, bool]:
    """Wheel angles (N, 4) [rad] and whether they are free of drift.

    Position columns are taken as they are. Integrated speeds drift with their noise, which blurs
    what is periodic in the angle; where the wheels do not slip, a pose shows the way they went.
    """
    if log.position is not None:
        return log.position, True
    integrated = integral_of(log.velocity, dt)
    if log.pose is None:
        return integrated, False
    yaw = log.pose[:, 2]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    c, s = np.cos(middle), np.sin(middle)
    dx, dy, turn = np.diff(log.pose, axis=0).T
    # From the chord to the arc that was driven: a part in 10^5, but a ripple counts each turn.
    arc = 1.0 / np.sinc(turn / (2 * np.pi))
    dx, dy = arc * dx, arc * dy
    way = geometry.wheel_speeds(np.column_stack([c * dx + s * dy, c * dy - s * dx, turn]))
    rolled = np.vstack([np.zeros(4), np.cumsum(way, axis=0)])
    drift = white_noise(log.velocity) * np.sqrt(dt * dt * len(log))
    # Noise alone leaves a random walk; anything beyond is slip, and the wheels know better.
    slips = np.abs(rolled - integrated).max(axis=0) > SLIPPING * drift + ROUGH
    return (integrated, False) if slips.any() else (rolled, True)


def samples_of(log: Log, geometry: Geometry) -> MecanumSamples:
    """Motion and torque of a log.

    The twist is the least-squares projection of the four wheel speeds. Without pose columns the
    pose is integrated from the wheels from (0, 0, 0); without positions wheel angles start at 0.

    Raises
    ------
    InputError
        If the log is not that of a platform with four wheels.
    """
    if tuple(log.joints) != WHEELS:
        raise InputError(f"{log.source or log.name}: not the log of a mecanum platform")
    time = log.time - log.time[0]
    dt = float(time[-1] / (len(time) - 1))
    twist = geometry.body_twist(log.velocity)
    if log.pose is not None:
        pose = log.pose
    else:
        yaw = integral_of(twist[:, 2], dt)
        c, s = np.cos(yaw), np.sin(yaw)
        velocity = np.column_stack(
            [c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]]
        )
        pose = np.column_stack([integral_of(velocity, dt), yaw])
    angle, measured = _wheel_angles(log, geometry, dt)
    return MecanumSamples(
        log.name, time, dt, twist, pose, angle, log.velocity, log.effort, measured
    )
