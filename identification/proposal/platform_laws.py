"""The grammar of laws of a mecanum platform: which force at which site depends on what, and how.

Physics prunes it. What depends on a site's own speed only takes energy, and is odd in it; what
depends on a place or a heading is a potential's slope or swings; one law holds for all four wheels
before each wheel has its own. What the catalogue holds is left out: it has been tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.proposal.forms import Form, Quantity, even_forms, speed_forms, strength
from identification.proposal.joint_laws import laws_of_joints
from identification.proposal.law import Constant, Law
from identification.proposal.place_laws import laws_by_place
from identification.proposal.settings import ProposalSettings
from identification.proposal.sized_friction import sized_frictions, times_a_turn
from identification.proposal.surroundings import (
    CIRCLE,
    CONFIRM,
    TURN,
    Surroundings,
    direction_constant,
)
from identification.proposal.time_laws import laws_by_time
from youbot_env.physics.effect import BODY, WORLD

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
        *laws_by_time(seen, settings),
        *_of_body(seen, settings),
        *laws_of_joints(seen, settings),
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
