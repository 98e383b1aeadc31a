"""Models drawn anew for each episode: from ranges, or from an identified model's covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model
from youbot_env.physics.effect import CATALOGUE, with_unit

Effects = Mapping[str, Mapping[str, float]]
Bound = float | str
Ranges = Mapping[str, tuple[Bound, Bound]]


class EpisodeStreams(NamedTuple):
    """Random numbers of one episode: one stream for each purpose.

    So a change in one (noise switched on) does not change what the others give for the same seed.
    """

    model: np.random.Generator
    reference: np.random.Generator
    noise: np.random.Generator


def episode_streams(rng: np.random.Generator) -> EpisodeStreams:
    """The streams of the next episode."""
    return EpisodeStreams(*(np.random.default_rng(seed) for seed in rng.integers(2**63, size=3)))


class Source(Protocol):
    """Where an episode's model comes from."""

    def draw(self, rng: np.random.Generator) -> Model:
        """The next episode's model."""
        ...


@dataclass(frozen=True)
class Same:
    """Always the same model."""

    model: Model

    def draw(self, rng: np.random.Generator) -> Model:
        return self.model


@dataclass(frozen=True)
class Uniform:
    """Parameters uniform in ranges: name -> (low, high), SI units."""

    model: Model
    ranges: Mapping[str, tuple[float, float]]
    attempts: int = field(
        default=100,
        metadata={
            "unit": "draws",
            "reason": "ranges of which less than some hundredths are physical are a mistake",
        },
    )

    def draw(self, rng: np.random.Generator) -> Model:
        """A physical model; draws that are not physical are drawn again."""
        for _ in range(self.attempts):
            values = {name: rng.uniform(low, high) for name, (low, high) in self.ranges.items()}
            try:
                return self.model.with_values(values)
            except InputError as error:
                reason = error
        raise InputError(f"randomise: hardly a draw from these ranges is physical: {reason}")


@dataclass(frozen=True)
class Posterior:
    """Parameters drawn from the model's covariance; the effects are added with fixed values."""

    model: Model
    effects: Effects

    def draw(self, rng: np.random.Generator) -> Model:
        return with_effects(self.model.sample(rng), self.effects)


def source(randomise: Ranges | str | None, model: Model, effects: Effects) -> Source:
    """What the option ``randomise`` of the environments asks for.

    Parameters
    ----------
    randomise : None; "covariance"; or parameter name -> (low, high), where a bound is a number
        in SI units or a share of the model's own value, as "80%"
    model, effects : the model, and the effects to add to it

    Raises
    ------
    InputError
        If a name or range cannot be, or the model has no covariance.
    """
    if isinstance(randomise, str):
        if randomise != "covariance":
            raise InputError(
                f"randomise: {randomise!r} is neither 'covariance' nor ranges by parameter name"
            )
        if model.covariance is None:
            raise InputError(
                f"randomise: model {model.name} holds no covariance; identify it from logs, "
                "or give ranges"
            )
        return Posterior(model, effects)
    model = with_effects(model, effects)
    if not randomise:
        return Same(model)
    if not isinstance(randomise, Mapping):
        raise InputError("randomise: give 'covariance' or ranges by parameter name")
    return Uniform(model, {name: _range(model, name, pair) for name, pair in randomise.items()})


def with_effects(model: Model, effects: Effects) -> Model:
    """The model with effects added: name -> its parameters by name."""
    for name, values in effects.items():
        if not isinstance(values, Mapping):
            raise InputError(f"effects: {name} needs its parameters by name, not {values!r}")
        numbers = {key: finite(f"effect {name} {key}", value) for key, value in values.items()}
        model = model.with_effect(name, **numbers)
    return model


def _range(model: Model, name: str, pair: object) -> tuple[float, float]:
    if name not in model.values:
        known = ", ".join(model.values)
        raise InputError(f"randomise: unknown parameter {name!r}; the model has {known}")
    if not isinstance(pair, (tuple, list)) or len(pair) != 2:
        raise InputError(f"randomise: {name} needs a pair (low, high), not {pair!r}")
    low, high = (_bound(model, name, bound) for bound in pair)
    if low > high and all(isinstance(bound, str) for bound in pair) and model.values[name] < 0:
        low, high = high, low  # of a negative value the larger share is the lower number
    if low > high:
        raise InputError(f"randomise: {name}: {low:g} to {high:g} is empty")
    if "." in name:
        effect, parameter = name.split(".")
        bounds = CATALOGUE[effect].public_parameter(parameter)
        if low < bounds.lower or high > bounds.upper:
            raise InputError(
                f"randomise: {name}: {low:g} to {with_unit(f'{high:g}', bounds.unit)} leaves "
                f"[{bounds.lower:g}, {bounds.upper:g}]"
            )
    return low, high


def _bound(model: Model, name: str, bound: object) -> float:
    if isinstance(bound, str):
        number, sign, rest = bound.partition("%")
        try:
            share = float(number) if sign and not rest else float("nan")
        except ValueError:
            share = float("nan")
        if not np.isfinite(share):
            raise InputError(f"randomise: {name}: {bound!r} is neither a number nor like '80%'")
        return finite(f"randomise {name}", share / 100 * model.values[name])
    return finite(f"randomise {name}", bound)
