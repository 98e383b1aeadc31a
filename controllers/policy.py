"""A trained policy as a controller: played with numpy alone, whatever it was trained with."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Array, Controller, Loop, Observation, Reference
from controllers.policy_inputs import Layout, cut
from youbot_env.errors import InputError
from youbot_env.hardware import MAX_WHEEL_TORQUE
from youbot_env.model import Model

Weights = NDArray[np.float32]

FEATURE_LIMIT = 10.0
"""Features are cut here, in training and in use."""

RATE_TOLERANCE = 0.01
"""A sample time may differ from the trained one by this share."""


def relu(x: Weights) -> Weights:
    """max(0, x)."""
    return np.maximum(x, np.float32(0.0))


ACTIVATIONS = {"tanh": np.tanh, "relu": relu}
"""Functions between the layers, by the names that a description uses."""


@dataclass(frozen=True, eq=False)
class Network:
    """Features, layers and mix: from observations to actions, both as the environment has them.

    Attributes
    ----------
    features : (F, D) applied to an observation in double precision, then cut at +-FEATURE_LIMIT
    layers : (weight (out, in), bias (out,)) float32, first to last
    mix : (4, A), wheel actions per output
    activation : between layers, of ``ACTIVATIONS``
    squashed : whether the outputs pass through tanh, as those of SAC and TD3 do
    """

    features: Array
    layers: Sequence[tuple[Weights, Weights]]
    mix: Array
    activation: str = "tanh"
    squashed: bool = False
    _steps: tuple[tuple[Weights, Weights], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        steps = tuple((np.ascontiguousarray(w.T), b) for w, b in self.layers)
        object.__setattr__(self, "_steps", steps)

    def see(self, observation: Array) -> Weights:
        """Features (..., F) float32 of observations (..., D)."""
        found = np.asarray(observation, np.float64) @ self.features.T
        return np.minimum(np.maximum(found, -FEATURE_LIMIT), FEATURE_LIMIT).astype(np.float32)

    def outputs(self, features: Weights) -> Array:
        """Outputs (..., A) in [-1, 1] for features (..., F)."""
        activation, x = ACTIVATIONS[self.activation], features
        for weight, bias in self._steps[:-1]:
            x = activation(x @ weight + bias)
        weight, bias = self._steps[-1]
        x = x @ weight + bias
        x = np.tanh(x) if self.squashed else np.minimum(np.maximum(x, -1.0), 1.0)
        return x.astype(np.float64)

    def actions(self, observation: Array) -> Array:
        """Wheel actions (..., 4), not yet limited, for observations (..., D)."""
        return self.outputs(self.see(observation)) @ self.mix.T


@dataclass(frozen=True)
class Description:
    """What a policy was made for.

    Attributes
    ----------
    name : a word for tables
    layout : of the observation
    torque_limit : wheel torque [N m] at an action of 1
    control_rate : [Hz]
    base : name of the controller that it sits on, None if it drives alone
    share : largest part of the torque limit that it may ask of a wheel
    training : how it was trained: command, seed, steps, times, versions, learning curve
    """

    name: str
    layout: Layout
    torque_limit: float = MAX_WHEEL_TORQUE
    control_rate: float = 100.0
    base: str | None = None
    share: float = 1.0
    training: Mapping[str, Any] = field(default_factory=dict)


class Policy:
    """A network that drives, alone or on top of another controller.

    Stateless but for its past actions, so nothing winds up: after a fault it goes on as before it.
    What is NaN in an observation counts as 0, as in training.

    Parameters
    ----------
    network, description : see there; ``load_policy`` reads both from a file
    base : the controller beneath, if the description names one
    torque_limit : [N m] at each wheel, if it is lower than the trained one

    Attributes
    ----------
    preview_needed : coming reference samples that ``Reference.preview`` must hold

    Raises
    ------
    InputError
        If a controller beneath is missing, or was not asked for.
    """

    def __init__(
        self,
        network: Network,
        description: Description,
        base: Controller | None = None,
        torque_limit: float | None = None,
    ) -> None:
        if (base is None) != (description.base is None):
            wanted = f"sits on {description.base}" if description.base else "drives alone"
            raise InputError(f"policy {description.name}: {wanted}; build it with build_policy")
        self.network = network
        self.description = description
        self.base = base
        self.preview_needed = max(description.layout.preview, getattr(base, "preview_needed", 0))
        ratio = (torque_limit or description.torque_limit) / description.torque_limit
        self._bound = min(1.0, ratio)
        self.reset()

    def reset(self) -> None:
        """Forgets its past actions."""
        self._past = np.zeros(4 * self.description.layout.action_history)
        if self.base is not None:
            self.base.reset()

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) [N m].

        Raises
        ------
        InputError
            If the reference does not look ``preview_needed`` samples ahead.
        """
        how, base = self.description, None
        if self.base is not None:
            base = self.base(observation, reference) / how.torque_limit
        seen = how.layout.observe(observation, reference, self._past, base)
        if not np.abs(seen).max() <= CUT_FREE:  # so that NaN is cut too
            seen = cut(seen)
        action = compose(how.share * self.network.actions(seen), base, self._bound)
        self._past = np.concatenate((action, self._past[:-4]))
        return how.torque_limit * action


CUT_FREE = 1.0
"""Below this no value needs to be cut, and ``cut`` costs a third of a step."""


def compose(action: Array, base: Array | None, bound: float = 1.0) -> Array:
    """Actions (..., 4): a policy's, on top of the controller's beneath (NaN counts as 0)."""
    total = action if base is None else action + np.nan_to_num(base)
    return np.minimum(np.maximum(total, -bound), bound)


def build_policy(source: str | os.PathLike[str], model: Model, loop: Loop) -> Policy:
    """A policy file, or a shipped policy by name, ready to drive.

    Parameters
    ----------
    model : what the controller beneath believes; a policy that drives alone knows no model
    loop : must have the control rate that the policy was trained at

    Raises
    ------
    InputError
        If the file is no valid policy, or the loop is not what it was trained for.
    """
    from controllers.policy_file import load_policy

    network, description = load_policy(source)
    if abs(loop.sample_time * description.control_rate - 1.0) > RATE_TOLERANCE:
        raise InputError(
            f"policy {description.name}: was trained at {description.control_rate:g} Hz, the loop "
            f"runs at {1.0 / loop.sample_time:g} Hz; train one for it"
        )
    base = None
    if description.base is not None:
        from controllers.registry import build

        base = build(description.base, model, loop)
    return Policy(network, description, base, loop.torque_limit)
