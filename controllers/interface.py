"""What every controller receives and returns: the same in simulation, on a log and on a robot."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Observation(NamedTuple):
    """What is measured at one instant.

    Attributes
    ----------
    time : [s]
    wheel_speed : (4,) fl, fr, bl, br [rad/s], positive rolls the robot forward
    body_twist : (3,) VX, VY, W [m/s, m/s, rad/s] in the body frame
    pose : (3,) x, y, yaw [m, m, rad] in the world, None where it is not measured
    wheel_torque : (4,) the torque applied until now [N m], None where it is not known
    """

    time: float
    wheel_speed: Array
    body_twist: Array
    pose: Array | None = None
    wheel_torque: Array | None = None


class Reference(NamedTuple):
    """What is wanted at one instant.

    Attributes
    ----------
    twist : (3,) VX, VY, W [m/s, m/s, rad/s] in the body frame
    acceleration : (3,) time derivative of the twist's components
    preview : (k, 3) the next k twists, one sample time apart, None where they are not known
    """

    twist: Array
    acceleration: Array
    preview: Array | None = None


@runtime_checkable
class Controller(Protocol):
    """Wheel torques from an observation and a reference, called once per sample time."""

    def reset(self) -> None:
        """Forgets everything, as before the first call."""
        ...

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) fl, fr, bl, br [N m], a new array at each call."""
        ...
