"""What platforms are built from, checked, and what follows from it however they are moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.contact.settings import Contact
from youbot_env.errors import InputError, finite
from youbot_env.motions.base import Motion
from youbot_env.simulation.plant import plant_substeps
from youbot_env.tracking.actuation import Actuation
from youbot_env.tracking.randomisation import Same, Source
from youbot_env.tracking.sensors import Sensors
from youbot_env.tracking.task import TrackingTask

Array = NDArray[np.float64]

START_SIZES = {"twist": 3, "pose": 3, "wheel_angle": 4, "torque": 4, "time": 0}
"""What an initial state may name, and how many numbers each takes (0: one plain number)."""


@dataclass(frozen=True)
class Setup:
    """All that an environment is built from; checked once, here and in its parts.

    Attributes
    ----------
    source : where each episode's model comes from
    task, actuation, sensors : see there
    period : control period [s]
    steps : control periods in an episode
    start : initial state by name, see ``START_SIZES``; zero where left out
    reference : the same motion in each episode, or None for random ones
    contact : None integrates the model; else MuJoCo moves bodies that have its parameters
    single : whether rows are in single precision
    probes : draws of a randomised model that settle how fine all episodes are integrated
    """

    source: Source
    task: TrackingTask = field(default_factory=TrackingTask)
    actuation: Actuation = field(default_factory=Actuation)
    sensors: Sensors = field(default_factory=Sensors)
    period: float = 0.01
    steps: int = 1000
    start: Mapping[str, ArrayLike] = field(default_factory=dict)
    reference: Motion | None = None
    contact: Contact | None = None
    single: bool = False
    probes: int = field(
        default=32,
        metadata={
            "unit": "1",
            "reason": "chosen: a platform's course must not depend on its neighbours, so one "
            "fineness serves all draws",
        },
    )

    @property
    def real(self) -> type[np.floating]:
        """The type of the rows' numbers."""
        return np.float32 if self.single else np.float64


def integration_steps(setup: Setup) -> int:
    """Steps for the finest of several draws: a result must not depend on neighbouring rows."""
    source, rng = setup.source, np.random.default_rng(0)
    draws = 1 if isinstance(source, Same) else setup.probes
    models = [source.draw(rng) for _ in range(draws)]
    return max(plant_substeps(model, setup.period) for model in models)


def checked_start(start: Mapping[str, Any], largest_twist: Array) -> dict[str, Array]:
    """An initial state's parts as arrays of the right size, or InputError."""
    found = {}
    for name, value in start.items():
        if name not in START_SIZES:
            known = ", ".join(START_SIZES)
            raise InputError(f"initial_state: unknown part {name!r}; known are {known}")
        try:
            part = np.array(value, float)
        except (TypeError, ValueError):
            raise InputError(f"initial_state {name}: {value!r} does not hold numbers") from None
        size = START_SIZES[name]
        if part.shape != ((size,) if size else ()) or not np.isfinite(part).all():
            wanted = f"{size} finite numbers" if size else "a finite number"
            raise InputError(f"initial_state {name}: {value!r} is not {wanted}")
        found[name] = part
    if "twist" in found and (np.abs(found["twist"]) > largest_twist).any():
        raise InputError(f"initial_state twist: {start['twist']!r} is faster than any platform")
    return found


def episode_steps(length: object, period: float) -> int:
    """Control periods in an episode of ``length`` [s]."""
    seconds = finite("episode_length", length, positive=True)
    steps = round(seconds / period)
    if steps < 1:
        raise InputError(f"episode_length: {seconds:g} s is shorter than a control period")
    return steps
