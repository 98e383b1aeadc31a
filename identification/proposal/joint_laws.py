"""Laws of wheels and rollers: friction and losses at each joint, by what that joint sees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from identification.proposal.forms import Form, Quantity, even_forms, speed_forms, strength
from identification.proposal.law import Constant, Law
from identification.proposal.settings import ProposalSettings
from identification.proposal.sized_friction import (
    by_fading,
    by_place,
    by_time,
    by_wheel_angle,
    sized,
    without_level,
)
from identification.proposal.surroundings import CONFIRM, Surroundings
from identification.proposal.time_laws import late
from youbot_env.physics.effect import ROLLER, WHEEL, Place


def laws_of_joints(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Torques at the wheels and rollers by their own speed, load, acceleration and time."""
    for place, variable in OF_SPEED.items():
        for form in speed_forms(_rate(place, seen, settings), "torque", "N m", settings):
            law = _joint_law(place, form, variable)
            if form.key not in TRIED[place]:
                yield law
            if form.key not in TRIED_OF_EACH[place]:
                yield _each(law)
    for friction in frictions_of_joints(seen, settings):
        from_a_time = late(friction, seen, settings)
        yield from (from_a_time, _each(from_a_time))
        if friction.place is WHEEL:
            yield from _sized(friction, seen, settings)
    # Even: in the catalogue for all wheels together, not for each.
    for form in even_forms(_rate(WHEEL, seen, settings), "torque", "N m"):
        yield _each(_joint_law(WHEEL, form, OF_SPEED[WHEEL]))
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
        law = _joint_law(WHEEL, form, "torque")
        # Within these the torque that a motion demands stays one.
        most = settings.most_load_share / (load.typical or 1.0)
        limit = replace(law.constants[0], lower=-most, upper=most)
        yield replace(law, constants=(limit,), recognise="The residual bends with the torque.")
    lossy = _loss_while_driving(seen, settings)
    yield from (lossy, _each(lossy))
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


def _loss_while_driving(seen: Surroundings, settings: ProposalSettings) -> Law:
    """A gear that loses where the motor drives, and little where the load drives it back."""
    sign = "xp.tanh(wheel.rate / smoothing)"
    dry = next(
        form
        for form in speed_forms(_rate(WHEEL, seen, settings), "torque", "N m", settings)
        if form.key == "dry"
    )
    eps = next(c for c in dry.constants if c.name == "smoothing")
    return Law(
        "loss_while_driving", WHEEL, ("torque", "wheel_speed"),
        (Constant("share", "1", 0.0, settings.most_lost_share, size=0.2), eps), (),
        f"share * xp.maximum(wheel.torque * {sign}, 0.0) * {sign}",
        "Part of the torque that is lost where it drives the wheel, and not where it brakes",
        "k |M| tanh(w/eps) (M w > 0)", r"k\,|M|\tanh(\omega/\epsilon)\,[M \omega > 0]",
        "The wheels get less than the log says while they speed up or pull, and all of it while "
        "they brake.", CONFIRM["load"], dissipative=True, terms=2,
    )  # fmt: skip


def _faults_of_torque(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Torques of which a part is lost: over a part of the turn, from a time on, or ever more."""
    share = settings.most_lost_share
    lost = Law(
        "lost_torque", WHEEL, ("torque",),
        (Constant("share", "1", -share, share, size=0.1),), (),
        "share * wheel.torque", "Part of the torque that is lost", "k M", "k M",
        "The wheels get less, or more, than the log says", CONFIRM["load"],
    )  # fmt: skip
    over_turn = (
        replace(by_wheel_angle(order), word="which swings with its angle: a drive that is weaker "
                "over a part of the turn")
        for order in settings.wheel_orders
    )  # fmt: skip
    from_a_time = late(lost, seen, settings)
    laws = [from_a_time, _each(from_a_time)]
    # Without a level: what the wheels lose alike at all times is no other than their scale.
    laws += (
        _each(sized(lost, without_level(by)))
        for by in (*over_turn, by_time(), by_fading(seen, settings))
    )
    yield from (_within(law, share) for law in laws)


def _within(law: Law, share: float) -> Law:
    """The law with shares of a torque that leave a motion one torque."""
    constants = tuple(
        replace(c, lower=-share, upper=share) if c.unit == "1" and not c.is_shape else c
        for c in law.constants
    )
    return replace(law, constants=constants)


OF_SPEED = {WHEEL: "wheel_speed", ROLLER: "twist"}
"""The variable that tells a joint's speed."""

TRIED = {WHEEL: ("dry", "viscous", "quadratic"), ROLLER: ("dry", "viscous")}
"""Forms of friction that the catalogue or the base model has for all joints."""

TRIED_OF_EACH = {WHEEL: ("dry", "viscous"), ROLLER: ("dry",)}
"""The same for each joint its own."""


def _rate(place: Place, seen: Surroundings, settings: ProposalSettings) -> Quantity:
    """The speed of a joint."""
    point = place.name.split()[0]
    typical, smoothing = (
        (seen.wheel, settings.smoothing[2]) if place is WHEEL
        else (seen.roller, settings.smoothing[3])
    )  # fmt: skip
    return Quantity(f"{point}.rate", "w", r"\omega", f"{point} speed", "rad/s", typical, smoothing)


def frictions_of_joints(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Dry and viscous friction of all wheels, and of all rollers, which the catalogue has too."""
    for place, variable in OF_SPEED.items():
        for form in speed_forms(_rate(place, seen, settings), "torque", "N m", settings):
            if form.key in ("dry", "viscous"):
                yield _joint_law(place, form, variable)


def _joint_law(place: Place, form: Form, variable: str) -> Law:
    point = place.name.split()[0]
    return Law(
        f"{form.key}_{point}_friction" if form.dissipative else f"{form.key}_{point}_torque",
        place,
        (variable,),
        form.constants,
        (),
        form.text,
        f"{form.word.capitalize()} torque at each {point}",
        form.symbol,
        form.latex,
        f"The residual follows the {point}s' own {variable.partition('_')[2] or 'speed'}.",
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
        recognise=f"{law.recognise.rstrip('.')}, at some wheels more than at others.",
    )


def _sized(friction: Law, seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Friction of a wheel that rubs over a part of its turn: its size swings with the angle; and
    friction that grows or fades as a part wears or runs in, or changes over the floor."""
    for order in settings.wheel_orders:
        yield _each(sized(friction, by_wheel_angle(order)))
    for by in (by_time(), by_fading(seen, settings)):
        law = sized(friction, by)
        yield from (law, _each(law))
    yield sized(friction, by_place())
