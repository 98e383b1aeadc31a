"""The grammar of laws of a mecanum platform: which force at which site depends on what, and how.

Physics prunes it. What depends on a site's own speed only takes energy, and is odd in it; what
depends on a place or a heading is a potential's slope or swings; one law holds for all four wheels
before each wheel has its own. What the catalogue holds is left out: it has been tried.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.proposal.forms import Form, Quantity, even_forms, speed_forms, strength
from identification.proposal.law import Constant, Law, Shapes
from identification.proposal.settings import ProposalSettings
from youbot_env.physics.effect import BODY, ROLLER, WHEEL, WORLD, Place

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surroundings:
    """What the logs show of the platform: typical speeds (rms), where it was, and for how long.

    twist (3,), wheel, roller : [m/s, m/s, rad/s], [rad/s]; torque [N m]
    place (n, 2) [m], loud (n,) : where it was, and the squares that are left there
    """

    twist: tuple[float, float, float]
    wheel: float
    roller: float
    torque: float
    place: Array
    loud: Array
    duration: float

    @property
    def speed(self) -> float:
        """Of O [m/s]."""
        return math.hypot(*self.twist[:2]) / math.sqrt(2)


CIRCLE = (-2 * math.pi, 2 * math.pi)

WORLD_SPEEDS = ("twist", "heading")
"""Variables of a force that depends on a speed along a direction of the world."""


def _directions(count: int, half: bool) -> tuple[float, ...]:
    turn = math.pi if half else 2 * math.pi
    number = count if half else 2 * count
    return tuple(k * turn / number for k in range(number))


def _direction(settings: ProposalSettings, half: bool = True) -> Constant:
    values = _directions(settings.directions, half)
    return Constant("direction", "rad", *CIRCLE, 1.0, values)


TURN = "c, s = xp.cos(direction), xp.sin(direction)"

CONFIRM = {
    "direction": "drive along that direction of the floor and across it, at one speed",
    "heading": "turn the robot on the spot, then drive the same line at other headings",
    "place": "drive over the place slowly, both ways, and beside it",
    "speed": "drive at several constant speeds, both ways",
    "wheel": "lift the robot and spin the wheels by hand",
    "roller": "drive slowly sideways: one roller after the other takes the load",
    "time": "record the same motion again, starting at another time",
}


def single_laws(seen: Surroundings, settings: ProposalSettings) -> list[Law]:
    """The laws of one variable, shortest first; those that are periodic in a place are sought
    apart."""
    found = [
        *_along_directions(seen, settings),
        *_by_place(seen, settings),
        *_by_heading(settings),
        *_friction_by_heading(seen),
        *_friction_by_time(seen),
        *_by_time(seen, settings),
        *_of_body(seen, settings),
        *_of_joints(seen, settings),
    ]
    return sorted(found, key=lambda law: law.length)


# --- the world -------------------------------------------------------------------------------


def _along_directions(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces along a direction of the world that depend on the speed along it."""
    speed = "speed = c * world.velocity_x + s * world.velocity_y"
    known = ("speed", "v_d", "v_d", "speed along a direction of the floor", "m/s")
    u = Quantity(*known, seen.speed, settings.smoothing[0])
    for form in speed_forms(u, "force", "N", settings):
        one_way = form.key.startswith(("forward", "backward"))
        if form.key.startswith("backward"):
            continue  # the same as forward along the opposite direction
        direction = _direction(settings, half=not one_way)
        # Away from any one speed: the full grid of a peak along all directions takes too long.
        constants = tuple(
            replace(c, values=c.values[:2]) if c.name in ("width", "peak_speed") else c
            for c in form.constants
        )
        yield Law(
            f"{form.key}_nap",
            WORLD,
            WORLD_SPEEDS,
            (*constants, direction),
            (TURN, speed, f"along = {form.text}"),
            "along * c, along * s, 0.0",
            f"{form.word.capitalize()} friction along one direction of the floor",
            f"{form.symbol}, v_d = vx cos(d) + vy sin(d)",
            rf"{form.latex},\; v_d = v_x\cos d + v_y\sin d",
            "A force against motion along one direction of the floor, none across it, whichever "
            "way the robot faces.",
            CONFIRM["direction"],
            dissipative=form.dissipative,
        )
    yield _along_and_across(settings)


