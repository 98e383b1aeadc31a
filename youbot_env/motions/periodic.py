"""Periodic motions: a sine under a window, with whole periods between the ramps.

W(t) is odd about the middle of the motion, so that the mean of W^3 is zero over its whole periods
and, ramps included, over the whole motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from youbot_env.errors import InputError
from youbot_env.motions.base import Array, Motion, window

MIN_RAMP = 1.0
"""Shortest ramp [s] at each end of a periodic motion."""


@dataclass(frozen=True, kw_only=True)
class Periodic(Motion):
    """As many whole periods as fit between two ramps of at least MIN_RAMP.

    Attributes
    ----------
    frequency : of the sine [rad/s]
    """

    frequency: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("frequency", positive=True)
        if self.periods < 1:
            least = 2 * np.pi / self.frequency + 2 * MIN_RAMP
            raise InputError(
                f"motion '{self.name}': no period fits into {self.duration:g} s; "
                f"give it {least:.3g} s or a higher frequency"
            )

    @property
    def periods(self) -> int:
        """Number of whole periods on the plateau."""
        # 1e-9: a duration made for whole periods must not lose one by rounding.
        return int((self.duration - 2 * MIN_RAMP) * self.frequency / (2 * np.pi) + 1e-9)

    @property
    def ramp(self) -> float:
        """Length of each ramp [s]."""
        return self.duration / 2 - np.pi * self.periods / self.frequency

    @property
    def plateau(self) -> tuple[float, float]:
        """Start and end [s] of the whole periods."""
        return self.ramp, self.duration - self.ramp

    def _window(self, t: Array) -> tuple[Array, Array, Array]:
        return window(t, self.duration, self.ramp)

    def _angle(self, t: Array) -> Array:
        # Zero in the middle, so that sine is odd and cosine even about it.
        return self.frequency * (t - self.duration / 2)


@dataclass(frozen=True, kw_only=True)
class Turning(Periodic):
    """Turning to and fro, W = yaw_rate * sin, about a point fixed in body and world.

    V = (lever_x W, lever_y W), so the point is at (-lever_y, lever_x) in the body frame.

    Attributes
    ----------
    yaw_rate : amplitude of W [rad/s]
    lever_x, lever_y : VX and VY per W [m]
    """

    kind: ClassVar[str] = "turning"

    yaw_rate: float
    lever_x: float
    lever_y: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("yaw_rate", "lever_x", "lever_y")

    def _curves(self, t: Array) -> tuple[Array, Array]:
        s, s1, _ = self._window(t)
        angle = self._angle(t)
        sine, cosine = np.sin(angle), np.cos(angle)
        shape = self.yaw_rate * np.array([self.lever_x, self.lever_y, 1.0])
        slope = s1 * sine + s * self.frequency * cosine
        return np.multiply.outer(s * sine, shape), np.multiply.outer(slope, shape)


@dataclass(frozen=True, kw_only=True)
class Circling(Periodic):
    """Translation along a circle without turning: V = speed * (cos, sin), W = 0.

    Attributes
    ----------
    speed : of O [m/s]
    """

    kind: ClassVar[str] = "circling"

    speed: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("speed")

    def _curves(self, t: Array) -> tuple[Array, Array]:
        s, s1, _ = self._window(t)
        angle = self._angle(t)
        ray = self.speed * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(t)])
        # The derivative of (cos, sin) is (-sin, cos).
        turn = self.frequency * ray[:, [1, 0, 2]] * [-1.0, 1.0, 0.0]
        return s[:, None] * ray, s1[:, None] * ray + s[:, None] * turn


@dataclass(frozen=True, kw_only=True)
class Straight(Periodic):
    """O moves along a straight line of the world while the platform swings about it.

    The heading is yaw_rate/frequency * cos under the window, from 0 to 0. Between the ramps the
    velocity in the world is constant, VX' = VY W and VY' = -VX W, and W is a sine.

    Attributes
    ----------
    speed : of O [m/s]
    direction : of its line [rad], from the heading at the start
    yaw_rate : amplitude of W [rad/s]
    """

    kind: ClassVar[str] = "straight"

    speed: float
    direction: float
    yaw_rate: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("speed", "direction", "yaw_rate")

    def heading(self, t: Array) -> tuple[Array, Array, Array]:
        """Heading [rad] from its start, W and W' at times (n,) [s]."""
        s, s1, s2 = self._window(t)
        angle, rate = self._angle(t), self.frequency
        swing = self.yaw_rate / rate
        cosine, sine = swing * np.cos(angle), swing * np.sin(angle)
        yaw_rate = s1 * cosine - s * rate * sine
        yaw_acceleration = s2 * cosine - 2 * s1 * rate * sine - s * rate**2 * cosine
        return s * cosine, yaw_rate, yaw_acceleration

    def _curves(self, t: Array) -> tuple[Array, Array]:
        s, s1, _ = self._window(t)
        heading, yaw_rate, yaw_acceleration = self.heading(t)
        ahead = self.speed * np.cos(self.direction - heading)
        left = self.speed * np.sin(self.direction - heading)
        # The heading carries its own window, so W does not get another.
        twist = np.column_stack([s * ahead, s * left, yaw_rate])
        rate_x = s1 * ahead + s * left * yaw_rate
        rate_y = s1 * left - s * ahead * yaw_rate
        return twist, np.column_stack([rate_x, rate_y, yaw_acceleration])
