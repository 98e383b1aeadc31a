"""Model files: JSON, validated on load, written atomically; loading one never runs code."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import Geometry

SCHEMA_VERSION = 1
"""Raised when a field changes its meaning; older files are then refused with a clear line."""


def shipped_models() -> tuple[str, ...]:
    """Names of the models that ship with the package."""
    folder = resources.files("youbot_env").joinpath("models")
    return tuple(sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".json")))


def write_content(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write a model file's content: complete or not at all."""
    write_atomically(path, json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def check_version(data: Mapping[str, Any], source: str) -> None:
    """Refuse the files of other versions, and what is no model file."""
    version = data.get("schema_version")
    if isinstance(version, bool) or version != SCHEMA_VERSION:
        raise InputError(
            f"{source}: schema_version is {version!r}, this version of youbot reads "
            f"{SCHEMA_VERSION}: not a model file, or written by another version"
        )


def history_to_dict(model: Any) -> dict[str, Any]:
    """What any model knows of its own fit: covariance, logs, errors, provenance."""
    return {
        "covariance": None
        if model.covariance is None
        else {"names": list(model.covariance_names), "matrix": model.covariance.tolist()},
        "logs": [dict(log) for log in model.logs],
        "errors": dict(model.errors),
        "provenance": dict(model.provenance),
    }


def history_from_dict(data: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The same, and the name, as a model's constructor takes them."""
    names, matrix = covariance(data.get("covariance"), source)
    return {
        "covariance": matrix,
        "covariance_names": names,
        "logs": tuple(mapping(log, source, "logs") for log in items(data, "logs", source)),
        "errors": mapping(data.get("errors", {}), source, "errors"),
        "name": str(data.get("name", "model")),
        "provenance": mapping(data.get("provenance", {}), source, "provenance"),
    }


def plain(value: Any) -> Any:
    """What JSON can hold: errors and provenance may bring numpy values, NaN and paths."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


def estimate_entry(estimate: Estimate) -> dict[str, Any]:
    """One parameter as the file holds it."""
    return {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}


def named(source: str, error: InputError) -> InputError:
    """The same error with the file's name, if it lacks it."""
    return error if str(error).startswith(f"{source}: ") else InputError(f"{source}: {error}")


def read_text(name: str) -> str:
    """Text of a model file."""
    try:
        return Path(name).read_text("utf-8")
    except FileNotFoundError:
        known = ", ".join(shipped_models())
        raise InputError(
            f"{name}: no such file; give a model file or a shipped model ({known})"
        ) from None
    except (OSError, ValueError) as error:
        # ValueError: bytes that are not UTF-8, or a name with a null byte.
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise InputError(f"{name}: cannot be read: {reason}".replace("\0", "?")) from None


def parse_json(text: str, name: str) -> dict[str, Any]:
    """A JSON object from text."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError beside JSONDecodeError: an integer of thousands of digits.
        is_syntax = isinstance(error, json.JSONDecodeError)
        where = f"row {error.lineno}, column {error.colno}: " if is_syntax else ""
        raise InputError(f"{name}: {where}not valid JSON; is it a model file?") from None
    return mapping(data, name, "the file")


def mapping(data: Any, source: str, what: str) -> dict[str, Any]:
    """The value as a dict, if it is a JSON object."""
    if not isinstance(data, Mapping):
        raise InputError(f"{source}: {what} must be a JSON object")
    return dict(data)


def items(data: Mapping[str, Any], key: str, source: str) -> list[Any]:
    """A list under a key; empty if there is none."""
    value = data.get(key, [])
    if not isinstance(value, list):
        raise InputError(f"{source}: {key} must be a JSON list")
    return value


def number(value: Any, source: str, where: str) -> float:
    """A finite number, bare or as an entry's value."""
    if isinstance(value, Mapping):
        value = value.get("value")
    # A JSON integer may be larger than any float.
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not abs(value) <= sys.float_info.max:
        shown = str(value) if len(str(value)) < 40 else "a huge value"
        raise InputError(f"{source}: {where}: {shown} is not a finite number")
    return float(value)


def estimates(data: Any, units: Mapping[str, str], source: str, where: str) -> dict[str, Estimate]:
    """All parameters that ``units`` names, each in its unit."""
    data = mapping(data, source, where)
    unknown = [name for name in data if name not in units]
    if unknown:
        raise InputError(
            f"{source}: {where}: unknown parameter {unknown[0]!r}; known are {', '.join(units)}"
        )
    found = {}
    for name, unit in units.items():
        if name not in data:
            raise InputError(f"{source}: {where}: {name!r} is missing")
        entry = data[name] if isinstance(data[name], Mapping) else {"value": data[name]}
        if entry.get("unit", unit) != unit:
            raise InputError(
                f"{source}: {where}.{name}: unit {entry['unit']!r}, expected {unit!r}: convert it"
            )
        found[name] = Estimate(
            number(entry, source, f"{where}.{name}"), unit, _std(entry, source, f"{where}.{name}")
        )
    return found


def _std(entry: Mapping[str, Any], source: str, where: str) -> float | None:
    if entry.get("std") is None:
        return None
    std = number(entry["std"], source, f"{where}.std")
    if std < 0:
        raise InputError(f"{source}: {where}.std: {std:g} must not be negative")
    return std


def covariance(data: Any, source: str) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Names and matrix of a covariance; (), None where there is none."""
    if data is None:
        return (), None
    data = mapping(data, source, "covariance")
    names = tuple(str(name) for name in items(data, "names", source))
    try:
        matrix = np.array(items(data, "matrix", source))
    except ValueError:  # rows of different lengths
        matrix = np.empty(0)
    is_numeric = matrix.dtype.kind in "if" and np.isfinite(matrix).all()
    if not names or matrix.shape != (len(names), len(names)) or not is_numeric:
        raise InputError(
            f"{source}: covariance.matrix must be {len(names)} x {len(names)} numbers, one row for "
            "each of covariance.names"
        )
    return names, matrix.astype(float)


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
