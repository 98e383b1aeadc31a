"""Products of two: a law in a part of the motion alone, or of a size that another variable sets."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from identification.proposal.law import Constant, Law
from identification.proposal.place_laws import FAR, inside_of_a_spot
from identification.proposal.settings import ProposalSettings
from identification.proposal.surroundings import (
    CIRCLE,
    CONFIRM,
    Surroundings,
    edges_of,
    instants,
    spot_constants,
)
from youbot_env.physics.effect import BODY, WORLD


def canonical_factors(seen: Surroundings) -> list[Law]:
    """Laws that the catalogue has everywhere, and that may act in a part of the motion alone."""
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
    pull = Law(
        "pull", WORLD, (), (Constant("force_x", "N", size=5.0), Constant("force_y", "N", size=5.0)),
        (), "force_x, force_y, 0.0", "Constant force along the world", "f", "f",
        "A constant force along one direction of the world", CONFIRM["place"],
    )  # fmt: skip
    return [dry, viscous, pull]


def turning_factors(settings: ProposalSettings) -> list[Law]:
    """The same of turning: dry and viscous friction."""
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
    return [dry, viscous]


class Window(NamedTuple):
    """A part of the motion: what its name, its sentence and its formula say, the variables that
    tell it, its constants, and lines of which the last ones make ``inside``, from 0 to 1."""

    name: str
    word: str
    mark: str
    confirm: str
    variables: tuple[str, ...]
    constants: tuple[Constant, ...]
    lines: tuple[str, ...]


def products(factor: Law, seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """A law of the world in a part of the floor, of the time or of the motion alone."""
    if factor.place is not WORLD:
        return
    taken = {c.name for c in factor.constants} | _assigned(factor.lines)
    for window in _windows(seen, settings):
        twice = window.variables == ("time",) and "time" in factor.variables
        # A spring beyond an edge has an edge already: beyond another one it is no new law.
        if not twice and taken.isdisjoint(c.name for c in window.constants):
            yield _times(factor, window)


def _assigned(lines: Sequence[str]) -> set[str]:
    """Names that statements of the form ``a, b = ...`` assign."""
    return {name.strip() for line in lines for name in line.partition("=")[0].split(",")}


def _windows(seen: Surroundings, settings: ProposalSettings) -> Iterator[Window]:
    yield Window(
        "in_a_patch",
        "inside of a round patch of the floor",
        "(r < r_0)",
        "place",
        ("position_x", "position_y"),
        spot_constants(seen, settings),
        (FAR, inside_of_a_spot(settings)),
    )
    yield from _of_lines(seen, settings)
    yield from _of_oblique_lines(seen, settings)
    first, size = instants(seen, settings), settings.switch_time
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, first)
    for name, word, mark, sign in (
        ("from_a_time_on", "from a time of each log on", "(t > t_0)", ""),
        ("until_a_time", "until a time of each log", "(t < t_0)", "-"),
    ):
        inside = f"inside = 0.5 + 0.5 * xp.tanh({sign}(world.time - instant) / {size:g})"
        yield Window(name, word, mark, "time", ("time",), (instant,), (inside,))
    for side, sign, mark in (("left", "", "(W > 0)"), ("right", "-", "(W < 0)")):
        inside = f"inside = 0.5 + 0.5 * xp.tanh({sign}world.yaw_rate / {settings.smoothing[1]:g})"
        yield Window(
            *(f"while_turning_{side}", f"while the robot turns {side}", mark, "speed"),
            *(("twist",), (), (inside,)),
        )


def _of_lines(seen: Surroundings, settings: ProposalSettings) -> Iterator[Window]:
    """Beyond a line across the floor, before it, and between two; along an axis, or oblique."""
    edges, low, high = edges_of(seen, settings)
    edge, width = Constant("edge", "m", low, high, 1.0, edges), settings.edge_width
    for axis in "xy":
        where = (f"position_{axis}",)
        for word, sign, mark in (("beyond", 1, ">"), ("before", -1, "<")):
            inside = f"inside = 0.5 + 0.5 * xp.tanh((world.{axis} - edge) / {sign * width:g})"
            yield Window(
                *(f"{word}_an_edge_in_{axis}", f"{word} a line across the floor"),
                *(f"({axis} {mark} p_0)", "place", where, (edge,), (inside,)),
            )
        way = f"way = xp.abs(world.{axis} - centre)"
        half = Constant("half_width", "m", 0.02, 2.0, 0.2, settings.strip_half_widths)
        yield Window(
            *(f"in_a_strip_across_{axis}", "in a strip across the floor"),
            *(f"(|{axis} - p_0| < b)", "place", where, (replace(edge, name="centre"), half)),
            (way, f"inside = 0.5 - 0.5 * xp.tanh((way - half_width) / {width:g})"),
        )


def _of_oblique_lines(seen: Surroundings, settings: ProposalSettings) -> Iterator[Window]:
    """Beyond a line in any direction, and between two."""
    across = Constant("across", "rad", *CIRCLE, 1.0, tuple(_turns(settings.line_directions)))
    ways = [
        quantile
        for angle in across.values
        for quantile in np.quantile(
            seen.place @ [math.cos(angle), math.sin(angle)], settings.line_quantiles
        )
    ]
    low, high = min(ways), max(ways)
    places = tuple(float(v) for v in np.quantile(ways, np.linspace(0.0, 1.0, settings.lines)))
    edge, width = Constant("edge", "m", low, high, 1.0, places), settings.edge_width
    half = Constant("half_width", "m", 0.02, 2.0, 0.2, settings.strip_half_widths)
    way = "way = world.x * xp.cos(across) + world.y * xp.sin(across)"
    yield Window(
        *("beyond_a_line", "beyond a line on the floor", "(p > p_0)", "place"),
        ("position_x", "position_y"),
        (edge, across),
        (way, f"inside = 0.5 + 0.5 * xp.tanh((way - edge) / {width:g})"),
    )
    yield Window(
        *("in_a_strip", "in a strip of the floor", "(|p - p_0| < b)", "place"),
        ("position_x", "position_y"),
        (replace(edge, name="centre"), half, replace(across, values=across.values[::2])),
        (way, f"inside = 0.5 - 0.5 * xp.tanh((xp.abs(way - centre) - half_width) / {width:g})"),
    )


def _turns(count: int) -> Iterator[float]:
    """Directions over a whole turn, opposite ones one after the other."""
    for k in range(count):
        yield from (math.pi * k / count, math.pi * (k / count + 1.0))


def _times(factor: Law, window: Window) -> Law:
    variables = (v for v in window.variables if v not in factor.variables)
    return replace(
        factor,
        name=f"{factor.name}_{window.name}",
        constants=(*factor.constants, *window.constants),
        # The force first: a window's lines may use the names of the factor's anew.
        lines=(*factor.lines, f"fx, fy, mz = {factor.result}", *window.lines),
        result="inside * fx, inside * fy, inside * mz",
        variables=(*factor.variables, *variables),
        meaning=f"{factor.meaning}, {window.word}",
        formula=f"{factor.formula} {window.mark}",
        latex=rf"{factor.latex}\,[{window.mark[1:-1]}]",
        recognise=f"{factor.recognise.rstrip('.')}, {window.word}, and none elsewhere.",
        confirm=CONFIRM[window.confirm],
        terms=factor.terms + 1,
    )


def friction_by_heading(seen: Surroundings) -> Iterator[Law]:
    """Friction whose size swings with the heading: a brush or a caster that is not round."""
    swings = "size = level + cosine * xp.cos(times * world.yaw) + sine * xp.sin(times * world.yaw)"
    dry, viscous, _ = canonical_factors(seen)
    for factor, unit in ((dry, "N"), (viscous, "N s/m")):
        size = factor.strengths[0].size
        for order in (1, 2):
            yield replace(
                _of_size(factor, swings, SWINGS, SWINGS_LATEX),
                name=f"{factor.name}_by_heading_{order}",
                variables=("heading", "twist"),
                constants=_swinging(unit, size, order),
                meaning=f"{factor.meaning}, whose size swings with the heading",
                recognise=f"{factor.recognise}, more at some headings than at others.",
                confirm=CONFIRM["heading"],
                dissipative=False,
                terms=3,
            )
    for order in (1, 2):
        yield Law(
            f"viscous_turning_by_heading_{order}",
            WORLD,
            ("heading", "twist"),
            _swinging("N m s", 1.0, order),
            (swings,),
            "0.0, 0.0, size * world.yaw_rate",
            "Viscous friction of turning, whose size swings with the heading",
            f"{SWINGS} W",
            rf"{SWINGS_LATEX}\,\Omega",
            "A moment against turning, more at some headings than at others.",
            CONFIRM["heading"],
            terms=3,
        )


SWINGS, SWINGS_LATEX = "(a + b cos(n psi) + c sin(n psi))", r"(a + b\cos n\psi + c\sin n\psi)"
"""A size that swings with the heading, ``times`` a turn."""


def _swinging(unit: str, size: float, order: int) -> tuple[Constant, ...]:
    """Constants of such a size."""
    return (
        Constant("level", unit, 0.0, size=size),
        *(Constant(name, unit, size=size) for name in ("cosine", "sine")),
        Constant("times", "1", 1.0, 8.0, 1.0, (float(order),), fitted=False, whole=True),
    )


def _of_size(factor: Law, line: str, formula: str, latex: str) -> Law:
    """A canonical factor whose strength is a ``size`` that the line computes."""
    return replace(
        factor,
        lines=(line, *(known.replace("force /", "size /") for known in factor.lines)),
        result=factor.result.replace("coefficient", "size"),
        formula=f"{formula} {factor.formula.partition(' ')[2]}",
        latex=rf"{latex}\,{factor.latex.partition(' ')[2]}",
    )


def friction_by_time(seen: Surroundings) -> Iterator[Law]:
    """Friction that grows steadily from the start of each log: something winds up, or wears."""
    for factor in canonical_factors(seen)[:2]:
        (strength_of,) = factor.strengths
        growth = Constant("growth", f"{strength_of.unit}/s", size=strength_of.size / 60.0)
        yield replace(
            _of_size(factor, "size = level + growth * world.time", "(a + b t)", "(a + b t)"),
            name=f"{factor.name}_that_grows",
            variables=("twist", "time"),
            constants=(_level(strength_of), growth),
            meaning=f"{factor.meaning}, which grows from the start of each log",
            recognise=f"{factor.recognise}, more from minute to minute.",
            confirm=CONFIRM["time"],
            dissipative=False,
            terms=2,
        )


def friction_by_place(seen: Surroundings) -> Iterator[Law]:
    """Friction that changes steadily over the floor: it gets softer, wetter, rougher."""
    changes = "size = level + along_x * world.x + along_y * world.y"
    dry, viscous, _ = canonical_factors(seen)
    for factor in (dry, viscous):
        (strength_of,) = factor.strengths
        yield replace(
            _of_size(factor, changes, GROWS, GROWS),
            name=f"{factor.name}_by_place",
            variables=("position_x", "position_y", "twist"),
            constants=_growing(strength_of.unit, strength_of.size),
            meaning=f"{factor.meaning}, which changes steadily over the floor",
            recognise=f"{factor.recognise}, more on one side of the room.",
            confirm=CONFIRM["place"],
            dissipative=False,
            terms=3,
        )
    yield Law(
        "viscous_turning_by_place",
        WORLD,
        ("position_x", "position_y", "twist"),
        _growing("N m s", 1.0),
        (changes,),
        "0.0, 0.0, size * world.yaw_rate",
        "Viscous friction of turning, which changes steadily over the floor",
        f"{GROWS} W",
        rf"{GROWS}\,\Omega",
        "A moment against turning, more on one side of the room.",
        CONFIRM["place"],
        terms=3,
    )


GROWS = "(a + b x + c y)"
"""A size that changes steadily over the floor."""


def _growing(unit: str, size: float) -> tuple[Constant, ...]:
    """Constants of such a size."""
    per_way = "N s/m^2" if unit == "N s/m" else f"{unit}/m"
    return (
        _level(Constant("level", unit, size=size)),
        *(Constant(name, per_way, size=size) for name in ("along_x", "along_y")),
    )


def friction_by_speed(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Friction of one motion whose size grows with the speed of another: a caster that is dragged
    sideways while the robot turns."""
    dry, viscous, _ = canonical_factors(seen)
    speed = "xp.sqrt(world.velocity_x**2 + world.velocity_y**2)"
    for factor in (dry, viscous):
        yield _grown(factor, "xp.abs(world.yaw_rate)", "|W|", r"|\Omega|", "yaw", "rad/s")
    for factor in turning_factors(settings):
        yield _grown(factor, speed, "|v|", "|v|", "driving", "m/s")
    axes = (
        ("forward", "m/s", seen.twist[0], "VX", "V_X"),
        ("sideways", "m/s", seen.twist[1], "VY", "V_Y"),
        ("yaw", "rad/s", seen.twist[2], "W", r"\Omega"),
    )
    for k, other in ((0, 1), (0, 2), (1, 0), (1, 2)):
        word, _, usual, symbol, latex = axes[k]
        by_word, by_unit, _, by_symbol, by_latex = axes[other]
        for form, unit, size, text, sign in (
            ("dry", "N", 5.0, f"xp.tanh(speed / {settings.smoothing[0]:g})", "sign "),
            ("viscous", "N s/m", 5.0 / max(usual, 1e-3), "speed", ""),
        ):
            factor = Law(
                f"{form}_{word}_drag",
                BODY,
                ("twist",),
                (Constant("force", unit, 0.0, size=size),),
                (f"speed = body.twist[{k}]", f"drag = size * {text}"),
                ", ".join("drag" if i == k else "0.0" for i in range(3)),
                f"{form.capitalize()} force against {word} motion",
                f"f {sign}{symbol}",
                rf"f {latex}",
                f"A force against {word} motion",
                CONFIRM["speed"],
            )
            yield _grown(
                factor, f"xp.abs(body.twist[{other}])", f"|{by_symbol}|", f"|{by_latex}|",
                by_word, by_unit,
            )  # fmt: skip


