"""Friction whose size something else sets: the heading, the time, the place, another speed.

A friction of constant size is a :class:`Law` with one strength. A :class:`Sizing` puts a sum in the
place of that constant: a level, and what comes to it. So each sizing goes with each friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from identification.proposal.law import Constant, Law
from identification.proposal.settings import ProposalSettings
from identification.proposal.surroundings import (
    CONFIRM,
    TURN,
    WAVE,
    Surroundings,
    wave_constants,
)
from youbot_env.physics.effect import BODY, WORLD


def frictions_of_travel(seen: Surroundings) -> tuple[Law, Law]:
    """Dry and viscous friction against the motion over the floor."""
    speed = "speed = xp.sqrt(world.velocity_x**2 + world.velocity_y**2 + 2.5e-05)"
    dry = Law(
        "dry_drag", WORLD, ("twist",), (Constant("force", "N", 0.0, size=5.0),),
        (speed, "per_speed = force / speed"),
        "per_speed * world.velocity_x, per_speed * world.velocity_y, 0.0",
        "Dry friction against the motion", "f v/|v|", r"f v/|v|",
        "A constant force against the motion", CONFIRM["place"], dissipative=True,
    )  # fmt: skip
    viscous = replace(
        dry, name="viscous_drag",
        constants=(Constant("coefficient", "N s/m", 0.0, size=5.0 / max(seen.speed, 1e-3)),),
        lines=(),
        result="coefficient * world.velocity_x, coefficient * world.velocity_y, 0.0",
        meaning="Viscous friction against the motion", formula="k v", latex="k v",
        recognise="A force against the motion that grows with it",
    )  # fmt: skip
    return dry, viscous


def frictions_of_turning(settings: ProposalSettings) -> tuple[Law, Law]:
    """Dry and viscous friction of turning."""
    dry = Law(
        "dry_turning", WORLD, ("twist",), (Constant("torque", "N m", 0.0, size=1.0),), (),
        f"0.0, 0.0, torque * xp.tanh(world.yaw_rate / {settings.smoothing[1]:g})",
        "Dry friction of turning", "m sign(W)", r"m\,\mathrm{sign}\,\Omega",
        "A constant moment against turning", CONFIRM["place"], dissipative=True,
    )  # fmt: skip
    viscous = replace(
        dry, name="viscous_turning", constants=(Constant("coefficient", "N m s", 0.0, size=1.0),),
        result="0.0, 0.0, coefficient * world.yaw_rate",
        meaning="Viscous friction of turning", formula="k W", latex=r"k\,\Omega",
        recognise="A moment against turning that grows with it",
    )  # fmt: skip
    return dry, viscous


@dataclass(frozen=True)
class Part:
    """A constant of a size: what it is multiplied by is in ``per`` ("" : nothing).

    share : how large it is where it matters, of the friction's own size; lower : its bound
    """

    name: str
    per: str = ""
    share: float = 1.0
    lower: float = -math.inf

    def constant(self, strength: Constant) -> Constant:
        """It, of a friction with a strength."""
        unit = PER[strength.unit, self.per] if self.per else strength.unit
        return replace(
            strength, name=self.name, unit=unit, size=self.share * strength.size, lower=self.lower
        )


PER = {
    ("N", "s"): "N/s",
    ("N", "m"): "N/m",
    ("N", "m/s"): "N s/m",
    ("N", "rad/s"): "N s/rad",
    ("N s/m", "s"): "N/m",
    ("N s/m", "m"): "N s/m^2",
    ("N s/m", "m/s"): "N s^2/m^2",
    ("N s/m", "rad/s"): "N s^2/(m rad)",
    ("N m", "s"): "N m/s",
    ("N m", "m"): "N",
    ("N m", "m/s"): "N s",
    ("N m s", "s"): "N m",
    ("1", "s"): "1/s",
    ("N m s", "m"): "N s",
    ("N m s", "m/s"): "N s^2",
}
"""Units of a strength over another unit."""

LEVEL = Part("level")
"""The part of a size that does not change: of a friction that begins with nothing, noise takes it
below zero."""


@dataclass(frozen=True)
class Sizing:
    """What sets the size of a friction.

    Attributes
    ----------
    name : what the law's name ends with
    word : of the sentence that says what the law is; more : of the one how to recognise it
    variables : that it reads
    parts : constants of the size; shapes : constants in which it is not linear
    lines : statements before ``size``, the expression; ``{0}`` in it is the point where it acts,
        ``{1}`` what has that point's place on the floor
    formula, latex : of the size; where : what a symbol in them stands for
    confirm : what experiment would confirm it, a key of ``CONFIRM``
    terms : how much longer it makes a law
    """

    name: str
    word: str
    more: str
    variables: tuple[str, ...]
    parts: tuple[Part, ...]
    size: str
    formula: str
    latex: str
    confirm: str
    shapes: tuple[Constant, ...] = ()
    lines: tuple[str, ...] = ()
    where: str = ""
    terms: int = 3


def sized(friction: Law, by: Sizing) -> Law:
    """A friction of one strength, whose size something sets."""
    (strength,) = friction.strengths
    size = by.size.format(friction.point, place_of(friction))
    # A formula begins with the strength, which is one letter.
    formula, latex = friction.formula[1:].lstrip(), friction.latex[1:].removeprefix(r"\,").lstrip()
    where = f", {by.where}" if by.where else ""
    return replace(
        friction,
        name=f"{friction.name}_{by.name}",
        variables=(*by.variables, *(v for v in friction.variables if v not in by.variables)),
        constants=(*(part.constant(strength) for part in by.parts), *friction.shapes, *by.shapes),
        # What was a constant is computed, under the same name.
        lines=(*by.lines, f"{strength.name} = {size}", *friction.lines),
        meaning=f"{friction.meaning}, {by.word}",
        formula=f"({by.formula}) {formula}{where}",
        latex=rf"({by.latex})\,{latex}{where}",
        recognise=f"{friction.recognise.rstrip('.')}, {by.more}.",
        confirm=CONFIRM[by.confirm],
        dissipative=False,  # of parts that are fitted freely the sum may be negative somewhere
        terms=by.terms,
    )


def without_level(by: Sizing) -> Sizing:
    """The same with no part that does not change."""
    return replace(
        by,
        parts=by.parts[1:],
        size=by.size.removeprefix("level + "),
        formula=by.formula.removeprefix("a + "),
        latex=by.latex.removeprefix("a + "),
    )


def place_of(law: Law) -> str:
    """What has the place on the floor at which a law acts, as ``.x`` and ``.y``."""
    return "world" if law.place is WORLD else f"{law.point}.contact"


def by_heading(order: int) -> Sizing:
    """Swinging with the heading, so many times a turn: a brush or a caster that is not round."""
    return Sizing(
        f"by_heading_{order}",
        "whose size swings with the heading",
        "more at some headings than at others",
        ("heading",),
        (Part("level", lower=0.0), Part("cosine"), Part("sine")),
        "level + cosine * xp.cos(times * world.yaw) + sine * xp.sin(times * world.yaw)",
        "a + b cos(n psi) + c sin(n psi)",
        r"a + b\cos n\psi + c\sin n\psi",
        "heading",
        (times_a_turn(order),),
    )


def by_wheel_angle(order: int) -> Sizing:
    """Swinging with the angle of a wheel, so many times a turn: it rubs over a part of the turn."""
    return Sizing(
        f"by_angle_{order}",
        "whose size swings with its angle: it rubs over a part of the turn",
        "more over a part of the turn",
        ("wheel_angle",),
        (LEVEL, Part("cosine"), Part("sine")),
        "level + cosine * xp.cos(times * wheel.angle) + sine * xp.sin(times * wheel.angle)",
        "a + b cos(n phi) + c sin(n phi)",
        r"a + b\cos n\varphi + c\sin n\varphi",
        "wheel",
        (times_a_turn(order),),
        terms=2,
    )


def times_a_turn(order: int) -> Constant:
    """How often something swings a turn."""
    return Constant("times", "1", 1.0, 8.0, 1.0, (float(order),), fitted=False, whole=True)


def by_time() -> Sizing:
    """Growing steadily from the start of each log: something winds up, or wears."""
    return Sizing(
        "that_grows",
        "which grows from the start of each log",
        "more from minute to minute",
        ("time",),
        (LEVEL, Part("growth", "s", 1.0 / 60.0)),
        "level + growth * {0}.time",
        "a + b t",
        "a + b t",
        "time",
        terms=2,
    )


def by_fading(seen: Surroundings, settings: ProposalSettings) -> Sizing:
    """Fading from the start of each log: grease warms, a part runs in."""
    most = max(seen.duration, max(settings.fading_times))
    return Sizing(
        "that_fades",
        "which fades from the start of each log",
        "less from minute to minute, and ever more slowly so",
        ("time",),
        (LEVEL, Part("extra")),
        "level + extra * xp.exp(-{0}.time / time_constant)",
        "a + b exp(-t/T)",
        "a + b e^{-t/T}",
        "time",
        (Constant("time_constant", "s", 1.0, most, 10.0, settings.fading_times),),
        terms=2,
    )


def by_place() -> Sizing:
    """Changing steadily over the floor: it gets softer, wetter, rougher."""
    return Sizing(
        "by_place",
        "which changes steadily over the floor",
        "more on one side of the room",
        ("position_x", "position_y"),
        (LEVEL, Part("along_x", "m"), Part("along_y", "m")),
        "level + along_x * {1}.x + along_y * {1}.y",
        "a + b x + c y",
        "a + b x + c y",
        "place",
    )


def by_distance(seen: Surroundings) -> Sizing:
    """Growing with the distance from a point: a cable that is dragged over the floor."""
    low, high = float(seen.place.min()), float(seen.place.max())
    point = tuple(
        Constant(f"point_{axis}", "m", low - 2.0, high + 2.0, 1.0, (0.0,), step=0.2)
        for axis in "xy"
    )
    return Sizing(
        "by_distance",
        "which grows with the distance from a point: a cable or hose that is dragged along",
        "more the farther it is from one point",
        ("position_x", "position_y"),
        (LEVEL, Part("growth", "m")),
        "level + growth * far",
        "a + b r",
        "a + b r",
        "place",
        point,
        ("far = xp.sqrt((world.x - point_x) ** 2 + (world.y - point_y) ** 2 + 1e-06)",),
        "r from the point",
    )


def over_floor(period: float, direction: float) -> Sizing:
    """Repeating itself along one direction of the floor, near a period [m]: stripes, tiles."""
    return Sizing(
        "of_stripes",
        "whose size repeats itself along one direction of the floor: stripes, tiles",
        "more on some stripes of the floor than on others",
        ("position_x", "position_y"),
        (Part("level", lower=0.0), Part("cosine"), Part("sine")),
        "level + cosine * xp.cos(turn) + sine * xp.sin(turn)",
        "a + b cos(2 pi p/P) + c sin(2 pi p/P)",
        r"a + b\cos\frac{2\pi p}{P} + c\sin\frac{2\pi p}{P}",
        "place",
        wave_constants(period, direction),
        (TURN, WAVE),
        "p along d",
    )


def by_speed(speed: str, symbol: str, latex: str, word: str, unit: str) -> Sizing:
    """Growing with another speed: a caster that is dragged sideways while the robot turns."""
    return Sizing(
        f"by_{word}",
        f"whose size grows with the {word} speed",
        f"more while the {word} speed is large",
        (),
        (LEVEL, Part("growth", unit)),
        f"level + growth * {speed}",
        f"a + b {symbol}",
        f"a + b {latex}",
        "speed",
    )


def sized_frictions(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Friction against the motion, and of turning, whose size another variable sets."""
    dry, viscous = frictions_of_travel(seen)
    dry_turning, viscous_turning = frictions_of_turning(settings)
    for friction in (dry, viscous, viscous_turning):
        yield from (sized(friction, by_heading(order)) for order in (1, 2))
        yield sized(friction, by_place())
    yield sized(dry, by_distance(seen))
    over_time = (by_time(), by_fading(seen, settings))
    yield from (sized(friction, by) for friction in (dry, viscous) for by in over_time)
    by_yaw = by_speed("xp.abs(world.yaw_rate)", "|W|", r"|\Omega|", "yaw", "rad/s")
    yield from (sized(friction, by_yaw) for friction in (dry, viscous))
    travel = "xp.sqrt(world.velocity_x**2 + world.velocity_y**2)"
    by_travel = by_speed(travel, "|v|", "|v|", "driving", "m/s")
    yield from (sized(friction, by_travel) for friction in (dry_turning, viscous_turning))
    yield from _frictions_along_axes(seen, settings)


