"""What the commands of a loop come to at the wheels, and whether the wheels agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.interface import Array, Loop
from controllers.linear.linear_system import TWIST, twist_dynamics
from youbot_env.model.model import Model
from youbot_env.simulation.delay_line import DelayLine

CONTRADICTION = 0.05
"""Share of the torque limit by which a measured torque may differ from the expected one."""


def drive_lag(model: Model) -> float:
    """Time constant [s] of the drives; 0 for a model whose torques act at once."""
    if not model.structure.has_actuator:
        return 0.0
    return -1.0 / float(twist_dynamics(model).a[3, 3])


class Inertia(NamedTuple):
    """Mass (3, 3) and viscous friction (3, 3) of F = mass v' + friction v."""

    mass: Array
    friction: Array


def effective_mass(model: Model) -> Inertia:
    """What the commanded body force (3,) meets once everything turns.

    The wheels' spin is in it, and so is a gain between commanded and acting torque.
    """
    plant = twist_dynamics(model)
    push = plant.b[TWIST]
    if len(plant.a) > 3:
        push = push - plant.a[:3, 3:] @ np.linalg.solve(plant.a[3:, 3:], plant.b[3:])
    mass = np.asarray(np.linalg.inv(push), float)
    return Inertia(mass, -mass @ plant.a[TWIST, TWIST])


class CommandTracker:
    """Follows commanded wheel torques through the loop's delay and the drives' lag.

    Call once a sample: ``contradiction`` with what is measured, then ``command``.
    """

    def __init__(self, model: Model, loop: Loop) -> None:
        self.period = loop.sample_time
        self.delay = loop.delay + max(model.delay, 0.0)
        self.lag = drive_lag(model)
        self.tolerance = CONTRADICTION * loop.torque_limit
        self.reset()

    def reset(self) -> None:
        """Nothing is on its way."""
        self._line = DelayLine(self.delay)
        self._last: Array = np.zeros(4)
        self.acting: Array = np.zeros(4)

    def contradiction(self, measured: Array | None) -> Array | None:
        """Measured minus expected torque (4,) [N m], where it is known and cannot be ours.

        None where it is not known, or is what the commands make of it, or is the last command: some
        loops report that.
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
        for (late,), piece in self._line.passed(torque[None], self.period):
            keep = np.exp(-piece / self.lag) if self.lag > 0.0 else 0.0
            self.acting = late + keep * (self.acting - late)
