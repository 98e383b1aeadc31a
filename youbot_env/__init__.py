"""Model, simulation and Gymnasium environments of a mecanum platform."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from youbot_env.tracking.registration import register_when_imported

if TYPE_CHECKING:
    from youbot_env.contact.plant import ContactPlant
    from youbot_env.contact.settings import Contact
    from youbot_env.errors import InputError
    from youbot_env.exports import to_torch
    from youbot_env.exports.bodies import to_mjcf
    from youbot_env.exports.control_systems import linear_control, to_control
    from youbot_env.exports.step_function import step_function
    from youbot_env.model.model import Estimate, Model
    from youbot_env.model.model_file import load_model, save_model, shipped_models
    from youbot_env.motions.calibration import multisine
    from youbot_env.physics.effect import (
        ACTUATOR,
        BODY,
        CATALOGUE,
        CHANNEL,
        CLOCK,
        ROLLER,
        WHEEL,
        WORLD,
        Parameter,
        Public,
        effect,
    )
    from youbot_env.physics.geometry import Geometry
    from youbot_env.simulation.free_run import initial_state
    from youbot_env.simulation.plant import Plant

__version__ = "0.1.0"

_HOMES = {
    "youbot_env.physics.effect": (
        *("ACTUATOR", "BODY", "CHANNEL", "CLOCK", "ROLLER", "WHEEL", "WORLD"),
        *("Parameter", "Public", "effect"),
    ),
    "youbot_env.contact.settings": ("Contact",),
    "youbot_env.contact.plant": ("ContactPlant",),
    "youbot_env.errors": ("InputError",),
    "youbot_env.exports": ("to_torch",),
    "youbot_env.exports.bodies": ("to_mjcf",),
    "youbot_env.exports.control_systems": ("linear_control", "to_control"),
    "youbot_env.exports.step_function": ("step_function",),
    "youbot_env.physics.geometry": ("Geometry",),
    "youbot_env.model.model": ("Estimate", "Model"),
    "youbot_env.model.model_file": ("load_model", "save_model", "shipped_models"),
    "youbot_env.motions.calibration": ("multisine",),
    "youbot_env.simulation.plant": ("Plant",),
    "youbot_env.simulation.free_run": ("initial_state",),
    "youbot_env.physics.structure": ("CATALOGUE",),  # it fills the catalogue
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ACTUATOR",
    "BODY",
    "CATALOGUE",
    "CHANNEL",
    "CLOCK",
    "ROLLER",
    "WHEEL",
    "WORLD",
    "Contact",
    "ContactPlant",
    "Estimate",
    "Geometry",
    "InputError",
    "Model",
    "Parameter",
    "Plant",
    "Public",
    "effect",
    "initial_state",
    "linear_control",
    "load_model",
    "multisine",
    "save_model",
    "shipped_models",
    "step_function",
    "to_control",
    "to_mjcf",
    "to_torch",
]


def __getattr__(name: str) -> Any:
    """Public names are fetched when first used: a model needs no compiler, a script no Gym."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])


register_when_imported()
