"""Model files: JSON, validated on load, written atomically; loading one never runs code."""

from __future__ import annotations

import os
from importlib import resources
from typing import Any

from youbot_env.effects import CATALOGUE
from youbot_env.errors import InputError
from youbot_env.geometry import Geometry
from youbot_env.model import BASE_UNITS, Estimate, Model
from youbot_env.model_parts import (
    SCHEMA_VERSION,
    check_version,
    estimate_entry,
    estimates,
    history_from_dict,
    history_to_dict,
    mapping,
    named,
    number,
    parse_json,
    read_text,
    shipped_models,
    write_content,
)

__all__ = [
    "SCHEMA_VERSION",
    "load_geometry",
    "load_model",
    "model_from_dict",
    "model_to_dict",
    "save_model",
    "shipped_models",
]


def load_model(source: str | os.PathLike[str] | Model) -> Model:
    """Load a model file, or a model that ships with the package by name (``paper``).

    Raises
    ------
    InputError
        If the file cannot be read or does not hold a valid model: one line with file and key.
    """
    if isinstance(source, Model):
        return source
    name = os.fspath(source)
    if name in shipped_models():
        text = resources.files("youbot_env").joinpath(f"models/{name}.json").read_text("utf-8")
        return model_from_dict(parse_json(text, name), name)
    return model_from_dict(parse_json(read_text(name), name), name)


def load_geometry(source: str | os.PathLike[str]) -> Geometry:
    """l, h, R, r, m1 from a model, a shipped model's name, or a JSON file with those five keys."""
    name = os.fspath(source)
    if name in shipped_models():
        return load_model(name).geometry
    data = parse_json(read_text(name), name)
    return _geometry(data.get("geometry", data), name)


def save_model(path: str | os.PathLike[str], model: Model) -> None:
    """Write a model file: complete or not at all."""
    write_content(path, model_to_dict(model))


def model_to_dict(model: Model) -> dict[str, Any]:
    """The model file's content."""
    g = model.geometry
    return {
        "schema_version": SCHEMA_VERSION,
        "name": model.name,
        "mechanism": "mecanum",
        "geometry": {"l": g.l, "h": g.h, "R": g.R, "r": g.r, "m1": g.m1},
        "parameters": {name: estimate_entry(model.parameters[name]) for name in BASE_UNITS},
        "effects": {
            effect: {
                "parameters": {name: estimate_entry(value) for name, value in parameters.items()}
            }
            for effect, parameters in model.effects.items()
        },
        **history_to_dict(model),
    }


def model_from_dict(data: Any, source: str = "model") -> Model:
    """Build and check a model from a model file's content; ``source`` names it in errors."""
    data = mapping(data, source, "the file")
    check_version(data, source)
    if data.get("mechanism", "mecanum") != "mecanum":
        raise InputError(f"{source}: mechanism {data['mechanism']!r} is not a mecanum platform")
    history = history_from_dict(data, source)
    try:
        return Model(
            geometry=_geometry(data.get("geometry"), source),
            parameters=estimates(data.get("parameters"), BASE_UNITS, source, "parameters"),
            effects=_effects(data.get("effects", {}), source),
            **history,
        )
    except InputError as error:
        raise named(source, error) from None


def _geometry(data: Any, source: str) -> Geometry:
    data = mapping(data, source, "geometry")
    missing = [key for key in ("l", "h", "R", "r", "m1") if key not in data]
    if missing:
        raise InputError(f"{source}: geometry lacks {missing[0]!r} (it needs l, h, R, r, m1)")
    try:
        numbers = [number(data[k], source, f"geometry.{k}") for k in ("l", "h", "R", "r", "m1")]
        return Geometry(*numbers)
    except InputError as error:
        raise named(source, error) from None


def _effects(data: Any, source: str) -> dict[str, dict[str, Estimate]]:
    found = {}
    for name, entry in mapping(data, source, "effects").items():
        try:
            effect = CATALOGUE[name]
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        units = {key: effect.public_parameter(key).unit for key in effect.public_names}
        parameters = mapping(entry, source, f"effects.{name}").get("parameters", {})
        where = f"effects.{name}.parameters"
        filled = {
            key: {"value": value}
            for key, value in effect.public_defaults.items()
            if effect.public_parameter(key).is_shape
        } | mapping(parameters, source, where)
        found[name] = estimates(filled, units, source, where)
    return found
