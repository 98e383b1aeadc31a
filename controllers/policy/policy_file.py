"""Policy files: NAME.json describes, NAME.safetensors beside it holds the weights; neither can run
code.

Every number is checked before it is used: what was tampered with, cut short or blown up is refused
with one line. Weights of older versions, in NAME.npz, are read as well.
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
from numpy.typing import NDArray

from controllers.policy.inputs import Layout
from controllers.policy.policy import ACTIVATIONS, Description, Network
from youbot_env.errors import InputError
from youbot_env.files import (
    SCHEMA_VERSION,
    FileKind,
    Schema,
    plain,
    read_bytes,
    read_json,
    write_atomically,
)
from youbot_env.physics.geometry import ARRANGEMENTS

Arrays = dict[str, NDArray[Any]]

MAX_JSON, MAX_WEIGHTS = 1 << 20, 1 << 24
"""Largest size [bytes] of a description and of its unpacked weights; a network with two layers of
256 needs a fiftieth."""

MAX_LAYERS, MAX_AHEAD = 8, 1000
"""Layers of a network; samples ahead and past actions."""

WEIGHTS, OLD_WEIGHTS = ".safetensors", ".npz"
"""Endings of the weights' file: of this version, and of those before, which is read only."""


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that ship with the package."""
    folder = resources.files("controllers").joinpath("policies")
    if not folder.is_dir():
        return ()
    return tuple(sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".json")))


def load_policy(source: str | os.PathLike[str]) -> tuple[Network, Description]:
    """Network and description from NAME.json (and the weights beside it), or of a shipped policy.

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
    content = read_json(path, DESCRIPTION_FILE)
    description = _description(content)
    weights = weights_file(path)
    packed = read_bytes(weights, MAX_WEIGHTS)
    # Two files: weights of another training beside this description would fit in shape.
    if hashlib.sha256(packed).hexdigest() != content["weights_sha256"]:
        raise InputError(f"{weights}: is not the file that {path.name} describes (sha256 differs)")
    unpack = _unpacked if weights.suffix == WEIGHTS else _unpacked_npz
    arrays = unpack(packed, str(weights))
    return _network(arrays, description, content["network"], str(weights)), description


def weights_file(path: Path) -> Path:
    """The weights' file beside a description; the .npz of older versions if there is no other."""
    new, old = path.with_suffix(WEIGHTS), path.with_suffix(OLD_WEIGHTS)
    return old if old.exists() and not new.exists() else new


