"""Acting wheel torques that follow from a loop's commands, and their check by measured torques."""

from __future__ import annotations

import numpy as np

from controllers.interface import Array, Loop
from controllers.linear.linear_system import DriveSettings, acting_delay, drive_lag
from youbot_env.model.model import Model
from youbot_env.simulation.delay_line import DelayLine


class CommandTracker:
    """Follows commanded wheel torques through the loop's delay and the drives' lag.

    Call once a sample: ``contradiction`` with what is measured, then ``command``.
    """

    def __init__(self, model: Model, loop: Loop) -> None:
        self.period = loop.sample_time
        self.delay = acting_delay(model, loop)
        self.lag = drive_lag(model)
        self.tolerance = DriveSettings.contradiction_share * loop.torque_limit
        self.reset()

    def reset(self) -> None:
        """As before the first command: no torque acts, and none is on its way."""
        self._line = DelayLine(self.delay, shape=(4,))
        self._last: Array = np.zeros(4)
        self.acting: Array = np.zeros(4)

    def contradiction(self, measured: Array | None) -> Array | None:
        """Measured minus expected torque (4,) [N m], where the two contradict each other.

        None where the torque is not measured, where it is the one expected, or where it is the last
        command, which some loops report in its place.
        """
        if measured is None or not np.isfinite(measured).all():
            return None
        apart = measured - self.acting
        if max(map(abs, apart.tolist())) <= self.tolerance:
            return None
        last = measured - self._last
        return None if max(map(abs, last.tolist())) <= self.tolerance else apart

    def command(self, torque: Array) -> None:
        """Moves on by one sample under a new command (4,) [N m]."""
        self._last = torque
        for late, piece in self._line.passed(torque, self.period):
            # Exact solution of the first-order lag under a held torque.
            keep = np.exp(-piece / self.lag) if self.lag > 0.0 else 0.0
            self.acting = late + keep * (self.acting - late)
