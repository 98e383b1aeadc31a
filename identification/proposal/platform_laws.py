"""The grammar of laws of a mecanum platform: which force at which site depends on what, and how.

Physics prunes it. What depends on a site's own speed only takes energy, and is odd in it; what
depends on a place or a heading is a potential's slope or swings; one law holds for all four wheels
before each wheel has its own. What the catalogue holds is left out: it has been tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.proposal.forms import Form, Quantity, even_forms, speed_forms, strength
from identification.proposal.law import Constant, Law
from identification.proposal.place_laws import laws_by_place
from identification.proposal.settings import ProposalSettings
from identification.proposal.sized_friction import (
    by_fading,
    by_place,
    by_time,
    by_wheel_angle,
    sized,
    sized_frictions,
    times_a_turn,
)
from identification.proposal.surroundings import (
    CIRCLE,
    CONFIRM,
    TURN,
    WAVE,
    Surroundings,
    direction_constant,
    instants,
    wave_constants,
)
from youbot_env.physics.effect import BODY, ROLLER, WHEEL, WORLD, Place

Array = NDArray[np.float64]


WORLD_SPEEDS = ("twist", "heading")
"""Variables of a force that depends on a speed along a direction of the world."""


def single_laws(seen: Surroundings, settings: ProposalSettings) -> list[Law]:
    """The laws of one variable, shortest first; those that are periodic in a place are sought
    apart."""
    found = [
        *_along_directions(seen, settings),
        *laws_by_place(seen, settings),
        *_by_heading(settings),
        *sized_frictions(seen, settings),
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
        direction = direction_constant(settings, half=not one_way)
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


def _by_heading(settings: ProposalSettings) -> Iterator[Law]:
    """Forces along the world and moments that swing with the heading."""
    for order in settings.heading_orders:
        turns = times_a_turn(order)
        pair = (Constant("cosine", "N", size=5.0), Constant("sine", "N", size=5.0))
        swing = "cosine * xp.cos(times * world.yaw) + sine * xp.sin(times * world.yaw)"
        yield Law(
            f"force_by_heading_{order}",
            WORLD,
            ("heading",),
            (*pair, direction_constant(settings), turns),
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


# --- time ------------------------------------------------------------------------------------


def _by_time(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """A pull that comes and goes."""
    pull = (Constant("force_x", "N", size=5.0), Constant("force_y", "N", size=5.0))
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, instants(seen, settings))
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
    yield Law(
        "turning_for_a_while",
        WORLD,
        ("time",),
        (Constant("moment", "N m", size=1.0), replace(instant, name="middle"), width),
        ("share = xp.exp(-(((world.time - middle) / width) ** 2))",),
        "0.0, 0.0, moment * share",
        "Moment that comes and goes in each log",
        "m exp(-((t - t_m)/b)^2)",
        r"m e^{-((t - t_m)/b)^2}",
        "For a while something turns the robot.",
        CONFIRM["time"],
        terms=2,
    )
    pull_law = Law(
        "pull", WORLD, (), pull, (), "force_x, force_y, 0.0", "Force along the world", "f", "f",
        "A pull towards one side of the room", CONFIRM["time"],
    )  # fmt: skip
    on_board = Law(
        "push_on_board", BODY, (), (*pull, Constant("moment", "N m", size=1.0)), (),
        "force_x, force_y, moment", "Force and moment that turn with the robot", "f", "f",
        "A push that turns with the robot", CONFIRM["time"],
    )  # fmt: skip
    yield _late(on_board, "body", seen, settings)  # of the world: among the products
    yield from (_growing(law, point) for law, point in ((pull_law, "world"), (on_board, "body")))


def _growing(law: Law, point: str) -> Law:
    """A force that grows steadily from the start of each log, from one that is there already."""
    growth = (
        replace(c, name=f"{c.name}_growth", unit=f"{c.unit}/s", size=c.size / 60.0)
        for c in law.constants
    )
    grown = (f"{c.name} + {c.name}_growth * {point}.time" for c in law.constants)
    return replace(
        law,
        name=f"{law.name}_that_grows",
        variables=("time",),
        constants=(*law.constants, *growth),
        result=", ".join([*grown, "0.0"][:3]),
        meaning=f"{law.meaning}, growing from the start of each log",
        formula="f + g t",
        latex="f + g t",
        recognise=f"{law.recognise}, more from minute to minute.",
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
    """Forces along the body's axes that depend on its speeds and accelerations."""
    for k, (axis, word, *_, unit, name) in enumerate(AXES):
        if axis != "yaw":  # of turning it is the base model's inertia
            yield Law(
                f"inertia_along_{axis}", BODY, ("acceleration",),
                (Constant("mass", "kg", 0.0, size=3.0),), (),
                _on_axis(k, f"mass * body.acceleration[{k}]"),
                f"Mass that resists {word} motion alone: what rolls or sloshes along one axis",
                f"k V{axis.upper()}'", rf"k\,\dot V_{axis.upper()}",
                f"The robot is heavier in {word} motion than in the other.", CONFIRM["load"],
            )  # fmt: skip
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
    yield from _dragged_at_a_point(settings)
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


