"""What a model of any mechanism is made of: its base's components, then added effects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from youbot_env.effects import ACTUATOR, Effect, Place, Registry
from youbot_env.errors import InputError


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
