"""A delay line of commands: each acts one delay later, for the time that it was held."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Share of an interval below which a piece of it is rounding, not a piece of its own."""


class DelayLine:
    """The wheel torques of platforms that share a delay, from their command to their drives.

    The delay may be any number of seconds, and commands may be held for any times, so it is a queue
    of torques with the time that each is held, not of samples. One platform is a batch of one.
    At the start the line is filled with zero torque.

    Parameters
    ----------
    delay : from a command to its effect [s], at least 0
    shape : (n, 4) of the commands of n platforms that stand side by side, or (4,)

    Attributes
    ----------
    acting : (n, 4) torques [N m] that left the line last; the last command where there is no delay
    """

    def __init__(self, delay: float, shape: tuple[int, ...] = (1, 4)) -> None:
        self.delay = delay
        self.acting: Array = np.zeros(shape)
        self._queue: deque[tuple[Array, float]] = deque()
        if delay > 0.0:
            self._queue.append((np.zeros(shape), delay))

    def passed(self, command: Array, duration: float) -> Sequence[tuple[Array, float]]:
        """What acts while ``command`` (n, 4) [N m] is held for ``duration`` [s].

        Returns the torques (n, 4), the earliest first, each with the time [s] for which it acts;
        the times add up to ``duration``. A command is kept as it is, not copied: nobody may write
        into it afterwards.
        """
        queue = self._queue
        if not queue:
            self.acting = command
            return ((command, duration),)
        queue.append((command, duration))
        rounding = ROUNDING * duration
        torque, length = queue[0]
        # The usual case, a delay of whole periods: each piece acts for one period, uncut.
        if abs(length - duration) <= rounding:
            queue.popleft()
            self.acting = torque
            return ((torque, duration),)
        return self._cut(duration, rounding)

    def _cut(self, duration: float, rounding: float) -> list[tuple[Array, float]]:
        queue, pieces, left = self._queue, [], duration
        while left > 0.0:
            torque, length = queue.popleft()
            if length > left + rounding:
                # A copy, because the part that acts now is handed out.
                queue.appendleft((torque.copy(), length - left))
            # Rounding of the times leaves pieces of nearly no length. They are dropped as long as
            # more of the period is left to fill.
            if length <= rounding < left:
                continue
            taken = left if length > left - rounding else length
            pieces.append((torque, taken))
            left -= taken
        self.acting = pieces[-1][0]
        return pieces

    def clear(self, rows: int | slice) -> None:
        """Set the commands on their way to some platforms to zero; the others' commands stay.

        The arrays belong to callers too, so they are replaced, not written into.
        """
        self.acting = _without(self.acting, rows)
        for at, (torque, held) in enumerate(self._queue):
            self._queue[at] = (_without(torque, rows), held)


def _without(torque: Array, rows: int | slice) -> Array:
    rest = torque.copy()
    rest[rows] = 0.0
    return rest
