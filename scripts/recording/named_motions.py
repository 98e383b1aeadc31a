"""Motions and plants as they are named on the command line."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from controllers.recording import generator
from youbot_env.errors import InputError
from youbot_env.files import read_json
from youbot_env.model.model import Model
from youbot_env.motions.base import MOTION_FILE, Motion
from youbot_env.motions.calibration import calibration, motion_i, motion_ii, motion_iii, motion_iv
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import CATALOGUE, Effect
from youbot_env.physics.geometry import Geometry

DEFAULT_MOTIONS = "calibration,multisine_a,multisine_b"

FIXED = {
    "calibration": calibration,
    "I": motion_i,
    "II": motion_ii,
    "III": motion_iii,
    "IV": motion_iv,
}
"""Motions that do not depend on the seed; names with "multisine" are drawn at random."""

_SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. -]*")


def motions_named(names: str | Iterable[str], geometry: Geometry, seed: int) -> list[Motion]:
    """The motions of a list of names, or of names separated by commas.

    A name is one of FIXED, starts with "multisine" (tones and phases are drawn from the seed and
    the name), or is a JSON file that holds ``Motion.to_dict()``.

    Raises
    ------
    InputError
        If a name is unknown, a file does not hold a motion, or two motions have one name.
    """
    names = names.split(",") if isinstance(names, str) else names
    found: dict[str, Motion] = {}
    for name in filter(None, (name.strip() for name in names)):
        motion = _motion_named(name, geometry, seed)
        if motion.name in found:
            raise InputError(f"motions: two are named '{motion.name}'; logs go by name, rename one")
        found[motion.name] = motion
    if not found:
        raise InputError(f"motions: none is named; use {', '.join(FIXED)} or multisine_a")
    return list(found.values())


def _motion_named(name: str, geometry: Geometry, seed: int) -> Motion:
    if name in FIXED:
        return FIXED[name](geometry)
    if name.endswith(".json"):
        return _motion_from_file(Path(name))
    if name.startswith("multisine") and _SAFE_NAME.fullmatch(name):
        # Seed and name: adding a motion to the list does not change the others.
        rng = generator(seed, name, "motion")
        # Gone through twice, a motion shows the noise of its log: what does not repeat. A period of
        # 30.5 s holds the twelve harmonics that four tones an axis need.
        return multisine(rng, tones=4, duration=64.0, periods=2, geometry=geometry, name=name)
    raise InputError(
        f"motion {name!r}: not known; use {', '.join(FIXED)}, multisine_a (or another name that "
        "starts with multisine), or a .json file that holds a motion"
    )


def _motion_from_file(path: Path) -> Motion:
    motion = read_json(path, MOTION_FILE)
    if not _SAFE_NAME.fullmatch(motion.name):
        raise InputError(
            f"{path}: motion name {motion.name!r} cannot name a file; use letters, digits, _ and -"
        )
    return motion


def catalogue_size(effect: Effect) -> dict[str, float]:
    """Parameters of an effect at its catalogue size.

    Where each wheel has its own value only the front left one has that size: what all four share
    belongs to the base model.
    """
    values = effect.public_defaults
    for parameter in effect.public_parameters:
        if not parameter.is_shape:
            values[parameter.names[0]] = parameter.size
    return values


def with_effects(model: Model, texts: Iterable[str]) -> Model:
    """The model plus effects given as ``NAME`` (at catalogue size) or ``NAME:param=value,...``.

    Raises
    ------
    InputError
        If an effect or parameter is unknown, or a value is no number or out of its bounds.
    """
    for text in texts:
        name, colon, assignments = text.partition(":")
        values = _values(text, assignments) if colon else catalogue_size(CATALOGUE[name])
        model = model.with_effect(name, **values)
    return model


def _values(text: str, assignments: str) -> dict[str, Any]:
    values = {}
    for assignment in assignments.split(","):
        key, _, number = assignment.partition("=")
        try:
            values[key.strip()] = float(number)
        except ValueError:
            raise InputError(
                f"effect {text!r}: {assignment!r} is not parameter=number; write for instance "
                "wheel_coulomb_friction:torque=0.25"
            ) from None
    return values
