"""Which effects a model of a platform holds, and what probing them tells.

What an effect reads and whether it is linear is found by evaluating it, so that none declares it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import youbot_env.physics.catalogue  # noqa: F401 - fills the registries
from youbot_env.errors import InputError
from youbot_env.physics.effect import (
    ACTUATOR,
    BASE,
    CATALOGUE,
    CLOCK,
    WHEEL,
    Effect,
    Place,
    Registry,
    Wheel,
)
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.namespaces import floats
from youbot_env.physics.points import Base, EffectPoints, Instant, component_wrench


@dataclass(frozen=True)
class Composition:
    """Which effects a model holds beside the base: fixes the order of its parameters.

    A mechanism's own kind of it says what it chooses from:

    - base : the components of the base model
    - catalogue : the effects that can be added
    - motion_state : components of its state, before those of its drives
    - drive_state : components that an actuator effect adds: what acts

    Raises
    ------
    InputError
        If an effect is unknown or named twice, or two of them are actuators.
    """

    base: ClassVar[Registry]
    catalogue: ClassVar[Registry]
    motion_state: ClassVar[tuple[str, ...]]
    drive_state: ClassVar[tuple[str, ...]]

    effects: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"an effect is named twice: {', '.join(self.effects)}")
        if sum(item.acts_at is ACTUATOR for item in self.components) > 1:
            raise InputError("a model holds one actuator effect at most")

    def __getstate__(self) -> dict[str, Any]:
        return {"effects": self.effects}  # the effects themselves are found again by name

    @cached_property
    def components(self) -> tuple[Effect, ...]:
        """Base components, then the effects by name."""
        return (*self.base, *(self.catalogue[name] for name in self.effects))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of ``theta``: the base parameters, then ``effect.parameter``."""
        names = [name for item in self.base for name in item.parameter_names]
        for item in self.components[len(self.base) :]:
            names += [f"{item.name}.{name}" for name in item.parameter_names]
        return tuple(names)

    @cached_property
    def slices(self) -> tuple[tuple[Effect, slice], ...]:
        """Each component with its place in ``theta``."""
        found, start = [], 0
        for item in self.components:
            found.append((item, slice(start, start + len(item.parameter_names))))
            start = found[-1][1].stop
        return tuple(found)

    @cached_property
    def wrenches(self) -> tuple[tuple[Effect, slice], ...]:
        """The components that demand a force."""
        return tuple(row for row in self.slices if row[0].acts_at.kind == "wrench")

    def at(self, place: Place) -> list[tuple[Effect, slice]]:
        """The components that act at a place."""
        return [(item, where) for item, where in self.slices if item.acts_at is place]

    @cached_property
    def has_actuator(self) -> bool:
        """Whether what acts (the drives' torques, a force) is a state of its own."""
        return bool(self.at(ACTUATOR))

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Components of the state of a mechanism with these effects."""
        return self.motion_state + (self.drive_state if self.has_actuator else ())


STATE = (
    *("velocity_x", "velocity_y", "yaw_rate"),
    *("x", "y", "yaw"),
    *("angle_fl", "angle_fr", "angle_bl", "angle_br"),
    "time",
)
"""Components of a platform's state, before those of its drives."""

DRIVE_STATE = ("torque_fl", "torque_fr", "torque_bl", "torque_br")
"""The state that an actuator effect adds: the torques that act."""