def stripes(seen: Surroundings, period: float, direction: float) -> Iterator[Law]:
    """Friction against the motion that repeats itself over the floor, near a period [m]."""
    by = over_floor(period, direction)
    yield from (sized(friction, by) for friction in frictions_of_travel(seen))


def _frictions_along_axes(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Friction along one axis of the body whose size grows with the speed along another."""
    axes = (
        ("forward", "m/s", seen.twist[0], "VX", "V_X"),
        ("sideways", "m/s", seen.twist[1], "VY", "V_Y"),
        ("yaw", "rad/s", seen.twist[2], "W", r"\Omega"),
    )
    for k, other in ((0, 1), (0, 2), (1, 0), (1, 2)):
        word, _, usual, symbol, latex = axes[k]
        by_word, by_unit, _, by_symbol, by_latex = axes[other]
        by = by_speed(
            f"xp.abs(body.twist[{other}])", f"|{by_symbol}|", f"|{by_latex}|", by_word, by_unit
        )
        for form, unit, size, text, sign in (
            ("dry", "N", 5.0, f"xp.tanh(speed / {settings.smoothing[0]:g})", "sign "),
            ("viscous", "N s/m", 5.0 / max(usual, 1e-3), "speed", ""),
        ):
            friction = Law(
                f"{form}_{word}_drag",
                BODY,
                ("twist",),
                (Constant("force", unit, 0.0, size=size),),
                (f"speed = body.twist[{k}]", f"drag = force * {text}"),
                ", ".join("drag" if i == k else "0.0" for i in range(3)),
                f"{form.capitalize()} force against {word} motion",
                f"f {sign}{symbol}",
                rf"f {latex}",
                f"A force against {word} motion",
                CONFIRM["speed"],
            )
            yield sized(friction, by)
