"""A trained policy as a controller. It does not need the libraries that it was trained with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Array, Controller, Observation, Reference
from controllers.policy.inputs import CUT, Layout
from youbot_env.caching import njit
from youbot_env.errors import InputError, check_settings
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE

Weights = NDArray[np.float32]

FEATURE_LIMIT = 10.0
"""Features are cut here, in training and in use."""

ACTIVATIONS = ("tanh", "relu")
"""Functions between the layers."""


@dataclass(frozen=True)
class PolicySettings:
    """When a policy is refused."""

    max_rate_difference_share: float = field(
        default=0.01,
        metadata={
            "unit": "of the control rate",
            "reason": "a loop may run so far from the rate of the training: a clock's error, no "
            "other rate",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, eq=False)
class Network:
    """Features, layers and mix: from observations to actions, both as the environment has them.

    Attributes
    ----------
    features : (F, D) applied to an observation in double precision, then cut at +-FEATURE_LIMIT
    layers : (weight (out, in), bias (out,)) float32, first to last
    mix : (4, A), wheel actions per output
    activation : between layers, of ``ACTIVATIONS``
    squashed : whether the outputs pass through tanh, as those of SAC and TD3 do; else they are cut
        at +-1, as those of PPO are
    """

    features: Array
    layers: Sequence[tuple[Weights, Weights]]
    mix: Array
    activation: str = "tanh"
    squashed: bool = False
    _packed: Weights = field(init=False, repr=False)
    _sizes: NDArray[np.int64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # One flat array: numba takes no list of arrays of different shapes. Transposed, so that the
        # inner loop reads neighbouring numbers.
        parts = [part for weight, bias in self.layers for part in (weight.T.ravel(), bias)]
        sizes = [len(self.features), *(len(bias) for _, bias in self.layers)]
        object.__setattr__(self, "_packed", np.concatenate(parts).astype(np.float32))
        object.__setattr__(self, "_sizes", np.array(sizes, np.int64))
        object.__setattr__(self, "features", np.ascontiguousarray(self.features, np.float64))
        object.__setattr__(self, "mix", np.ascontiguousarray(self.mix, np.float64))

    def actions(self, observation: NDArray[Any]) -> Array:
        """Wheel actions (n, 4), not yet limited, for observations (n, D); NaN counts as 0."""
        seen = np.ascontiguousarray(observation, np.float64)
        out = np.empty((len(seen), 4))
        evaluate(
            seen,
            self.features,
            self._packed,
            self._sizes,
            self.activation == "relu",
            self.squashed,
            self.mix,
            out,
        )
        return out


@njit(cache=True)
def evaluate(seen, features, packed, sizes, is_relu, squashed, mix, out):
    """Fill wheel actions ``out`` (n, 4) for observations ``seen`` (n, D).

    ``packed`` holds each layer's weight (in, out) and bias (out,) one after another, ``sizes`` the
    widths. Layers are computed in single precision, as they were trained.
    """
    last = sizes.size - 2
    for row in range(seen.shape[0]):
        x = np.empty(sizes[0], np.float32)
        for i in range(sizes[0]):
            total = 0.0
            for k in range(seen.shape[1]):
                value = seen[row, k] if seen[row, k] == seen[row, k] else 0.0
                total += features[i, k] * min(max(value, -CUT), CUT)
            x[i] = min(max(total, -FEATURE_LIMIT), FEATURE_LIMIT)
        at = 0
        for layer in range(last + 1):
            before, after = sizes[layer], sizes[layer + 1]
            y = packed[at + before * after : at + (before + 1) * after].copy()
            for k in range(before):
                weight = packed[at + k * after : at + (k + 1) * after]
                for i in range(after):
                    y[i] += x[k] * weight[i]
            at += (before + 1) * after
            for i in range(after):
                if layer == last and not squashed:
                    y[i] = min(max(y[i], np.float32(-1.0)), np.float32(1.0))
                elif layer < last and is_relu:
                    y[i] = max(y[i], np.float32(0.0))
                else:
                    y[i] = math.tanh(y[i])
            x = y
        for wheel in range(4):
            out[row, wheel] = 0.0
            for i in range(x.size):
                out[row, wheel] += mix[wheel, i] * x[i]


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
    rollers : how those of the robot stand that it was trained on, in "X" or "O": by that other
        wheels push sideways and turn
    training : how it was trained: command, seed, steps, times, versions, learning curve
    """

    name: str
    layout: Layout
    torque_limit: float = MAX_WHEEL_TORQUE
    control_rate: float = 100.0
    base: str | None = None
    share: float = 1.0
    rollers: str = "X"
    training: Mapping[str, Any] = field(default_factory=dict)


class Policy:
    """A network that drives, alone or on top of another controller.

    Its only state is its past actions, so there is no windup, and after a fault it goes on as
    before. NaN in an observation counts as 0, as in training.

    Parameters
    ----------
    network, description : see there; ``load_policy`` reads both from a file
    base : the base controller, if the description names one
    torque_limit : [N m] at each wheel, if it is lower than the trained one

    Attributes
    ----------
    preview_needed : coming reference samples that ``Reference.preview`` must hold

    Raises
    ------
    InputError
        If the base controller is missing, or was not asked for.
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
        self._divisors = description.layout.divisors
        self._seen = np.zeros((1, description.layout.size))
        network.actions(self._seen)  # compile, or load what is compiled, before a loop needs it
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
            base = self.base(without_torque(observation), reference) / how.torque_limit
        how.layout.fill(self._seen[0], observation, reference, self._past, base)
        wanted = how.share * self.network.actions(self._seen / self._divisors)[0]
        action = combined_action(wanted, base, self._bound)
        # A copy, because source and target overlap.
        self._past[4:] = self._past[:-4].copy()
        self._past[:4] = action
        return how.torque_limit * action


def combined_action(action: Array, base: Array | None, bound: float = 1.0) -> Array:
    """Actions (..., 4): a policy's, added to the base controller's (NaN counts as 0)."""
    total = action if base is None else action + np.nan_to_num(base)
    return np.minimum(np.maximum(total, -bound), bound)


def without_torque(observation: Observation) -> Observation:
    """The observation of a base controller, without torques: they include the policy's part."""
    return observation._replace(wheel_torque=None)
