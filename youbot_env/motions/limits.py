"""What a motion demands of the platform, and whether the platform can do it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from youbot_env.errors import InputError, finite
from youbot_env.motions.base import Array, Motion
from youbot_env.physics import hardware
from youbot_env.physics.geometry import WHEELS, Geometry

BodyForce = Callable[[Array, Array], Array]
"""(F_X, F_Y, M_W) (n, 3) [N, N, N m] demanded by twist and acceleration (n, 3): inverse
dynamics of whichever model the caller trusts."""


@dataclass(frozen=True)
class MotionLimits:
    """Largest wheel speed [rad/s], speed of O [m/s] and wheel torque [N m].

    The default keeps the wheels well below the motors' 21 rad/s, so that a loop that overshoots
    stays linear; body speed and torque are the youBot's.

    Raises
    ------
    InputError
        If a limit is not positive and finite.
    """

    wheel_speed: float = 12.0
    body_speed: float = hardware.MAX_BODY_SPEED
    wheel_torque: float = hardware.MAX_WHEEL_TORQUE

    def __post_init__(self) -> None:
        for f in fields(self):
            value = finite(f"limit {f.name}", getattr(self, f.name), positive=True)
            object.__setattr__(self, f.name, value)

    @classmethod
    def of(cls, geometry: Geometry) -> MotionLimits:
        """Those of a platform that says its top wheel speed or torque; else the youBot's."""
        if geometry.speed_limit is None:
            return cls(wheel_torque=geometry.max_wheel_torque)
        share = cls.wheel_speed / hardware.MAX_WHEEL_SPEED
        return cls(
            wheel_speed=share * geometry.speed_limit,
            body_speed=geometry.max_body_speed,
            wheel_torque=geometry.max_wheel_torque,
        )

    def room(self, twist: Array, geometry: Geometry) -> float:
        """Largest factor, at most 1, that brings twists (n, 3) within the speed limits."""
        wheel = np.abs(geometry.wheel_speeds(twist)).max(initial=0.0)
        body = np.hypot(twist[..., 0], twist[..., 1]).max(initial=0.0)
        # Torque is no part of it: that depends on a model.
        excess = max(1.0, wheel / self.wheel_speed, body / self.body_speed)
        return float(1.0 / excess)


@dataclass(frozen=True)
class Peaks:
    """Largest wheel speed [rad/s], speed of O [m/s] and wheel torque [N m] of a motion.

    The torque is None where no model was given to predict it.
    """

    wheel_speed: float
    body_speed: float
    wheel_torque: float | None = None


def check_limits(
    motion: Motion,
    geometry: Geometry | None = None,
    limits: MotionLimits | None = None,
    body_force: BodyForce | None = None,
    rate: float = 200.0,
) -> Peaks:
    """The motion's peaks, found on a grid of ``rate`` [Hz].

    Torque is checked only where ``body_force`` predicts what the motion demands; it is the
    least-norm distribution over the four wheels.

    Raises
    ------
    InputError
        If a peak passes its limit: names the motion, the wheel, the second and the cure.
    """
    geometry = geometry or Geometry()
    limits = limits or MotionLimits.of(geometry)
    time = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration * rate)) + 1)
    twist, acceleration = motion.evaluate(time)

    def peak(what: str, unit: str, values: Array, limit: float, places: tuple[str, ...]) -> float:
        row, column = np.unravel_index(np.abs(values).argmax(), values.shape)
        top = float(abs(values[row, column]))
        if top > limit:
            raise InputError(
                f"motion '{motion.name}': {what}{places[column]} reaches {top:.3g} {unit} at "
                f"{time[row]:.2f} s, the limit is {limit:.3g}; lower its amplitude or frequency"
            )
        return top

    wheels = tuple(f" of wheel {wheel}" for wheel in WHEELS)
    speeds = geometry.wheel_speeds(twist)
    body = np.hypot(twist[:, :1], twist[:, 1:2])
    torque = None
    if body_force is not None:
        torques = geometry.wheel_torque(body_force(twist, acceleration))
        torque = peak("torque", "N m", torques, limits.wheel_torque, wheels)
    return Peaks(
        wheel_speed=peak("speed", "rad/s", speeds, limits.wheel_speed, wheels),
        body_speed=peak("speed", "m/s", body, limits.body_speed, (" of the platform",)),
        wheel_torque=torque,
    )
