"""What every controller receives and returns: the same in simulation, on a log and on a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError, finite
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE

Array = NDArray[np.float64]

SHORTEST_SAMPLE, LONGEST_SAMPLE = 1e-5, 10.0
"""[s] between which a loop's sample time must lie: no drive's bus is faster, no platform slower."""

MOST_SAMPLES_LATE = 10_000
"""Most samples by which a command or a measurement may be late: controllers keep all of them."""


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
    preview_acceleration : (k, 3) their accelerations
    """

    twist: Array
    acceleration: Array
    preview: Array | None = None
    preview_acceleration: Array | None = None


@dataclass(frozen=True)
class Loop:
    """What is known of the loop in which a controller will run, when it is built.

    Attributes
    ----------
    sample_time : [s] between calls; each command is held until the next
    delay : [s] by which commands act late, bus and computation together; what the drives themselves
        add is the model's (effects ``torque_delay`` and ``actuator_lag``)
    measurement_delay : [s], the age of a measured speed; half a sample where counts are differenced
    torque_limit : [N m] at each wheel; inf where nothing but the controller limits its commands
    speed_noise : standard deviation of a measured wheel speed [rad/s]

    Raises
    ------
    InputError
        If a number cannot be.
    """

    sample_time: float = 0.01
    delay: float = 0.0
    measurement_delay: float = 0.0
    torque_limit: float = MAX_WHEEL_TORQUE
    speed_noise: float = 0.01

    def __post_init__(self) -> None:
        period = finite("loop sample_time", self.sample_time, positive=True)
        if not SHORTEST_SAMPLE <= period <= LONGEST_SAMPLE:
            raise InputError(
                f"loop sample_time: {period:.4g} s (a rate of {1 / period:.4g} Hz) is not between "
                f"{SHORTEST_SAMPLE:g} and {LONGEST_SAMPLE:g} s"
            )
        # ``finite`` would refuse the infinity that stands for no limit.
        if self.torque_limit != math.inf:
            finite("loop torque_limit", self.torque_limit, positive=True)
        for name in ("delay", "measurement_delay", "speed_noise"):
            finite(f"loop {name}", getattr(self, name), least=0.0)
        for name in ("delay", "measurement_delay"):
            late = getattr(self, name) / period
            if late > MOST_SAMPLES_LATE:
                raise InputError(
                    f"loop {name}: {late:.4g} samples are more than {MOST_SAMPLES_LATE}"
                )


@runtime_checkable
class Controller(Protocol):
    """Wheel torques from an observation and a reference, called once per sample time."""

    def reset(self) -> None:
        """Forgets everything, as before the first call."""
        ...

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) fl, fr, bl, br [N m], a new array at each call."""
        ...
