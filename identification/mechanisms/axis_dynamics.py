"""Inverse dynamics of one axis from its effects, and everything that is derived from it.

As :mod:`youbot_env.physics.inverse_dynamics` for the platform: all functions take the namespace
``xp`` first, so that the same formulas are evaluated on arrays and traced for the compiled stepper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from identification.mechanisms import axis_effects as axis_catalogue
from identification.mechanisms.axis_effects import AXIS_BASE, AXIS_CATALOGUE, Base, Joint
from youbot_env.errors import InputError
from youbot_env.physics import effect, namespaces, structure
from youbot_env.physics.effect import ACTUATOR, CLOCK, Actuator, Clock
from youbot_env.physics.namespaces import floats
from youbot_env.physics.structure import Composition
from youbot_env.simulation import generated_code
from youbot_env.simulation.generated_code import System

STATE = ("speed", "position", "time")
"""Components of an axis' state, before that of its drive."""

DRIVE_STATE = ("force",)
"""The state that an actuator effect adds: the force that acts."""


@dataclass(frozen=True)
class Instant:
    """What the motion of an axis is at one instant (or at many: arrays of one shape).

    ``force`` is the force that truly acts: only effects that depend on the load read it.
    """

    rate: Any
    acceleration: Any = 0.0
    position: Any = 0.0
    force: Any = 0.0
    time: Any = 0.0


@dataclass(frozen=True)
class AxisStructure(Composition):
    """Which effects a model of an axis holds beside the base."""

    base = AXIS_BASE
    catalogue = AXIS_CATALOGUE
    motion_state = STATE
    drive_state = DRIVE_STATE

    def _probe(self, force: float, base: float) -> list[Any]:
        """Values of the added effects at some instant, for some acting force and base."""
        joint = Joint(0.7, 0.6, 0.5, force, 0.4, Base(base, base, base, 0.3, base))
        return [
            item.evaluate(floats, joint, [0.5] * (where.stop - where.start))
            for item, where in self.wrenches[len(AXIS_BASE) :]
        ]

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether an effect reads the force that acts: probed, so that none has to declare it."""
        return self._probe(0.3, 1.0) != self._probe(1.9, 1.0)

    @cached_property
    def is_linear(self) -> bool:
        """Whether the logged effort is linear in the parameters, shape constants apart."""
        reads_base = self._probe(0.3, 1.0) != self._probe(0.3, 1.9)
        only_wrenches = self.wrenches == self.slices
        return only_wrenches and not reads_base and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the effort is not linear: shifts in time."""
        return frozenset(item.name for item, _ in self.at(CLOCK))


def _joint(theta: Any, at: Instant) -> Joint:
    base = Base(*theta[: len(Base._fields)])
    return Joint(at.rate, at.acceleration, at.position, at.force, at.time, base)


def demanded_force(xp: Any, structure: AxisStructure, theta: Any, at: Instant) -> Any:
    """Force that a motion demands while ``at.force`` acts."""
    joint = _joint(theta, at)
    return sum(item.evaluate(xp, joint, theta[where]) for item, where in structure.wrenches)


def acting_force(xp: Any, structure: AxisStructure, theta: Any, at: Instant) -> Any:
    """Force that drives a motion, losses under load included: a fixed point.

    Raises
    ------
    InputError
        If the losses eat what is put in and no force can drive the motion.
    """
    force = demanded_force(xp, structure, theta, at)
    if not structure.depends_on_load:
        return force
    # Shares are below one, so the iteration contracts: 330 rounds at the largest, 0.9.
    for _ in range(1000):
        last = force
        force = demanded_force(xp, structure, theta, replace(at, force=last))
        if xp.abs(force - last).max() <= 1e-12 * xp.abs(force).max():
            return force
    raise InputError("no force drives this motion: friction grows as fast as the force")


def drive_command(xp: Any, structure: AxisStructure, theta: Any, drive: Actuator) -> Any:
    """Effort behind a drive that the acting force and its rate demand."""
    for item, where in structure.at(ACTUATOR):
        return item.evaluate(xp, drive, theta[where])
    return drive.torque


def delay(structure: AxisStructure, theta: Any) -> float:
    """How much later [s] than logged the efforts act."""
    shifts = structure.at(CLOCK)
    return float(sum(item.evaluate(floats, Clock(), theta[where]) for item, where in shifts))


def acceleration(xp: Any, structure: AxisStructure, theta: Any, at: Instant) -> Any:
    """Acceleration under the force ``at.force`` that acts."""
    still = demanded_force(xp, structure, theta, replace(at, acceleration=0.0))
    moved = demanded_force(xp, structure, theta, replace(at, acceleration=1.0))
    return (at.force - still) / (moved - still)


def state_derivative(
    xp: Any, structure: AxisStructure, lengths: Any, theta: Any, state: Any, effort: Sequence[Any]
) -> tuple[Any, ...]:
    """Time derivative of the state (``structure.state_names``) under an effort of the drive."""
    speed, position, time = state[:3]
    command = effort[0]
    force = state[3] if structure.has_actuator else command
    at = Instant(speed, position=position, force=force, time=time)
    moved = (acceleration(xp, structure, theta, at), speed, 1.0)
    if not structure.has_actuator:
        return moved
    zero = drive_command(xp, structure, theta, Actuator(force, 0.0, time))
    one = drive_command(xp, structure, theta, Actuator(force, 1.0, time))
    return (*moved, (command - zero) / (one - zero))


_SOURCES = (axis_catalogue, namespaces, generated_code, structure, effect)

SYSTEM = System(
    state_derivative,
    inputs=1,
    lengths=(),
    sources=(__name__, *(module.__name__ for module in _SOURCES)),
)
"""What the compiled stepper is generated from."""