def _dragged_at_a_point(settings: ProposalSettings) -> Iterator[Law]:
    """Friction at a point of the robot that touches the floor, or where a cable is fixed."""
    lever = settings.drag_lever
    places = tuple(
        Constant(f"point_{axis}", "m", -1.0, 1.0, lever, (-lever, 0.0, lever), step=lever / 3)
        for axis in "xy"
    )
    for name, constant, size, word, formula, latex in (
        (
            "dry_drag_at_a_point",
            Constant("force", "N", size=5.0),
            "force / xp.sqrt(vx**2 + vy**2 + 2.5e-05)",
            "Dry",
            "f v_p/|v_p|",
            r"f\,v_p/|v_p|",
        ),
        (
            "viscous_drag_at_a_point",
            Constant("coefficient", "N s/m", size=50.0),
            "coefficient",
            "Viscous",
            "k v_p",
            r"k\,v_p",
        ),
    ):
        yield Law(
            name,
            BODY,
            ("twist",),
            (constant, *places),
            (
                "vx, vy = body.twist[0] - body.twist[2] * point_y,"
                " body.twist[1] + body.twist[2] * point_x",
                f"size = {size}",
            ),
            "size * vx, size * vy, size * (point_x * vy - point_y * vx)",
            f"{word} friction at one point of the robot: a caster, a brush, a cable fixed there",
            f"{formula} at a point p of the robot",
            latex,
            "A force against the motion of one point of the robot, with its moment.",
            CONFIRM["speed"],
            dissipative=True,
            terms=2,
        )


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
    yield from _sized_wheels(seen, settings)
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
    # The loss grows with the square of the torque: at peaks of 2.5 times the rms its share doubles.
    most = settings.most_load_share / (10 * seen.torque or 1.0)
    yield Law(
        "loss_under_common_load", WHEEL, ("torque",),
        (Constant("share", "1/(N m)", -most, most, size=0.2 * most),), (),
        "share * wheel.torque * wheel.total_torque",
        "Torque that each wheel loses as all together ask for more: the battery's voltage sags",
        "k M (|M_1| + ... + |M_4|)", r"k\,M \sum_i |M_i|",
        "All wheels are weaker while all of them work hard.", CONFIRM["load"], terms=2,
    )  # fmt: skip
    yield from _faults_of_torque(seen, settings)


def _faults_of_torque(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Torques of which a part is lost: over a part of the turn, from a time on, or ever more."""
    share = settings.most_lost_share
    lost = Law(
        "lost_torque", WHEEL, ("torque",),
        (Constant("share", "1", -share, share, size=0.1),), (),
        "share * wheel.torque", "Part of the torque that is lost", "k M", "k M",
        "The wheels get less than the log says", CONFIRM["load"],
    )  # fmt: skip
    over_turn = (
        replace(by_wheel_angle(order), word="which swings with its angle: a drive that is weaker "
                "over a part of the turn")
        for order in settings.wheel_orders
    )  # fmt: skip
    late = _late(lost, "wheel", seen, settings)
    laws = [late, _each(late)]
    laws += (_each(sized(lost, by)) for by in (*over_turn, by_time(), by_fading(seen, settings)))
    yield from (_within(law, share) for law in laws)


def _within(law: Law, share: float) -> Law:
    """The law with shares of a torque that leave a motion one torque."""
    constants = tuple(
        replace(c, lower=-share, upper=share) if c.unit == "1" and not c.is_shape else c
        for c in law.constants
    )
    return replace(law, constants=constants)


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
    for form in speed_forms(u, "torque", "N m", settings):
        if form.key in ("dry", "viscous"):
            late = _late(_joint_law(place, point, form, _variables(point)), point, seen, settings)
            yield from (late, _each(late))


def _late(law: Law, point: str, seen: Surroundings, settings: ProposalSettings) -> Law:
    """A law from a time on."""
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, instants(seen, settings))
    acts = f"acts = 0.5 + 0.5 * xp.tanh(({point}.time - instant) / {settings.switch_time:g})"
    parts = (part.strip() for part in law.result.split(","))
    return replace(
        law,
        name=f"late_{law.name}",
        variables=(*law.variables, "time"),
        constants=(*law.constants, instant),
        lines=(acts, *law.lines),
        result=", ".join(part if part == "0.0" else f"acts * {part}" for part in parts),
        meaning=f"{law.meaning} from a time on",
        formula=f"{law.formula} (t > t_0)",
        latex=rf"{law.latex}\,[t > t_0]",
        confirm=CONFIRM["time"],
        terms=law.terms + 1,
    )


def _sized_wheels(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Friction of a wheel that rubs over a part of its turn: its size swings with the angle; and
    friction that grows or fades as a part wears or runs in."""
    u = Quantity(
        "wheel.rate", "w", r"\omega", "wheel speed", "rad/s", seen.wheel, settings.smoothing[2]
    )
    for form in speed_forms(u, "torque", "N m", settings):
        if form.key in ("dry", "viscous"):
            friction = _joint_law(WHEEL, "wheel", form, ("wheel_speed",))
            for order in settings.wheel_orders:
                yield _each(sized(friction, by_wheel_angle(order)))
            for by in (by_time(), by_fading(seen, settings)):
                law = sized(friction, by)
                yield from (law, _each(law))
            yield sized(friction, by_place())


def frictions_of_joints(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Dry and viscous friction of all wheels, and of all rollers, which the catalogue has too."""
    for place, point, typical, eps in (
        (WHEEL, "wheel", seen.wheel, settings.smoothing[2]),
        (ROLLER, "roller", seen.roller, settings.smoothing[3]),
    ):
        u = Quantity(f"{point}.rate", "w", r"\omega", f"{point} speed", "rad/s", typical, eps)
        for form in speed_forms(u, "torque", "N m", settings):
            if form.key in ("dry", "viscous"):
                yield _joint_law(place, point, form, _variables(point))


def _variables(point: str) -> tuple[str, ...]:
    return ("wheel_speed",) if point == "wheel" else ("twist",)


# --- what repeats itself -------------------------------------------------------------------------


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