def _along_and_across(settings: ProposalSettings) -> Law:
    """Dry friction of another size along a direction than across it: a weave, a grain."""
    across = "across = {0}_across * xp.tanh((c * world.velocity_y - s * world.velocity_x) / {1})"
    along = "along = {0}_along * xp.tanh((c * world.velocity_x + s * world.velocity_y) / {1})"
    eps = Constant("smoothing", "m/s", 1e-4, 0.1, settings.smoothing[0],
                   (settings.smoothing[0],), fitted=False)  # fmt: skip
    # A quarter turn: along and across change places.
    quarter = tuple(k * math.pi / (2 * settings.quarters) for k in range(settings.quarters))
    return Law(
        "dry_along_and_across",
        WORLD,
        WORLD_SPEEDS,
        (
            Constant("force_along", "N", 0.0, size=5.0),
            Constant("force_across", "N", 0.0, size=5.0),
            eps,
            Constant("direction", "rad", *CIRCLE, 1.0, quarter),
        ),
        (TURN, along.format("force", "smoothing"), across.format("force", "smoothing")),
        "along * c - across * s, along * s + across * c, 0.0",
        "Dry friction along a direction of the floor and another across it",
        "f_1 tanh(v_d/eps) along d, f_2 tanh(v_n/eps) across it",
        r"f_1\tanh(v_d/\epsilon)\,d + f_2\tanh(v_n/\epsilon)\,n",
        "A force against the motion that has another size along one direction of the floor than "
        "across it, whichever way the robot faces.",
        CONFIRM["direction"],
        dissipative=True,
        terms=2,
    )


