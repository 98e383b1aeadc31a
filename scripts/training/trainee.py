"""What a choice of settings means for a model: setups, controller beneath, ways in and out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from controllers.interface import Array, Loop
from controllers.policy.inputs import WHEEL_MIX, Layout, plain_features, tracking_features
from controllers.policy.policy import Description, Network
from controllers.registry import CONTROLLERS, entry
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.tracking.stepper import Setup
from youbot_scripts.recording.named_motions import with_effects
from youbot_scripts.training.conditions import Conditions, ranges_from
from youbot_scripts.training.held_out import Tracking, idle, track
from youbot_scripts.training.platforms import MakeBase, PlatformBatch
from youbot_scripts.training.settings import Choice

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
"""Functions between the layers, by the names of ``controllers.policy.policy.ACTIVATIONS``."""

FEATURES: dict[str, Callable[[Layout, float], Array]] = {
    "tracking": tracking_features,
    "plain": lambda layout, lever: plain_features(layout),
}


@dataclass(frozen=True)
class Trainee:
    """Everything that a choice means for a model: setups, controller beneath, ways in and out.

    Attributes
    ----------
    training, nominal : setups with models drawn anew, and with the one model
    make_base : makes the controller beneath, which believes the model without effects; or None
    features, mix : see ``TrackingVecEnv``
    description : of the policy that will come out
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
        return PlatformBatch(self.training, count, self.make_base, self.choice.share)

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
        """The same for a controller of the registry that believes ``model``."""
        conditions = self.choice.conditions
        make = base_maker(name, believed(model, conditions), loop_of(conditions))
        return track(idle, self.nominal, references=references, seed=seed, make_base=make)


def prepare(choice: Choice, model: Model) -> Trainee:
    """What a choice means; everything that cannot be shows here.

    Raises
    ------
    InputError
        If an option cannot be.
    """
    conditions, learner = choice.conditions, choice.learner
    plant = with_effects(model, choice.effects)
    training = conditions.setup(plant, ranges_from(choice.randomise, plant))
    nominal = conditions.setup(plant)
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
    )
    mix = WHEEL_MIX if learner.mixed else np.eye(4)
    features = FEATURES[learner.features](layout, model.geometry.L)
    return Trainee(choice, training, nominal, make_base, features, mix, description)


def believed(model: Model, conditions: Conditions) -> Model:
    """What controllers believe: the model and the drives' lag, not the plant's other effects."""
    if conditions.lag is None:
        return model
    return model.with_effect("actuator_lag", time_constant=conditions.lag)


def loop_of(conditions: Conditions) -> Loop:
    """What a controller may know of the loop. Counted speeds are half a period old."""
    period = 1.0 / conditions.control_rate
    return Loop(
        sample_time=period,
        delay=conditions.delay * period,
        measurement_delay=0.5 * period if conditions.encoder_ticks else 0.0,
        torque_limit=conditions.torque_limit,
        speed_noise=conditions.wheel_speed_noise,
    )


def base_maker(name: str, model: Model, loop: Loop) -> MakeBase:
    """Makes controllers of a name; what takes a search is searched once."""
    found = CONTROLLERS.get(name)
    if found is None:
        entry(name)  # tells what comes close
        raise InputError(f"residual: {name} is a policy itself; name a controller")
    settings = dict(found.design(model, loop)) if found.design is not None else {}
    return lambda: found.build(model, loop, **settings)
