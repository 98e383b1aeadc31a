"""Policy files: NAME.json describes, NAME.npz beside it holds the weights; neither can run code.

Every number is checked before it is used: what was tampered with, cut short or blown up is refused
with one line.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from controllers.policy.inputs import Layout
from controllers.policy.policy import ACTIVATIONS, Description, Network
from youbot_env.errors import InputError
from youbot_env.files import plain, write_atomically

SCHEMA_VERSION = 1

MAX_JSON, MAX_WEIGHTS = 1 << 20, 1 << 24
"""Bytes that a description and its (unpacked) weights may have: 256 x 256 networks fit 50 times."""

MAX_LAYERS, MAX_AHEAD = 8, 1000
"""Layers of a network; samples ahead and past actions."""

KEYS = {
    "schema_version",
    *("name", "weights_sha256", "observation", "network", "action", "base", "training"),
}


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that ship with the package."""
    folder = resources.files("controllers").joinpath("policies")
    if not folder.is_dir():
        return ()
    return tuple(sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".json")))


def load_policy(source: str | os.PathLike[str]) -> tuple[Network, Description]:
    """Network and description from NAME.json (and NAME.npz beside it), or of a shipped policy.

    Raises
    ------
    InputError
        If a file cannot be read or is not valid: one line with file and key.
    """
    name = os.fspath(source)
    path = Path(name)
    if name in shipped_policies():
        path = Path(str(resources.files("controllers").joinpath(f"policies/{name}.json")))
    elif path.suffix != ".json":
        known = ", ".join(shipped_policies()) or "none"
        raise InputError(f"{name}: is no shipped policy ({known}); name the .json of a policy")
    data = _json(_bytes(path, MAX_JSON), name)
    description, about = _description(data, name)
    weights = path.with_suffix(".npz")
    content = _bytes(weights, MAX_WEIGHTS)
    if hashlib.sha256(content).hexdigest() != data["weights_sha256"]:
        raise InputError(f"{weights}: is not the file that {path.name} describes (sha256 differs)")
    return _network(_arrays(content, str(weights)), description, about, str(weights)), description


def save_policy(
    path: str | os.PathLike[str], network: Network, description: Description
) -> tuple[Path, Path]:
    """Write NAME.json and NAME.npz; the weights come first, so a description never lacks them.

    Raises
    ------
    InputError
        If the path does not end in .json or cannot be written.
    """
    path = Path(path)
    if path.suffix != ".json":
        raise InputError(f"{path}: the description of a policy ends in .json")
    arrays = {"features": network.features, "mix": network.mix}
    for k, (weight, bias) in enumerate(network.layers):
        arrays |= {f"weight_{k}": weight, f"bias_{k}": bias}
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    layout = description.layout
    data = {
        "schema_version": SCHEMA_VERSION,
        "name": description.name,
        "weights_sha256": hashlib.sha256(stream.getvalue()).hexdigest(),
        "observation": {
            "twist_scale": list(layout.twist_scale),
            "preview": layout.preview,
            "action_history": layout.action_history,
            "base_torque": layout.base_torque,
        },
        "network": {
            "layers": [len(network.features), *(len(bias) for _, bias in network.layers)],
            "activation": network.activation,
            "squashed": network.squashed,
        },
        "action": {
            "torque_limit": description.torque_limit,
            "control_rate": description.control_rate,
            "share": description.share,
        },
        "base": description.base,
        "training": plain(description.training),
    }
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_atomically(path.with_suffix(".npz"), stream.getvalue())
    write_atomically(path, text)
    return path, path.with_suffix(".npz")


# --- reading ---------------------------------------------------------------------------------


