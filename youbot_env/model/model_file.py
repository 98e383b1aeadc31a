"""Model files: JSON, validated on load, written atomically; loading one never runs code."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np

from youbot_env.errors import InputError, finite
from youbot_env.files import (
    MAX_BYTES,
    SCHEMA_VERSION,
    FileKind,
    Schema,
    parse_json,
    read_bytes,
    write_json,
)
from youbot_env.model.covariance import covariance_of
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import ARRANGEMENTS, WHEELS, Geometry

LENGTHS = ("l", "h", "R", "r", "m1")
"""Of a platform's geometry, in the order of :class:`Geometry`."""

OPTIONAL = ("arrangement", "roller_angles", "torque_limit", "speed_limit")
"""What a geometry file may say beside them: see :class:`Geometry`."""

MIN_WHEEL_RADIUS, MAX_WHEEL_RADIUS = 0.015, 0.6
"""Of wheels that a platform may have [m]: beyond, the file is in another unit."""

# --- what the model files of all mechanisms share ---------------------------------------------

ENTRY: Schema = {
    # A file written by hand may say "mu1": 0.1 for "mu1": {"value": 0.1, "unit": "N m s"}.
    "type": ["number", "object"],
    "properties": {
        "value": {"type": "number"},
        "std": {"type": ["number", "null"], "minimum": 0},
    },
    "required": ["value"],
}
"""A number with unit and standard deviation, or bare."""

ENTRIES: Schema = {"type": "object", "additionalProperties": ENTRY}

LOG_NAMES: Schema = {"type": "array", "items": {"type": "string"}, "minItems": 1}
"""Of an effect that acts in some logs only."""

SHARED: dict[str, Schema] = {
    "parameters": ENTRIES,
    "effects": {
        "type": "object",
        "additionalProperties": {
            "type": "object",
            "properties": {"parameters": ENTRIES, "logs": LOG_NAMES},
        },
    },
    "covariance": {
        "type": ["object", "null"],
        "properties": {"names": {"type": "array"}, "matrix": {"type": "array"}},
        "required": ["names", "matrix"],
    },
    "logs": {"type": "array", "items": {"type": "object"}},
    "errors": {"type": "object"},
    "provenance": {"type": "object"},
}
"""Fields of any mechanism's model. Names, units and bounds are in the catalogue, not here; they are
checked after the schema."""


def history_to_dict(model: Any) -> dict[str, Any]:
    """A model's record of its own fit: covariance, logs, errors, provenance."""
    return {
        "covariance": None
        if model.covariance is None
        else {"names": list(model.covariance_names), "matrix": model.covariance.tolist()},
        "logs": [dict(log) for log in model.logs],
        "errors": dict(model.errors),
        "provenance": dict(model.provenance),
    }


def history_from_dict(data: Mapping[str, Any]) -> dict[str, Any]:
    """The same, and the name, as a model's constructor takes them."""
    names, matrix = covariance_of(data.get("covariance"))
    return {
        "covariance": matrix,
        "covariance_names": names,
        "logs": tuple(dict(log) for log in data.get("logs", ())),
        "errors": dict(data.get("errors", {})),
        "name": str(data.get("name", "model")),
        "provenance": dict(data.get("provenance", {})),
    }


def estimate_entry(estimate: Estimate) -> dict[str, Any]:
    """One parameter as the file holds it."""
    return {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}


def effect_entries(model: Model[Any]) -> dict[str, Any]:
    """A model's effects as the file holds them, with the logs of those that act in some only."""
    return {
        effect: {"parameters": {key: estimate_entry(item) for key, item in parameters.items()}}
        | ({"logs": list(model.effect_logs[effect])} if effect in model.effect_logs else {})
        for effect, parameters in model.effects.items()
    }