def _by_place(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces along the world's axes that depend on the place along a direction."""
    direction = _direction(settings)
    where = CONFIRM["place"]
    yield Law(
        "line_spring",
        WORLD,
        ("position_x", "position_y"),
        (Constant("stiffness", "N/m", size=5.0), Constant("pull", "N", size=5.0), direction),
        (TURN, "along = stiffness * (world.x * c + world.y * s) - pull"),
        "along * c, along * s, 0.0",
        "Spring along one direction of the floor",
        "k p - f, p = x cos(d) + y sin(d)",
        r"k p - f,\; p = x\cos d + y\sin d",
        "A force along one direction of the floor that grows with the way along it.",
        where,
    )
    edges, low, high = _edges(seen, settings)
    edge = Constant("edge", "m", low, high, 1.0, edges)
    for angle, axis in ((0.0, "x"), (0.5 * math.pi, "y")):
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
        ("position_x", "position_y"),
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
    yield _bump(seen, settings)


def _edges(
    seen: Surroundings, settings: ProposalSettings
) -> tuple[tuple[float, ...], float, float]:
    shares = np.linspace(0.0, 1.0, settings.edges + 2)[1:-1]
    found = sorted({round(float(v), 3) for v in np.quantile(seen.place, shares)})
    return tuple(found), float(seen.place.min()), float(seen.place.max())


def spots(seen: Surroundings, settings: ProposalSettings) -> list[tuple[float, float, float]]:
    """Centres (x, y) and radii [m] of patches and bumps to try: for each radius a grid as fine as
    it, those places where most is left unexplained."""
    found: list[tuple[float, float, float]] = []
    for radius in settings.spot_radii:
        spacing = settings.spot_spacing * radius
        cells = np.round(seen.place / spacing).astype(int)
        places, which = np.unique(cells, axis=0, return_inverse=True)
        squares = np.bincount(which.ravel(), seen.loud)
        order = np.lexsort((places[:, 1], places[:, 0], -squares))[: settings.max_spots]
        found += [(float(x), float(y), radius) for x, y in spacing * places[order]]
    return found


SPOT = ("spot_x", "spot_y", "radius")


def choices_of(law: Law, seen: Surroundings, settings: ProposalSettings) -> Iterator[Shapes]:
    """The values of its shape constants at which a law is tried: all combinations, and around
    every spot where it has one."""
    names = [c.name for c in law.shapes]
    if not set(SPOT) <= set(names):
        yield from itertools.product(*(c.values for c in law.shapes))
        return
    first = names.index(SPOT[0])
    rest = itertools.product(*(c.values for c in law.shapes if c.name not in SPOT))
    for others in rest:
        for spot in spots(seen, settings):
            yield (*others[:first], *spot, *others[first:])


def _spot_constants(seen: Surroundings, settings: ProposalSettings) -> tuple[Constant, ...]:
    """Of a spot; what is tried of them is told by :func:`spots`."""
    low, high = float(seen.place.min()) - 0.5, float(seen.place.max()) + 0.5
    return (
        Constant("spot_x", "m", low, high, 1.0, (0.0,)),
        Constant("spot_y", "m", low, high, 1.0, (0.0,)),
        Constant("radius", "m", 0.03, 2.0, 0.3, settings.spot_radii),
    )


def _bump(seen: Surroundings, settings: ProposalSettings) -> Law:
    return Law(
        "spot_that_pushes",
        WORLD,
        ("position_x", "position_y"),
        (Constant("force", "N", size=5.0), *_spot_constants(seen, settings)),
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


def _by_heading(settings: ProposalSettings) -> Iterator[Law]:
    """Forces along the world and moments that swing with the heading."""
    for order in settings.heading_orders:
        turns = Constant("times", "1", 1.0, 8.0, 1.0, (float(order),), fitted=False, whole=True)
        pair = (Constant("cosine", "N", size=5.0), Constant("sine", "N", size=5.0))
        swing = "cosine * xp.cos(times * world.yaw) + sine * xp.sin(times * world.yaw)"
        yield Law(
            f"force_by_heading_{order}",
            WORLD,
            ("heading",),
            (*pair, _direction(settings), turns),
            (TURN, f"along = {swing}"),
            "along * c, along * s, 0.0",
            "Force along one direction of the world that swings with the heading: wind",
            "a cos(n psi) + b sin(n psi) along d",
            r"a\cos n\psi + b\sin n\psi",
            f"A push along one direction of the world that swings {order} times a turn.",
            CONFIRM["heading"],
            terms=2,
        )
        pair = (Constant("cosine", "N m", size=1.0), Constant("sine", "N m", size=1.0))
        yield Law(
            f"moment_by_heading_{order}",
            WORLD,
            ("heading",),
            (*pair, turns),
            (),
            f"0.0, 0.0, {swing}",
            "Moment that swings with the heading",
            "a cos(n psi) + b sin(n psi)",
            r"a\cos n\psi + b\sin n\psi",
            f"A moment that swings {order} times as the robot turns once around.",
            CONFIRM["heading"],
            terms=2,
        )


def _friction_by_heading(seen: Surroundings) -> Iterator[Law]:
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


def _friction_by_time(seen: Surroundings) -> Iterator[Law]:
    """Friction that grows steadily from the start of each log: something winds up, or wears."""
    for factor in canonical_factors(seen)[:2]:
        (strength_of,) = factor.strengths
        growth = Constant("growth", f"{strength_of.unit}/s", size=strength_of.size / 60.0)
        yield replace(
            _of_size(factor, "size = level + growth * world.time", "(a + b t)", "(a + b t)"),
            name=f"{factor.name}_that_grows",
            variables=("twist", "time"),
            constants=(replace(strength_of, name="level"), growth),
            meaning=f"{factor.meaning}, which grows from the start of each log",
            recognise=f"{factor.recognise}, more from minute to minute.",
            confirm=CONFIRM["time"],
            dissipative=False,
            terms=2,
        )


# --- time ------------------------------------------------------------------------------------


def _instants(seen: Surroundings, settings: ProposalSettings) -> tuple[float, ...]:
    inner = np.linspace(0.0, seen.duration, settings.instants + 2)[1:-1]
    return tuple(float(round(t, 2)) for t in inner)


def _by_time(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """A pull that comes and goes."""
    pull = (Constant("force_x", "N", size=5.0), Constant("force_y", "N", size=5.0))
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, _instants(seen, settings))
    width = Constant("width", "s", 1.0, seen.duration, 5.0, (3.0, 10.0))
    yield Law(
        "pull_for_a_while",
        WORLD,
        ("time",),
        (*pull, replace(instant, name="middle"), width),
        ("share = xp.exp(-(((world.time - middle) / width) ** 2))",),
        "force_x * share, force_y * share, 0.0",
        "Force along the world that comes and goes in each log",
        "f exp(-((t - t_m)/b)^2)",
        r"f e^{-((t - t_m)/b)^2}",
        "For a while something pulls towards one side of the room.",
        CONFIRM["time"],
        terms=2,
    )


# --- the body --------------------------------------------------------------------------------

AXES = (
    ("x", "forward", "body.twist[0]", "VX", "V_X", "m/s", "N", "force"),
    ("y", "sideways", "body.twist[1]", "VY", "V_Y", "m/s", "N", "force"),
    ("yaw", "turning", "body.twist[2]", "W", r"\Omega", "rad/s", "N m", "moment"),
)


def _quantity(k: int, seen: Surroundings, settings: ProposalSettings) -> Quantity:
    _, word, text, symbol, latex, unit, *_ = AXES[k]
    smoothing = settings.smoothing[0 if k < 2 else 1]
    return Quantity(text, symbol, latex, f"{word} speed", unit, seen.twist[k], smoothing)


def _on_axis(k: int, text: str) -> str:
    return ", ".join(text if i == k else "0.0" for i in range(3))


def _of_body(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces along the body's axes that depend on its speeds."""
    for k, (axis, word, *_, unit, name) in enumerate(AXES):
        for form in speed_forms(_quantity(k, seen, settings), name, unit, settings):
            if (axis, form.key) != ("yaw", "dry"):  # the catalogue has it
                yield _body_law(k, k, form, f"{form.key}_drag_{axis}", word)
        for other in range(3):
            u = _quantity(other, seen, settings)
            more = even_forms(u, name, unit)
            if other != k:
                more += [
                    replace(form, dissipative=False)
                    for form in speed_forms(u, name, unit, settings)
                    if form.key in ("dry", "viscous", "quadratic", "cubic")
                ]
            for form in more:
                yield _body_law(k, other, form, f"{form.key}_{AXES[other][0]}_to_{axis}", word)
        yield from _products_of_speeds(k, seen, unit, settings)
    yield from _drags(seen, settings)
    air = "coefficient * xp.sqrt(body.twist[0] ** 2 + body.twist[1] ** 2)"
    yield Law(
        "air_drag",
        BODY,
        ("twist",),
        (strength("coefficient", "N", _quantity(0, seen, settings), 2),),
        (f"per_speed = {air}",),
        "per_speed * body.twist[0], per_speed * body.twist[1], 0.0",
        "Drag that grows with the square of the speed, against it",
        "k |v| v",
        r"k |v| v",
        "A force against the motion that grows with the square of the speed, whichever way.",
        CONFIRM["speed"],
        dissipative=True,
    )


def _drags(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Forces against the motion, whichever way it goes, that grow ever less with the speed."""
    speed = "speed = xp.sqrt(body.twist[0] ** 2 + body.twist[1] ** 2 + 2.5e-05)"
    knees = tuple(share * seen.speed for share in settings.knee_shares)
    knee = Constant("knee", "m/s", 0.02 * seen.speed, 5 * seen.speed, seen.speed, knees)
    root = Constant("coefficient", "N s^0.5/m^0.5", size=5.0 / math.sqrt(seen.speed or 1.0))
    for name, constants, line, word, formula, latex in (
        (
            "levelling_drag",
            (Constant("force", "N"), knee),
            "per_speed = force * xp.tanh(speed / knee) / speed",
            "levels off with the speed",
            "f tanh(|v|/u_k) v/|v|",
            r"f \tanh(|v|/u_k)\,v/|v|",
        ),
        (
            "root_drag",
            (root,),
            "per_speed = coefficient / xp.sqrt(speed)",
            "grows with the root of the speed",
            "k |v|^0.5 v/|v|",
            r"k \sqrt{|v|}\,v/|v|",
        ),
    ):
        yield Law(
            name, BODY, ("twist",), constants, (speed, line),
            "per_speed * body.twist[0], per_speed * body.twist[1], 0.0",
            f"Drag that {word}, against it", formula, latex,
            f"A force against the motion that {word}, whichever way.", CONFIRM["speed"],
            dissipative=True,
        )  # fmt: skip


def _body_law(k: int, other: int, form: Form, name: str, word: str) -> Law:
    own = k == other and form.dissipative
    u = AXES[other][2]
    what = "against it" if own else f"{AXES[k][7]} {word}"
    return Law(
        name,
        BODY,
        ("twist",),
        form.constants,
        (f"speed = {u}", f"{AXES[k][7]}_on_body = {form.text.replace(u, 'speed')}"),
        _on_axis(k, f"{AXES[k][7]}_on_body"),
        f"{form.word.capitalize()} {AXES[k][7]} {word} by the {AXES[other][1]} speed",
        form.symbol,
        form.latex,
        f"The residual {AXES[k][7]} {word} follows the {AXES[other][1]} speed ({what}).",
        CONFIRM["speed"],
        dissipative=own,
        # A force across the speed that makes it is no friction: less likely, so longer.
        terms=1 if own else 2,
    )


def _products_of_speeds(
    k: int, seen: Surroundings, unit: str, settings: ProposalSettings
) -> Iterator[Law]:
    pairs = ((0, 1), (0, 2), (1, 2))
    for a, b in pairs:
        one, two = _quantity(a, seen, settings), _quantity(b, seen, settings)
        size = 1.0 / max(one.typical * two.typical, 1e-9)
        units = f"{unit} s^2/({one.unit.split('/')[0]} {two.unit.split('/')[0]})"
        yield Law(
            f"product_{AXES[a][0]}_{AXES[b][0]}_to_{AXES[k][0]}",
            BODY,
            ("twist",),
            (Constant("coefficient", units, size=size),),
            (),
            _on_axis(k, f"coefficient * {one.text} * {two.text}"),
            f"{AXES[k][7].capitalize()} {AXES[k][1]} by the product of two speeds",
            f"k {one.symbol} {two.symbol}",
            f"k {one.latex} {two.latex}",
            f"The residual {AXES[k][7]} {AXES[k][1]} follows the product of two speeds.",
            CONFIRM["speed"],
            terms=3,
        )


# --- wheels and rollers ----------------------------------------------------------------------


def _of_joints(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Torques at the wheels and rollers by their own speed, load, acceleration and time."""
    for place, point, typical, eps, variable in (
        (WHEEL, "wheel", seen.wheel, settings.smoothing[2], "wheel_speed"),
        (ROLLER, "roller", seen.roller, settings.smoothing[3], "twist"),
    ):
        u = Quantity(f"{point}.rate", "w", r"\omega", f"{point} speed", "rad/s", typical, eps)
        for form in speed_forms(u, "torque", "N m", settings):
            if form.key not in TRIED.get(point, ()):
                yield _joint_law(place, point, form, (variable,))
            if form.key not in TRIED.get(f"each {point}", ()):
                yield _each(_joint_law(place, point, form, (variable,)))
        yield from _joints_by_time(place, point, u, seen, settings)
    # Even: in the catalogue for all wheels together, not for each.
    u = Quantity(
        "wheel.rate", "w", r"\omega", "wheel speed", "rad/s", seen.wheel, settings.smoothing[2]
    )
    for form in even_forms(u, "torque", "N m"):
        yield _each(_joint_law(WHEEL, "wheel", form, ("wheel_speed",)))
    yield Law(
        "inertia_of_one_wheel", WHEEL, ("acceleration",),
        (Constant("inertia", "kg m^2", 0.0, size=0.01, each_wheel=True),), (),
        "inertia * wheel.acceleration", "Spin inertia of each wheel beyond the others'",
        "I_i phi_i''", r"I_i \ddot\varphi_i", "One wheel answers its torque more slowly.",
        CONFIRM["wheel"],
    )  # fmt: skip
    load = Quantity("wheel.torque", "M", "M", "wheel torque", "N m", seen.torque)
    edges = Constant("edge", "N m", 0.0, 4 * seen.torque, seen.torque,
                     tuple(share * seen.torque for share in settings.knee_shares))  # fmt: skip
    for way, sign in (("forward", ""), ("backward", "-")):
        yield Law(
            f"{way}_load_beyond_an_edge", WHEEL, ("torque",),
            (Constant("share", "1", -settings.most_load_share, size=0.3), edges), (),
            f"{sign}share * xp.maximum({sign}wheel.torque - edge, 0.0)",
            f"Part of the {way} torque beyond an edge that is lost: a drive that is weak one way",
            "k (M beyond M_0)", r"k\,\max(M - M_0, 0)",
            f"Beyond a torque the wheels get less than the log says, {way} alone.",
            CONFIRM["wheel"], terms=2,
        )  # fmt: skip
    for form in (
        Form("squared_load", "of the squared torque", (strength("share", "N m", load, 2),),
             "share * wheel.torque * xp.abs(wheel.torque)", "k M |M|", "k M |M|", False),
        Form("even_load", "of the absolute torque", (strength("share", "N m", load, 1),),
             "share * xp.abs(wheel.torque)", "k |M|", "k |M|", False, False),
    ):  # fmt: skip
        law = _joint_law(WHEEL, "wheel", form, ("torque",))
        # Within these the torque that a motion demands stays one.
        most = settings.most_load_share / (load.typical or 1.0)
        limit = replace(law.constants[0], lower=-most, upper=most)
        yield replace(law, constants=(limit,), recognise="The residual bends with the torque.")


TRIED = {
    "wheel": ("dry", "viscous", "quadratic"),
    "roller": ("dry", "viscous"),
    "each wheel": ("dry", "viscous"),
    "each roller": ("dry",),
}
"""Forms of friction that the catalogue or the base model has."""


def _joint_law(place: Place, point: str, form: Form, variables: tuple[str, ...]) -> Law:
    return Law(
        f"{form.key}_{point}_friction" if form.dissipative else f"{form.key}_{point}_torque",
        place,
        variables,
        form.constants,
        (),
        form.text,
        f"{form.word.capitalize()} torque at each {point}",
        form.symbol,
        form.latex,
        f"The residual follows the {point}s' own {variables[0].partition('_')[2] or 'speed'}.",
        CONFIRM["wheel"],
        dissipative=form.dissipative,
    )


def _each(law: Law) -> Law:
    """The law with a strength of its own at each wheel."""
    constants = tuple(
        c if c.is_shape else replace(c, each_wheel=True, lower=0.0 if law.dissipative else c.lower)
        for c in law.constants
    )
    # Four strengths where mostly one acts: as long as two.
    return replace(
        law,
        name=f"uneven_{law.name}",
        constants=constants,
        meaning=f"{law.meaning}, each wheel its own",
        recognise=f"{law.recognise.rstrip('.')} of certain wheels.",
    )


def _joints_by_time(
    place: Place, point: str, u: Quantity, seen: Surroundings, settings: ProposalSettings
) -> Iterator[Law]:
    """Friction that begins at a time."""
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, _instants(seen, settings))
    share = f"share = 0.5 + 0.5 * xp.tanh(({point}.time - instant) / {settings.switch_time:g})"
    for form in speed_forms(u, "torque", "N m", settings):
        if form.key in ("dry", "viscous"):
            law = _joint_law(place, point, form, (*_variables(point), "time"))
            late = replace(
                law,
                name=f"late_{law.name}",
                constants=(*law.constants, instant),
                lines=(share,),
                result=f"share * {law.result}",
                meaning=f"{law.meaning} from a time on",
                formula=f"{law.formula} (t > t_0)",
                latex=rf"{law.latex}\,[t > t_0]",
                confirm=CONFIRM["time"],
                terms=2,
            )
            yield from (late, _each(late))


def _variables(point: str) -> tuple[str, ...]:
    return ("wheel_speed",) if point == "wheel" else ("twist",)


# --- what repeats itself -------------------------------------------------------------------------


def ripple_over_floor(period: float, direction: float) -> Law:
    """A force along a direction that is periodic in the way along it, near a period [m]."""
    step = 0.02 * period
    return Law(
        "ripple_of_floor",
        WORLD,
        ("position_x", "position_y"),
        (
            Constant("sine", "N", size=5.0),
            Constant("cosine", "N", size=5.0),
            Constant("period", "m", 0.5 * period, 2.0 * period, period, (period,), step=0.1 * step),
            Constant("direction", "rad", *CIRCLE, 1.0, (direction,), step=0.02),
        ),
        (TURN, "turn = 6.283185307179586 * (world.x * c + world.y * s) / period",
         "along = sine * xp.sin(turn) + cosine * xp.cos(turn)"),
        "along * c, along * s, 0.0",
        "Force that repeats itself along one direction of the floor: joints of tiles, a grid",
        "a sin(2 pi p/P) + b cos(2 pi p/P), p = x cos(d) + y sin(d)",
        r"a\sin\frac{2\pi p}{P} + b\cos\frac{2\pi p}{P},\; p = x\cos d + y\sin d",
        "The residual repeats itself along one direction of the floor, faster the faster the robot "
        "drives.",
        CONFIRM["place"],
        terms=2,
    )  # fmt: skip


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


# --- products ------------------------------------------------------------------------------------


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


def products(factor: Law, seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """A law of the world inside of a patch, or beyond an edge of the floor; from a time on."""
    if factor.place is not WORLD:
        return
    radius = _spot_constants(seen, settings)
    far = "far = xp.sqrt((world.x - spot_x) ** 2 + (world.y - spot_y) ** 2 + 1e-06)"
    inside = f"inside = 0.5 - 0.5 * xp.tanh((far - radius) / {settings.edge_width:g})"
    yield _times(
        *(factor, "in_a_patch", "inside", radius, (far, inside), ("position_x", "position_y")),
        *("inside of a round patch of the floor", "(r < r_0)", "place"),
    )
    edges, low, high = _edges(seen, settings)
    edge = Constant("edge", "m", low, high, 1.0, edges)
    for axis in "xy":
        for word, sign, mark in (("beyond", 1, ">"), ("before", -1, "<")):
            width = sign * settings.edge_width
            share = f"inside = 0.5 + 0.5 * xp.tanh((world.{axis} - edge) / {width:g})"
            yield _times(
                *(factor, f"{word}_an_edge_in_{axis}", "inside", (edge,), (share,)),
                *((f"position_{axis}",), f"{word} a line across the floor", f"({axis} {mark} p_0)"),
                "place",
            )
    if "time" not in factor.variables:
        instant = Constant("instant", "s", 0.0, seen.duration, 10.0, _instants(seen, settings))
        share = f"inside = 0.5 + 0.5 * xp.tanh((world.time - instant) / {settings.switch_time:g})"
        yield _times(
            *(factor, "from_a_time_on", "inside", (instant,), (share,), ("time",)),
            *("from a time of each log on", "(t > t_0)", "time"),
        )


def _times(
    factor: Law,
    name: str,
    share: str,
    constants: tuple[Constant, ...],
    lines: tuple[str, ...],
    variables: tuple[str, ...],
    word: str,
    mark: str,
    confirm: str,
) -> Law:
    return replace(
        factor,
        name=f"{factor.name}_{name}",
        constants=(*factor.constants, *constants),
        lines=(*factor.lines, *lines, f"fx, fy, mz = {factor.result}"),
        result=f"{share} * fx, {share} * fy, {share} * mz",
        variables=(*factor.variables, *(v for v in variables if v not in factor.variables)),
        meaning=f"{factor.meaning}, {word}",
        formula=f"{factor.formula} {mark}",
        latex=rf"{factor.latex}\,[{mark.strip('()')}]",
        recognise=f"{factor.recognise.rstrip('.')}, {word}, and none elsewhere.",
        confirm=CONFIRM[confirm],
        terms=factor.terms + 1,
    )