def _bytes(path: Path, limit: int) -> bytes:
    try:
        with open(path, "rb") as stream:
            content = stream.read(limit + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(content) > limit:
        raise InputError(f"{path}: is larger than {limit >> 20} MiB: not a policy")
    return content


def _json(content: bytes, source: str) -> dict[str, Any]:
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        raise InputError(f"{source}: not valid JSON; is it a policy's description?") from None
    data = _part(data, source, "the file")
    if data.get("schema_version") != SCHEMA_VERSION:
        version = data.get("schema_version")
        raise InputError(
            f"{source}: schema_version is {version!r}, this version of youbot reads "
            f"{SCHEMA_VERSION}: not a policy, or written by another version"
        )
    _exactly(data, KEYS, source, "the file")
    return data


def _description(data: Mapping[str, Any], source: str) -> tuple[Description, dict[str, Any]]:
    seen = _part(data["observation"], source, "observation")
    _exactly(
        seen, {"twist_scale", "preview", "action_history", "base_torque"}, source, "observation"
    )
    acts = _part(data["action"], source, "action")
    _exactly(acts, {"torque_limit", "control_rate", "share"}, source, "action")
    about = _part(data["network"], source, "network")
    _exactly(about, {"layers", "activation", "squashed"}, source, "network")
    scale, base = seen["twist_scale"], data["base"]
    if not isinstance(scale, list) or len(scale) != 3:
        raise InputError(f"{source}: observation.twist_scale must be three numbers")
    if base is not None and not isinstance(base, str):
        raise InputError(f"{source}: base must be null or a controller's name")
    if not isinstance(seen["base_torque"], bool) or seen["base_torque"] != (base is not None):
        raise InputError(f"{source}: observation.base_torque must be true just where base is named")
    layout = Layout(
        twist_scale=tuple(_positive(value, source, "observation.twist_scale") for value in scale),  # pyright: ignore[reportArgumentType]
        preview=_whole(seen["preview"], 0, MAX_AHEAD, source, "observation.preview"),
        action_history=_whole(seen["action_history"], 1, MAX_AHEAD, source, "action_history"),
        base_torque=seen["base_torque"],
    )
    share = _positive(acts["share"], source, "action.share")
    if share > 1.0:
        raise InputError(f"{source}: action.share: {share:g} is more than 1")
    description = Description(
        name=str(data["name"]),
        layout=layout,
        torque_limit=_positive(acts["torque_limit"], source, "action.torque_limit"),
        control_rate=_positive(acts["control_rate"], source, "action.control_rate"),
        base=base,
        share=share,
        training=_part(data["training"], source, "training"),
    )
    return description, about


def _arrays(content: bytes, source: str) -> dict[str, np.ndarray]:
    """The arrays of an npz; sizes are looked at before anything is unpacked."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            size = sum(member.file_size for member in packed.infolist())
            if size > MAX_WEIGHTS:
                raise InputError(f"{source}: unpacks to more than {MAX_WEIGHTS >> 20} MiB")
        with np.load(io.BytesIO(content), allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except InputError:
        raise
    except Exception:  # zipfile, zlib and numpy raise many kinds on broken bytes
        raise InputError(
            f"{source}: not an npz of plain numbers (objects, which could run code, are refused)"
        ) from None


def _network(
    arrays: dict[str, np.ndarray], description: Description, about: dict[str, Any], source: str
) -> Network:
    sizes, activation, squashed = about["layers"], about["activation"], about["squashed"]
    if not isinstance(sizes, list) or not 2 <= len(sizes) <= MAX_LAYERS + 1:
        raise InputError(f"{source}: network.layers must list 2 to {MAX_LAYERS + 1} sizes")
    if activation not in list(ACTIVATIONS):
        raise InputError(f"{source}: network.activation is none of {', '.join(ACTIVATIONS)}")
    if not isinstance(squashed, bool):
        raise InputError(f"{source}: network.squashed must be true or false")
    sizes = [_whole(size, 1, MAX_WEIGHTS, source, "network.layers") for size in sizes]
    shapes: dict[str, tuple[int, ...]] = {
        "features": (sizes[0], description.layout.size),
        "mix": (4, sizes[-1]),
    }
    for k, (before, after) in enumerate(zip(sizes, sizes[1:], strict=False)):
        shapes |= {f"weight_{k}": (after, before), f"bias_{k}": (after,)}
    _exactly(arrays, set(shapes), source, "the file")
    for name, shape in shapes.items():
        kind = np.float64 if name in ("features", "mix") else np.float32
        if arrays[name].shape != shape or arrays[name].dtype != kind:
            found = f"{arrays[name].dtype} {arrays[name].shape}"
            raise InputError(f"{source}: {name} is {found}, expected {kind.__name__} {shape}")
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"{source}: {name} holds NaN or infinity")
    layers = [(arrays[f"weight_{k}"], arrays[f"bias_{k}"]) for k in range(len(sizes) - 1)]
    return Network(arrays["features"], layers, arrays["mix"], activation, squashed)


def _part(value: Any, source: str, what: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{source}: {what} must be a JSON object")
    return value


def _exactly(found: Mapping[str, Any], wanted: set[str], source: str, what: str) -> None:
    for key in sorted(wanted ^ set(found)):
        state = "is missing" if key in wanted else "is not known"
        raise InputError(f"{source}: {what}: {key!r} {state}")


def _whole(value: Any, least: int, most: int, source: str, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(f"{source}: {what} must be a whole number from {least} to {most}")
    return value


def _positive(value: Any, source: str, what: str) -> float:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not 0.0 < value < 1e9:
        raise InputError(f"{source}: {what} must be a positive number")
    return float(value)
