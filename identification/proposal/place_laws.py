"""Laws of the floor: forces that depend on where a platform is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from identification.proposal.law import Constant, Law
from identification.proposal.settings import ProposalSettings
from identification.proposal.surroundings import (
    CIRCLE,
    CONFIRM,
    TURN,
    Surroundings,
    direction_constant,
    edge_constant,
    spot_constants,
)
from youbot_env.physics.effect import WORLD

PLACE = ("position_x", "position_y")
"""Variables of a force that depends on both coordinates of the place."""


def laws_by_place(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces along the world's axes that depend on the place along a direction."""
    direction = direction_constant(settings)
    where = CONFIRM["place"]
    yield Law(
        "line_spring",
        WORLD,
        PLACE,
        (Constant("stiffness", "N/m", size=5.0), Constant("pull", "N", size=5.0), direction),
        (TURN, "along = stiffness * (world.x * c + world.y * s) - pull"),
        "along * c, along * s, 0.0",
        "Spring along one direction of the floor",
        "k p - f, p = x cos(d) + y sin(d)",
        r"k p - f,\; p = x\cos d + y\sin d",
        "A force along one direction of the floor that grows with the way along it.",
        where,
    )
    for angle, axis in ((0.0, "x"), (0.5 * math.pi, "y")):
        edge = edge_constant(axis, seen, settings)
        held = Constant("direction", "rad", *CIRCLE, 1.0, (angle,))
        strip = Constant("width", "m", 0.02, 1.0, 0.1, (0.1, 0.25))
        yield Law(
            f"strip_across_{axis}",
            WORLD,
            (f"position_{axis}",),
            (Constant("force", "N", size=5.0), replace(edge, name="centre"), held, strip),
            (
                TURN,
                "way = (world.x * c + world.y * s - centre) / width",
                "along = force * way * xp.exp(0.5 - 0.5 * way**2)",
            ),
            "along * c, along * s, 0.0",
            "Bump or dip across the floor: the slope of a ridge along a line",
            "f w exp((1 - w^2)/2), w = (p - p_0)/b, p = x cos(d) + y sin(d)",
            r"f w e^{(1 - w^2)/2},\; w = (p - p_0)/b",
            "A force that pushes away from a line on the floor, or draws towards it, near it only.",
            where,
            terms=2,
        )
        for word, sign, mark in (("beyond", "", ">"), ("before", "-", "<")):
            way = f"xp.maximum({sign}(world.{axis} - edge), 0.0)"
            push = f"{sign}stiffness * {way}"
            yield Law(
                f"spring_{word}_an_edge_in_{axis}",
                WORLD,
                (f"position_{axis}",),
                (Constant("stiffness", "N/m", size=10.0), edge),
                (),
                f"{push}, 0.0, 0.0" if axis == "x" else f"0.0, {push}, 0.0",
                f"Spring {word} a line across the floor: something soft in the way",
                f"k ({axis} - p_0) ({axis} {mark} p_0)",
                rf"k ({axis} - p_0)\,[{axis} {mark} p_0]",
                f"A force back that grows {word} a line on the floor, and none on its other side.",
                where,
                terms=2,
            )
    yield Law(
        "moment_by_place",
        WORLD,
        PLACE,
        (Constant("along_x", "N m/m", size=1.0), Constant("along_y", "N m/m", size=1.0)),
        (),
        "0.0, 0.0, along_x * world.x + along_y * world.y",
        "Moment that grows along the floor",
        "a x + b y",
        "a x + b y",
        "The robot is turned, the more the farther it is on one side of the room.",
        where,
        terms=2,
    )
    yield from _near_a_wall(seen, settings)
    yield _from_a_point(seen, settings)
    yield _stream(seen, settings)
    yield from _fields(settings)
    yield from _moments(settings)
    yield from _by_place_and_heading()
    yield _bump(seen, settings)
    yield _spot_field(seen, settings)
    yield _around(seen)