def _level(strength_of: Constant) -> Constant:
    """The part of a size that does not change: of a friction that begins with nothing, noise takes
    it below zero."""
    return replace(strength_of, name="level", lower=-math.inf)


GROWTHS = {
    ("N", "m/s"): "N s/m",
    ("N", "rad/s"): "N s/rad",
    ("N s/m", "m/s"): "N s^2/m^2",
    ("N s/m", "rad/s"): "N s^2/(m rad)",
    ("N m", "m/s"): "N s",
    ("N m s", "m/s"): "N s^2",
}
"""Units of a strength over a speed."""


def _grown(factor: Law, other: str, symbol: str, latex: str, word: str, unit: str) -> Law:
    """A friction whose size is a level and what grows with the size of another speed."""
    (strength_of,) = factor.strengths
    growth = Constant("growth", GROWTHS[strength_of.unit, unit], size=strength_of.size)
    grown = _of_size(
        factor, f"size = level + growth * {other}", f"(a + b {symbol})", f"(a + b {latex})"
    )
    return replace(
        grown,
        name=f"{factor.name}_by_{word}",
        constants=(_level(strength_of), growth),
        result=grown.result.replace("torque *", "size *"),
        meaning=f"{factor.meaning}, whose size grows with the {word} speed",
        recognise=f"{factor.recognise.rstrip('.')}, more while the {word} speed is large.",
        confirm=CONFIRM["speed"],
        dissipative=False,
        terms=3,
    )
