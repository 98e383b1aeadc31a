"""Whether a robot has changed since its model was made: the model's parameters, and new ones.

Both come with a covariance. A difference of independent estimates has the sum of the two, so each
parameter, and each sum of parameters that is known better than its members, gives a normal score;
p-values are Bonferroni's over all that are tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from identification.fitting.misfit import misfit_of
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from youbot_env.model.model import Model
from youbot_env.physics.effect import effect_of, with_unit

Array = NDArray[np.float64]


NO_DEVIATIONS = "the model holds no standard deviations: nothing to test"


@dataclass(frozen=True)
class Change:
    """A parameter, or a sum of some, in two models.

    given, refitted : its values; std : of their difference; p_value : family-wise, of no change
    members : names of the parameters that it is made of
    """

    name: str
    unit: str
    given: float
    refitted: float
    std: float
    p_value: float
    members: tuple[str, ...]
    has_changed: bool = False

    @property
    def size(self) -> float:
        """By how much it has risen."""
        return self.refitted - self.given

    @property
    def sentence(self) -> str:
        """The change in words."""
        size, std = abs(self.size), max(self.std, 1e-300)
        # As many decimals as the two leading digits of the deviation have.
        decimals = max(0, 1 - int(np.floor(np.log10(std))))
        verb = "risen" if self.size > 0 else "fallen"
        return (
            f"{self.name} has {verb} by "
            f"{with_unit(f'{size:.{decimals}f} +- {std:.{decimals}f}', self.unit)} "
            "since the model was made"
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "given": self.given,
            "refitted": self.refitted,
            "change": self.size,
            "std": self.std,
            "p_value": self.p_value,
            "has_changed": self.has_changed,
        }


@dataclass(frozen=True)
class ParameterChanges:
    """What has become of a model's parameters; ``reason``: why nothing could be tested, or ""."""

    rows: tuple[Change, ...] = ()
    reason: str = ""

    @property
    def changed(self) -> list[Change]:
        """Those that chance does not explain; a sum only where none of its members stands out."""
        return [row for row in self.rows if row.has_changed]

    @property
    def sentences(self) -> list[str]:
        """The changes in words, the surest first."""
        return [row.sentence for row in self.changed]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "tested": bool(self.rows),
            "reason": self.reason or None,
            "parameters": [row.to_dict() for row in self.rows],
            "words": self.sentences,
        }


@dataclass(frozen=True)
class _Known:
    """Estimates (k,) by name with their covariance (k, k)."""

    names: tuple[str, ...]
    values: Mapping[str, float] = field(repr=False)
    covariance: Array = field(repr=False)

    def of(self, factors: Mapping[str, float]) -> tuple[float, float]:
        """Value and variance of a sum."""
        weights = np.array([factors.get(name, 0.0) for name in self.names])
        value = sum(factor * self.values[name] for name, factor in factors.items())
        return float(value), float(max(weights @ self.covariance @ weights, 0.0))


def _lacked_from_the_start(given: Model[Any], refitted: Model[Any], settings: FitSettings) -> str:
    """Why parameters that differ have not changed: what the new model holds and the given one
    lacks was missing on the logs that it was made of, and its parameters took a part of it."""
    new = [name for name in refitted.effects if name not in given.effects]
    times = misfit_of(given, settings)
    if not new or times is None:
        return ""
    return (
        f"the model did not fit the logs that it was made of (a force error {times:.3g} times the "
        f"noise floor) for want of {' and '.join(map(effect_of, new))}, so its parameters were off "
        "from the start"
    )


def _lacks_now(given: Model[Any], refitted: Model[Any], settings: FitSettings) -> str:
    """Why parameters that differ may not have changed: something acts on the new logs that no model
    holds, and was not there when the given one was made. A part of it passes for each parameter."""
    times, before = misfit_of(refitted, settings), misfit_of(given, settings) or 1.0
    if times is None or times < settings.max_misfit_growth * before:
        return ""
    return (
        f"these logs hold something that the model lacks (refitted, its force error is {times:.3g} "
        "times the noise floor), and it could pass for a change of any parameter"
    )


def changed_parameters(
    given: Model[Any],
    refitted: Model[Any],
    mechanism: Mechanism,
    settings: FitSettings = FitSettings(),
    alike: Mapping[str, float] | None = None,
) -> ParameterChanges:
    """Test the parameters that two models of one mechanism share.

    Where the refitted model holds an effect that the given one lacks, that effect may have been
    there from the start, with a part of it in the given model's parameters. So a parameter has
    changed only if the given model's own structure, fitted to the logs at hand, says so too.

    Parameters
    ----------
    given : the model as it was made, on other logs
    refitted : the same structure, or a larger one, fitted to the logs at hand; its errors there
    alike : of a larger structure, the parameters of the given one fitted to these logs, by name
    """
    if given.covariance is None or refitted.covariance is None:
        return ParameterChanges(reason=NO_DEVIATIONS)
    for untold in (_lacked_from_the_start, _lacks_now):
        if reason := untold(given, refitted, settings):
            return ParameterChanges(reason=reason)
    shared = [name for name in given.covariance_names if name in refitted.covariance_names]
    before = _Known(given.covariance_names, given.values, given.covariance)
    after = _Known(refitted.covariance_names, refitted.values, refitted.covariance)
    rows = []
    for name, factors in _tested(mechanism, shared).items():
        (old, old_variance), (new, new_variance) = before.of(factors), after.of(factors)
        std = float(np.sqrt(old_variance + new_variance))
        if std > 0:
            unit = _units(given)[next(iter(factors))]
            change = new - old
            if alike is not None:
                also = sum(factor * alike[part] for part, factor in factors.items()) - old
                change = min(change, also, key=abs) if change * also > 0 else 0.0
            p_value = float(erfc(abs(change) / std / np.sqrt(2.0)))
            rows.append(Change(name, unit, old, new, std, p_value, tuple(factors)))
    if not rows:
        return ParameterChanges(reason="the model and the logs share no parameter to test")
    rows = [replace(row, p_value=min(1.0, row.p_value * len(rows))) for row in rows]
    rows.sort(key=lambda row: row.p_value)
    sure = [row for row in rows if row.p_value <= settings.max_change_p_value]
    alone = {row.name for row in sure if len(row.members) == 1}
    told = {
        row.name for row in sure if len(row.members) == 1 or not alone.intersection(row.members)
    }
    return ParameterChanges(tuple(replace(row, has_changed=row.name in told) for row in rows))


def _tested(mechanism: Mechanism, shared: Sequence[str]) -> dict[str, Mapping[str, float]]:
    """Each parameter alone, and the sums that the mechanism names, by how people write them."""
    found: dict[str, Mapping[str, float]] = {name: {name: 1.0} for name in shared}
    for name, factors in mechanism.conventions.combinations(mechanism.geometry).items():
        if set(factors) <= set(shared):
            found[name] = factors
    return found


def _units(model: Model[Any]) -> dict[str, str]:
    units = {name: entry.unit for name, entry in model.parameters.items()}
    for effect, entries in model.effects.items():
        units |= {f"{effect}.{name}": entry.unit for name, entry in entries.items()}
    return units
