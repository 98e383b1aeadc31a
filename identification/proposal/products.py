"""Products of two: a law that acts in a part of the motion alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from identification.proposal.joint_laws import frictions_of_joints
from identification.proposal.law import Constant, Law
from identification.proposal.place_laws import FAR, inside_of_a_spot
from identification.proposal.settings import ProposalSettings
from identification.proposal.sized_friction import (
    frictions_of_travel,
    frictions_of_turning,
    place_of,
)
from identification.proposal.surroundings import (
    CIRCLE,
    CONFIRM,
    Surroundings,
    edge_constant,
    instants,
    spot_constants,
)
from youbot_env.physics.effect import ROLLER, WHEEL, WORLD


def canonical_factors(seen: Surroundings, settings: ProposalSettings) -> list[Law]:
    """Laws that the catalogue has everywhere, and that may act in a part of the motion alone."""
    pull = Law(
        "pull", WORLD, (), (Constant("force_x", "N", size=5.0), Constant("force_y", "N", size=5.0)),
        (), "force_x, force_y, 0.0", "Constant force along the world", "f", "f",
        "A constant force along one direction of the world", CONFIRM["place"],
    )  # fmt: skip
    travel, turning = frictions_of_travel(seen), frictions_of_turning(settings)
    return [*travel, pull, *turning, *frictions_of_joints(seen, settings)]


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
    """A law of the world in a part of the floor, of the time or of the motion alone; friction of
    all wheels or rollers in a part of the floor."""
    if factor.place is WORLD:
        windows = _windows(seen, settings)
    elif factor.place in (WHEEL, ROLLER) and not any(c.each_wheel for c in factor.constants):
        windows = _parts_of_the_floor(seen, settings)
    else:
        return
    taken = {c.name for c in factor.constants} | _assigned(factor.lines)
    for window in windows:
        twice = window.variables == ("time",) and "time" in factor.variables
        # A spring beyond an edge has an edge already: beyond another one it is no new law.
        if not twice and taken.isdisjoint(c.name for c in window.constants):
            yield _times(factor, window)


def _assigned(lines: Sequence[str]) -> set[str]:
    """Names that statements of the form ``a, b = ...`` assign."""
    return {name.strip() for line in lines for name in line.partition("=")[0].split(",")}


def _parts_of_the_floor(seen: Surroundings, settings: ProposalSettings) -> Iterator[Window]:
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


def _windows(seen: Surroundings, settings: ProposalSettings) -> Iterator[Window]:
    yield from _parts_of_the_floor(seen, settings)
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
    width = settings.edge_width
    for axis in "xy":
        edge = edge_constant(axis, seen, settings)
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
    far = float(np.hypot(*seen.place.T).max())
    # Where they are tried is told together with their direction, see `choices_of`.
    edge = Constant("edge", "m", -far, far, 1.0, (0.0,), step=0.2)
    across = Constant(
        "across", "rad", *CIRCLE, 1.0, (0.0,), step=math.pi / settings.line_directions
    )
    width = settings.edge_width
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
        (half, replace(edge, name="centre"), across),
        (way, f"inside = 0.5 - 0.5 * xp.tanh((xp.abs(way - centre) - half_width) / {width:g})"),
    )


def _times(factor: Law, window: Window) -> Law:
    variables = (v for v in window.variables if v not in factor.variables)
    place, of_world = f"{place_of(factor)}.", factor.place is WORLD
    parts = "fx, fy, mz" if of_world else "torque_there"
    return replace(
        factor,
        name=f"{factor.name}_{window.name}",
        constants=(*factor.constants, *window.constants),
        # The force first: a window's lines may use the names of the factor's anew.
        lines=(
            *(*factor.lines, f"{parts} = {factor.result}"),
            *(line.replace("world.", place) for line in window.lines),
        ),
        result=", ".join(f"inside * {part}" for part in parts.split(", ")),
        variables=(*factor.variables, *variables),
        meaning=f"{factor.meaning}, {window.word}",
        formula=f"{factor.formula} {window.mark}",
        latex=rf"{factor.latex}\,[{window.mark[1:-1]}]",
        recognise=f"{factor.recognise.rstrip('.')}, {window.word}, and none elsewhere.",
        confirm=CONFIRM[window.confirm],
        terms=factor.terms + 1,
    )