@dataclass(frozen=True)
class ModelStructure(Composition):
    """Which effects a model of a platform holds beside the paper's base model."""

    base = BASE
    catalogue = CATALOGUE
    motion_state = STATE
    drive_state = DRIVE_STATE

    @cached_property
    def load_readers(self) -> tuple[tuple[Effect, slice], ...]:
        """Wheel effects that read the torque: probed, so that no effect has to declare it."""
        light, heavy = (Wheel(0.7, 0.7, 0.7, t, 0.7, Base(*[1.0] * 7)) for t in (0.3, 1.9))
        return self._telling_apart(light, heavy)

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether a wheel effect reads the torque."""
        return bool(self.load_readers)

    @cached_property
    def depends_on_angle(self) -> bool:
        """Whether a wheel effect reads the wheel's angle: probed."""
        here, there = (Wheel(0.7, 0.7, a, 0.7, 0.7, Base(*[1.0] * 7)) for a in (0.3, 1.9))
        return bool(self._telling_apart(here, there))

    def _telling_apart(self, first: Wheel, second: Wheel) -> tuple[tuple[Effect, slice], ...]:
        return tuple(
            (item, where)
            for item, where in self.at(WHEEL)
            if item.evaluate(floats, first, [0.5] * (where.stop - where.start))
            != item.evaluate(floats, second, [0.5] * (where.stop - where.start))
        )

    @cached_property
    def only_wrenches(self) -> bool:
        """Whether the interface torque is the torque that acts, at some time: no drive, no
        channel."""
        return all(item.acts_at.kind in ("wrench", "shift") for item, _ in self.slices)

    @cached_property
    def base_readers(self) -> frozenset[str]:
        """Names of the components that refer to base parameters: probed, not declared."""
        return frozenset(
            item.name
            for item, where in self.wrenches
            if _reads_base(item, where.stop - where.start)
        )

    @cached_property
    def is_linear(self) -> bool:
        """Whether the interface force is linear in the base parameters, whatever the others are."""
        return self.only_wrenches and not self.base_readers and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the interface force is not linear, even if
        all else is given: shifts, and wrenches that are found so by probing."""
        return frozenset(
            item.name
            for item, _ in self.slices
            if item.acts_at is CLOCK or (item.acts_at.kind == "wrench" and not _is_linear(item))
        )

    @cached_property
    def carriers(self) -> tuple[tuple[Effect, slice], ...]:
        """The loads: components that others reckon with beside the base parameters."""
        return tuple(row for row in self.slices if row[0].carries is not None)


_SOMEWHERE = Instant((0.3, 0.4, 0.5), (0.6, 0.7, 0.8), (0.1, 0.2, 0.3), (0.5,) * 4, (0.6,) * 4)
"""A motion in which all moves, turns and pulls: effects are probed there."""


def _reads_base(item: Effect, count: int) -> bool:
    """Whether an effect's value changes with the base parameters alone."""
    values = [0.5] * count
    # Not in proportion, so that a ratio such as the centre of mass m_aX/m0 is seen to change.
    first, second = (
        EffectPoints(floats, Geometry(), [scale**k for k in range(1, 8)], _SOMEWHERE)
        for scale in (1.3, 1.9)
    )
    return component_wrench(floats, item, values, first) != component_wrench(
        floats, item, values, second
    )


def _is_linear(item: Effect) -> bool:
    """Whether an effect's wrench is linear in its own parameters, shape constants apart."""
    declared = [item.parameter(name) for name in item.parameter_names]
    shape = [parameter.default or 0.0 for parameter in declared]
    size = [0.0 if parameter.is_shape else parameter.size for parameter in declared]
    # Early and late, since some effects begin and others fade.
    points = [
        EffectPoints(floats, Geometry(), [1.0] * 7, replace(_SOMEWHERE, time=time))
        for time in (0.7, 1000.0)
    ]

    def force(*parts: float) -> list[float]:
        # Neighbours get parts out of proportion, so that products and ratios are seen to change.
        share = [parts[k % len(parts)] for k in range(len(declared))]
        values = [c + s * part for c, s, part in zip(shape, size, share, strict=True)]
        return [f for point in points for f in component_wrench(floats, item, values, point)]

    rows = zip(force(0.5, 0.7, 0.3), force(0.4, 0.2, 0.8), force(1.3, 1.1, 1.9), strict=True)
    return all(abs(a + 2 * b - both) <= 1e-9 * (abs(a) + abs(b)) for a, b, both in rows)
