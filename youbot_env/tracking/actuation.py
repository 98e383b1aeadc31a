"""From an action to the torque at the interface: limit, delay, memory of past actions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.caching import njit
from youbot_env.errors import InputError, finite
from youbot_env.physics import hardware
from youbot_env.physics.geometry import WHEELS

BOUND_TOLERANCE = 1e-6
"""How far past +-1 an action may lie: rounding of float32, no more. It is cut to +-1."""

AT_LIMIT = 1.0 - 1e-6
"""An action this large counts as saturated."""


@dataclass(frozen=True)
class Actuation:
    """What happens to an action (4,) in [-1, 1] on its way to the drives.

    Attributes
    ----------
    torque_limit : wheel torque [N m] that an action of 1 commands
    delay : whole control periods by which a command acts late

    Raises
    ------
    InputError
        If a number cannot be.
    """

    torque_limit: float = hardware.MAX_WHEEL_TORQUE
    delay: int = 0

    def __post_init__(self) -> None:
        limit = finite("torque_limit", self.torque_limit, positive=True)
        object.__setattr__(self, "torque_limit", limit)
        whole_number("delay", self.delay, least=0)

    def to_action(self, torque: ArrayLike) -> NDArray[np.float64]:
        """The actions (..., 4) that command wheel torques (..., 4) [N m], cut to the limit."""
        return np.clip(np.asarray(torque, float) / self.torque_limit, -1.0, 1.0)


def whole_number(name: str, value: object, *, least: int) -> int:
    """``value`` as an int of at least ``least``, or InputError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise InputError(f"{name}: {value!r} must be a whole number of at least {least}")
    return int(value)


def action_rows(action: Any, count: int, *, single: bool) -> NDArray[np.float64]:
    """The action as C-contiguous rows (count, 4), or InputError if it has another shape."""
    shape = (4,) if single else (count, 4)
    try:
        # A copy, so that a caller who writes to its array later changes nothing here.
        given = np.asarray(action)
        # Complex numbers would lose a part with no more than a warning.
        if np.iscomplexobj(given):
            raise TypeError
        rows = np.array(given, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"action: {action!r} does not hold numbers") from None
    if rows.shape != shape:
        raise InputError(f"action: shape {rows.shape}, expected {shape} (fl, fr, bl, br)")
    return rows.reshape(count, 4)


def reject(action: NDArray[np.float64], index: int) -> InputError:
    """The error for the element ``index`` of actions (n, 4) that ``take`` refused."""
    row, wheel = divmod(index, 4)
    where = f"wheel {WHEELS[wheel]}" + (f" of environment {row}" if len(action) > 1 else "")
    value = float(action[row, wheel])
    return InputError(f"action: {value!r} at {where} is not a number from -1 to 1; clip it first")


@njit(cache=True)
def take(action, past, limit, commanded, saturated):
    """Take actions (n, 4) in and fill the torques (n, 4) [N m] that they command.

    ``past`` (n, k, 4) holds the last actions, the newest first, and moves on; ``saturated`` (n, 4)
    tells whether the action is at its bound.
    Returns -1, or the flat index of the first element out of bounds, with nothing changed.
    """
    rows, slots = action.shape[0], past.shape[1]
    # All actions are checked before anything changes.
    for row in range(rows):
        for wheel in range(4):
            if not abs(action[row, wheel]) <= 1.0 + BOUND_TOLERANCE:  # so that NaN fails too
                return 4 * row + wheel
    for row in range(rows):
        for wheel in range(4):
            for slot in range(slots - 1, 0, -1):
                past[row, slot, wheel] = past[row, slot - 1, wheel]
            value = min(max(action[row, wheel], -1.0), 1.0)
            past[row, 0, wheel] = value
            commanded[row, wheel] = limit * value
            saturated[row, wheel] = abs(value) >= AT_LIMIT
    return -1
