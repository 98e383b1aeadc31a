"""What is evaluated: plants, models of them, loops and references, as options define them."""

from __future__ import annotations

import difflib
import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from controllers.interface import Loop
from controllers.recording import generator
from youbot_env.errors import InputError, count, finite
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import Motion, check_length
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import Geometry
from youbot_env.simulation.plant import Plant
from youbot_env.simulation.platforms import Platforms
from youbot_scripts.evaluation.summary import RUNS_ALSO
from youbot_scripts.recording.named_motions import with_effects
from youbot_scripts.recording.named_plants import Driven, plant_named

LAG = "actuator_lag"

KNOWN, IDENTIFIED, DIAGNOSED = "known", "identified", "diagnosed"

WORDS = (KNOWN, IDENTIFIED, DIAGNOSED)
"""Words that a user may give in place of a model file."""

Band = tuple[float, float]

BASIC = ("kinematic", "kinematic_tuned", "pid", "lqi", "computed_torque")
"""Compared unless others are named."""

WIDE: tuple[Band, ...] = ((0.5, 3.0),)
"""The whole band of the tracking task, undivided."""

MOST_SEEDS = 10_000
"""Most references of a band: their means are then known to a hundredth of their spread."""

SHORTEST = 20.0
"""Shortest judged duration [s], unless a duration is given."""


@dataclass(frozen=True)
class LoopSettings:
    """The loop between a controller and a plant, as options define it.

    Attributes
    ----------
    rate : of control [Hz]
    delay : whole control periods by which commands act late
    noise : standard deviation of a measured wheel speed [rad/s], on top of its encoder's counts
    pose : whether the controller gets the true pose; otherwise it gets wheel speeds only

    Raises
    ------
    InputError
        If a number is out of its range.
    """

    rate: float = 100.0
    delay: int = 1
    noise: float = 0.01
    pose: bool = False

    def __post_init__(self) -> None:
        finite("rate [Hz]", self.rate, positive=True)
        for name in ("delay", "noise"):
            finite(name, getattr(self, name), least=0.0)

    def known(self, geometry: Geometry) -> Loop:
        """The loop as a controller's designer knows it; the drives' lag is part of the model.

        Encoder counts over a period give the mean speed over it, which is half a period old.
        """
        period = 1.0 / self.rate
        return Loop(
            sample_time=period,
            delay=self.delay * period,
            measurement_delay=0.5 * period,
            torque_limit=geometry.max_wheel_torque,
            speed_noise=self.noise,
        )


@dataclass(frozen=True)
class PlantSource:
    """A platform that is driven. Its controllers may know less of it: see `ModelSource`.

    Attributes
    ----------
    source : a model file, "paper", or "contact[:SETTING=VALUE,...]", as ``record --plant`` takes it
    effects : added to it, as ``record --effect`` takes them
    surprises : further effects, present in the runs only and not while logs are made
    lag : time constant of the drives [s], 0 for none
    """

    source: str = "paper"
    effects: tuple[str, ...] = ()
    surprises: tuple[str, ...] = ()
    lag: float = 0.0

    @cached_property
    def recorded(self) -> Driven:
        """The plant as it is while logs are made."""
        lag = (f"{LAG}:time_constant={self.lag!r}",) if self.lag else ()
        return plant_named(self.source, (*self.effects, *lag))

    @cached_property
    def driven(self) -> Driven:
        """The plant as it is in the runs."""
        return replace(self.recorded, model=with_effects(self.recorded.model, self.surprises))

    @property
    def truth(self) -> Model:
        """The true model of the plant. A plant with contacts also has slip, which no model has."""
        return self.driven.model

    def platform(self) -> Platforms:
        """One platform for a closed loop.

        Raises
        ------
        InputError
            If MuJoCo is missing, or no bodies have these parameters and effects.
        """
        found = self.driven.platform()
        # A contact plant is a platform already; a model needs a simulation.
        return Plant(found) if isinstance(found, Model) else found

    def to_dict(self) -> dict[str, Any]:
        """JSON form of everything that determines its motion in the runs."""
        return self.driven.to_dict()

    def __str__(self) -> str:
        known = " + ".join((self.source, *self.effects))
        return RUNS_ALSO.join((known, *self.surprises))


