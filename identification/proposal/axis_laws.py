"""The grammar of laws of one axis that slides or turns: friction along the travel, bends, a limit.

Constants are in the units of an axis that slides (see `axis_effects`); the file of a law holds them
as multiples of what is typical for the axis at hand, as the catalogue does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.mechanisms.axis_effects import JOINT, UNITS, Scales
from identification.proposal.forms import Quantity, even_forms, speed_forms
from identification.proposal.law import Constant, Law
from identification.proposal.settings import ProposalSettings


@dataclass(frozen=True)
class Travel:
    """What the logs show of an axis: its scales, where it was (quantiles) [m], how long [s], and
    the width of a sign of its speed [m/s]."""

    scales: Scales
    places: tuple[float, ...]
    duration: float
    smoothing: float

    @property
    def length(self) -> float:
        """From end to end of what is passed."""
        return self.places[-1] - self.places[0]


CONFIRM = {
    "place": "drive over the place slowly, both ways, and elsewhere at the same speed",
    "speed": "drive at several constant speeds, both ways",
    "load": "drive one motion with and without a load",
    "time": "record the same motion again, starting at another time",
}

KNOWN = ("dry", "viscous", "quadratic", "levelling")
"""Forms of friction that the base model or the catalogue has."""

SIGN = "xp.tanh(joint.rate / smoothing)"


def axis_laws(seen: Travel, settings: ProposalSettings) -> list[Law]:
    """Laws of one axis, shortest first."""
    found = [*_by_speed(seen, settings), *_by_place(seen, settings), *_of_the_rest(seen, settings)]
    units = {word for law in found for word in (c.unit for c in law.constants)}
    typical = tuple((word, _typical(word, seen.scales)) for word in sorted(units))
    return sorted((replace(law, typical=typical) for law in found), key=lambda law: law.length)


def _typical(unit: str, scales: Scales) -> float:
    return UNITS[unit].typical(scales)


def _law(name: str, variables: Sequence[str], constants: Sequence[Constant], result: str,
         meaning: str, formula: str, latex: str, recognise: str, confirm: str, *,
         terms: int, dissipative: bool = False) -> Law:  # fmt: skip
    return Law(
        *(name, JOINT, tuple(variables), tuple(constants), (), result, meaning, formula, latex),
        *(recognise, CONFIRM[confirm], dissipative, terms),
    )


def _by_speed(seen: Travel, settings: ProposalSettings) -> Iterator[Law]:
    speed = seen.scales.speed
    u = Quantity("joint.rate", "v", "v", "speed", "m/s", speed, seen.smoothing)
    for form in (*speed_forms(u, "force", "N", settings), *even_forms(u, "force", "N")):
        if form.key in KNOWN or form.key == "absolute":
            continue
        if any(c.unit not in UNITS for c in form.constants):
            continue  # the cube of a speed has no unit in the axis' catalogue
        yield _law(
            f"{form.key}_axis_friction", ("speed",), form.constants, form.text,
            f"{form.word.capitalize()} force of the axis by its speed", form.symbol, form.latex,
            "The residual follows the speed.", "speed", terms=1, dissipative=form.dissipative,
        )  # fmt: skip


def _smoothing(seen: Travel) -> Constant:
    eps = seen.smoothing
    return Constant("smoothing", "m/s", 1e-3 * eps, 100 * eps, eps, (eps,), fitted=False)


def _spot(seen: Travel, settings: ProposalSettings) -> tuple[Constant, Constant]:
    low, high, length = seen.places[0], seen.places[-1], seen.length
    widths = tuple(share * length for share in settings.spot_shares)
    return (
        Constant("centre", "m", low, high, length, seen.places[1:-1]),
        Constant("width", "m", 0.01 * length, length, widths[0], widths),
    )


def _by_place(seen: Travel, settings: ProposalSettings) -> Iterator[Law]:
    force, eps = Constant("force", "N"), _smoothing(seen)
    spot = _spot(seen, settings)
    near = "xp.exp(-(((joint.position - centre) / width) ** 2))"
    near_s, near_t = "exp(-((x - x_0)/b)^2)", r"e^{-((x - x_0)/b)^2}"
    yield _law(
        "tight_spot", ("position", "speed"), (replace(force, lower=0.0), *spot, eps),
        f"force * {near} * {SIGN}", "Dry friction around one place of the travel",
        f"f {near_s} tanh(v/eps)", rf"f {near_t}\tanh(v/\epsilon)",
        "A force against the motion near one place of the travel, both ways.", "place",
        dissipative=True, terms=2,
    )  # fmt: skip
    yield _law(
        "bump_of_travel", ("position",), (force, *spot),
        f"force * {near}", "Force around one place of the travel",
        f"f {near_s}", f"f {near_t}",
        "A push one way near one place of the travel, whichever way the axis moves.", "place",
        terms=2,
    )  # fmt: skip
    periods = tuple(2.0 * seen.length / k for k in range(3, settings.axis_periods + 3))
    period = Constant("period", "m", periods[-1] / 2, seen.length, periods[0], periods)
    turn = f"{2 * math.pi!r} * joint.position / period"
    yield _law(
        "friction_that_swings", ("position", "speed"),
        (replace(force, name="sine"), replace(force, name="cosine"), period, eps),
        f"(sine * xp.sin({turn}) + cosine * xp.cos({turn})) * {SIGN}",
        "Dry friction that swings along the travel: a screw or a gear that runs out of true",
        "(a sin(2 pi x/p) + b cos(2 pi x/p)) tanh(v/eps)",
        r"(a\sin\frac{2\pi x}{p} + b\cos\frac{2\pi x}{p})\tanh(v/\epsilon)",
        "Friction that comes and goes along the travel.", "place", terms=2,
    )  # fmt: skip
    middle = 0.5 * (seen.places[0] + seen.places[-1])
    held = Constant("middle", "m", -math.inf, math.inf, seen.length, (middle,), fitted=False)
    for name, factor, word, mark in (
        ("bending_spring", "", "Spring that stiffens towards both ends", ""),
        (
            "friction_of_the_ends",
            f" * {SIGN}",
            "Dry friction that grows towards both ends",
            " tanh(v/eps)",
        ),
    ):
        constants = (Constant("end", "N"), held, *((eps,) if factor else ()))
        yield _law(
            name, ("position", *(("speed",) if factor else ())), constants,
            f"end * ((joint.position - middle) / {float(0.5 * seen.length)!r}) ** 2{factor}",
            word, f"f ((x - x_m)/l)^2{mark}", rf"f ((x - x_m)/l)^2{mark}",
            "The residual bends along the travel.", "place", terms=2,
        )  # fmt: skip


def _of_the_rest(seen: Travel, settings: ProposalSettings) -> Iterator[Law]:
    instants = np.linspace(0.0, seen.duration, settings.instants + 2)[1:-1]
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, tuple(instants.tolist()))
    share = f"(0.5 + 0.5 * xp.tanh((joint.time - instant) / {settings.switch_time:g}))"
    yield _law(
        "force_from_a_time_on", ("time",), (Constant("force", "N"), instant),
        f"force * {share}", "Force from a time of each log on", "f (t > t_0)", "f [t > t_0]",
        "From a moment on the axis is pushed one way.", "time", terms=2,
    )  # fmt: skip
    yield _law(
        "dry_friction_from_a_time_on", ("speed", "time"),
        (Constant("force", "N"), instant, _smoothing(seen)), f"force * {share} * {SIGN}",
        "Dry friction from a time of each log on", "f tanh(v/eps) (t > t_0)",
        r"f\tanh(v/\epsilon)\,[t > t_0]", "From a moment on the axis runs harder, or more easily.",
        "time", terms=2,
    )  # fmt: skip
    typical = seen.scales.force
    edges = tuple(part * typical for part in settings.knee_shares)
    edge = Constant("edge", "N", 0.0, 4 * typical, typical, edges)
    yield _law(
        "loss_while_driving", ("force", "speed"),
        (Constant("share", "1", 0.0, settings.most_lost_share, size=0.2), _smoothing(seen)),
        f"share * xp.maximum(joint.force * {SIGN}, 0.0) * {SIGN}",
        "Part of the force that is lost where it drives the axis, and not where it brakes",
        "k |F| tanh(v/eps) (F v > 0)", r"k\,|F|\tanh(v/\epsilon)\,[F v > 0]",
        "The axis gets less than the log says while it speeds up or lifts, and all of it while it "
        "brakes.", "load", dissipative=True, terms=2,
    )  # fmt: skip
    most = settings.most_load_share
    for way, sign in (("forward", ""), ("backward", "-")):
        yield _law(
            f"{way}_force_beyond_an_edge", ("force",),
            (Constant("share", "1", -most, size=0.3), edge),
            f"{sign}share * xp.maximum({sign}joint.force - edge, 0.0)",
            f"Part of the {way} force beyond an edge that is lost: a drive that is weak one way",
            "k (F beyond F_0)", r"k\,\max(F - F_0, 0)",
            f"Beyond a force the axis gets less than the log says, {way} alone.", "load", terms=2,
        )  # fmt: skip
