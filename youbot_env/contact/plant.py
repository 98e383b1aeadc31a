"""A plant in MuJoCo: gravity, and rollers that touch the floor with friction.

Only the parameters come from the project's model, not its dynamics. So a controller or an
identification can be tested on physics that its model lacks: wheels slip, contact passes from one
roller to the next sixteen times a turn, load shifts between the wheels.

How it departs from the ideal model with the same parameters (the paper's, defaults of ``Contact``,
4 s of smooth torques up to 2 N m; ``pytest tests/youbot_env/contact/test_plant.py -s`` prints it):

- twist: 0.2 % (VX), 2.3 % (VY), 1.8 % (W), rms over rms, or 2.0 % (VY) in half the engine's step;
- m0 + 4 I1/R^2 from a fit: 1.5 % (X) and 1.2 % (Y) low;
- wheel rates: 0.8 % off rolling without slip, with a ripple of 1 % sixteen times a turn;
- roller friction: mu2 acts 3 to 4 % larger. A roller is thinner, so turns faster, away from its
  middle, and two neighbours share the floor at each hand-over;
- rollers have the spin inertia timestep * mu2, without which their friction would not be stable:
  0.24 kg (8 timestep mu2 / r^2) more in sideways motion.

The engine takes about a tenth of real time on an idle core.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.contact.bodies import CLOCK, YAW, Bodies
from youbot_env.contact.mjcf import check_translatable
from youbot_env.contact.settings import Contact
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.platforms import (
    DRIVES,
    POSE,
    TWIST,
    WHEEL_ANGLE,
    StateRows,
    checked_duration,
    checked_torque,
)

Array = NDArray[np.float64]


class ContactPlant(StateRows):
    """A mecanum platform in MuJoCo, under wheel torques: the interface of :class:`Plant`.

    The state holds the twist and pose of O and the wheels' angles as they are; wheel rates do not
    follow from the twist, because wheels slip, and stand in ``wheel_rates``.

    Parameters
    ----------
    model : its parameters are the bodies' masses, inertias and frictions. Of its effects,
        floor_tilt turns gravity, wheel_coulomb_friction and uneven_wheel_friction brake the wheel
        joints, payload_change puts a load on at its time, and torque_delay and actuator_lag act
        on the torques before the engine gets them.
    contact : friction with the floor, and how the rollers are made
    platforms : as for ``Plant``

    Attributes
    ----------
    states : (n, S) in the order of ``model.structure.state_names``, live, not a copy
    wheel_rates : (n, 4) [rad/s], live
    models : the model of each platform

    Raises
    ------
    InputError
        If MuJoCo is not installed, the model has other effects, no bodies have its parameters, or
        the platform tips over.
    """

    def __init__(
        self,
        model: str | os.PathLike[str] | Model = "paper",
        contact: Contact | None = None,
        *,
        platforms: int | None = None,
    ) -> None:
        model = load_model(model)
        check_translatable(model)
        self._single = platforms is None
        count = 1 if platforms is None else platforms
        if count < 1:
            raise InputError("plant: platforms must be at least 1")
        self.contact = contact or Contact()
        self.structure = model.structure
        self.geometry = model.geometry
        self.models = [model] * count
        self.states: Array = np.tile(initial_state(model), (count, 1))
        self.wheel_rates: Array = np.zeros((count, 4))
        first = Bodies(model, self.contact)
        self._bodies = [first, *(first.twin() for _ in range(count - 1))]
        self.reset()

    def reset(
        self, model: Model | None = None, *, row: int | Sequence[int] | None = None, **start: Any
    ) -> Array:
        """Put platforms on the floor, wheels and rollers turning without slip; see ``Plant``."""
        rows = np.arange(len(self.states)) if row is None else np.atleast_1d(row)
        for index in rows.tolist():
            if model is not None and model is not self.models[index]:
                if model.structure != self.structure or model.geometry != self.geometry:
                    raise InputError(
                        f"plant: model {model.name} has other effects or another geometry than "
                        "the plant was built with"
                    )
                self._bodies[index] = Bodies(model, self.contact)
                self.models[index] = model
            state = initial_state(self.models[index], **start)
            self._bodies[index].place(state)
            self._read(index, state[CLOCK], state[YAW])
        return self.state

    def step(self, torque: ArrayLike, duration: float) -> Array:
        """Move on by ``duration`` [s] under torques (4,) or (n, 4) [N m] that are held."""
        held = checked_torque(torque, len(self.states), single=self._single)
        self.advance(held, checked_duration(duration))
        return self.state

    def advance(self, torque: Array, duration: float) -> None:
        """``step`` for rows (n, 4), unchecked and without a result.

        A platform whose torques are no numbers, or which the engine gives up, is NaN from there on.
        """
        for index, bodies in enumerate(self._bodies):
            bodies.advance(torque[index], duration)
            state = self.states[index]
            self._read(index, state[CLOCK] + duration, state[YAW])

    def _read(self, index: int, time: float, yaw: float) -> None:
        """Fill the row ``index``; the yaw is the one next to ``yaw``, so it does not wrap."""
        bodies, state = self._bodies[index], self.states[index]
        bodies.read(state[TWIST], state[POSE], state[WHEEL_ANGLE], self.wheel_rates[index])
        heading = state[YAW]
        # A run that is lost has no heading (NaN): the last yaw is kept.
        state[YAW] = yaw + math.remainder(heading - yaw, 2 * math.pi) if heading == heading else yaw
        state[CLOCK] = time
        if self.structure.has_actuator:
            state[DRIVES] = bodies.acting

    def acting_torque(self, command: Array) -> Array:
        """Torques (n, 4) [N m] that act at the wheels now, whatever is commanded."""
        return np.stack([bodies.acting for bodies in self._bodies])

    @property
    def height(self) -> Array:
        """() or (n,) [m]: O above the floor; it ripples as the rollers pass."""
        found = np.array([bodies.height for bodies in self._bodies])
        return found[0] if self._single else found

    @property
    def energy(self) -> Array:
        """() or (n,) [J]: kinetic and potential energy of all bodies."""
        found = np.array([bodies.energy for bodies in self._bodies])
        return found[0] if self._single else found

    @property
    def wheel_speed(self) -> Array:
        """(4,) or (n, 4) [rad/s]: fl, fr, bl, br, slip included."""
        return (self.wheel_rates[0] if self._single else self.wheel_rates).copy()
