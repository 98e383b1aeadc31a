"""Maps of the residual on logs: the range that they are fitted over, and logs that leave it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics.effect import Effect, Registry
from youbot_env.physics.residual_maps import (
    Places,
    basis_at,
    components_of,
    is_map,
    map_limits,
    refuse_unseen,
    seen_range,
    variable_of,
)

Array = NDArray[np.float64]


def places_of(samples: Samples) -> Places:
    """Where a log goes."""
    return Places(samples.twist, samples.pose, samples.wheel_angle, samples.wheel_speed,
                  samples.time)  # fmt: skip


def with_effect_of_its_own(mechanism: Mechanism[Any], effect: Effect) -> Mechanism[Any]:
    """The same structure of a mechanism whose catalogue holds an effect more, or another one of
    that name. The catalogue of all is left as it is."""
    catalogue = Registry(mechanism.kind.catalogue.make)
    for item in mechanism.kind.catalogue:
        catalogue.add(item)
    catalogue.add(effect)
    kind = replace(mechanism.kind, catalogue=catalogue)
    return Mechanism(
        mechanism.geometry,
        replace(mechanism.structure, mechanism=kind),
        replace(mechanism.conventions, kind=kind),
        *(mechanism.settings, mechanism.held, mechanism.acts_in),
    )


def with_map_over(
    mechanism: Mechanism[Any], name: str, samples: Sequence[Samples]
) -> Mechanism[Any]:
    """The mechanism whose catalogue has a map over the range that logs pass.

    Raises
    ------
    InputError
        If there is no such map, the logs show nothing of it, or another acts at the same place.
    """
    effect = mechanism.catalogue[name]
    for other in mechanism.structure.effects:
        if is_map(other) and mechanism.catalogue[other].acts_at is effect.acts_at:
            raise InputError(
                f"{name}: the model holds {other}, which acts at the same place: both hold a "
                "constant, and no log tells these apart; start from a model without it"
            )
    limits = seen_range(name, map(places_of, samples))
    declared = tuple(
        replace(item, default=limits[item.name]) if item.name in limits else item
        for item in effect.parameters
    )
    return with_effect_of_its_own(mechanism, replace(effect, parameters=declared))


def refuse_unseen_logs(mechanism: Mechanism[Any], theta: Array, samples: Sequence[Samples]) -> None:
    """Refuse logs that go where a map of the residual knows nothing.

    Raises
    ------
    InputError
        One line: map, log, value, range, and what to do.
    """
    values = dict(zip(mechanism.parameter_names, theta.tolist(), strict=True))
    limits = map_limits(mechanism.structure.effects, values)
    for item in samples if limits else ():
        refuse_unseen(limits, places_of(item), f"{item.name}")


def curve_of(model: Model, name: str, points: int) -> list[dict[str, Any]]:
    """A map as a table: at even places of its range the force, and its standard deviation (None:
    not known).

    A map that each wheel has its own is told by its largest wheel at each place.
    """
    limits = model.map_limits[name]
    at = np.linspace(*limits, points)
    variable, columns = variable_of(name), basis_at(name, at, limits)
    found: list[dict[str, Any]] = [{"at": float(x), "unit": variable.unit} for x in at]
    effect = model.effect(name)
    for part, unit, _ in components_of(name):
        names = [list(p.names) for p in effect.parameters if p.name.startswith(part)]
        wheels = [[f"{name}.{row[k]}" for row in names] for k in range(len(names[0]))]
        curves = [_with_deviation(model, keys, columns) for keys in wheels]
        for k, row in enumerate(found):
            value, std = max((curve[k] for curve in curves), key=lambda pair: abs(pair[0]))
            row[part] = {"value": value, "unit": unit, "std": std}
    return found


def _with_deviation(
    model: Model, names: Sequence[str], columns: Array
) -> list[tuple[float, float | None]]:
    """Values of a curve with these coefficients, and their standard deviations."""
    value = columns @ np.array([model.values[name] for name in names])
    known = list(model.covariance_names)
    if model.covariance is None or not set(names) <= set(known):
        return [(float(v), None) for v in value]
    at = [known.index(name) for name in names]
    variance = np.einsum("nk,kl,nl->n", columns, model.covariance[np.ix_(at, at)], columns)
    std = np.sqrt(np.maximum(variance, 0.0))
    return [(float(v), float(s)) for v, s in zip(value, std, strict=True)]


def sentence_of_map(model: Model, name: str, points: int) -> str:
    """What a map is, how large at so many places, and where it holds."""
    low, high = model.map_limits[name]
    variable, rows = variable_of(name), curve_of(model, name, points)
    sizes = []
    for part, unit, _ in components_of(name):
        most = max(abs(row[part]["value"]) for row in rows)
        what = "" if part == "torque" else f" along {part}" if part != "turn" else " in turning"
        sizes.append(f"{most:.2g} {unit}{what}")
    return (
        f"{name}: a smooth map over {variable.name.replace('_', ' ')} from {low:.3g} to {high:.3g} "
        f"{variable.unit} of what no named effect explains, up to {', '.join(sizes)}; it explains "
        "nothing, and is refused where it has not been"
    )
