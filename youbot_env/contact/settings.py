"""What a plant with real contacts has beyond its model, and which effects it can be built with."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from youbot_env.errors import InputError, count, finite
from youbot_env.model.model import Model

COARSEST = 0.001
"""Longest step [s] that still resolves the contacts."""

FEWEST_ROLLERS = 6

TRANSLATED = (
    *("floor_tilt", "wheel_coulomb_friction", "uneven_wheel_friction", "payload_change"),
    *("actuator_lag", "torque_delay"),
)
"""Effects of a model that the contact plant knows how to build."""


@dataclass(frozen=True)
class Contact:
    """What a plant with real contacts has beyond its model.

    Attributes
    ----------
    friction : coefficient of Coulomb friction between rollers and floor
    rollers : on each wheel. The youBot has 6; with more the wheels roll more smoothly.
    timestep : longest step of the engine [s], at most 1 ms
    com_height : of the platform's centre of mass above the floor [m]; it moves load between the
        wheels when the platform accelerates or stands on a slope

    Raises
    ------
    InputError
        If a number cannot be.
    """

    friction: float = 0.8
    rollers: int = 16
    timestep: float = COARSEST
    com_height: float = 0.1

    def __post_init__(self) -> None:
        for name in ("friction", "timestep", "com_height"):
            value = finite(f"contact {name}", getattr(self, name), positive=True)
            object.__setattr__(self, name, value)
        if self.timestep > COARSEST:
            raise InputError(
                f"contact timestep: {self.timestep:g} s is too coarse for hard contacts; "
                f"at most {COARSEST:g} s"
            )
        if count("contact rollers", self.rollers) < FEWEST_ROLLERS:
            raise InputError(f"contact rollers: {self.rollers} must be at least {FEWEST_ROLLERS}")

    def to_dict(self) -> dict[str, float]:
        """The settings by name."""
        return asdict(self)


def contact_named(plant: str | Contact) -> Contact | None:
    """The settings of a plant "contact", None for a plant "model", or InputError."""
    if isinstance(plant, Contact):
        return plant
    if plant not in ("model", "contact"):
        raise InputError(f"plant: {plant!r} is none of 'model', 'contact' or Contact(...)")
    return Contact() if plant == "contact" else None


def check_translatable(model: Model) -> None:
    """InputError if the model holds an effect that this plant cannot build."""
    for name in model.effects:
        if name not in TRANSLATED:
            raise InputError(
                f"model {model.name}: effect {name} cannot be built with contacts; a plant "
                f"'contact' knows {', '.join(TRANSLATED)}"
            )
