"""What moves: a model, or another simulator's platform, with what is hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from controllers.recording import Progress, record
from identification.logs.log import Log
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.simulation.plant import Plant
from youbot_env.simulation.platforms import Platforms
from youbot_scripts.recording.named_motions import with_effects
from youbot_scripts.recording.named_plants import Driven, plant_named

LAG = "actuator_lag"

SURPRISE = ", in the runs also "
"""Between what logs have seen of a plant and what they have not, in its name."""


@dataclass(frozen=True)
class PlantSource:
    """A platform that is driven; what its controllers know of it is another matter.

    Attributes
    ----------
    source : a model file, "paper", or "contact[:SETTING=VALUE,...]", as ``record --plant`` takes it
    effects : added to it, as ``record --effect`` takes them
    surprises : more of them, in the runs alone: no log has seen them
    lag : time constant of the drives [s], 0 for none
    """

    source: str = "paper"
    effects: tuple[str, ...] = ()
    surprises: tuple[str, ...] = ()
    lag: float = 0.0

    @cached_property
    def recorded(self) -> Driven:
        """What moves while logs are made, in parts."""
        lag = (f"{LAG}:time_constant={self.lag!r}",) if self.lag else ()
        return plant_named(self.source, (*self.effects, *lag))

    @cached_property
    def driven(self) -> Driven:
        """What moves in the runs."""
        return replace(self.recorded, model=with_effects(self.recorded.model, self.surprises))

    @property
    def truth(self) -> Model:
        """The model that knows all that a model can know of it; with contacts that is not all."""
        return self.driven.model

    def platform(self) -> Platforms:
        """One platform for a closed loop.

        Raises
        ------
        InputError
            If MuJoCo is missing, or no bodies have these parameters and effects.
        """
        found = self.driven.platform()
        return Plant(found) if isinstance(found, Model) else found

    def logs(
        self, motions: Sequence[Motion], seed: int, progress: Progress | None = None
    ) -> list[Log]:
        """What a robot would have logged along motions, under the stock control, with noise."""
        return record(self.recorded.platform(), motions, seed=seed, progress=progress)

    def to_dict(self) -> dict[str, Any]:
        """All that its motion in the runs depends on."""
        return self.driven.to_dict()

    def __str__(self) -> str:
        known = " + ".join((self.source, *self.effects))
        return SURPRISE.join((known, *self.surprises))