def save_policy(
    path: str | os.PathLike[str], network: Network, description: Description
) -> tuple[Path, Path]:
    """Write NAME.json and NAME.safetensors. Weights come first: a description always has them.

    Raises
    ------
    InputError
        If the path does not end in .json or cannot be written.
    """
    # Imported late: commands that read or write no policy start without it.
    from safetensors.numpy import save

    path = Path(path)
    if path.suffix != ".json":
        raise InputError(f"{path}: the description of a policy ends in .json")
    arrays = {"features": network.features, "mix": network.mix}
    for k, (weight, bias) in enumerate(network.layers):
        arrays |= {f"weight_{k}": weight, f"bias_{k}": bias}
    # safetensors writes the memory of an array as it is; a transposed view would be in wrong order.
    packed = save({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    layout = description.layout
    data = {
        "schema_version": SCHEMA_VERSION,
        "name": description.name,
        "weights_sha256": hashlib.sha256(packed).hexdigest(),
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
            "rollers": description.rollers,
        },
        "base": description.base,
        "training": plain(description.training),
    }
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    weights = path.with_suffix(WEIGHTS)
    write_atomically(weights, packed)
    write_atomically(path, text)
    return path, weights


# --- reading ---------------------------------------------------------------------------------


def _description(content: Mapping[str, Any]) -> Description:
    seen, acts = content["observation"], content["action"]
    x, y, w = map(float, seen["twist_scale"])
    return Description(
        name=str(content["name"]),
        layout=Layout(
            twist_scale=(x, y, w),
            preview=int(seen["preview"]),
            action_history=int(seen["action_history"]),
            base_torque=seen["base_torque"],
        ),
        torque_limit=float(acts["torque_limit"]),
        control_rate=float(acts["control_rate"]),
        base=content["base"],
        share=float(acts["share"]),
        rollers=acts.get("rollers", "X"),  # older files hold none
        training=content["training"],
    )


def _checked(content: dict[str, Any], source: str) -> dict[str, Any]:
    """The content, if its parts agree with each other."""
    if content["observation"]["base_torque"] != (content["base"] is not None):
        raise InputError("observation.base_torque must be true just where base is named")
    return content


def _unpacked(content: bytes, source: str) -> Arrays:
    """The arrays of a safetensors file, each a copy of its own that may be written to."""
    from safetensors.numpy import load

    try:
        return {name: np.array(array) for name, array in load(content).items()}
    except Exception as error:  # its own, and KeyError for a type that numpy lacks
        reason = " ".join(str(error).split())[:80]
        raise InputError(f"{source}: not a safetensors file of plain numbers: {reason}") from None


def _unpacked_npz(content: bytes, source: str) -> Arrays:
    """The arrays of an npz; sizes are looked at before anything is unpacked."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            size = sum(member.file_size for member in packed.infolist())
            if size > MAX_WEIGHTS:
                raise InputError(f"{source}: unpacks to more than {MAX_WEIGHTS >> 20} MiB")
        with np.load(io.BytesIO(content), allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    # The clause after it would turn this clear message into a general one.
    except InputError:
        raise
    except Exception:  # zipfile, zlib and numpy raise many kinds on broken bytes
        raise InputError(
            f"{source}: not an npz of plain numbers (objects, which could run code, are refused)"
        ) from None


def _network(
    arrays: Arrays, description: Description, about: Mapping[str, Any], source: str
) -> Network:
    """The network of arrays whose names, shapes and types are those that ``about`` tells."""
    sizes = [int(size) for size in about["layers"]]
    shapes: dict[str, tuple[int, ...]] = {
        "features": (sizes[0], description.layout.size),
        "mix": (4, sizes[-1]),
    }
    for k, (before, after) in enumerate(zip(sizes, sizes[1:], strict=False)):
        shapes |= {f"weight_{k}": (after, before), f"bias_{k}": (after,)}
    for key in sorted(set(shapes) ^ set(arrays)):
        state = "is missing" if key in shapes else "is not known"
        raise InputError(f"{source}: the file: {key[:80]!r} {state}")
    for name, shape in shapes.items():
        kind = np.float64 if name in ("features", "mix") else np.float32
        if arrays[name].shape != shape or arrays[name].dtype != kind:
            found = f"{arrays[name].dtype} {arrays[name].shape}"
            raise InputError(f"{source}: {name} is {found}, expected {kind.__name__} {shape}")
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"{source}: {name} holds NaN or infinity")
    layers = [(arrays[f"weight_{k}"], arrays[f"bias_{k}"]) for k in range(len(sizes) - 1)]
    return Network(
        arrays["features"], layers, arrays["mix"], about["activation"], about["squashed"]
    )


def _exactly(optional: Mapping[str, Schema] = {}, **properties: Schema) -> Schema:
    """An object that has each of the properties and no other but for optional ones."""
    return {
        "type": "object",
        "properties": {**properties, **optional},
        "required": list(properties),
        "additionalProperties": False,
    }


POSITIVE: Schema = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1e9}

DESCRIPTION_FILE = FileKind(
    "a policy's description",
    _exactly(
        schema_version={},
        name={},
        weights_sha256={"type": "string"},
        observation=_exactly(
            twist_scale={"type": "array", "items": POSITIVE, "minItems": 3, "maxItems": 3},
            preview={"type": "integer", "minimum": 0, "maximum": MAX_AHEAD},
            action_history={"type": "integer", "minimum": 1, "maximum": MAX_AHEAD},
            base_torque={"type": "boolean"},
        ),
        network=_exactly(
            layers={
                "type": "array",
                "items": {"type": "integer", "minimum": 1, "maximum": MAX_WEIGHTS},
                "minItems": 2,
                "maxItems": MAX_LAYERS + 1,
            },
            activation={"enum": list(ACTIVATIONS)},
            squashed={"type": "boolean"},
        ),
        action=_exactly(
            torque_limit=POSITIVE,
            control_rate=POSITIVE,
            share={"type": "number", "exclusiveMinimum": 0, "maximum": 1},
            optional={"rollers": {"enum": list(ARRANGEMENTS)}},
        ),
        base={"type": ["string", "null"]},
        training={"type": "object"},
    ),
    _checked,
    max_bytes=MAX_JSON,
)
