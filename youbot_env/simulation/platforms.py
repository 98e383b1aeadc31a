"""What all simulated platforms have in common: rows of states, and the interface that loops use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import DRIVE_STATE, STATE
from youbot_env.simulation.delay_line import DelayLine

Array = NDArray[np.float64]

TWIST, POSE, WHEEL_ANGLE = slice(0, 3), slice(3, 6), slice(6, 10)
"""Where they stand in a state (see ``STATE``)."""

DRIVES = slice(len(STATE), len(STATE) + len(DRIVE_STATE))
"""Where the acting torques stand in the state of a model with an actuator."""


class Platforms(Protocol):
    """The interface of platforms that are simulated side by side.

    Attributes
    ----------
    models : the model of each platform
    states : (n, S) in the order of ``models[0].structure.state_names``, live
    wheel_rates : (n, 4) [rad/s], live; (0, 4) where no wheel slips: rates follow from the twist
    """

    geometry: Geometry
    models: list[Model]
    states: Array
    wheel_rates: Array

    def reset(
        self, model: Model | None = None, *, row: int | Sequence[int] | None = None, **start: Any
    ) -> Array:
        """Put platforms (None: all) at a start; see :meth:`Plant.reset`."""
        ...

    def advance(self, torque: Array, duration: float) -> None:
        """Move on by ``duration`` [s] under torques (n, 4) [N m], C-contiguous, that are held."""
        ...

    def acting_torque(self, command: Array) -> Array:
        """Torques (n, 4) [N m] that act at the wheels now, under the commands (n, 4)."""
        ...


class StateRows:
    """How platforms that stand side by side, or one alone, show their rows of ``states``."""

    states: Array
    _single: bool

    def _seen(self, where: slice) -> Array:
        # A copy: the states are written to at every step.
        return (self.states[0, where] if self._single else self.states[:, where]).copy()

    @property
    def state(self) -> Array:
        """(S,) or (n, S), a copy, in the order of ``model.structure.state_names``."""
        return self._seen(slice(None))

    @property
    def twist(self) -> Array:
        """(3,) or (n, 3): VX, VY, W [m/s, m/s, rad/s] of O in the body frame."""
        return self._seen(TWIST)

    @property
    def pose(self) -> Array:
        """(3,) or (n, 3): x, y, yaw [m, m, rad] of O in the world; yaw does not wrap."""
        return self._seen(POSE)

    @property
    def wheel_angle(self) -> Array:
        """(4,) or (n, 4) [rad]: fl, fr, bl, br."""
        return self._seen(WHEEL_ANGLE)


def drive_delay(model: Model) -> DelayLine:
    """The delay line of one platform, for the model's own delay [s].

    Raises
    ------
    InputError
        If the delay is negative: a log's may be, but nothing acts before it is commanded.
    """
    if model.delay < 0.0:
        raise InputError(
            f"torque_delay: {model.delay:g} s belongs to a log whose torques are late; a plant "
            "cannot act before it is commanded: give it a delay of at least 0"
        )
    return DelayLine(model.delay)


def checked_torque(torque: ArrayLike, platforms: int, *, single: bool) -> Array:
    """The torques of a step as rows (n, 4), or InputError if they are none or of another shape."""
    try:
        wheel_torque = np.array(torque, float)
    except (TypeError, ValueError):
        raise InputError(f"plant: {torque!r} does not hold numbers") from None
    if wheel_torque.shape != ((4,) if single else (platforms, 4)):
        raise InputError(f"plant: four torques per platform, not shape {wheel_torque.shape}")
    # A state that is once no number stays so, and nothing would tell when it began.
    if not np.isfinite(wheel_torque).all():
        raise InputError(f"plant: torques {wheel_torque.tolist()} hold what is no finite number")
    return wheel_torque.reshape(-1, 4)


def checked_duration(duration: float) -> float:
    """The duration of a step [s], or InputError if it is none."""
    return finite("plant: duration [s]", duration, least=0.0)
