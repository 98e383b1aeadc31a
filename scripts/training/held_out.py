"""How well a policy tracks references that it was not trained on: true errors, not rewards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.interface import Array
from youbot_env.tracking.stepper import Setup
from youbot_scripts.training.platforms import MakeBase, PlatformBatch
from youbot_scripts.training.settings import TEST_SEED

AXES = ("velocity_x", "velocity_y", "yaw_rate")


@dataclass(frozen=True)
class Tracking:
    """Errors over some references.

    Attributes
    ----------
    error : (n, 3) rms of reference - true twist over the reference's rms, by reference and axis
    torque_rate : rms of the torques' change [N m/s]
    saturated : share of the wheels' commands at their limit
    """

    error: Array
    torque_rate: float
    saturated: float

    @property
    def mean(self) -> float:
        """Over references and axes."""
        return float(self.error.mean())

    def to_dict(self) -> dict[str, Any]:
        """JSON-able summary."""
        by_axis = dict(zip(AXES, self.error.mean(axis=0).tolist(), strict=True))
        return {
            "error": self.mean,
            "error_by_axis": by_axis,
            "worst_reference": float(self.error.mean(axis=1).max()),
            "torque_rate": self.torque_rate,
            "saturated": self.saturated,
            "references": len(self.error),
        }


def track(
    act: Callable[[Array], Array],
    setup: Setup,
    *,
    references: int = 20,
    seed: int = TEST_SEED,
    make_base: MakeBase | None = None,
    share: float = 1.0,
) -> Tracking:
    """Drive ``references`` episodes side by side, each over its whole length.

    Parameters
    ----------
    act : wheel actions (n, 4) for observations (n, D)
    setup : of plant and loop
    seed : of the first reference; the others follow one by one
    make_base, share : the controller beneath, see ``PlatformBatch``
    """
    fleet = PlatformBatch(setup, references, make_base, share)
    for row in range(references):
        fleet.reset(row, np.random.default_rng(seed + row))
    error, wanted, torque = (np.empty((setup.steps, references, k)) for k in (3, 3, 4))
    saturated = np.empty((setup.steps, references, 4), bool)
    for step in range(setup.steps):
        fleet.step(act(fleet.observe()))
        for row in range(references):
            _, _, info = fleet.stepper.result(row)
            error[step, row] = info["tracking_error"]
            wanted[step, row] = info["reference_twist"]
            torque[step, row] = info["commanded_torque"]
            saturated[step, row] = info["saturated"]
    with np.errstate(all="ignore"):
        ratio = np.sqrt((error**2).mean(axis=0) / (wanted**2).mean(axis=0))
    rate = np.diff(torque, axis=0) / setup.period
    return Tracking(ratio, float(np.sqrt((rate**2).mean())), float(saturated.mean()))


def idle(observation: Array) -> Array:
    """No torque of its own: what the controller beneath does alone."""
    return np.zeros((len(observation), 4))