@dataclass(frozen=True)
class ModelSource:
    """Where the controllers' model of a plant comes from.

    Attributes
    ----------
    how : "known" (the plant's own, exact), "identified" (the base model fitted to
        noisy logs of the plant, "identified+NAME" with an effect), "diagnosed" (the same, and
        whatever ``diagnose`` finds missing), or a model file. Drives that are known to lag belong
        to the base model.

    Raises
    ------
    InputError
        If it is none of these.
    """

    how: str = IDENTIFIED

    def __post_init__(self) -> None:
        word, *effects = self.how.split("+")
        if word == IDENTIFIED:
            for effect in effects:
                # Only for its error: the registry raises InputError, with a hint, for an unknown
                # name.
                CATALOGUE[effect]
        elif self.how not in (KNOWN, DIAGNOSED) and not Path(self.how).exists():
            self._check_file()

    def _check_file(self) -> None:
        try:
            load_model(self.how)
        except InputError as error:
            close = difflib.get_close_matches(self.how, WORDS, 1)
            hint = f"; did you mean {close[0]!r}?" if close else f", nor {', '.join(WORDS)}"
            raise InputError(f"{error}{hint}") from None

    @property
    def learns(self) -> bool:
        """Whether logs of the plant have to be made."""
        return self.how.split("+")[0] in (IDENTIFIED, DIAGNOSED)

    def __str__(self) -> str:
        return self.how


@dataclass(frozen=True)
class ReferenceMotion:
    """Random multisine references of a frequency band: see ``motions.multisine``.

    Attributes
    ----------
    band : lowest and highest frequency [rad/s]
    amplitude : peaks of VX, VY [m/s] and W [rad/s]
    duration : [s] that is judged, after the ramp
    ramp : [s] from rest to the full motion
    """

    band: tuple[float, float]
    amplitude: tuple[float, float, float] = (0.22, 0.18, 0.6)
    duration: float = 20.0
    ramp: float = 1.5

    @property
    def length(self) -> float:
        """[s] from the start to the end of the judged part, before the motion slows down."""
        return self.ramp + self.duration

    def motion(self, plant: PlantSource, seed: int, index: int) -> Motion:
        """The reference of one seed, the same for every controller, model and loop."""
        name = f"{self.band[0]:g}-{self.band[1]:g}"
        return multisine(
            generator(seed, str(index), name),
            band=self.band,
            amplitude=self.amplitude,
            duration=self.duration + 2 * self.ramp,
            ramp=self.ramp,
            geometry=plant.truth.geometry,
            name=name,
        )

    def __str__(self) -> str:
        return f"{self.band[0]:g}-{self.band[1]:g} rad/s"


@dataclass(frozen=True)
class Condition:
    """The conditions of a comparison: a plant, a model of it, and a loop."""

    plant: PlantSource
    model_source: ModelSource
    loop: LoopSettings

    def to_dict(self) -> dict[str, Any]:
        """JSON form, for people."""
        loop = {**asdict(self.loop), "lag": self.plant.lag}
        return {"plant": str(self.plant), "model": str(self.model_source), "loop": loop}


@dataclass(frozen=True)
class Settings:
    """Everything that determines the result of an evaluation.

    Attributes
    ----------
    plants, effects, surprises, lag : of the plants, see ``PlantSource``; effects are in every plant
    models : where the controllers' models come from, see ``ModelSource``
    controllers : names of the registry
    bands : of the references [rad/s]
    amplitude : peaks of VX, VY [m/s] and W [rad/s]
    seeds : references, with their noise, for each band
    duration : judged part [s]; None: one period of the band's slowest tone, at least 20 s
    rate, delay, noise, pose : see ``LoopSettings``
    against : the controller with which the others are compared

    Raises
    ------
    InputError
        If a list is empty, a plant or model is unknown, or a number is out of its range. Names of
        controllers are checked by ``evaluate``.
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
        count("seeds", self.seeds, most=MOST_SEEDS)
        finite("lag [s]", self.lag, least=0.0)
        if self.duration is not None:
            finite("duration [s]", self.duration, positive=True)
            check_length("duration", self.duration)
        # Makes one reference, so that a wrong band or amplitude is refused here and not after
        # hours.
        self.references()[0].motion(self.conditions()[0].plant, 0, 0)

    def conditions(self) -> list[Condition]:
        """Every plant with every model, in one loop."""
        loop = LoopSettings(self.rate, self.delay, self.noise, self.pose)
        plants = [
            PlantSource(source, self.effects, self.surprises, self.lag)
            # dict.fromkeys drops repetitions and keeps the order.
            for source in dict.fromkeys(self.plants)
        ]
        models = [ModelSource(how) for how in dict.fromkeys(self.models)]
        return [Condition(plant, model, loop) for plant, model in product(plants, models)]

    def references(self) -> list[ReferenceMotion]:
        """The references of each band."""
        return [
            ReferenceMotion(band, self.amplitude, self.duration or self._once_around(band))
            for band in self.bands
        ]

    def _once_around(self, band: Band) -> float:
        slowest = finite("band", band[0], positive=True)
        return max(SHORTEST, float(math.ceil(2 * math.pi / slowest)))
