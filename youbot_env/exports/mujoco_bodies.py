"""The model as an MJCF document: bodies, joints and rolling contacts for MuJoCo."""

from __future__ import annotations

import os

from youbot_env.contact.mjcf import check_translatable, mjcf
from youbot_env.contact.settings import Contact
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model


def to_mjcf(
    model: str | os.PathLike[str] | Model,
    contact: Contact | None = None,
    *,
    loaded: bool = False,
) -> str:
    """The platform as MuJoCo's XML: a free body on four wheels with rollers, on a floor.

    Its four motors (fl, fr, bl, br) take the torques [N m] that act at the wheels, so a model's
    ``actuator_lag`` and ``torque_delay`` are for the caller to apply before. floor_tilt turns
    gravity, wheel_coulomb_friction and uneven_wheel_friction brake the joints.
    :class:`youbot_env.ContactPlant` does all this by itself, with ``Plant``'s interface.

    Parameters
    ----------
    model : a model, a model file, or a shipped model's name
    contact : friction, rollers and time step; None is ``Contact()``
    loaded : whether the load of the effect payload_change is on the platform

    Raises
    ------
    InputError
        If the model cannot be read, holds an effect that has no counterpart among bodies, or no
        bodies have its parameters.
    """
    model = load_model(model)
    check_translatable(model)
    return mjcf(model, contact or Contact(), loaded=loaded and "payload_change" in model.effects)
