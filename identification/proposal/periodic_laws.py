"""Laws that repeat themselves near a period that a scan has found: over the floor, in time, with
the angle of a wheel."""

from __future__ import annotations

from typing import NamedTuple

from identification.proposal.law import Constant, Law
from identification.proposal.surroundings import CONFIRM, TURN, WAVE, wave_constants
from youbot_env.physics.effect import BODY, ROLLER, WHEEL, WORLD, Place


def ripple_over_floor(period: float, direction: float) -> Law:
    """A force along a direction that is periodic in the way along it, near a period [m]."""
    return Law(
        "ripple_of_floor",
        WORLD,
        ("position_x", "position_y"),
        (
            Constant("sine", "N", size=5.0),
            Constant("cosine", "N", size=5.0),
            *wave_constants(period, direction),
        ),
        (TURN, WAVE, "along = sine * xp.sin(turn) + cosine * xp.cos(turn)"),
        "along * c, along * s, 0.0",
        "Force that repeats itself along one direction of the floor: joints of tiles, a grid",
        "a sin(2 pi p/P) + b cos(2 pi p/P), p = x cos(d) + y sin(d)",
        r"a\sin\frac{2\pi p}{P} + b\cos\frac{2\pi p}{P},\; p = x\cos d + y\sin d",
        "The residual repeats itself along one direction of the floor, faster the faster the robot "
        "drives.",
        CONFIRM["place"],
        terms=2,
    )  # fmt: skip


class Swing(NamedTuple):
    """What swings in time: a force along the world or the robot, a moment, or both.

    name, meaning, recognise : of its law
    place : where it acts; axes : that it acts along, of x, y and yaw
    """

    name: str
    place: Place
    axes: tuple[str, ...]
    meaning: str
    recognise: str


SWAY = Swing(
    "sway",
    WORLD,
    ("x", "y"),
    "Force along the world that swings in time: a deck that sways, a load that hangs",
    "Something pulls to and fro, whatever the robot does.",
)
SWAY_AND_TURN = Swing(
    "sway_and_turn",
    WORLD,
    ("x", "y", "yaw"),
    "Force along the world and moment that swing in time: a deck that sways and turns",
    "Something pulls to and fro and turns the robot, whatever it does.",
)
SWINGING_MOMENT = Swing(
    "swinging_moment",
    WORLD,
    ("yaw",),
    "Moment that swings in time: a turntable that is not at rest, an arm that swings",
    "Something turns the robot to and fro, whatever it does.",
)
SHAKE = Swing(
    "shake",
    BODY,
    ("x", "y", "yaw"),
    "Force along the robot and moment that swing in time: a motor, a pump or an arm on board",
    "Something on board shakes the robot, whatever it does.",
)


def swinging(swing: Swing, period: float) -> Law:
    """A force or moment that swings in time, near a period [s]; when a log began on its clock is a
    number of the log."""
    step = 2e-3 * period
    units = {"x": ("N", 5.0), "y": ("N", 5.0), "yaw": ("N m", 1.0)}
    strengths = tuple(
        Constant(f"{part}_{axis}", units[axis][0], size=units[axis][1])
        for axis in swing.axes
        for part in ("sine", "cosine")
    )
    wave = Constant("period", "s", 0.5 * period, 2.0 * period, period, (period,), step=step)
    point = swing.place.name
    parts = [
        f"sine_{axis} * s + cosine_{axis} * c" if axis in swing.axes else "0.0"
        for axis in ("x", "y", "yaw")
    ]
    return Law(
        swing.name,
        swing.place,
        ("time",),
        (*strengths, wave),
        (
            f"turn = 6.283185307179586 * ({point}.time + {point}.start) / period",
            "s, c = xp.sin(turn), xp.cos(turn)",
        ),
        ", ".join(parts),
        swing.meaning,
        "a sin(2 pi t/T) + b cos(2 pi t/T)",
        r"a\sin\frac{2\pi t}{T} + b\cos\frac{2\pi t}{T}",
        swing.recognise,
        CONFIRM["time"],
        terms=2,
        own_clock="period",
    )


def ripple_of_wheels(cycles: float, each: bool) -> Law:
    """A torque that is periodic in the wheels' angles, near some cycles a turn."""
    law = Law(
        "uneven_ripple_of_wheels" if each else "ripple_of_wheels",
        WHEEL,
        ("wheel_angle",),
        (
            Constant("sine", "N m", size=0.2, each_wheel=each),
            Constant("cosine", "N m", size=0.2, each_wheel=each),
            Constant("cycles", "1", 0.1, 60.0, 1.0, (cycles,), step=0.005),
        ),
        (),
        "sine * xp.sin(cycles * wheel.angle) + cosine * xp.cos(cycles * wheel.angle)",
        "Torque that repeats itself with the angle of each wheel: a gear, cogging",
        "a sin(n phi) + b cos(n phi)",
        r"a\sin n\varphi + b\cos n\varphi",
        "The residual swings with the wheels' angles, faster the faster they turn.",
        CONFIRM["wheel"],
        terms=2,
    )
    return law


def ripple_of_rollers(cycles: float, each: bool) -> Law:
    """Viscous friction of the rollers that swings with the angle of their wheel, near some cycles
    a turn: as many as there are rollers, where it depends on the spot of a roller that carries."""
    swing = "a sin(n phi) + b cos(n phi)"
    return Law(
        "uneven_roller_ripple" if each else "roller_ripple",
        ROLLER,
        ("wheel_angle", "twist"),
        (
            Constant("sine", "N m s", size=2e-3, each_wheel=each),
            Constant("cosine", "N m s", size=2e-3, each_wheel=each),
            Constant("cycles", "1", 0.1, 60.0, 1.0, (cycles,), step=0.005),
        ),
        (
            "size = sine * xp.sin(cycles * roller.wheel_angle)"
            " + cosine * xp.cos(cycles * roller.wheel_angle)",
        ),
        "size * roller.rate",
        "Friction of the rollers that repeats itself with the angle of their wheel: it depends on "
        "which roller stands on the floor, and where on it",
        f"({swing}) w",
        r"(a\sin n\varphi + b\cos n\varphi)\,\omega",
        "The residual swings with the wheels' angles while the robot slides sideways over its "
        "rollers, most plainly where a wheel hardly turns.",
        CONFIRM["roller"],
        terms=2,
    )
