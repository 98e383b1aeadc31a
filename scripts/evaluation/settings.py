"""What is evaluated: settings as a user states them, ready-made suites, and the conditions."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

from controllers import registry
from youbot_env.errors import InputError, count, finite
from youbot_scripts.evaluation.knowledge import IDENTIFIED, ModelSource
from youbot_scripts.evaluation.loop_settings import LoopSettings
from youbot_scripts.evaluation.plants import PlantSource
from youbot_scripts.evaluation.trials import Condition, ReferenceMotion

Band = tuple[float, float]

BASIC = ("kinematic", "kinematic_tuned", "pid", "lqi", "computed_torque")
"""Compared unless others are named."""

WIDE: tuple[Band, ...] = ((0.5, 3.0),)
"""The band of the tracking task, as one."""

SHORTEST = 20.0
"""Least duration [s] of what is judged, unless another is asked for."""


@dataclass(frozen=True)
class Settings:
    """All that decides what an evaluation finds.

    Attributes
    ----------
    plants, effects, surprises, lag : what moves, see ``PlantSource``; effects are in every plant
    models : how the controllers' models of it come about, see ``ModelSource``
    controllers : names of the registry
    bands : of the references [rad/s]
    amplitude : peaks of VX, VY [m/s] and W [rad/s]
    seeds : references, with their noise, for each band
    duration : [s] that is judged; None is once around the band's slowest tone, at least 20 s
    rate, delay, noise, pose : see ``LoopSettings``
    against : the controller that others are measured by

    Raises
    ------
    InputError
        If a name is unknown or a number cannot be.
    """

    plants: tuple[str, ...] = ("paper",)
    effects: tuple[str, ...] = ()
    surprises: tuple[str, ...] = ()
    lag: float = 0.0
    models: tuple[str, ...] = (IDENTIFIED,)
    controllers: tuple[str, ...] = BASIC
    bands: tuple[Band, ...] = ((0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0))
    amplitude: tuple[float, float, float] = (0.22, 0.18, 0.6)
    seeds: int = 5
    duration: float | None = None
    rate: float = 100.0
    delay: int = 1
    noise: float = 0.01
    pose: bool = False
    against: str = "kinematic_tuned"

    def __post_init__(self) -> None:
        for name in ("plants", "models", "controllers", "bands"):
            if not getattr(self, name):
                raise InputError(f"{name}: none is named")
        for controller in self.controllers:
            registry.check(controller)
        count("seeds", self.seeds)
        finite("lag [s]", self.lag, least=0.0)
        if self.duration is not None:
            finite("duration [s]", self.duration, positive=True)
        self.courses()[0].motion(self.conditions()[0].plant, 0, 0)

    def conditions(self) -> list[Condition]:
        """Every plant with every model, in one loop."""
        loop = LoopSettings(self.rate, self.delay, self.noise, self.pose)
        plants = [
            PlantSource(source, self.effects, self.surprises, self.lag)
            for source in dict.fromkeys(self.plants)
        ]
        models = [ModelSource(how) for how in dict.fromkeys(self.models)]
        return [Condition(plant, model, loop) for plant, model in product(plants, models)]

    def courses(self) -> list[ReferenceMotion]:
        """The references of each band."""
        return [
            ReferenceMotion(band, self.amplitude, self.duration or self._once_around(band))
            for band in self.bands
        ]

    def _once_around(self, band: Band) -> float:
        slowest = finite("band", band[0], positive=True)
        return max(SHORTEST, float(math.ceil(2 * math.pi / slowest)))


SUITES: dict[str, Mapping[str, Any]] = {
    "paper": {},
    "prompt": {
        "models": ("known", "identified"),
        "controllers": (*BASIC, "adaptive", "kinematic_free"),
        "bands": WIDE,
    },
    "late": {
        "models": ("known", "identified"),
        "controllers": (*BASIC, "adaptive", "kinematic_free"),
        "bands": WIDE,
        "delay": 3,
        "lag": 0.03,
    },
    "saturated": {"bands": ((4.0, 8.0),), "amplitude": (0.4, 0.3, 1.0)},
    "payload": {
        "surprises": ("payload_change:mass=8,x=0.1,y=0.05,time=20",),
        "controllers": ("kinematic_tuned", "computed_torque", "adaptive"),
        "bands": WIDE,
        "duration": 45.0,
    },
    "tilt": {
        "effects": ("floor_tilt:tilt_x=-0.018,tilt_y=-0.004",),
        "models": ("identified", "diagnosed"),
        "bands": WIDE,
    },
    "contact": {"plants": ("contact",), "bands": WIDE, "delay": 3, "lag": 0.03},
    "coulomb": {
        "effects": ("wheel_coulomb_friction:torque=0.1",),
        "models": ("identified", "diagnosed"),
        "bands": WIDE,
    },
}
"""Settings under a name; what a user says beside it goes first.

paper: the paper's claim, band by band; prompt, late: one sample of delay, and three with drives
that lag by 30 ms; saturated: references beyond the torque limit; contact: real rollers on a real
floor; payload: a load is put on in mid-run; tilt, coulomb: an effect is hidden, before and after
it is diagnosed.
"""


def settings(suite: str, given: Mapping[str, Any]) -> Settings:
    """Settings of a suite, changed where ``given`` holds more than None.

    Raises
    ------
    InputError
        If the suite is unknown, or the settings cannot be.
    """
    if suite not in SUITES:
        close = difflib.get_close_matches(suite, SUITES, 1)
        hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(SUITES)}"
        raise InputError(f"suite {suite!r}: not known; {hint}")
    names = {field.name for field in fields(Settings)}
    said = {name: value for name, value in given.items() if value is not None}
    assert names.issuperset(said)
    chosen = Settings(**{**SUITES[suite], **said})
    if "against" in said and chosen.against not in chosen.controllers:
        raise InputError(
            f"against: {chosen.against!r} is not compared; name one of "
            f"{', '.join(chosen.controllers)}"
        )
    return chosen


def words(what: str, text: str | None) -> tuple[str, ...] | None:
    """Names separated by commas, or InputError if there is none."""
    if text is None:
        return None
    found = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    if not found:
        raise InputError(f"{what}: none is named")
    return found


def bands(text: str | None) -> tuple[Band, ...] | None:
    """Bands [rad/s] such as "0.5-1,1-2"."""
    if text is None:
        return None
    found = []
    for word in words("bands", text) or ():
        low, _, high = word.partition("-")
        try:
            edges = float(low), float(high)
        except ValueError:
            edges = (math.nan, math.nan)
        if not 0 < edges[0] < edges[1] < math.inf:
            raise InputError(f"bands: {word!r} is no band in rad/s; write for instance 0.5-1,1-2")
        found.append(edges)
    return tuple(found)


def amplitude(text: str | None) -> tuple[float, float, float] | None:
    """Peaks of VX, VY [m/s] and W [rad/s] such as "0.22,0.18,0.6"."""
    if text is None:
        return None
    try:
        vx, vy, wz = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(
            f"amplitude: {text!r} is not three numbers; write for instance 0.22,0.18,0.6"
        ) from None
    return vx, vy, wz
