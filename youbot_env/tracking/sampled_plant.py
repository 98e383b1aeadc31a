"""Platforms behind a sampled interface: commands in, measured speeds out, once a control period.

It holds and delays commands and simulates encoders with noise. All environments and closed loops
use it, so that these parts are written once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from youbot_env.simulation.delay_line import DelayLine
from youbot_env.simulation.platforms import TWIST, WHEEL_ANGLE, Platforms
from youbot_env.tracking.sensors import Sensors, sense

Array = NDArray[np.float64]


class SampledPlant:
    """Several platforms behind their sampled interface; one platform is a batch of one.

    Parameters
    ----------
    plant : what moves
    sensors : how its wheel speeds are measured
    period : control period [s]
    samples : instants at which is measured, the one of the start among them
    delay : [s] by which commands act late, beside what the plant's model itself delays

    Attributes
    ----------
    clock : (n,) control periods since each platform's start
    """

    def __init__(
        self, plant: Platforms, sensors: Sensors, period: float, samples: int, delay: float = 0.0
    ) -> None:
        count, geometry = len(plant.states), plant.geometry
        self.plant, self.sensors, self.period = plant, sensors, period
        self.clock = np.zeros(count, np.int64)
        self._line = DelayLine(delay, (count, 4))
        self._noise = np.zeros((count, samples, 4))
        self._counts = np.zeros((count, sensors.window, 4))
        self._resolution = sensors.resolution
        # Gathered once: the arrays stay the same, and eight look-ups a step would cost 0.2 us.
        self._sensed = (
            plant.states,
            plant.wheel_rates,
            np.stack([geometry.wheel_jacobian, geometry.body_twist(np.eye(4))]),
            self._noise,
            self.clock,
            self._counts,
            sensors.resolution,
            sensors.window * period,
        )

    def begin(self, rows: int | slice, noise: Array) -> None:
        """Begin a run of platforms that were put at their start: no command is on its way.

        ``noise`` (samples, 4) [rad/s], with an axis of rows in front of it for a slice, is added to
        their wheel speeds, see ``Sensors.noise``. Old encoder counts are set as if they had
        always moved at their present speed; otherwise the first measured speeds would be wrong.
        """
        self.clock[rows] = 0
        self._noise[rows] = noise
        self._line.clear(rows)
        if self._resolution:
            state, slipping = self.plant.states[rows], self.plant.wheel_rates
            turning = self.plant.geometry.wheel_speeds(state[..., TWIST])
            rate = slipping[rows] if len(slipping) else turning
            for age in range(1, self.sensors.window + 1):
                angle = state[..., WHEEL_ANGLE] - rate * (age * self.period)
                self._counts[rows, -age] = np.floor(angle / self._resolution)

    def apply(self, torque: Array) -> None:
        """One control period under commands (n, 4) [N m], C-contiguous.

        They are held for the period, and act when the delay is over.
        """
        # The line keeps a delayed command, while the caller hands out its own array: a copy.
        if self._line.delay:
            torque = torque.copy()
        for acting, piece in self._line.passed(torque, self.period):
            self.plant.advance(acting, piece)

    def measure(
        self, wheel_speed: Array, body_twist: Array, rows: tuple[int, int], elapsed: int
    ) -> None:
        """Fill rows of measured wheel speeds (n, 4) [rad/s] and body twists (n, 3).

        ``rows`` (first, past the last) says which. ``elapsed``: control periods since the
        encoders were read last, 1 after each period and 0 at a start.
        """
        sense(rows, elapsed, *self._sensed, wheel_speed, body_twist)

    @property
    def delivered(self) -> Array:
        """(n, 4) torques [N m] that have reached the drives: commands of a delay ago."""
        return self._line.acting
