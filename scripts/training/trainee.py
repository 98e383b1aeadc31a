"""From settings and a model to what is trained: setups, base controller, features and outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from controllers.interface import Array, Loop
from controllers.policy.inputs import Layout, plain_features, tracking_features, wheel_mix
from controllers.policy.policy import Description, Network
from controllers.registry import CONTROLLERS, entry
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.tracking.batch import INFO, SATURATED, keys_of
from youbot_env.tracking.setup import Setup
from youbot_scripts.recording.named_motions import with_effects
from youbot_scripts.training.conditions import Conditions, ranges_from
from youbot_scripts.training.platforms import MakeBase, PlatformBatch, platform_setup
from youbot_scripts.training.settings import TEST_SEED, Choice

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
    """Drive ``references`` episodes in parallel, each over its whole length.

    Parameters
    ----------
    act : wheel actions (n, 4) for observations (n, D)
    setup : of plant and loop
    seed : of the first reference; the others follow one by one
    make_base, share : the base controller, see ``PlatformBatch``
    """
    fleet = PlatformBatch(setup, references, make_base, share)
    fleet.begin(keys=keys_of(range(seed, seed + references)))
    error, wanted, torque = (np.empty((setup.steps, references, k)) for k in (3, 3, 4))
    saturated = np.empty((setup.steps, references, 4), bool)
    for step in range(setup.steps):
        fleet.step(act(fleet.observe()))
        report = fleet.rows.results.report
        error[step], wanted[step] = (
            report[:, INFO[name]] for name in ("tracking_error", "reference_twist")
        )
        torque[step] = report[:, INFO["commanded_torque"]]
        saturated[step] = report[:, SATURATED] != 0.0
    # An axis at rest divides by zero.
    with np.errstate(all="ignore"):
        ratio = np.sqrt((error**2).mean(axis=0) / (wanted**2).mean(axis=0))
    rate = np.diff(torque, axis=0) / setup.period
    return Tracking(ratio, float(np.sqrt((rate**2).mean())), float(saturated.mean()))


def idle(observation: Array) -> Array:
    """Actions (n, 4) of zero: the base controller acts alone."""
    return np.zeros((len(observation), 4))


ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
"""Functions between the layers, by the names of ``controllers.policy.policy.ACTIVATIONS``."""

FEATURES: dict[str, Callable[[Layout, float], Array]] = {
    "tracking": tracking_features,
    "plain": lambda layout, lever: plain_features(layout),
}


@dataclass(frozen=True)
class Trainee:
    """What is trained: setups, base controller, features and outputs.

    Attributes
    ----------
    training, nominal : setups with models drawn anew, and with the one model
    make_base : makes the base controller, built on the model without the plant's effects; or None
    features, mix : see ``FeatureVecEnv``
    description : of the policy that is exported
    """

    choice: Choice
    training: Setup
    nominal: Setup
    make_base: MakeBase | None
    features: Array
    mix: Array
    description: Description

    def fleet(self, count: int) -> PlatformBatch:
        """Platforms to train on."""
        return PlatformBatch(self.training, count, self.make_base, self.choice.share, reports=False)

    def judge(self, network: Network, seed: int, references: int = 20) -> Tracking:
        """True errors on the nominal plant, on references from ``seed`` on."""
        return track(
            network.actions,
            self.nominal,
            references=references,
            seed=seed,
            make_base=self.make_base,
            share=self.choice.share,
        )

    def judge_other(self, name: str, model: Model, seed: int, references: int = 20) -> Tracking:
        """The same for a controller of the registry that is built on ``model``."""
        conditions = self.choice.conditions
        make = base_maker(name, believed(model, conditions), loop_of(conditions))
        return track(idle, self.nominal, references=references, seed=seed, make_base=make)


def prepare(choice: Choice, model: Model) -> Trainee:
    """From a choice to what is trained; wrong options are refused here.

    Raises
    ------
    InputError
        If an option is out of its range.
    """
    conditions, learner = choice.conditions, choice.learner
    plant = with_effects(model, choice.effects)
    training = platform_setup(conditions, plant, ranges_from(choice.randomise, plant))
    nominal = platform_setup(conditions, plant)
    make_base = None
    if choice.base is not None:
        make_base = base_maker(choice.base, believed(model, conditions), loop_of(conditions))
    layout = PlatformBatch(nominal, 1, make_base).layout
    if learner.features not in FEATURES or learner.activation not in ACTIVATIONS:
        raise InputError(
            f"set: features is one of {', '.join(FEATURES)}, activation of {', '.join(ACTIVATIONS)}"
        )
    description = Description(
        name=f"{choice.algorithm}" + (f" on {choice.base}" if choice.base else ""),
        layout=layout,
        torque_limit=conditions.torque_limit,
        control_rate=conditions.control_rate,
        base=choice.base,
        share=choice.share,
        rollers=plant.geometry.arrangement,
    )
    mix = wheel_mix(plant.geometry) if learner.mixed else np.eye(4)
    features = FEATURES[learner.features](layout, model.geometry.L)
    return Trainee(choice, training, nominal, make_base, features, mix, description)


def believed(model: Model, conditions: Conditions) -> Model:
    """Model that controllers are built on: with the drives' lag, without the plant's effects."""
    if conditions.lag is None:
        return model
    return model.with_effect("actuator_lag", time_constant=conditions.lag)


def loop_of(conditions: Conditions) -> Loop:
    """The loop as a controller's designer knows it; counted speeds are half a period old."""
    period = 1.0 / conditions.control_rate
    return Loop(
        sample_time=period,
        delay=conditions.delay * period,
        measurement_delay=0.5 * period if conditions.encoder_ticks else 0.0,
        torque_limit=conditions.torque_limit,
        speed_noise=conditions.wheel_speed_noise,
    )


def base_maker(name: str, model: Model, loop: Loop) -> MakeBase:
    """Maker of controllers of a name; a design by search is done once for all."""
    found = CONTROLLERS.get(name)
    if found is None:
        entry(name)  # raises for an unknown name, with the nearest known one
        raise InputError(f"residual: {name} is a policy itself; name a controller")
    settings = dict(found.design(model, loop)) if found.design is not None else {}
    return lambda: found.build(model, loop, **settings)
