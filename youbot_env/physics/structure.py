"""Which effects a model holds beside its mechanism's base, and what trying them tells.

What an effect reads and whether it is linear is found by evaluating it, so that none declares it.
On numbers, not on symbols: 0.4 ms for a structure, where sympy takes 70 ms and a second to load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from youbot_env.errors import InputError
from youbot_env.physics.effect import ACTUATOR, CLOCK, Effect, Place
from youbot_env.physics.mechanism import EffectPoints, Instant, MechanismKind, component_force
from youbot_env.physics.namespaces import floats


@dataclass(frozen=True)
class ModelStructure:
    """Which effects a model of a mechanism holds beside the base: fixes the order of theta.

    Raises
    ------
    InputError
        If an effect is unknown or named twice, or two of them are actuators.
    """

    effects: tuple[str, ...]
    mechanism: MechanismKind

    def __post_init__(self) -> None:
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"an effect is named twice: {', '.join(self.effects)}")
        if sum(item.acts_at is ACTUATOR for item in self.components) > 1:
            raise InputError("a model holds one actuator effect at most")

    def __getstate__(self) -> dict[str, Any]:
        # The effects themselves are found again by name.
        return {"effects": self.effects, "mechanism": self.mechanism}

    def with_effects(self, effects: Sequence[str]) -> ModelStructure:
        """The structure of the same mechanism with other effects."""
        return ModelStructure(tuple(effects), self.mechanism)

    @cached_property
    def components(self) -> tuple[Effect, ...]:
        """Base components, then the effects by name."""
        catalogue = self.mechanism.catalogue
        return (*self.mechanism.base, *(catalogue[name] for name in self.effects))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of ``theta``: the base parameters, then ``effect.parameter``."""
        base = self.mechanism.base
        names = [name for item in base for name in item.parameter_names]
        for item in self.components[len(base) :]:
            names += [f"{item.name}.{name}" for name in item.parameter_names]
        return tuple(names)

    @cached_property
    def base_names(self) -> tuple[str, ...]:
        """Parameters of the base model, in the order of theta, which begins with them."""
        return tuple(name for item in self.mechanism.base for name in item.parameter_names)

    @cached_property
    def slices(self) -> tuple[tuple[Effect, slice], ...]:
        """Each component with its place in ``theta``."""
        found: list[tuple[Effect, slice]] = []
        start = 0
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
        return self.mechanism.state + (self.mechanism.drive_state if self.has_actuator else ())

    @cached_property
    def carriers(self) -> tuple[tuple[Effect, slice], ...]:
        """The loads: components that others reckon with beside the base parameters."""
        return tuple(row for row in self.slices if row[0].carries is not None)

    @cached_property
    def only_wrenches(self) -> bool:
        """Whether the interface torque is the torque that acts, at some time: no drive, no
        channel."""
        return all(item.acts_at.kind in ("wrench", "shift") for item, _ in self.slices)

    # What effects read: tried, not declared -----------------------------------------------------

    @cached_property
    def load_readers(self) -> tuple[tuple[Effect, slice], ...]:
        """Effects that read the torque that acts."""
        light, heavy = self._two_sets()
        return self._telling_apart(
            replace(self._somewhere, torque=light), replace(self._somewhere, torque=heavy)
        )

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether an effect reads the torque that acts."""
        return bool(self.load_readers)

    @cached_property
    def depends_on_angle(self) -> bool:
        """Whether an effect reads the angle of a joint."""
        here, there = self._two_sets()
        found = self._telling_apart(
            replace(self._somewhere, wheel_angle=here), replace(self._somewhere, wheel_angle=there)
        )
        return bool(found)

    def _two_sets(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Two sets of torques, or of angles, in no proportion: what they make cannot cancel."""
        joints = range(len(self.mechanism.joints))
        return tuple(0.3 + 0.1 * k for k in joints), tuple(1.9 - 0.17 * k for k in joints)

    @cached_property
    def base_readers(self) -> frozenset[str]:
        """Names of the components that refer to base parameters."""
        # Not in proportion, so that a ratio such as the centre of mass m_aX/m0 is seen to change.
        first, second = (
            self._tried_at(self._somewhere, [scale**k for k in range(1, len(self.base_names) + 1)])
            for scale in (1.3, 1.9)
        )
        return frozenset(
            item.name
            for item, where in self.wrenches
            if _tried(item, where, first) != _tried(item, where, second)
        )

    @cached_property
    def is_linear(self) -> bool:
        """Whether the interface force is linear in the base parameters, whatever the others are."""
        return self.only_wrenches and not self.base_readers and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the interface force is not linear, even if
        all else is given: shifts, and wrenches that are found so by trying."""
        return frozenset(
            item.name
            for item, _ in self.slices
            if item.acts_at is CLOCK
            or (item.acts_at.kind == "wrench" and not self._is_linear(item))
        )

    @cached_property
    def _somewhere(self) -> Instant:
        """A motion in which all moves, turns and pulls: effects are tried there."""
        mechanism = self.mechanism

        def some(start: float, names: Sequence[str]) -> tuple[float, ...]:
            return tuple(start + 0.1 * k for k in range(len(names)))

        return Instant(
            some(0.3, mechanism.axes),
            some(0.6, mechanism.axes),
            some(0.1, mechanism.pose_state),
            some(0.5, mechanism.joints),
            some(0.6, mechanism.joints),
        )

    def _tried_at(self, at: Instant, base: Sequence[float]) -> EffectPoints:
        return EffectPoints(floats, self.mechanism, self.mechanism.geometry, base, at)

    def _telling_apart(self, first: Instant, second: Instant) -> tuple[tuple[Effect, slice], ...]:
        ones = [1.0] * len(self.base_names)
        here, there = self._tried_at(first, ones), self._tried_at(second, ones)
        return tuple(
            (item, where)
            for item, where in self.wrenches
            if _tried(item, where, here) != _tried(item, where, there)
        )

    def _is_linear(self, item: Effect) -> bool:
        """Whether an effect's force is linear in its own parameters, shape constants apart."""
        declared = [item.parameter(name) for name in item.parameter_names]
        shape = [parameter.default or 0.0 for parameter in declared]
        size = [0.0 if parameter.is_shape else parameter.size for parameter in declared]
        ones = [1.0] * len(self.base_names)
        # Early and late, since some effects begin and others fade.
        points = [
            self._tried_at(replace(self._somewhere, time=time), ones) for time in (0.7, 1000.0)
        ]

        def force(*parts: float) -> list[float]:
            # Neighbours out of proportion, so that products and ratios are seen to change.
            share = [parts[k % len(parts)] for k in range(len(declared))]
            values = [c + s * part for c, s, part in zip(shape, size, share, strict=True)]
            return [f for point in points for f in component_force(item, values, point)]

        rows = zip(force(0.5, 0.7, 0.3), force(0.4, 0.2, 0.8), force(1.3, 1.1, 1.9), strict=True)
        return all(abs(a + 2 * b - both) <= 1e-9 * (abs(a) + abs(b)) for a, b, both in rows)


def _tried(item: Effect, where: slice, points: EffectPoints) -> tuple[Any, ...]:
    return component_force(item, [0.5] * (where.stop - where.start), points)