def effect_logs(content: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Names of the logs of effects that act in some only, from a file's content."""
    entries = content.get("effects", {})
    return {name: tuple(entry["logs"]) for name, entry in entries.items() if "logs" in entry}


def number(entry: Any, where: str) -> float:
    """The number that an entry holds, bare or as its ``value``."""
    return finite(where, entry["value"] if isinstance(entry, dict) else entry)


def estimates(
    entries: Mapping[str, Any], units: Mapping[str, str], where: str, noun: str = "parameter "
) -> dict[str, Estimate]:
    """All quantities that ``units`` names, each in its unit, from entries that fit the schema.

    Raises
    ------
    InputError
        If one is unknown, missing, or in another unit; ``where`` is the entries' path in the file.
    """
    for name in entries:
        if name not in units:
            known = ", ".join(units)
            raise InputError(f"{where}: unknown {noun}{name!r}; known are {known}")
    found = {}
    for name, unit in units.items():
        if name not in entries:
            raise InputError(f"{where}: {name!r} is missing")
        entry, path = entries[name], f"{where}.{name}"
        said, std = unit, None
        if isinstance(entry, dict):
            said, std = entry.get("unit", unit), entry.get("std")
        if said != unit:
            raise InputError(f"{path}: unit {said!r}, expected {unit!r}: convert it")
        std = None if std is None else finite(f"{path}.std", std)
        found[name] = Estimate(number(entry, path), unit, std)
    return found


# --- files of a platform ---------------------------------------------------------------------


@cache
def _shipped_folder() -> Traversable:
    return resources.files("youbot_env").joinpath("models")


def shipped_models() -> tuple[str, ...]:
    """Names of the models that ship with the package."""
    names = (file.name for file in _shipped_folder().iterdir())
    return tuple(sorted(name[:-5] for name in names if name.endswith(".json")))


def _shipped(name: str) -> Traversable | None:
    """The file of a shipped model, or None where a path or an unknown name is meant."""
    file = _shipped_folder().joinpath(f"{name}.json")
    # A name with a folder in it is a path, and must not lead out of the package's folder.
    return file if os.path.basename(name) == name and file.is_file() else None


def read_content(source: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of a model file, or of a shipped model by its name; of any mechanism.

    Raises
    ------
    InputError
        If the file cannot be read or is no JSON object.
    """
    name = os.fspath(source)
    if shipped := _shipped(name):
        text = shipped.read_bytes()
    else:
        text = read_bytes(name, MAX_BYTES, _advice)
    content = parse_json(text, name, MODEL_FILE)
    if not isinstance(content, dict):
        raise InputError(f"{name}: the file must be a JSON object")
    return content


def _advice() -> str:
    return f"give a model file or a shipped model ({', '.join(shipped_models())})"


def load_model(source: str | os.PathLike[str] | Model[Geometry]) -> Model[Geometry]:
    """Load a model file, or a model that ships with the package by name (``paper``).

    Raises
    ------
    InputError
        If the file cannot be read or does not hold a valid model: one line with file and key.
    """
    if isinstance(source, Model):
        return source
    return model_from_dict(read_content(source), os.fspath(source))


def load_geometry(source: str | os.PathLike[str]) -> Geometry:
    """What is known of a platform, from a model, a shipped model's name, or a JSON file.

    Such a file holds l, h, R, r, m1 (and ``OPTIONAL`` keys), bare or under "geometry".
    """
    name = os.fspath(source)
    if _shipped(name):
        return load_model(name).geometry
    content = read_content(name)
    return GEOMETRY_FILE.from_content({"geometry": content.get("geometry", content)}, name)


def geometry_to_dict(geometry: Geometry) -> dict[str, Any]:
    """A geometry as files hold it; what is not the youBot's alone beside the five numbers."""
    found: dict[str, Any] = {name: getattr(geometry, name) for name in LENGTHS}
    usual = Geometry()
    for name in OPTIONAL:
        value = getattr(geometry, name)
        if value != getattr(usual, name):
            found[name] = list(value) if isinstance(value, tuple) else value
    return found


def save_model(path: str | os.PathLike[str], model: Model[Geometry]) -> None:
    """Write a model file: complete or not at all."""
    write_json(path, model_to_dict(model))


def model_to_dict(model: Model[Geometry]) -> dict[str, Any]:
    """The model file's content."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": model.name,
        "mechanism": "mecanum",
        "geometry": geometry_to_dict(model.geometry),
        "parameters": {name: estimate_entry(model.parameters[name]) for name in BASE_UNITS},
        "effects": effect_entries(model),
        **history_to_dict(model),
    }


def model_from_dict(data: Any, source: str = "model") -> Model[Geometry]:
    """Build and check a model from a model file's content; ``source`` names it in errors."""
    MODEL_FILE.check_version(data, source)
    # Before the schema: a file of another mechanism does not fit it, and the error would name a
    # missing key instead of the mechanism.
    if data.get("mechanism", "mecanum") != "mecanum":
        raise InputError(f"{source}: mechanism {data['mechanism']!r} is not a mecanum platform")
    return MODEL_FILE.from_content(data, source)


def _model(content: dict[str, Any], source: str) -> Model[Geometry]:
    effects = {name: _effect(name, of) for name, of in content.get("effects", {}).items()}
    return Model(
        geometry=_geometry(content, source),
        parameters=estimates(content["parameters"], BASE_UNITS, "parameters"),
        effects=effects,
        effect_logs=effect_logs(content),
        **_with_wheels(history_from_dict(content), effects),
    )


def _with_wheels(history: dict[str, Any], effects: Iterable[str]) -> dict[str, Any]:
    """A history whose covariance names each wheel's parameter, where a file knew one for all."""
    known = {
        f"{effect}.{parameter.name}": [f"{effect}.{name}" for name in parameter.names]
        for effect in effects
        for parameter in CATALOGUE[effect].public_parameters
        if parameter.each_wheel
    }
    names, matrix = history["covariance_names"], history["covariance"]
    if matrix is None or not any(name in known for name in names):
        return history
    wider = [(name, k) for k, old in enumerate(names) for name in known.get(old, [old])]
    rows = [k for _, k in wider]
    return history | {
        "covariance_names": tuple(name for name, _ in wider),
        "covariance": matrix[np.ix_(rows, rows)],
    }


def _geometry(content: dict[str, Any], source: str) -> Geometry:
    numbers = content["geometry"]
    found = {name: number(numbers[name], f"geometry.{name}") for name in LENGTHS}
    # A wheel's radius of 0.6 m is a lorry's; in other units than m that of any platform is more.
    if found["R"] > MAX_WHEEL_RADIUS:
        unit, factor = ("mm", 1000) if found["R"] / 1000 > MIN_WHEEL_RADIUS else ("cm", 100)
        raise InputError(
            f"{source}: geometry.R: {found['R']:g} m cannot be a wheel's radius; lengths in "
            f"{unit}? divide l, h, R, r by {factor}"
        )
    more = {name: numbers[name] for name in ("arrangement",) if name in numbers}
    for name in ("torque_limit", "speed_limit"):
        if numbers.get(name) is not None:
            more[name] = number(numbers[name], f"geometry.{name}")
    if (angles := numbers.get("roller_angles")) is not None:
        several = angles if isinstance(angles, list) else [angles] * len(WHEELS)
        more["roller_angles"] = tuple(
            number(angle, f"geometry.roller_angles[{i}]") for i, angle in enumerate(several)
        )
    return Geometry(**found, **more)


def _effect(name: str, entry: Mapping[str, Any]) -> dict[str, Estimate]:
    """An effect's estimates; shape constants that are left out take their defaults."""
    effect = CATALOGUE[name]
    units = {key: effect.public_parameter(key).unit for key in effect.public_names}
    shapes = {
        key: value
        for key, value in effect.public_defaults.items()
        if effect.public_parameter(key).is_shape
    }
    given = effect.for_each_wheel(entry.get("parameters", {}))
    return estimates({**shapes, **given}, units, f"effects.{name}.parameters")


_LIMIT: Schema = {**ENTRY, "type": ["number", "object", "null"]}
_ANGLES: Schema = {
    # One for all wheels, bare or with its unit, or a list.
    **ENTRY,
    **{"type": ["number", "object", "array", "null"], "items": ENTRY, "minItems": 4, "maxItems": 4},
}
GEOMETRY: Schema = {
    "type": "object",
    "properties": {
        **dict.fromkeys(LENGTHS, ENTRY),
        "arrangement": {"enum": list(ARRANGEMENTS)},
        "roller_angles": _ANGLES,
        "torque_limit": _LIMIT,
        "speed_limit": _LIMIT,
    },
    "required": list(LENGTHS),
}

MODEL_FILE = FileKind(
    "a model file",
    {
        "type": "object",
        "properties": {"geometry": GEOMETRY, **SHARED},
        "required": ["geometry", "parameters"],
    },
    _model,
)

GEOMETRY_FILE = FileKind(
    "a geometry file",
    {"type": "object", "properties": {"geometry": GEOMETRY}, "required": ["geometry"]},
    _geometry,
    version=None,
)
