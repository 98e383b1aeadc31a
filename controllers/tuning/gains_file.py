"""Gains files: JSON, validated on load, written atomically; loading one never runs code."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from controllers.kinematic import Gains
from controllers.pid.design import PIDGains
from youbot_env.errors import InputError
from youbot_env.model.model_file import (
    check_version,
    mapping,
    named,
    number,
    parse_json,
    read_text,
    write_content,
)

SCHEMA_VERSION = 1

UNITS: dict[str, dict[str, str]] = {
    "kinematic": {"proportional": "N m s/rad", "integral": "N m/rad", "lead": "s"},
    "pid": {
        "bandwidth_x": "rad/s",
        "bandwidth_y": "rad/s",
        "bandwidth_w": "rad/s",
        "damping": "1",
        "derivative_time": "s",
        "filter_time": "s",
    },
}
"""What a file holds for each controller, with its unit."""

BANDWIDTHS = ("bandwidth_x", "bandwidth_y", "bandwidth_w")

REQUIRED = ("schema_version", "controller", "gains")
KNOWN = (*REQUIRED, "loop", "model", "provenance")


def gains_to_dict(gains: Gains | PIDGains) -> dict[str, Any]:
    """Controller and gains as the file holds them."""
    values: dict[str, Any] = asdict(gains)
    name = "kinematic" if isinstance(gains, Gains) else "pid"
    if name == "pid":
        values = {**dict(zip(BANDWIDTHS, values.pop("bandwidth"), strict=True)), **values}
    return {
        "controller": name,
        "gains": {key: {"value": values[key], "unit": unit} for key, unit in UNITS[name].items()},
    }


def save_gains(
    path: str | os.PathLike[str],
    gains: Gains | PIDGains,
    *,
    loop: Mapping[str, Any] | None = None,
    model: str = "",
    provenance: Mapping[str, Any] | None = None,
) -> None:
    """Write a gains file, complete or not at all, with what the gains were tuned for.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    about = {"loop": dict(loop or {}), "model": model, "provenance": dict(provenance or {})}
    write_content(path, {"schema_version": SCHEMA_VERSION, **gains_to_dict(gains), **about})


def is_gains_file(path: str | os.PathLike[str]) -> bool:
    """Whether a file can be read and says that it holds gains; whether they are valid is open."""
    source = os.fspath(path)
    try:
        return "gains" in parse_json(read_text(source), source)
    except InputError:
        return False


def load_gains(path: str | os.PathLike[str]) -> Gains | PIDGains:
    """Gains of ``KinematicControl`` or of ``PID``, as the file says.

    Raises
    ------
    InputError
        If the file cannot be read or is no valid gains file: one line with file and key.
    """
    source = os.fspath(path)
    data = parse_json(read_text(source), source)
    check_version(data, source)
    for key in data:
        if key not in KNOWN:
            raise InputError(f"{source}: unknown key {key!r}; known are {', '.join(KNOWN)}")
    for key in REQUIRED:
        if key not in data:
            raise InputError(f"{source}: {key!r} is missing: is it a gains file of `youbot tune`?")
    name = data["controller"]
    if not isinstance(name, str) or name not in UNITS:
        raise InputError(f"{source}: controller {name!r} is none of {', '.join(UNITS)}")
    values = _values(mapping(data["gains"], source, "gains"), UNITS[name], source)
    try:
        if name == "kinematic":
            return Gains(**values)
        x, y, w = (values.pop(key) for key in BANDWIDTHS)
        return PIDGains((x, y, w), **values)
    except InputError as error:
        raise named(source, error) from None


def _values(data: Mapping[str, Any], units: Mapping[str, str], source: str) -> dict[str, float]:
    for key in data:
        if key not in units:
            raise InputError(f"{source}: gains: unknown {key!r}; known are {', '.join(units)}")
    found = {}
    for key, unit in units.items():
        if key not in data:
            raise InputError(f"{source}: gains: {key!r} is missing")
        entry = data[key]
        said = entry.get("unit", unit) if isinstance(entry, Mapping) else unit
        if said != unit:
            raise InputError(f"{source}: gains.{key}: unit {said!r}, expected {unit!r}: convert it")
        found[key] = number(entry, source, f"gains.{key}")
    return found
