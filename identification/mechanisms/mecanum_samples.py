"""Logs of a mecanum platform: motion, wheel angles and torques on a uniform time base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.samples import Samples, planar_pose
from identification.mechanisms.settings import MechanismSettings
from identification.signals.filters import integral_of
from identification.signals.noise import white_noise
from youbot_env.errors import InputError
from youbot_env.physics.geometry import WHEELS, Geometry

Array = NDArray[np.float64]


def _wheel_angles(
    log: Log, geometry: Geometry, dt: float, settings: MechanismSettings
) -> tuple[Array, bool]:
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
    explained = settings.max_drift_deviations * drift + settings.max_pose_angle_error
    slips = np.abs(rolled - integrated).max(axis=0) > explained
    return (integrated, False) if slips.any() else (rolled, True)


def samples_of(
    log: Log, geometry: Geometry, settings: MechanismSettings = MechanismSettings()
) -> Samples:
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
    pose = log.pose if log.pose is not None else planar_pose(twist, dt)
    angle, measured = _wheel_angles(log, geometry, dt, settings)
    return Samples(
        *(log.name, time, dt, twist, pose, angle, log.velocity, log.effort, measured),
        pose_measured=log.pose is not None,
    )
