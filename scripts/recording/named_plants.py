"""Plants as they are named on the command line: a model, or bodies with its parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from youbot_env.contact.settings import Contact
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model, model_to_dict
from youbot_env.simulation.platforms import Platforms
from youbot_scripts.recording.named_motions import with_effects

CONTACT = "contact"

SETTINGS = {field.name: field for field in dataclasses.fields(Contact)}


@dataclass(frozen=True)
class Driven:
    """A plant by its parts.

    Attributes
    ----------
    model : its parameters and effects
    contact : contact of wheels and floor; None: the model itself is simulated, without slip
    """

    model: Model
    contact: Contact | None = None

    def platform(self) -> Model | Platforms:
        """The plant as :func:`controllers.recording.run` takes it.

        Raises
        ------
        InputError
            If MuJoCo is missing, or no bodies have these parameters and effects.
        """
        if self.contact is None:
            return self.model
        from youbot_env.contact.plant import ContactPlant

        return ContactPlant(self.model, self.contact)

    def to_dict(self) -> dict[str, Any]:
        """JSON form of everything that determines its motion."""
        found = {"plant": model_to_dict(self.model)}
        return found if self.contact is None else found | {"contact": self.contact.to_dict()}

    def __str__(self) -> str:
        return self.model.name if self.contact is None else f"{self.model.name} with contacts"


def plant_named(text: str, effects: Iterable[str] = ()) -> Driven:
    """The plant ``text``: a model's name or file, or ``contact[:SETTING=VALUE,...]``.

    The settings are the fields of :class:`Contact`, and ``model``, a name or file ("paper").

    Parameters
    ----------
    effects : added to its model, as ``with_effects`` takes them

    Raises
    ------
    InputError
        If a model, effect or setting is unknown, or a value cannot be.
    """
    kind, colon, assignments = text.partition(":")
    if kind != CONTACT:
        return Driven(with_effects(load_model(text), effects))
    given = dict(_assigned(text, part) for part in assignments.split(",")) if colon else {}
    model = with_effects(load_model(given.pop("model", "paper")), effects)
    return Driven(model, Contact(**{name: _number(text, name, given[name]) for name in given}))


def _assigned(text: str, assignment: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in assignment.partition("="))
    if not equals or not value or name not in (*SETTINGS, "model"):
        known = ", ".join(("model", *SETTINGS))
        raise InputError(
            f"plant {text!r}: {assignment.strip()!r} is not SETTING=VALUE with one of {known}; "
            "slopes, payloads and dragging wheels are effects of the model (--effect)"
        )
    return name, value


def _number(text: str, name: str, value: str) -> Any:
    try:
        # With postponed annotations a field's type is text.
        return int(value) if SETTINGS[name].type == "int" else float(value)
    except ValueError:
        raise InputError(
            f"plant {text!r}: {name}={value} is not a number as {name} needs"
        ) from None
