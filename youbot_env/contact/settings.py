"""What a plant with real contacts has beyond its model."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import InputError, Settings, check_settings, count, finite


@dataclass(frozen=True)
class EngineSettings:
    """How the engine is set up, and what bodies have that the base model leaves open."""

    max_timestep: float = field(
        default=0.001,
        metadata={"unit": "s", "reason": "the longest step that still resolves the contacts"},
    )
    min_rollers: int = field(
        default=6,
        metadata={"unit": "1", "reason": "the youBot's wheels have six"},
    )
    contact_time: float = field(
        default=0.002,
        metadata={
            "unit": "s",
            "reason": "time constant with which a contact that has sunk in comes out again: "
            "softer ones let two neighbouring rollers carry, and brake, one wheel for "
            "longer; harder ones let wheels lift off",
        },
    )
    friction_stiffness_ratio: float = field(
        default=3.0,
        metadata={
            "unit": "1",
            "reason": "how much stiffer friction is than the normal force (MuJoCo's impratio): "
            "wheels creep less",
        },
    )
    roller_mass_share: float = field(
        default=0.02,
        metadata={
            "unit": "of a wheel's mass",
            "reason": "that is in its rollers, which the base model takes for massless",
        },
    )
    payload_height: float = field(
        default=0.2,
        metadata={
            "unit": "m",
            "reason": "of a payload's centre of mass above the floor: a small load on the deck",
        },
    )
    settling_time: float = field(
        default=0.06,
        metadata={
            "unit": "s",
            "reason": "after it a platform that is held in place stands still on its rollers",
        },
    )
    max_torque: float = field(
        default=1e4,
        metadata={
            "unit": "N m",
            "reason": "at a wheel; beyond it the run has diverged and nothing is simulated",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class Contact(Settings):
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
    timestep: float = EngineSettings.max_timestep
    com_height: float = 0.1

    def __post_init__(self) -> None:
        for name in ("friction", "timestep", "com_height"):
            value = finite(f"contact {name}", getattr(self, name), positive=True)
            object.__setattr__(self, name, value)
        if self.timestep > EngineSettings.max_timestep:
            raise InputError(
                f"contact timestep: {self.timestep:g} s is too coarse for hard contacts; "
                f"at most {EngineSettings.max_timestep:g} s"
            )
        if count("contact rollers", self.rollers) < EngineSettings.min_rollers:
            raise InputError(
                f"contact rollers: {self.rollers} must be at least {EngineSettings.min_rollers}"
            )


def contact_named(plant: str | Contact) -> Contact | None:
    """The settings of a plant "contact", None for a plant "model", or InputError."""
    if isinstance(plant, Contact):
        return plant
    if plant not in ("model", "contact"):
        raise InputError(f"plant: {plant!r} is none of 'model', 'contact' or Contact(...)")
    return Contact() if plant == "contact" else None
