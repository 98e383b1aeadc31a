"""Steps of the body twist: hard starts and stops, in which drive lags and delays show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from youbot_env.errors import InputError, count, finite
from youbot_env.motions.base import Array, Motion
from youbot_env.motions.limits import MotionLimits
from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True, kw_only=True)
class Steps(Motion):
    """Twists held one after another, from one to the next by a quintic of length ``rise``.

    Attributes
    ----------
    rise : [s] from one level to the next
    hold : [s] from the start of one transition to that of the next
    levels : (k, 3) twists [m/s, m/s, rad/s]; before the first and after the last is rest

    Raises
    ------
    InputError
        If a number cannot be, no level is given, or a rise is longer than a hold.
    """

    kind: ClassVar[str] = "steps"

    rise: float
    hold: float
    levels: tuple[tuple[float, float, float], ...]
    duration: float = field(init=False)

    def __post_init__(self) -> None:
        self._check("rise", "hold", positive=True)
        what = f"motion '{self.name}'"
        if self.rise > self.hold:
            raise InputError(f"{what}: a rise of {self.rise:g} s does not fit into its hold")
        levels = tuple(self._level(what, level) for level in self.levels)
        if not levels:
            raise InputError(f"{what} levels: at least one twist is needed")
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "duration", len(levels) * self.hold + self.rise)
        super().__post_init__()

    @staticmethod
    def _level(what: str, level: Any) -> tuple[float, float, float]:
        if not isinstance(level, (list, tuple)) or len(level) != 3:
            raise InputError(f"{what} level: {level!r} is not three numbers VX, VY, W")
        vx, vy, wz = (finite(f"{what} level", value) for value in level)
        return vx, vy, wz

    def _curves(self, t: Array) -> tuple[Array, Array]:
        levels = np.vstack([np.zeros(3), self.levels, np.zeros(3)])
        index = np.clip(np.floor(t / self.hold), 0, len(levels) - 2).astype(int)
        u = np.clip((t - index * self.hold) / self.rise, 0.0, 1.0)[:, None]
        climb = levels[index + 1] - levels[index]
        twist = levels[index] + climb * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        moving = ((t > 0.0) & (t < self.duration))[:, None]  # exactly zero elsewhere, as promised
        slope = climb * 30.0 * u**2 * (1.0 - u) ** 2 / self.rise
        return np.where(moving, twist, 0.0), np.where(moving, slope, 0.0)

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "levels": [list(level) for level in self.levels]}

    @classmethod
    def _from_fields(cls, values: Mapping[str, Any]) -> Motion:
        if not isinstance(values["levels"], (list, tuple)):
            raise InputError("motion levels: a list of twists is needed")
        return cls(**{**values, "levels": tuple(values["levels"])})


def steps(
    rng: np.random.Generator,
    *,
    amplitude: tuple[float, float, float] = (0.25, 0.2, 0.7),
    duration: float = 60.0,
    rise: float = 0.15,
    hold: float = 0.9,
    geometry: Geometry | None = None,
    limits: MotionLimits | None = None,
    name: str = "steps",
) -> Steps:
    """Random steps, each followed by its opposite, so that the robot stays near its start.

    ``amplitude``: peaks of VX, VY [m/s] and W [rad/s], brought within the limits together. Rise
    and hold [s]: the default asks the paper's platform for some 2 N m, for moments.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    pairs = count("steps pairs", max(1, round(finite("steps duration", duration) / (2 * hold))))
    # At least 0.3 of the amplitude: a step near zero would show nothing.
    drawn = rng.uniform(0.3, 1.0, (pairs, 3)) * rng.choice([-1.0, 1.0], (pairs, 3))
    levels = np.repeat(drawn * amplitude, 2, axis=0)
    levels[1::2] *= -1.0
    geometry = geometry or Geometry()
    levels *= (limits or MotionLimits.of(geometry)).room(levels, geometry)
    rows = tuple((float(vx), float(vy), float(wz)) for vx, vy, wz in levels)
    return Steps(name=name, rise=rise, hold=hold, levels=rows)
