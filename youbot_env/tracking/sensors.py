"""Measured wheel speeds: with noise, and on request from whole encoder counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from youbot_env.caching import njit
from youbot_env.errors import finite
from youbot_env.tracking.actuation import whole_number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensors:
    """How wheel speeds are measured.

    Attributes
    ----------
    wheel_speed_noise : standard deviation [rad/s] of white noise on each wheel speed
    encoder_ticks : counts per turn of a wheel; speeds are then the counts of the last ``window``
        control periods over their length, so the mean speed over them in steps of one count. None
        measures the speed at the instant. The youBot has 103,352 (``hardware.ENCODER_TICKS``).
    window : control periods over which counts are differenced

    Raises
    ------
    InputError
        If a number cannot be.
    """

    wheel_speed_noise: float = 0.0
    encoder_ticks: float | None = None
    window: int = 1

    def __post_init__(self) -> None:
        finite("wheel_speed_noise", self.wheel_speed_noise, least=0.0)
        if self.encoder_ticks is not None:
            finite("encoder_ticks", self.encoder_ticks, positive=True)
        whole_number("window", self.window, least=1)

    @property
    def resolution(self) -> float:
        """Wheel angle per count [rad]; 0 without an encoder."""
        return 0.0 if self.encoder_ticks is None else 2 * math.pi / self.encoder_ticks

    def noise(self, rng: np.random.Generator, samples: int) -> Array:
        """Errors (samples, 4) [rad/s] of one platform's wheel speeds.

        Drawn even if they are zero, so that later draws from ``rng`` do not depend on the noise.
        """
        return self.wheel_speed_noise * rng.standard_normal((samples, 4))


@njit(cache=True)
def sense(
    rows,
    elapsed,
    states,
    rates,
    kinematics,
    noise,
    clock,
    counts,
    resolution,
    span,
    wheel_speed,
    body_twist,
):
    """Fill measured wheel speeds (n, 4) [rad/s] and body twist (n, 3) of states (n, S).

    ``rows`` (first, past the last) says of which platforms; their ``clock`` (n,) moves on by
    ``elapsed`` periods. ``kinematics`` (2, 4, 3): wheel rates
    per twist, and the least-squares way back; ``rates`` (n, 4) are the wheels' own where they slip,
    (0, 4) where the twist tells them; ``noise`` (n, N, 4) at the sample ``clock``;
    ``counts`` (n, w, 4) are the encoders' last readings, the oldest first, and move on; ``span``
    [s] lies between the oldest and now.
    """
    for row in range(rows[0], rows[1]):
        clock[row] += elapsed
        for axis in range(3):
            body_twist[row, axis] = 0.0
        for wheel in range(4):
            speed = 0.0
            # 6 + wheel: wheel angles follow twist (3) and pose (3) in a state.
            if resolution > 0.0:
                count = np.floor(states[row, 6 + wheel] / resolution)
                speed = (count - counts[row, 0, wheel]) * resolution / span
                # Oldest first, so the loop may overwrite each entry by its successor.
                for age in range(counts.shape[1] - 1):
                    counts[row, age, wheel] = counts[row, age + 1, wheel]
                counts[row, -1, wheel] = count
            elif len(rates):
                speed = rates[row, wheel]
            else:
                for axis in range(3):
                    speed += kinematics[0, wheel, axis] * states[row, axis]
            speed += noise[row, clock[row], wheel]
            wheel_speed[row, wheel] = speed
            for axis in range(3):
                body_twist[row, axis] += kinematics[1, wheel, axis] * speed
