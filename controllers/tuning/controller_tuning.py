"""Kinematic control and PID tuned for a model in a loop, and the gains that weaker demands give."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from controllers.interface import Array, Loop
from controllers.kinematic import Gains
from controllers.linear.margins import Margins
from controllers.pid.design import PIDGains
from controllers.tuning.gains_file import gains_to_dict
from controllers.tuning.trials import TuningTrial, references
from controllers.tuning.tunable_laws import TunableKinematic, TunablePID
from controllers.tuning.tuning import (
    GainSearch,
    Progress,
    Requirements,
    SearchSettings,
    TunedGains,
    allowed_torque_rate,
)
from youbot_env.model.model import Model
from youbot_env.physics.hardware import STOCK_INTEGRAL, STOCK_PROPORTIONAL

NO_LEAD = 1e-9
"""Lead [s] that stands for none: the search takes the logarithm, which 0 has not."""

STEPS = 3 * SearchSettings.rounds + 1
"""How often a tuning tells its progress."""


@dataclass(frozen=True)
class TuningTask:
    """What a controller is tuned for.

    Attributes
    ----------
    model : of the plant, with all its effects
    loop : between controller and plant
    gain_margin, phase_margin : to keep at each axis [dB], [degrees]
    torque_rate : largest rms of the commands' change [N m/s]; None is 1.1 times that of computed
        torque on the same model in the same loop
    runs, duration : references, and the length of each [s]
    seed : of references and noise
    """

    model: Model
    loop: Loop
    gain_margin: float = 6.0
    phase_margin: float = 45.0
    torque_rate: float | None = None
    runs: int = 4
    duration: float = 10.0
    seed: int = 0

    @cached_property
    def trial(self) -> TuningTrial:
        """The simulated runs that judge a point of the search."""
        motions = references(self.model, count=self.runs, duration=self.duration, seed=self.seed)
        return TuningTrial(self.model, self.loop, motions, self.duration, self.seed)

    @cached_property
    def requirements(self) -> Requirements:
        """What the tuned gains keep."""
        limit = self.torque_rate or allowed_torque_rate(self.model, self.loop, self.trial)
        return Requirements(self.gain_margin, self.phase_margin, limit)

    @property
    def margins(self) -> dict[str, float]:
        """The margins alone."""
        return {"gain_margin": self.gain_margin, "phase_margin": self.phase_margin}


@dataclass(frozen=True)
class TunedController:
    """The gains that a search found, by what they had to keep.

    Attributes
    ----------
    points : "tuned" keeps margins and torque rate, "any rate" the margins alone, "free" is stable
        and no more; "stock" are kinematic control's gains as they are delivered
    search : that judged them
    """

    task: TuningTask
    points: Mapping[str, TunedGains]
    search: GainSearch

    @cached_property
    def gains(self) -> dict[str, Gains | PIDGains]:
        """Gains of each point, as the controller takes them."""
        law: Any = self.search.law
        return {name: law.gains(_array(one)) for name, one in self.points.items()}

    def python_control_margins(self) -> Margins:
        """The tuned loop's margins as python-control finds them (extra: control)."""
        return self.search.python_control_margins(_array(self.points["tuned"]))

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        task = self.task
        results = {
            name: {**one.to_dict(), **gains_to_dict(self.gains[name])}
            for name, one in self.points.items()
        }
        return {
            "loop": vars(task.loop),
            "model": task.model.name,
            "references": [motion.to_dict() for motion in task.trial.motions],
            "requirements": {
                **vars(task.requirements),
                "torque_rate_source": "asked" if task.torque_rate else "computed torque",
            },
            **gains_to_dict(self.gains["tuned"]),
            "results": results,
        }


def tune_kinematic(
    task: TuningTask, *, lead: bool = False, progress: Progress = lambda steps: None
) -> TunedController:
    """Tune ``KinematicControl``.

    Parameters
    ----------
    lead : whether it may read the reference ahead too, as no stock control does
    progress : is told 1.0 after each of ``STEPS`` steps

    Raises
    ------
    InputError
        If no gains keep what is wanted.
    """
    found = _tune(task, lambda: TunableKinematic(task.model, task.loop, lead=lead), progress)
    stock = [STOCK_PROPORTIONAL, STOCK_INTEGRAL, NO_LEAD]
    names = found.search.law.names
    as_delivered = found.search.evaluate(np.array(stock[: len(names)]))
    return TunedController(task, {**found.points, "stock": as_delivered}, found.search)


def tune_pid(task: TuningTask, *, progress: Progress = lambda steps: None) -> TunedController:
    """Tune ``PID``: as :func:`tune_kinematic`."""
    return _tune(task, lambda: TunablePID(task.model, task.loop, **task.margins), progress)


def _tune(
    task: TuningTask,
    law: Callable[[], TunableKinematic | TunablePID],
    progress: Progress,
) -> TunedController:
    requirements = task.requirements  # takes a long simulation, so it is part of the first step
    search = GainSearch(law(), task.trial)
    progress(1.0)
    kept = {"tuned": requirements, "any rate": Requirements(**task.margins), "free": None}
    points = {name: search.best(wanted, progress) for name, wanted in kept.items()}
    return TunedController(task, points, search)


def _array(one: TunedGains) -> Array:
    return np.array(list(one.point.values()))
