"""Gains files: JSON, validated on load, written atomically; loading one never runs code."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from controllers.kinematic import Gains
from controllers.pid.design import PIDGains
from youbot_env.errors import InputError
from youbot_env.files import SCHEMA_VERSION, FileKind, read_json, write_json
from youbot_env.model.model_file import ENTRIES, estimates

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
    write_json(path, {"schema_version": SCHEMA_VERSION, **gains_to_dict(gains), **about})


def is_gains_file(path: str | os.PathLike[str]) -> bool:
    """Whether a file can be read and says that it holds gains; whether they are valid is open."""
    try:
        return "gains" in read_json(path, ANY_FILE)
    except InputError:
        return False


def load_gains(path: str | os.PathLike[str]) -> Gains | PIDGains:
    """Gains of ``KinematicControl`` or of ``PID``, as the file says.

    Raises
    ------
    InputError
        If the file cannot be read or is no valid gains file: one line with file and key.
    """
    return read_json(path, GAINS_FILE, lambda: f"give {GAINS_FILE.noun}")


def _gains(content: dict[str, Any], source: str) -> Gains | PIDGains:
    found = estimates(content["gains"], UNITS[content["controller"]], "gains", noun="")
    values = {name: entry.value for name, entry in found.items()}
    if content["controller"] == "kinematic":
        return Gains(**values)
    x, y, w = (values.pop(key) for key in BANDWIDTHS)
    return PIDGains((x, y, w), **values)


GAINS_FILE = FileKind(
    "a gains file of `youbot tune`",
    {
        "type": "object",
        "properties": {
            "schema_version": {},
            "controller": {"enum": list(UNITS)},
            "gains": ENTRIES,
            "loop": {},
            "model": {},
            "provenance": {},
        },
        "required": ["controller", "gains"],
        "additionalProperties": False,
    },
    _gains,
)

ANY_FILE = FileKind("a JSON file", {"type": "object"}, lambda content, _: content, version=None)
