"""Inverse dynamics of one axis from its effects, and everything that is derived from it.

As :mod:`youbot_env.dynamics` for the platform: all functions take the namespace ``xp`` first, so
that the same formulas are evaluated on arrays and traced for the compiled stepper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from identification import axis_catalogue
from identification.axis_catalogue import AXIS_BASE, AXIS_CATALOGUE, Base, Joint
from youbot_env import backends, codegen, effects
from youbot_env.backends import floats
from youbot_env.codegen import System
from youbot_env.effects import ACTUATOR, CLOCK, Actuator, Clock, Effect
from youbot_env.errors import InputError

STATE = ("speed", "position", "time")
"""Components of an axis' state; a drive adds the force that acts."""


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
class AxisStructure:
    """Which effects a model of an axis holds beside the base: fixes the order of theta."""

    effects: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"an effect is named twice: {', '.join(self.effects)}")
        if sum(item.acts_at is ACTUATOR for item in self.components) > 1:
            raise InputError("a model holds one actuator effect at most")

    @cached_property
    def components(self) -> tuple[Effect, ...]:
        """The base model's components, then the added effects."""
        return (*AXIS_BASE, *(AXIS_CATALOGUE[name] for name in self.effects))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of theta; parameters of effects as ``effect.parameter``."""
        names = [name for item in AXIS_BASE for name in item.parameter_names]
        for item in self.components[len(AXIS_BASE) :]:
            names += [f"{item.name}.{name}" for name in item.parameter_names]
        return tuple(names)

    @cached_property
    def slices(self) -> tuple[tuple[Effect, slice], ...]:
        """Each component with its place in theta."""
        found, start = [], 0
        for item in self.components:
            found.append((item, slice(start, start + len(item.parameter_names))))
            start = found[-1][1].stop
        return tuple(found)

    def of_kind(self, kind: str) -> list[tuple[Effect, slice]]:
        """Components that are a "wrench", an "actuator" or a "shift"."""
        return [row for row in self.slices if row[0].acts_at.kind == kind]

    @cached_property
    def has_actuator(self) -> bool:
        """Whether the force that acts is a state of its own."""
        return bool(self.of_kind("actuator"))

    @cached_property
    def has_clock(self) -> bool:
        """Whether the log's efforts act at other times than it says."""
        return any(item.acts_at is CLOCK for item in self.components)

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Components of the state."""
        return STATE + (("force",) if self.has_actuator else ())

    def _probe(self, force: float, base: float) -> list[Any]:
        """Values of the added effects at some instant, for some acting force and base."""
        joint = Joint(0.7, 0.6, 0.5, force, 0.4, Base(base, base, base, 0.3, base))
        return [
            item.evaluate(floats, joint, [0.5] * (where.stop - where.start))
            for item, where in self.of_kind("wrench")[len(AXIS_BASE) :]
        ]

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether an effect reads the force that acts: probed, so that none has to declare it."""
        return self._probe(0.3, 1.0) != self._probe(1.9, 1.0)

    @cached_property
    def is_linear(self) -> bool:
        """Whether the logged effort is linear in the parameters, shape constants apart."""
        reads_base = self._probe(0.3, 1.0) != self._probe(0.3, 1.9)
        wrenches_only = not self.has_actuator and not self.has_clock
        return wrenches_only and not reads_base and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the effort is not linear: shifts in time."""
        return frozenset(item.name for item, _ in self.of_kind("shift"))


def _joint(theta: Any, at: Instant) -> Joint:
    base = Base(*theta[: len(Base._fields)])
    return Joint(at.rate, at.acceleration, at.position, at.force, at.time, base)


def demanded_force(xp: Any, structure: AxisStructure, theta: Any, at: Instant) -> Any:
    """Force that a motion demands while ``at.force`` acts."""
    joint = _joint(theta, at)
    return sum(
        item.evaluate(xp, joint, theta[where]) for item, where in structure.of_kind("wrench")
    )


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
    for item, where in structure.of_kind("actuator"):
        return item.evaluate(xp, drive, theta[where])
    return drive.torque


def delay(structure: AxisStructure, theta: Any) -> float:
    """How much later [s] than logged the efforts act."""
    found = [
        item.evaluate(floats, Clock(), theta[where]) for item, where in structure.of_kind("shift")
    ]
    return float(sum(found))


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


_SOURCES = (backends.__name__, codegen.__name__, effects.__name__, axis_catalogue.__name__)

SYSTEM = System(state_derivative, inputs=1, lengths=(), sources=(__name__, *_SOURCES))
"""What the compiled stepper is generated from."""
