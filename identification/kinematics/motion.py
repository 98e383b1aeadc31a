"""Wheel speeds of a platform with its measured pose or yaw rate, and integrals of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.kinematics.settings import KinematicsSettings
from identification.signals.filters import integral_of, pieces

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Motion:
    """What a log says of a motion, torques aside; n instants at one step.

    Attributes
    ----------
    name : of the log
    time : (n,) [s]
    velocity : (n, 4) wheel speeds in the order of WHEELS; rad/s, unless the unit is to be found
    pose : (n, 3) x, y [m], yaw [rad], unwrapped, of a tracked point; NaN where it is not known
    gyro_z : (n,) yaw rate [rad/s], NaN where it is not known
    position : (n, 4) wheel angles [rad], or counts
    rows : (n,) lines of the file
    """

    name: str
    time: Array
    velocity: Array
    pose: Array | None = None
    gyro_z: Array | None = None
    position: Array | None = None
    rows: NDArray[np.int32] | None = None

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))


def is_new(pose: Array) -> NDArray[np.bool_]:
    """(N,) whether a pose (N, 3) is another one than at the sample before."""
    return np.r_[True, (np.diff(pose, axis=0) != 0).any(axis=1)]


def fresh_pose(motion: Motion, settings: KinematicsSettings) -> NDArray[np.intp]:
    """Samples (m,) at which the pose was measured, at most ``max_pose_rate`` of them a second.

    A pose that is slower than the log is held, or missing, between its own instants.
    """
    assert motion.pose is not None
    known = np.isfinite(motion.pose).all(axis=1)
    changed = is_new(motion.pose)
    # At rest a noise-free pose does not change either, so rests keep some of their samples.
    steps = np.arange(len(motion.time))
    since = steps - np.maximum.accumulate(np.where(changed, steps, 0))
    held = max(round(settings.max_hold_time / motion.dt), 1)
    found = np.flatnonzero(known & (changed | (since % held == 0)))
    least = 1.0 / settings.max_pose_rate - 0.5 * motion.dt
    kept, last = [], -np.inf
    for part in pieces(len(found)):
        some = found[part]
        for k, instant in zip(some.tolist(), motion.time[some].tolist(), strict=True):
            if instant - last >= least:
                kept.append(k)
                last = instant
    return np.array(kept, dtype=np.intp)


def angles_at(motion: Motion, delay: float) -> Array:
    """Wheel angles (n, 4) turned since the first sample, of speeds that the log has ``delay`` late.

    Exact for speeds that are linear between samples, as the trapezoids of the integral are.
    """
    speed, dt = motion.velocity, motion.dt
    angle, last = integral_of(speed, dt), len(speed) - 1
    found = np.empty_like(angle)
    for some in pieces(len(speed)):
        place = np.arange(some.start, some.stop) + delay / dt
        first = np.clip(np.floor(place).astype(np.intp), 0, max(last - 1, 0))
        # Beyond the ends the speed is taken to stay what it is there.
        part = (np.clip(place, 0, last) - first)[:, None]
        beyond = (place - np.clip(place, 0, last))[:, None]
        at = np.clip(np.round(place), 0, last).astype(np.intp)
        slope = speed[first + 1] - speed[first]
        inside = angle[first] + dt * (part * speed[first] + 0.5 * part**2 * slope)
        found[some] = inside + dt * beyond * speed[at]
    return found


def turned_paths(angle: Array | Complex, yaw: Array, at: NDArray[np.intp] | None = None) -> Complex:
    """Ways (n, k) in the world, complex x + i y, of angles (n, k) that roll ahead at a radius of 1.

    An imaginary angle rolls to the left; ``yaw`` (n,) is the platform's. ``at``: the samples (m,),
    in order, whose ways (m, k) are asked for; None for all.
    """
    size, last = (len(angle) if at is None else len(at)), np.zeros((1, angle.shape[1]), complex)
    path = np.zeros((size, angle.shape[1]), complex)
    for part in pieces(len(angle) - 1):
        some = slice(part.start, part.stop + 1)
        middle = np.exp(0.5j * (yaw[some][1:] + yaw[some][:-1]))[:, None]
        ways = np.concatenate([last, middle * np.diff(angle[some], axis=0)])
        np.cumsum(ways, axis=0, out=ways)
        last = ways[-1:]
        if at is None:
            path[some] = ways
        else:
            inside = slice(*np.searchsorted(at, [part.start, part.stop + 1]))
            path[inside] = ways[at[inside] - part.start]
    return path