def _near_a_wall(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces across a wall in any direction: it is soft, or pushes ever more as it nears."""
    far = float(np.hypot(*seen.place.T).max()) + max(settings.wall_ways) + settings.point_margin
    direction = direction_constant(settings, half=False)
    line = Constant("line", "m", -far, far, 1.0, (0.0,), step=0.2)
    power = power_constant(settings)
    way = "world.x * c + world.y * s"
    for name, strength, constants, push, word, formula, latex in (
        (
            "spring_beyond_a_line",
            Constant("stiffness", "N/m", size=10.0),
            (line, direction),
            f"stiffness * xp.maximum({way} - line, 0.0)",
            "Spring beyond a line across the floor, in any direction: something soft in the way",
            "k (p - p_0) (p > p_0)",
            r"k (p - p_0)\,[p > p_0]",
        ),
        (
            "push_near_a_wall",
            Constant("force_at_a_metre", "N", size=2.0),
            (replace(line, name="wall"), direction, power),
            f"force_at_a_metre * xp.maximum(wall - ({way}), {settings.nearest:g}) ** -power",
            "Force across a wall that grows as the wall nears: a magnet, a stream of air",
            "f / (p_0 - p)^n",
            r"f\,(p_0 - p)^{-n}",
        ),
    ):
        yield Law(
            name,
            WORLD,
            PLACE,
            (strength, *constants),
            (TURN, f"along = {push}"),
            "along * c, along * s, 0.0",
            word,
            f"{formula}, p = x cos(d) + y sin(d)",
            rf"{latex},\; p = x\cos d + y\sin d",
            "A force across one line of the floor that grows towards it or beyond it.",
            CONFIRM["place"],
            terms=2,
        )


def _stream(seen: Surroundings, settings: ProposalSettings) -> Law:
    far = float(np.hypot(*seen.place.T).max())
    return Law(
        "stream_along_a_line",
        WORLD,
        PLACE,
        (
            Constant("force", "N", size=5.0),
            Constant("stream", "m", -far, far, 1.0, (0.0,), step=0.2),
            Constant("direction", "rad", *CIRCLE, 1.0, (0.0,), step=0.25),
            Constant("width", "m", 0.03, 2.0, 0.3, settings.strip_half_widths),
        ),
        (
            TURN,
            "across = (world.y * c - world.x * s - stream) / width",
            "along = force * xp.exp(-(across**2))",
        ),
        "along * c, along * s, 0.0",
        "Force along a line of the floor, ever less beside it: a fan's stream of air",
        "f exp(-((n - n_0)/b)^2) along d, n across it",
        r"f e^{-((n - n_0)/b)^2}",
        "Along one line of the floor something pushes one way, most in its middle.",
        CONFIRM["place"],
        terms=2,
    )


def power_constant(settings: ProposalSettings) -> Constant:
    """Of a distance. It is sought together with the place: which is best is not seen before."""
    return Constant("power", "1", 0.5, 4.0, 1.0, settings.powers)


def _from_a_point(seen: Surroundings, settings: ProposalSettings) -> Law:
    low, high = (float(v) for v in (seen.place.min(), seen.place.max()))
    margin, core = 2 * settings.point_margin, settings.point_core
    return Law(
        "force_from_a_point",
        WORLD,
        PLACE,
        (
            Constant("force_at_a_metre", "N", size=2.0),
            Constant("point_x", "m", low - margin, high + margin, 1.0, (0.0,), step=0.1),
            Constant("point_y", "m", low - margin, high + margin, 1.0, (0.0,), step=0.1),
            Constant("core", "m", 0.01, 1.0, 0.1, (core,), step=core),
            power_constant(settings),
        ),
        (
            "dx, dy = world.x - point_x, world.y - point_y",
            "far = xp.sqrt(dx**2 + dy**2 + core**2)",
            "per_way = force_at_a_metre * far ** (-power - 1.0)",
        ),
        "per_way * dx, per_way * dy, 0.0",
        "Force from or to a point of the floor that fades with the distance: a magnet, a fan",
        "f / r^n from the point",
        r"f\,r^{-n}",
        "A force that pushes away from one point, or draws towards it, ever less far from it.",
        CONFIRM["place"],
        terms=2,
    )


def _fields(settings: ProposalSettings) -> Iterator[Law]:
    """Forces that are linear in the place, beyond a spring to a point and one along a line; and
    such as are its product or its square along one direction."""
    # Where such a force is none is not known: a constant force besides.
    pulls = (Constant("pull_x", "N", size=5.0), Constant("pull_y", "N", size=5.0))
    slope, skew = Constant("stretch", "N/m", size=5.0), Constant("skew", "N/m", size=5.0)
    for name, constants, force, word, formula, latex in (
        (
            "saddle",
            (slope, skew),
            ("stretch * world.x + skew * world.y", "skew * world.x - stretch * world.y"),
            "Saddle of the floor: it pushes away along one direction and back along the other",
            "(a x + b y, b x - a y) - f",
            "(a x + b y,\\; b x - a y) - f",
        ),
        (
            "swirl",
            (replace(skew, name="swirl"),),
            ("-swirl * world.y", "swirl * world.x"),
            "Force around a point of the floor that grows with the distance",
            "k (-y, x) - f",
            "k (-y,\\; x) - f",
        ),
        (
            "linear_field",
            tuple(Constant(f"{of}_{by}", "N/m", size=5.0) for of in "xy" for by in "xy"),
            ("x_x * world.x + x_y * world.y", "y_x * world.x + y_y * world.y"),
            "Force that changes steadily over the floor, in size and direction",
            "A (x, y) - f",
            "A (x,\\; y) - f",
        ),
    ):
        yield Law(
            name,
            WORLD,
            PLACE,
            (*constants, *pulls),
            (),
            f"{force[0]} - pull_x, {force[1]} - pull_y, 0.0",
            word,
            formula,
            latex,
            "The push along the floor changes from place to place, whichever way the robot faces.",
            CONFIRM["place"],
        )
    for name, constants, line, word, formula, latex, terms in (
        (
            "shear",
            (Constant("slope", "N/m", size=5.0), Constant("pull", "N", size=5.0)),
            "slope * across - pull",
            "Force along one direction of the floor that grows across it: a stream of air",
            "k n - f",
            "k n - f",
            1,
        ),
        (
            "force_by_product_of_places",
            (Constant("bend", "N/m^2", size=5.0),),
            "bend * way * across",
            "Force along one direction by the product of the ways along it and across it",
            "k p n",
            "k p n",
            2,
        ),
        (
            "quadratic_force_by_place",
            (
                *(Constant(f"bend_{k}", "N/m^2", size=5.0) for k in (1, 2, 3)),
                *(Constant(f"slope_{k}", "N/m", size=5.0) for k in (1, 2)),
                Constant("pull", "N", size=5.0),
            ),
            "bend_1 * way**2 + bend_2 * way * across + bend_3 * across**2"
            " + slope_1 * way + slope_2 * across - pull",
            "Force along one direction of the floor by the squares of the place",
            "a p^2 + b p n + c n^2 + k p + l n - f",
            "a p^2 + b p n + c n^2 + k p + l n - f",
            2,
        ),
    ):
        yield Law(
            name,
            WORLD,
            PLACE,
            (*constants, direction_constant(settings)),
            (
                TURN,
                "way, across = world.x * c + world.y * s, world.y * c - world.x * s",
                f"along = {line}",
            ),
            "along * c, along * s, 0.0",
            word,
            f"{formula}, p along d, n across it",
            latex,
            "A push along one direction of the floor that changes from place to place.",
            CONFIRM["place"],
            terms=terms,
        )


def _moments(settings: ProposalSettings) -> Iterator[Law]:
    """Moments by the squares of the place and by their product."""
    bends = tuple(Constant(f"bend_{k}", "N m/m^2", size=1.0) for k in (1, 2, 3))
    slopes = tuple(Constant(f"along_{axis}", "N m/m", size=1.0) for axis in "xy")
    for name, constants, lines, word, formula in (
        (
            "moment_by_product_of_places",
            (replace(bends[0], name="bend"),),
            ("turns = bend * world.x * world.y",),
            "Moment by the product of both coordinates",
            "k x y",
        ),
        (
            "moment_by_squared_place",
            (*bends, *slopes, Constant("moment", "N m", size=1.0)),
            (
                "squares = bend_1 * world.x**2 + bend_2 * world.x * world.y + bend_3 * world.y**2",
                "turns = squares + along_x * world.x + along_y * world.y - moment",
            ),
            "Moment by the squares of the place",
            "a x^2 + b x y + c y^2 + k x + l y - m",
        ),
    ):
        yield Law(
            name,
            WORLD,
            PLACE,
            constants,
            lines,
            "0.0, 0.0, turns",
            word,
            formula,
            formula,
            "The robot is turned by a moment that changes from place to place.",
            CONFIRM["place"],
            terms=2,
        )


BUMP = "spot_that_pushes"
"""The law that finds spots of the floor."""

SPOT_FIELD = "spot_field"
"""The law that finds spots about which a force is of any direction."""

FAR = "far = xp.sqrt((world.x - spot_x) ** 2 + (world.y - spot_y) ** 2 + 1e-06)"
"""Distance from a spot [m], smooth at the spot itself."""


def inside_of_a_spot(settings: ProposalSettings) -> str:
    """The line that says whether a place is inside of a round patch."""
    return f"inside = 0.5 - 0.5 * xp.tanh((far - radius) / {settings.edge_width:g})"


def fields_at_a_spot(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """The same of any direction: a whirl, a saddle."""
    yield Law(
        "linear_field_in_a_patch",
        WORLD,
        PLACE,
        (*_field_strengths("N/m"), *spot_constants(seen, settings)),
        (
            FAR,
            inside_of_a_spot(settings),
            "dx, dy = inside * (world.x - spot_x), inside * (world.y - spot_y)",
        ),
        "x_x * dx + x_y * dy, y_x * dx + y_y * dy, 0.0",
        "Force that changes steadily inside of a round patch of the floor: a whirl, a saddle",
        "A (x, y) (r < r_0)",
        r"A (x,\; y)\,[r < r_0]",
        "A force near one spot of the floor that changes its direction from side to side.",
        CONFIRM["place"],
        terms=2,
    )


def _field_strengths(unit: str) -> tuple[Constant, ...]:
    return tuple(Constant(f"{of}_{by}", unit, size=5.0) for of in "xy" for by in "xy")


def _spot_field(seen: Surroundings, settings: ProposalSettings) -> Law:
    return Law(
        SPOT_FIELD,
        WORLD,
        PLACE,
        (*_field_strengths("N"), *spot_constants(seen, settings)),
        (
            "dx, dy = (world.x - spot_x) / radius, (world.y - spot_y) / radius",
            "near = xp.exp(0.5 - 0.5 * (dx**2 + dy**2))",
        ),
        "near * (x_x * dx + x_y * dy), near * (y_x * dx + y_y * dy), 0.0",
        "Force about a spot of the floor that fades with the distance: a whirl, a saddle",
        "A (x, y)/b exp((1 - (r/b)^2)/2) about the spot",
        r"A \frac{(x,\; y)}{b} e^{(1 - (r/b)^2)/2}",
        "A force near one spot of the floor that changes its direction from side to side.",
        CONFIRM["place"],
        terms=2,
    )


def _by_place_and_heading() -> Iterator[Law]:
    """Forces along the robot and moments that depend on place and heading."""
    slopes = tuple(Constant(f"along_{axis}", "N/m", size=5.0) for axis in "xy")
    size = "size = level + along_x * world.x + along_y * world.y"
    for word, result in (
        ("forward", "size * xp.cos(world.yaw), size * xp.sin(world.yaw), 0.0"),
        ("sideways", "-size * xp.sin(world.yaw), size * xp.cos(world.yaw), 0.0"),
    ):
        yield Law(
            f"{word}_force_by_place",
            WORLD,
            (*PLACE, "heading"),
            (Constant("level", "N", size=5.0), *slopes),
            (size,),
            result,
            f"Force along the robot's {word} axis that changes steadily over the floor",
            "a + b x + c y",
            "a + b x + c y",
            f"The robot is pushed {word}, more on one side of the room.",
            CONFIRM["place"],
            terms=3,
        )
    strengths = tuple(
        Constant(f"{wave}_{by}", unit, size=1.0)
        for wave in ("cosine", "sine")
        for by, unit in (("x", "N m/m"), ("y", "N m/m"), ("level", "N m"))
    )
    swings = (
        f"{wave} = {wave}_x * world.x + {wave}_y * world.y + {wave}_level"
        for wave in ("cosine", "sine")
    )
    yield Law(
        "moment_by_place_and_heading",
        WORLD,
        (*PLACE, "heading"),
        strengths,
        tuple(swings),
        "0.0, 0.0, cosine * xp.cos(world.yaw) + sine * xp.sin(world.yaw)",
        "Moment that swings with the heading, by an amount that changes over the floor",
        "(a x + b y + c) cos(psi) + (d x + e y + f) sin(psi)",
        r"(a x + b y + c)\cos\psi + (d x + e y + f)\sin\psi",
        "The robot is turned towards a heading, more on one side of the room.",
        CONFIRM["heading"],
        terms=3,
    )


def laws_at_a_spot(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces from or to a spot of other shapes than a bump's; where there is a spot is told by the
    bump."""
    for name, constant, size, word, formula, latex in (
        (
            "spring_in_a_patch",
            Constant("stiffness", "N/m", size=20.0),
            "stiffness * inside",
            "Spring from or to the middle of a round patch of the floor, and none outside of it",
            "k r (r < r_0)",
            r"k r\,[r < r_0]",
        ),
        (
            "push_in_a_patch",
            Constant("force", "N", size=5.0),
            "force * inside / far",
            "Constant force from or to the middle of a round patch of the floor",
            "f (r < r_0)",
            r"f\,[r < r_0]",
        ),
    ):
        yield Law(
            name,
            WORLD,
            PLACE,
            (constant, *spot_constants(seen, settings)),
            (FAR, inside_of_a_spot(settings), f"per_way = {size}"),
            "per_way * (world.x - spot_x), per_way * (world.y - spot_y), 0.0",
            word,
            formula,
            latex,
            "A force that pushes away from one spot of the floor, or draws towards it, up to a "
            "distance.",
            CONFIRM["place"],
            terms=2,
        )


def _around(seen: Surroundings) -> Law:
    """A spring beyond a circle, about the middle of where the platform was."""
    x, y = (float(v) for v in np.median(seen.place, axis=0))
    far = np.hypot(seen.place[:, 0] - x, seen.place[:, 1] - y)
    low, high = float(seen.place.min()), float(seen.place.max())
    middle = tuple(
        Constant(f"middle_{axis}", "m", low, high, 1.0, (value,), step=0.2)
        for axis, value in (("x", x), ("y", y))
    )
    radii = tuple(float(v) for v in np.quantile(far, (0.4, 0.6, 0.8)))
    return Law(
        "spring_beyond_a_circle",
        WORLD,
        PLACE,
        (
            Constant("stiffness", "N/m", size=10.0),
            *middle,
            Constant("edge", "m", 0.0, float(far.max()), 1.0, radii),
        ),
        (
            "far = xp.sqrt((world.x - middle_x) ** 2 + (world.y - middle_y) ** 2 + 1e-06)",
            "per_way = stiffness * xp.maximum(far - edge, 0.0) / far",
        ),
        "per_way * (world.x - middle_x), per_way * (world.y - middle_y), 0.0",
        "Spring beyond a distance from a point: a cable that is slack near it",
        "k (r - r_0) (r > r_0)",
        r"k (r - r_0)\,[r > r_0]",
        "A force towards one point that grows beyond a distance, and none nearer.",
        CONFIRM["place"],
        terms=2,
    )


def _bump(seen: Surroundings, settings: ProposalSettings) -> Law:
    return Law(
        BUMP,
        WORLD,
        PLACE,
        (Constant("force", "N", size=5.0), *spot_constants(seen, settings)),
        (
            "dx, dy = (world.x - spot_x) / radius, (world.y - spot_y) / radius",
            "slope = force * xp.exp(0.5 - 0.5 * (dx**2 + dy**2))",
        ),
        # What the motion demands: a bump pushes away, so moving out takes less.
        "slope * dx, slope * dy, 0.0",
        "Round bump or dip of the floor, or a magnet under it: a potential's slope",
        "f (r/b) exp((1 - (r/b)^2)/2) from the spot",
        r"f \frac{r}{b} e^{(1 - (r/b)^2)/2}",
        "A force that pushes away from one spot of the floor, or draws towards it, near it only.",
        CONFIRM["place"],
        terms=2,
    )
