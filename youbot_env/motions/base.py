"""Motions of the platform as smooth functions of time: the base class and composition."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError, finite
from youbot_env.files import FileKind

Array = NDArray[np.float64]

LONGEST = 86400.0
"""[s] Longest motion, a day: its samples must fit into memory."""


def check_length(what: str, duration: float) -> None:
    """Refuse a duration [s] over ``LONGEST``."""
    if duration > LONGEST:
        raise InputError(f"{what}: {duration:g} s is longer than a day ({LONGEST:g} s)")


def window(t: Array, duration: float, ramp: float) -> tuple[Array, Array, Array]:
    """Quintic window over [0, duration] and its first and second derivative, each like t.

    Rises as u^3 (10 - 15 u + 6 u^2), u = t/ramp, stays at 1, and falls as it rose. It is twice
    continuously differentiable everywhere and exactly zero, with both derivatives, outside.
    """
    # Distance to the nearer end, so that the fall mirrors the rise.
    u = np.clip(np.minimum(t, duration - t) / ramp, 0.0, 1.0)
    slope = np.where(t < duration / 2, 1.0, -1.0) / ramp
    rise = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    first = 30.0 * u**2 * (1.0 - u) ** 2 * slope
    second = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / ramp**2
    return rise, first, second


@dataclass(frozen=True, kw_only=True)
class Motion(ABC):
    """A body twist that starts and ends at rest, with its exact derivative.

    Twist (VX, VY, W) [m/s, m/s, rad/s] and acceleration (VX', VY', W') [m/s^2, m/s^2, rad/s^2]
    are components in the body frame; the acceleration is their plain time derivative. Both are
    continuous and exactly zero outside [0, duration].

    A final subclass names its ``kind``, holds JSON-able fields and writes ``_curves``.

    Attributes
    ----------
    name : a word for tables and file names
    duration : [s]
    """

    kind: ClassVar[str]
    kinds: ClassVar[dict[str, type[Motion]]] = {}

    name: str
    duration: float

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # Not an inherited kind: abstract classes between have none of their own.
        if "kind" in cls.__dict__:
            Motion.kinds[cls.kind] = cls

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"motion name: {self.name!r} is not a text")
        self._check("duration", positive=True)
        check_length(f"motion '{self.name}' duration", self.duration)

    def _check(self, *names: str, positive: bool = False) -> None:
        """Turns the named fields into floats, or raises InputError."""
        for name in names:
            what = f"motion '{self.name}' {name}"
            object.__setattr__(self, name, finite(what, getattr(self, name), positive=positive))

    @abstractmethod
    def _curves(self, t: Array) -> tuple[Array, Array]:
        """Twist and acceleration (n, 3) at times (n,) [s]."""

    def evaluate(self, t: ArrayLike) -> tuple[Array, Array]:
        """Twist and acceleration (..., 3) at times (...) [s]; cheaper than one by one."""
        times = np.asarray(t, float)
        twist, acceleration = self._curves(times.reshape(-1))
        shape = (*times.shape, 3)
        return twist.reshape(shape), acceleration.reshape(shape)

    def twist(self, t: ArrayLike) -> Array:
        """Body twist (..., 3) (VX, VY, W) [m/s, m/s, rad/s] at times (...) [s]."""
        return self.evaluate(t)[0]

    def acceleration(self, t: ArrayLike) -> Array:
        """Body-frame derivative (..., 3) of the twist [m/s^2, m/s^2, rad/s^2]."""
        return self.evaluate(t)[1]

    def to_dict(self) -> dict[str, Any]:
        """A JSON-able description, from which ``motion_from_dict`` builds the motion again."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.init}
        return {"kind": self.kind, **values}

    @classmethod
    def _from_fields(cls, values: Mapping[str, Any]) -> Motion:
        return cls(**values)


@dataclass(frozen=True, kw_only=True)
class MotionSequence(Motion):
    """Motions one after another. Each is a body twist, so the heading simply carries over.

    Raises
    ------
    InputError
        If ``parts`` is empty or holds anything but motions.
    """

    kind: ClassVar[str] = "sequence"

    parts: tuple[Motion, ...]
    duration: float = field(init=False)

    def __post_init__(self) -> None:
        parts = tuple(self.parts)
        if not parts or not all(isinstance(part, Motion) for part in parts):
            raise InputError(f"motion '{self.name}': parts must be one motion or more")
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "duration", sum(part.duration for part in parts))
        super().__post_init__()

    def segments(self) -> list[tuple[str, float, float]]:
        """(name, start, end) [s] of each part."""
        ends = np.cumsum([part.duration for part in self.parts]).tolist()
        return list(zip((p.name for p in self.parts), [0.0, *ends[:-1]], ends, strict=True))

    def _curves(self, t: Array) -> tuple[Array, Array]:
        twist, acceleration = np.zeros((2, len(t), 3))
        for part, (_, start, end) in zip(self.parts, self.segments(), strict=True):
            # Half open, so that an instant belongs to one part. At the very end the twist is zero.
            inside = (t >= start) & (t < end)
            if inside.any():
                twist[inside], acceleration[inside] = part.evaluate(t[inside] - start)
        return twist, acceleration

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "parts": [part.to_dict() for part in self.parts]}

    @classmethod
    def _from_fields(cls, values: Mapping[str, Any]) -> Motion:
        parts = values["parts"]
        if not isinstance(parts, (list, tuple)):
            raise InputError("motion parts: a list of motions is needed")
        return cls(**{**values, "parts": tuple(motion_from_dict(part) for part in parts)})


def sequence(parts: Sequence[Motion], name: str = "sequence") -> MotionSequence:
    """The motions one after another as one motion."""
    return MotionSequence(name=name, parts=tuple(parts))


def motion_from_dict(description: Mapping[str, Any]) -> Motion:
    """The motion that ``Motion.to_dict`` described.

    Raises
    ------
    InputError
        If the kind is unknown, or a field is missing, unknown or cannot be.
    """
    if not isinstance(description, Mapping):
        raise InputError(f"motion: {description!r} is not an object with a 'kind'")
    values = dict(description)
    kind = values.pop("kind", None)
    if not isinstance(kind, str) or kind not in Motion.kinds:
        raise InputError(f"motion kind: {kind!r} is none of {', '.join(sorted(Motion.kinds))}")
    known = {f.name for f in fields(Motion.kinds[kind]) if f.init}
    # In one of the two sets only: a missing field, or an unknown one.
    for name in sorted(known ^ set(map(str, values))):
        state = "is missing" if name in known else f"is unknown, use {', '.join(sorted(known))}"
        raise InputError(f"motion of kind '{kind}': field '{name}' {state}")
    return Motion.kinds[kind]._from_fields(values)


def sample(motion: Motion, dt: float, n: int) -> Array:
    """Twists (n, 3) [m/s, m/s, rad/s] at times 0, dt, ..., (n - 1) dt [s]."""
    return motion.twist(finite("sample step dt", dt, positive=True) * np.arange(n))


MOTION_FILE = FileKind(
    "a motion file",
    {"type": "object"},
    lambda content, source: motion_from_dict(content),
    version=None,
)
"""A file that holds one motion. Its fields are those of the motion's kind, which checks them."""
