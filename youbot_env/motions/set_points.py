"""Motions as set points for a real robot: what to send when, and the floor that it takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from youbot_env.errors import InputError, finite
from youbot_env.motions.base import Array, Motion
from youbot_env.motions.limits import MotionLimits
from youbot_env.physics.geometry import SIGN_X, SIGN_Y, WHEELS, Geometry

COLUMNS = (
    *("time", "velocity_x", "velocity_y", "yaw_rate"),
    *(f"wheel_speed_{wheel}" for wheel in WHEELS),
)
"""Of a file of set points: s; m/s, m/s, rad/s in the robot's frame; rad/s."""

MARGIN = 0.3
"""Floor [m] beyond the ideal path on each side: a robot that slips drifts from it."""

MAX_ROWS = 5e6
"""Of a file of set points: 80 minutes at 1 kHz."""

REST = 2.0
"""Standing still before and after [s]: it shows the sensors' noise and offsets."""


@dataclass(frozen=True)
class Floor:
    """What a motion covers, the robot's start being (0, 0) with its front along x.

    Attributes
    ----------
    least, most : corners (x, y) [m] of the smallest upright rectangle around the whole robot
    """

    least: tuple[float, float]
    most: tuple[float, float]

    @property
    def size(self) -> tuple[float, float]:
        """Lengths [m] along x and y, the margin included."""
        return (
            self.most[0] - self.least[0] + 2 * MARGIN,
            self.most[1] - self.least[1] + 2 * MARGIN,
        )

    @property
    def start(self) -> tuple[float, float]:
        """Place of O at the start [m]: from the back and from the right edge of that floor."""
        return MARGIN - self.least[0], MARGIN - self.least[1]


@dataclass(frozen=True, eq=False)
class SetPoints:
    """A motion, sampled for a robot.

    Attributes
    ----------
    name : of the motion
    time : (n,) [s] from 0, at a constant rate
    twist : (n, 3) VX, VY, W [m/s, m/s, rad/s]
    wheel_speed : (n, 4) without slip [rad/s]
    pose : (n, 3) ideal path of O from (0, 0, 0) [m, m, rad]
    scale : factor by which the motion was slowed to keep the limits; 1 if it was not
    floor : what it covers
    """

    name: str
    time: Array
    twist: Array
    wheel_speed: Array
    pose: Array
    scale: float
    floor: Floor

    @property
    def table(self) -> Array:
        """(n, columns) in the order of :data:`COLUMNS`."""
        return np.column_stack([self.time, self.twist, self.wheel_speed])

    def to_dict(self) -> dict[str, Any]:
        """JSON form of what it asks."""
        return {
            "duration": float(self.time[-1]),
            "scale": self.scale,
            "peak_wheel_speed": float(np.abs(self.wheel_speed).max()),
            "peak_speed": float(np.hypot(self.twist[:, 0], self.twist[:, 1]).max()),
            "peak_yaw_rate": float(np.abs(self.twist[:, 2]).max()),
            "floor": {
                "least": list(self.floor.least),
                "most": list(self.floor.most),
                "size": list(self.floor.size),
                "start": list(self.floor.start),
            },
        }


def set_points(
    motion: Motion,
    geometry: Geometry | None = None,
    *,
    rate: float = 100.0,
    limits: MotionLimits | None = None,
    rest: float = REST,
) -> SetPoints:
    """Sample a motion for a robot, standing still before and after it.

    Parameters
    ----------
    geometry : of the robot, for its wheels' speeds and the floor that it covers
    rate : of the set points [Hz]
    limits : of the speeds; a motion that passes them is made slower as a whole
    rest : before and after the motion [s]

    Raises
    ------
    InputError
        If a number cannot be, or the rate is too low for the motion.
    """
    geometry = geometry or Geometry()
    limits = limits or MotionLimits.of(geometry)
    rate = finite("rate [Hz]", rate, positive=True)
    rest = finite("rest [s]", rest, least=0.0)
    rows = (motion.duration + 2 * rest) * rate
    if not rows < MAX_ROWS:
        raise InputError(f"motion '{motion.name}': over {MAX_ROWS:.0e} set points; lower the rate")
    count = int(np.ceil(rows)) + 1
    if count < 3:
        raise InputError(f"rate: {rate:g} Hz leaves no set points of '{motion.name}'; raise it")
    time = np.arange(count) / rate
    twist = motion.twist(time - rest)
    scale = limits.room(twist, geometry)
    twist = scale * twist
    pose = _path(twist, 1 / rate)
    return SetPoints(
        motion.name,
        time,
        twist,
        geometry.wheel_speeds(twist),
        pose,
        scale,
        _floor(pose, geometry),
    )


def _path(twist: Array, step: float) -> Array:
    """Poses (n, 3) from (0, 0, 0) of twists (n, 3), by the trapezoidal rule."""
    yaw = _integral(twist[:, 2], step)
    c, s = np.cos(yaw), np.sin(yaw)
    x = _integral(c * twist[:, 0] - s * twist[:, 1], step)
    y = _integral(s * twist[:, 0] + c * twist[:, 1], step)
    return np.column_stack([x, y, yaw])


def _integral(rate: Array, step: float) -> Array:
    return np.r_[0.0, np.cumsum((rate[1:] + rate[:-1]) / 2) * step]


def _floor(pose: Array, geometry: Geometry) -> Floor:
    """Rectangle around the corners of the robot, which its wheels span."""
    # A wheel reaches its radius ahead of its axle; its width is about the same.
    ahead = np.array(SIGN_X) * (geometry.h + geometry.R)
    aside = np.array(SIGN_Y) * (geometry.l + geometry.R)
    c, s = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    x = pose[:, :1] + c * ahead - s * aside
    y = pose[:, 1:2] + s * ahead + c * aside
    least, most = (float(x.min()), float(y.min())), (float(x.max()), float(y.max()))
    return Floor(least, most)
