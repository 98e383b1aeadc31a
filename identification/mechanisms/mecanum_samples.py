"""Logs of a mecanum platform: motion, wheel angles and torques on a uniform time base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.samples import Samples, planar_pose
from identification.mechanisms.settings import MechanismSettings
from identification.mechanisms.standstill import moving_rows
from identification.signals.filters import add_up_from, integral_of, pieces
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
    rolled, apart = np.zeros_like(integrated), np.zeros(4)
    for part in pieces(len(log) - 1):
        after = slice(part.start + 1, part.stop + 1)
        way = _rolled_between(log.pose[part.start : part.stop + 1], geometry)
        add_up_from(rolled, part.start, way)
        apart = np.maximum(apart, np.abs(rolled[after] - integrated[after]).max(axis=0))
    drift = white_noise(log.velocity) * np.sqrt(dt * dt * len(log))
    # Noise alone leaves a random walk; anything beyond is slip, and the wheels know better.
    explained = settings.max_drift_deviations * drift + settings.max_pose_angle_error
    return (integrated, False) if (apart > explained).any() else (rolled, True)


def _rolled_between(pose: Array, geometry: Geometry) -> Array:
    """(N - 1, 4) angles [rad] by which wheels roll from each pose (N, 3) to the next."""
    middle = 0.5 * (pose[1:, 2] + pose[:-1, 2])
    c, s = np.cos(middle), np.sin(middle)
    dx, dy, turn = np.diff(pose, axis=0).T
    # From the chord to the arc that was driven: a part in 10^5, but a ripple counts each turn.
    arc = 1.0 / np.sinc(turn / (2 * np.pi))
    dx, dy = arc * dx, arc * dy
    return geometry.wheel_speeds(np.column_stack([c * dx + s * dy, c * dy - s * dx, turn]))


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
    # Kept once where it starts at zero.
    time = log.time - log.time[0] if log.time[0] else log.time
    dt = float(time[-1] / (len(time) - 1))
    twist = geometry.body_twist(log.velocity)
    pose = log.pose if log.pose is not None else planar_pose(twist, dt)
    angle, measured = _wheel_angles(log, geometry, dt, settings)
    moves = moving_rows(log.velocity, dt, settings)
    return Samples(
        *(log.name, time, dt, twist, pose, angle, log.velocity, log.effort, measured),
        pose_measured=log.pose is not None,
        # A platform that hardly moves at all is judged by what there is.
        moves=None if moves.all() or moves.mean() < settings.min_moving_share else moves,
    )
