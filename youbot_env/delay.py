"""Commands on their way to the drives: what is commanded acts a fixed time later."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError

Array = NDArray[np.float64]

SLIVER = 1e-9
"""Share of an interval that is rounding, not a piece of its own."""


class DelayLine:
    """A pipe through which the commands of one platform, each held for a while, reach its drives.

    Before the first command no torque is on its way.

    Parameters
    ----------
    delay : [s], the length of the pipe

    Attributes
    ----------
    acting : (4,) torques [N m] that left the pipe last

    Raises
    ------
    InputError
        If the delay is negative: a log's may be, but nothing acts before it is commanded.
    """

    def __init__(self, delay: float) -> None:
        if delay < 0:
            raise InputError(
                f"torque_delay: {delay:g} s belongs to a log whose torques are late; a plant "
                "cannot act before it is commanded: give it a delay of at least 0"
            )
        self.acting: Array = np.zeros(4)
        self._pipe: deque[tuple[Array, float]] = deque([(self.acting, delay)])

    def passed(self, command: Array, duration: float) -> list[tuple[Array, float]]:
        """What acts while ``command`` (4,) is held for ``duration`` [s]: torques and their times.

        The times add up to ``duration``.
        """
        self._pipe.append((command.copy(), duration))
        pieces, left, rounding = [], duration, SLIVER * duration
        while left > 0.0:
            torque, length = self._pipe.popleft()
            if length > left + rounding:
                self._pipe.appendleft((torque, length - left))
            if length <= rounding < left:
                continue
            taken = left if length > left - rounding else length
            pieces.append((torque, taken))
            left -= taken
        self.acting = pieces[-1][0]
        return pieces
