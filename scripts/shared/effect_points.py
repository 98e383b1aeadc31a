"""What an effect can read at each site where it may act, as tables and as JSON."""

from __future__ import annotations

from typing import Any

from youbot_env.physics import effect
from youbot_env.physics.effect import BODY, ROLLER, WHEEL, WORLD, Place
from youbot_env.physics.mecanum import Base
from youbot_scripts.shared.tables import Table, columns, text

FIELDS: dict[str, tuple[str, str]] = {
    "body.twist": ("m/s, m/s, rad/s", "(VX, VY, W) of O, body frame"),
    "body.acceleration": ("m/s^2, m/s^2, rad/s^2", "derivative of the twist's components"),
    "wheel.rate": ("rad/s", "of the joint, positive rolls the robot forward"),
    "wheel.acceleration": ("rad/s^2", "of the joint"),
    "wheel.angle": ("rad", "of the joint, 0 at the log's start unless position_* says otherwise"),
    "wheel.torque": ("N m", "that truly acts at the joint"),
    "roller.rate": ("rad/s", "of the roller on the floor about its axle"),
    "roller.acceleration": ("rad/s^2", "the same"),
    "roller.wheel_angle": (
        "rad",
        "of its wheel: which roller stands on the floor, and where on it",
    ),
    "total_torque": ("N m", "absolute torques of all wheels, added up"),
    "contact": ("m", "with the floor, in the world: contact.x, contact.y"),
    "world.x": ("m", "place of O in the world"),
    "world.y": ("m", "the same, along world Y"),
    "world.yaw": ("rad", "heading in the world, unwrapped"),
    "world.velocity_x": ("m/s", "of O along world X"),
    "world.velocity_y": ("m/s", "of O along world Y"),
    "world.yaw_rate": ("rad/s", "as the body's"),
    "world.com_x": ("m", "from O to the centre of mass, along world X"),
    "world.com_y": ("m", "the same, along world Y"),
    "actuator.torque": ("N m", "that acts at the joint"),
    "actuator.torque_rate": ("N m/s", "its derivative"),
    "channel.torque": ("N m", "as the log, or the command, has it"),
    "channel.rate": ("rad/s", "of the wheel joint"),
    "torque": ("N m", "of the wheel joint"),
    "torque_second_rate": ("N m/s^2", "second derivative of the torque"),
    "speed": ("rad/s", "of the wheel joint"),
    "speed_rate": ("rad/s^2", "its derivative"),
    "tangent": ("1", "of the roller's nominal angle to X, 1 at 45 degrees"),
    "time": ("s", "since the log's start"),
    "start": ("s", "that start, on the clock that the logs share"),
    "base": ("", "parameters: " + ", ".join(f"base.{name}" for name in Base._fields)),
}
"""Unit and meaning of the fields of a site's point, by "SITE.FIELD", or the field where it is the
same at all sites. The site is the lower-case name of the point's class."""

NAMES = {name: value for name, value in sorted(vars(effect).items()) if isinstance(value, Place)}
"""Sites by the name that ``acts_at`` takes."""


def described(place: Place, field: str) -> tuple[str, str]:
    """Unit and meaning of a field of a site's point; empty where nobody has written them."""
    own = f"{place.point.__name__.lower()}.{field}"
    return FIELDS.get(own) or FIELDS.get(field) or ("", "")


def fields_of(place: Place) -> tuple[str, ...]:
    """The fields of a site's point."""
    return tuple(getattr(place.point, "_fields", ()))


OVERCOME = (
    "It is what the drives must overcome, not what acts on the robot: friction has the sign of the "
    "rate, a spring that pulls to x = 0 returns + k x"
)
"""The sign of what an effect returns where it is a force or a torque of the motion."""


def sign_of(place: Place) -> str:
    """The sign of what an effect returns there; empty where it is no force that is added up."""
    return OVERCOME if place in (BODY, WORLD, WHEEL, ROLLER) else ""


def returned(place: Place) -> str:
    """What an effect returns there, as the point's docstring says it."""
    words = " ".join((place.point.__doc__ or "").split())
    start = words.find("An effect here returns ")
    return words[start + len("An effect here returns ") :].split("]")[0] + "]" if start >= 0 else ""


def site_tables() -> list[Table]:
    """A table for each site."""
    return [
        Table(
            f"acts_at={name}",
            columns("field", text("unit"), text("meaning")),
            tuple((field, *described(place, field)) for field in fields_of(place)),
            (f"{_how_often(place)}; returns {returned(place)}", *filter(None, [sign_of(place)])),
        )
        for name, place in NAMES.items()
    ]


def sites_to_dict() -> list[dict[str, Any]]:
    """JSON form of the same."""
    return [
        {
            "acts_at": name,
            "name": place.name,
            "kind": place.kind,
            "each_wheel": place.each_wheel,
            "returns": returned(place),
            "sign": sign_of(place),
            "fields": {
                field: dict(zip(("unit", "meaning"), described(place, field), strict=True))
                for field in fields_of(place)
            },
        }
        for name, place in NAMES.items()
    ]


def _how_often(place: Place) -> str:
    return f"{place.name}, once a wheel" if place.each_wheel else place.name
