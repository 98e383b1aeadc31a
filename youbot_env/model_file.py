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

from youbot_env.effects import CATALOGUE
from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_env.geometry import Geometry
from youbot_env.model import BASE_UNITS, Estimate, Model

SCHEMA_VERSION = 1
"""Raised when a field changes its meaning; older files are then refused with a clear line."""


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
        return model_from_dict(_parse(text, name), name)
    return model_from_dict(_parse(_read(name), name), name)


def shipped_models() -> tuple[str, ...]:
    """Names of the models that ship with the package."""
    folder = resources.files("youbot_env").joinpath("models")
    return tuple(sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".json")))


def load_geometry(source: str | os.PathLike[str]) -> Geometry:
    """l, h, R, r, m1 from a model, a shipped model's name, or a JSON file with those five keys."""
    name = os.fspath(source)
    if name in shipped_models():
        return load_model(name).geometry
    data = _parse(_read(name), name)
    return _geometry(data.get("geometry", data), name)


def save_model(path: str | os.PathLike[str], model: Model) -> None:
    """Write a model file: complete or not at all."""
    text = json.dumps(_plain(model_to_dict(model)), indent=1, allow_nan=False)
    write_atomically(path, text + "\n")


def _plain(value: Any) -> Any:
    """What JSON can hold: errors and provenance may bring numpy values, NaN and paths."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


def model_to_dict(model: Model) -> dict[str, Any]:
    """The model file's content."""
    g = model.geometry
    return {
        "schema_version": SCHEMA_VERSION,
        "name": model.name,
        "mechanism": "mecanum",
        "geometry": {"l": g.l, "h": g.h, "R": g.R, "r": g.r, "m1": g.m1},
        "parameters": {name: _entry(model.parameters[name]) for name in BASE_UNITS},
        "effects": {
            effect: {"parameters": {name: _entry(value) for name, value in parameters.items()}}
            for effect, parameters in model.effects.items()
        },
        "covariance": None
        if model.covariance is None
        else {"names": list(model.covariance_names), "matrix": model.covariance.tolist()},
        "logs": [dict(log) for log in model.logs],
        "errors": dict(model.errors),
        "provenance": dict(model.provenance),
    }


def _entry(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}


def model_from_dict(data: Any, source: str = "model") -> Model:
    """Build and check a model from a model file's content; ``source`` names it in errors."""
    data = _mapping(data, source, "the file")
    version = data.get("schema_version")
    if isinstance(version, bool) or version != SCHEMA_VERSION:
        raise InputError(
            f"{source}: schema_version is {version!r}, this version of youbot reads "
            f"{SCHEMA_VERSION}: not a model file, or written by another version"
        )
    if data.get("mechanism", "mecanum") != "mecanum":
        raise InputError(f"{source}: mechanism {data['mechanism']!r} is not a mecanum platform")
    names, matrix = _covariance(data.get("covariance"), source)
    try:
        return Model(
            geometry=_geometry(data.get("geometry"), source),
            parameters=_estimates(data.get("parameters"), BASE_UNITS, source, "parameters"),
            effects=_effects(data.get("effects", {}), source),
            covariance=matrix,
            covariance_names=names,
            logs=tuple(_mapping(log, source, "logs") for log in _list(data, "logs", source)),
            errors=_mapping(data.get("errors", {}), source, "errors"),
            name=str(data.get("name", "model")),
            provenance=_mapping(data.get("provenance", {}), source, "provenance"),
        )
    except InputError as error:
        raise _named(source, error) from None


def _named(source: str, error: InputError) -> InputError:
    """The same error with the file's name, if it lacks it."""
    return error if str(error).startswith(f"{source}: ") else InputError(f"{source}: {error}")


def _read(name: str) -> str:
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


def _parse(text: str, name: str) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError beside JSONDecodeError: an integer of thousands of digits.
        is_syntax = isinstance(error, json.JSONDecodeError)
        where = f"row {error.lineno}, column {error.colno}: " if is_syntax else ""
        raise InputError(f"{name}: {where}not valid JSON; is it a model file?") from None
    return _mapping(data, name, "the file")


def _mapping(data: Any, source: str, what: str) -> dict[str, Any]:
    if not isinstance(data, Mapping):
        raise InputError(f"{source}: {what} must be a JSON object")
    return dict(data)


def _list(data: Mapping[str, Any], key: str, source: str) -> list[Any]:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise InputError(f"{source}: {key} must be a JSON list")
    return value


def _number(value: Any, source: str, where: str) -> float:
    if isinstance(value, Mapping):
        value = value.get("value")
    # A JSON integer may be larger than any float.
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not abs(value) <= sys.float_info.max:
        shown = str(value) if len(str(value)) < 40 else "a huge value"
        raise InputError(f"{source}: {where}: {shown} is not a finite number")
    return float(value)


def _geometry(data: Any, source: str) -> Geometry:
    data = _mapping(data, source, "geometry")
    missing = [key for key in ("l", "h", "R", "r", "m1") if key not in data]
    if missing:
        raise InputError(f"{source}: geometry lacks {missing[0]!r} (it needs l, h, R, r, m1)")
    try:
        numbers = [_number(data[k], source, f"geometry.{k}") for k in ("l", "h", "R", "r", "m1")]
        return Geometry(*numbers)
    except InputError as error:
        raise _named(source, error) from None


def _estimates(data: Any, units: Mapping[str, str], source: str, where: str) -> dict[str, Estimate]:
    data = _mapping(data, source, where)
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
            _number(entry, source, f"{where}.{name}"), unit, _std(entry, source, f"{where}.{name}")
        )
    return found


def _std(entry: Mapping[str, Any], source: str, where: str) -> float | None:
    if entry.get("std") is None:
        return None
    std = _number(entry["std"], source, f"{where}.std")
    if std < 0:
        raise InputError(f"{source}: {where}.std: {std:g} must not be negative")
    return std


def _effects(data: Any, source: str) -> dict[str, dict[str, Estimate]]:
    found = {}
    for name, entry in _mapping(data, source, "effects").items():
        try:
            effect = CATALOGUE[name]
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        units = {key: effect.public_parameter(key).unit for key in effect.public_names}
        parameters = _mapping(entry, source, f"effects.{name}").get("parameters", {})
        where = f"effects.{name}.parameters"
        filled = {
            key: {"value": value}
            for key, value in effect.public_defaults.items()
            if effect.public_parameter(key).is_shape
        } | _mapping(parameters, source, where)
        found[name] = _estimates(filled, units, source, where)
    return found


def _covariance(data: Any, source: str) -> tuple[tuple[str, ...], np.ndarray | None]:
    if data is None:
        return (), None
    data = _mapping(data, source, "covariance")
    names = tuple(str(name) for name in _list(data, "names", source))
    try:
        matrix = np.array(_list(data, "matrix", source))
    except ValueError:  # rows of different lengths
        matrix = np.empty(0)
    is_numeric = matrix.dtype.kind in "if" and np.isfinite(matrix).all()
    if not names or matrix.shape != (len(names), len(names)) or not is_numeric:
        raise InputError(
            f"{source}: covariance.matrix must be {len(names)} x {len(names)} numbers, one row for "
            "each of covariance.names"
        )
    return names, matrix.astype(float)
