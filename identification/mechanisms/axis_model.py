"""A model of one axis: parameters with uncertainty, effects, and its file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.axis import AXIS, Axis, default_theta, typical
from identification.mechanisms.axis_effects import AXIS_BASE, AXIS_CATALOGUE, Scales, fitted_to
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.plausibility import barely_observable
from identification.mechanisms.settings import MechanismSettings
from identification.signals.filters import FilterSettings
from youbot_env.errors import InputError
from youbot_env.files import SCHEMA_VERSION, FileKind, write_json
from youbot_env.model import model_file as parts
from youbot_env.model.model import Estimate, Model
from youbot_env.physics.effect import Effect

Array = NDArray[np.float64]

MECHANISM = "axis"
BASE_NAMES = tuple(name for item in AXIS_BASE for name in item.parameter_names)
UNITS = ("m", "rad")
"""Units of the position: of an axis that slides, and of one that turns."""

AxisModel = Model[Scales]
"""A model of one axis: ``geometry`` holds the units and typical sizes of the axis."""


def axis_model(
    axis: Mechanism[Scales], theta: Array, std: Mapping[str, float] | None = None
) -> AxisModel:
    """The model of an axis with parameters theta (P,); std by full name, where it is known."""
    found = {
        name: Estimate(float(value), label.parameter.unit, (std or {}).get(name))
        for name, value, label in zip(axis.parameter_names, theta, axis.labels, strict=True)
    }
    effects = {
        effect: {name: found[f"{effect}.{name}"] for name in axis.catalogue[effect].parameter_names}
        for effect in axis.structure.effects
    }
    base = {name: found[name] for name in BASE_NAMES}
    return Model(axis.geometry, base, effects, mechanism=AXIS)


def base_axis_model(
    logs: Sequence[Log],
    *,
    unit: str = "rad",
    every: bool = False,
    settings: MechanismSettings = MechanismSettings(),
) -> AxisModel:
    """Where the identification of an unknown axis starts: typical inertia and nothing else.

    Of an axis that moves one way only, dry friction and offset become one parameter, unless
    ``every`` one is asked for.

    Raises
    ------
    InputError
        If ``unit`` (of the position) is neither "m" nor "rad", or nothing moves in the logs.
    """
    if unit not in UNITS:
        raise InputError(f"unit {unit!r}: an axis is logged in m (m/s, N) or rad (rad/s, N m)")
    scales = typical(logs, turns=unit == "rad", settings=settings)
    axis = Axis(replace(scales, one_way=scales.one_way and not every))
    return axis_model(axis, default_theta(axis))


def warnings_of(model: AxisModel, settings: MechanismSettings = MechanismSettings()) -> list[str]:
    """Sentences on what the logs of a model leave open, the most serious first."""
    # An offset may well be zero.
    return [*_of_one_way(model), *barely_observable(model, settings, sizes={"offset": inf})]


def _of_one_way(model: AxisModel) -> list[str]:
    if not model.geometry.one_way:
        return []
    found = model.parameters["offset"]
    reach = "" if found.std is None else f" ± {found.std:.2g}"
    return [
        "the axis moves one way only, where dry friction and a constant force (weight, an offset "
        f"of the effort) are one: {found.value:.3g}{reach} {found.unit} for both together, written "
        "as offset, with coulomb = 0; a motion both ways tells them apart"
    ]


def save_axis_model(path: str | os.PathLike[str], model: AxisModel) -> None:
    """Write a model file: complete or not at all."""
    write_json(path, axis_to_dict(model))


def axis_to_dict(model: AxisModel) -> dict[str, Any]:
    """The model file's content."""
    sizes = asdict(model.geometry)
    turns, one_way = sizes.pop("turns"), sizes.pop("one_way")
    scales = {"unit": UNITS[turns], **sizes, **({"one_way": True} if one_way else {})}
    return {
        "schema_version": SCHEMA_VERSION,
        "name": model.name,
        "mechanism": MECHANISM,
        "scales": scales,
        "parameters": {name: parts.estimate_entry(model.parameters[name]) for name in BASE_NAMES},
        "effects": parts.effect_entries(model),
        **parts.history_to_dict(model),
    }


def axis_from_dict(data: Mapping[str, Any], source: str) -> AxisModel:
    """Build and check a model from a model file's content; ``source`` names it in errors.

    A file written by hand may leave out ``scales``: they are then guessed from the parameters.
    """
    return AXIS_FILE.from_content(data, source)


def _axis_model(content: dict[str, Any], source: str) -> AxisModel:
    given = content["parameters"]
    scales = _scales(content["scales"]) if content.get("scales") else _guessed(given)
    return Model(
        scales,
        _estimates(AXIS_BASE, scales, given, "parameters"),
        {
            name: _estimates(
                (AXIS_CATALOGUE[name],),
                scales,
                entry.get("parameters", {}),
                f"effects.{name}.parameters",
            )
            for name, entry in content.get("effects", {}).items()
        },
        **parts.history_from_dict(content),
        effect_logs=parts.effect_logs(content),
        mechanism=AXIS,
    )


def _estimates(
    items: Iterable[Effect], scales: Scales, given: Mapping[str, Any], where: str
) -> dict[str, Estimate]:
    """Estimates of effects; shape constants that are left out take their defaults."""
    known = [p for item in items for p in fitted_to(item, scales).parameters]
    shapes = {p.name: p.default for p in known if p.is_shape}
    return parts.estimates({**shapes, **given}, {p.name: p.unit for p in known}, where)


def _scales(entries: Mapping[str, Any]) -> Scales:
    sizes = [parts.number(entries[key], f"scales.{key}") for key in SIZES]
    if min(sizes) <= 0:
        raise InputError("scales must be positive")
    band = parts.number(entries.get("bandwidth", FilterSettings.rate), "scales.bandwidth")
    one_way = bool(entries.get("one_way", False))
    return Scales(entries["unit"] == "rad", *sizes, bandwidth=band, one_way=one_way)


def _guessed(parameters: Mapping[str, Any]) -> Scales:
    """Scales that a model's own parameters suggest: viscous friction as large as dry friction."""
    names = ("inertia", "viscous", "coulomb")
    for name in names:
        if name not in parameters:
            raise InputError(f"parameters: {name!r} is missing")
    inertia, viscous, coulomb = (parts.number(parameters[n], f"parameters.{n}") for n in names)
    entry = parameters["inertia"]
    turns = not isinstance(entry, Mapping) or entry.get("unit", "kg m^2") == "kg m^2"
    speed = coulomb / viscous if min(inertia, viscous, coulomb) > 0 else 1.0
    force = 2 * coulomb or inertia
    return Scales(turns, speed, abs(force / (inertia or 1.0)), abs(force), speed)


SIZES = ("speed", "acceleration", "force", "travel")
"""Of the scales; a file must give all, in any case."""

AXIS_FILE = FileKind(
    "a model file",
    {
        "type": "object",
        "properties": {
            "scales": {
                "type": ["object", "null"],
                "properties": {
                    "unit": {"enum": list(UNITS)},
                    "one_way": {"type": "boolean"},
                    **dict.fromkeys((*SIZES, "bandwidth"), parts.ENTRY),
                },
                "required": ["unit", *SIZES],
            },
            **parts.SHARED,
        },
        "required": ["parameters"],
    },
    _axis_model,
)
