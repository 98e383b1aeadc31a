"""What can act on one axis: the components of its base model, then the effects to add to them.

An axis slides or turns; its logs are in m, m/s and N, or in rad, rad/s and N m. The units below are
those of an axis that slides, and every default, bound and size is a multiple of what is typical for
the axis at hand (:class:`Scales`): a positioning stage and a wrist motor share one catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from identification.signals.filters import FilterSettings
from youbot_env.errors import InputError
from youbot_env.physics import catalogue
from youbot_env.physics.effect import (
    ACTUATOR,
    CLOCK,
    BaseParameters,
    Effect,
    Parameter,
    Place,
    Registry,
    effect,
)
from youbot_env.physics.namespaces import Namespace, Number


class Base(NamedTuple):
    """The base parameters, for effects that refer to them."""

    inertia: Number
    viscous: Number
    coulomb: Number
    smoothing: Number
    offset: Number


class Joint(NamedTuple):
    """The axis. An effect here returns the force that the motion demands; ``force``: what acts."""

    rate: Number
    acceleration: Number
    position: Number
    force: Number
    time: Number
    base: BaseParameters


JOINT = Place("axis", "wrench", Joint, False)
TURNING = Place("rotary", "wrench", Joint, False)


@dataclass(frozen=True)
class Scales:
    """What is typical for an axis, in its own units: rms values, and travel from end to end.

    turns : whether the units are rad, rad/s, N m rather than m, m/s, N
    bandwidth : up to which forces are fitted [rad/s]: as far as the speed's noise allows
    one_way : whether the axis only ever moves in one direction. Dry friction is then a constant
        force like the offset: ``offset`` stands for both, and ``coulomb`` stays at zero
    """

    turns: bool
    speed: float
    acceleration: float
    force: float
    travel: float
    bandwidth: float = FilterSettings.rate
    one_way: bool = False

    @property
    def cycle(self) -> float:
        """Length in which a force along the travel repeats itself at the latest [m or rad].

        A joint that turns on and on meets the same teeth and magnets again: two turns at most, for
        an output that turns half as fast.
        """
        return min(self.travel, 4 * math.pi) if self.turns else self.travel


class Unit(NamedTuple):
    """A unit's counterpart for an axis that turns, and what is typical for an axis."""

    turning: str
    typical: Callable[[Scales], float]


UNITS = {
    "1": Unit("1", lambda s: 1.0),
    "s": Unit("s", lambda s: 1.0),
    "kg": Unit("kg m^2", lambda s: s.force / s.acceleration),
    "N": Unit("N m", lambda s: s.force),
    "N/s": Unit("N m/s", lambda s: s.force),
    "N/m": Unit("N m/rad", lambda s: s.force / s.travel),
    "N s/m": Unit("N m s", lambda s: s.force / s.speed),
    "N s^2/m^2": Unit("N m s^2", lambda s: s.force / s.speed**2),
    "m": Unit("rad", lambda s: s.cycle),
    "m/s": Unit("rad/s", lambda s: s.speed),
}


def fitted_to(item: Effect, scales: Scales) -> Effect:
    """The effect with units, defaults, bounds, sizes and grids of the axis at hand.

    Raises
    ------
    InputError
        If a parameter's unit is none of ``UNITS``.
    """
    return replace(item, parameters=tuple(_fitted(item, p, scales) for p in item.parameters))


def _fitted(item: Effect, parameter: Parameter, scales: Scales) -> Parameter:
    if parameter.unit not in UNITS:
        raise InputError(
            f"effect {item.name}: {parameter.name} is in {parameter.unit!r}; "
            f"of one axis the units are {', '.join(UNITS)}"
        )
    unit = UNITS[parameter.unit]
    typical = unit.typical(scales)
    # What has a default is not identified.
    held = 0.0 if scales.one_way and parameter.name == "coulomb" else parameter.default
    return replace(
        parameter,
        unit=unit.turning if scales.turns else parameter.unit,
        default=None if held is None else held * typical,
        lower=parameter.lower * typical,
        upper=parameter.upper * typical,
        size=parameter.size * typical,
        grid=tuple(value * typical for value in parameter.grid),
    )


BOTH_WAYS = frozenset({"asymmetric_viscous_friction", "asymmetric_coulomb_friction"})
"""Effects that compare one direction with the other: one direction alone cannot show them."""

AXIS_BASE = Registry()
"""The components of the base model of one axis."""

AXIS_CATALOGUE = Registry(trial="identification.mechanisms.axis_printing:try_out")
"""Effects that can be added to it."""

_ARMSTRONG = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"
_EMPS = "Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019"


def direction(xp: Namespace, joint: Joint) -> Number:
    """Sign of the speed, smooth around standstill: tanh(v/eps)."""
    return xp.tanh(joint.rate / joint.base.smoothing)


@effect(
    registry=AXIS_BASE,
    acts_at=JOINT,
    parameters=[Parameter("inertia", "kg", lower=0.0)],
    source=_EMPS,
    recognise="Part of the base model.",
)
def axis_inertia(xp: Namespace, joint: Joint, inertia: Number) -> Number:
    """Mass or moment of inertia [N]: M a."""
    return inertia * joint.acceleration


@effect(
    registry=AXIS_BASE,
    acts_at=JOINT,
    parameters=[Parameter("viscous", "N s/m", lower=0.0)],
    source=_EMPS,
    recognise="Part of the base model.",
    dissipative=True,
)
def axis_viscous_friction(xp: Namespace, joint: Joint, viscous: Number) -> Number:
    """Viscous friction [N]: F_v v."""
    return viscous * joint.rate


@effect(
    registry=AXIS_BASE,
    acts_at=JOINT,
    parameters=[
        Parameter("coulomb", "N", lower=0.0),
        # On the EMPS data a step twice as wide costs 0.05 % of force error, a hundredfold one 2 %.
        Parameter("smoothing", "m/s", default=2e-3, lower=1e-4, upper=1.0),
    ],
    source=_EMPS,
    recognise="Part of the base model.",
    dissipative=True,
)
def axis_coulomb_friction(
    xp: Namespace, joint: Joint, coulomb: Number, smoothing: Number
) -> Number:
    """Dry friction [N]: F_c tanh(v/eps)."""
    return coulomb * xp.tanh(joint.rate / smoothing)


@effect(
    registry=AXIS_BASE,
    acts_at=JOINT,
    parameters=[Parameter("offset", "N")],
    source=_EMPS,
    recognise="Part of the base model.",
)
def axis_offset(xp: Namespace, joint: Joint, offset: Number) -> Number:
    """Constant force: weight, or the zero of the effort's measurement [N]."""
    return offset


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("asymmetry", "N s/m", lower=-10.0, upper=10.0, size=0.1)],
    source=_EMPS,
    recognise="The residual follows the absolute speed: one way is harder than the other.",
)
def asymmetric_viscous_friction(xp: Namespace, joint: Joint, asymmetry: Number) -> Number:
    """Viscous friction F_v + d at positive and F_v - d at negative speed [N]: d |v|."""
    return asymmetry * xp.abs(joint.rate)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("asymmetry", "N", lower=-2.0, upper=2.0, size=0.1)],
    source=_ARMSTRONG,
    recognise="A constant residual in motion, either way, that is gone at standstill.",
)
def asymmetric_coulomb_friction(xp: Namespace, joint: Joint, asymmetry: Number) -> Number:
    """Dry friction F_c + d at positive and F_c - d at negative speed [N]: d tanh(v/eps)^2."""
    return asymmetry * direction(xp, joint) ** 2


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[
        Parameter("breakaway", "N", lower=0.0, upper=10.0, size=0.2),
        Parameter(
            "stribeck_speed", "m/s", default=0.1, lower=0.01, upper=2.0, grid=(0.03, 0.1, 0.3, 0.8)
        ),
    ],
    source=_ARMSTRONG,
    recognise="The residual peaks either side of standstill, with the sign of the speed.",
    dissipative=True,
)
def stribeck_friction(
    xp: Namespace, joint: Joint, breakaway: Number, stribeck_speed: Number
) -> Number:
    """Dry friction beyond Coulomb's at low speed [N]: f_b exp(-(v/v_s)^2) tanh(v/eps)."""
    return breakaway * xp.exp(-((joint.rate / stribeck_speed) ** 2)) * direction(xp, joint)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("coefficient", "N s^2/m^2", lower=0.0, upper=10.0, size=0.1)],
    source="Turbulent (churning) losses: quadratic in the speed",
    recognise="The residual bends upwards with the speed.",
    dissipative=True,
)
def quadratic_friction(xp: Namespace, joint: Joint, coefficient: Number) -> Number:
    """Friction that grows with the square of the speed [N]: k v |v|."""
    return coefficient * joint.rate * xp.abs(joint.rate)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[
        Parameter("force", "N", lower=0.0, upper=10.0, size=0.2),
        Parameter("knee", "m/s", default=0.5, lower=0.05, upper=3.0, grid=(0.15, 0.5, 1.5)),
    ],
    source="Lubricant that thins with shear: Bittencourt and Gunnarsson, JDSMC 134(5), 2012",
    recognise="The residual rises steeply from standstill and is flat at high speed.",
    dissipative=True,
)
def thinning_friction(xp: Namespace, joint: Joint, force: Number, knee: Number) -> Number:
    """Viscous friction that levels off at high speed [N]: f tanh(v/v_k)."""
    return force * xp.tanh(joint.rate / knee)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[
        Parameter("fraction", "1", lower=0.0, upper=10.0, size=0.3),
        Parameter(
            "time_constant", "s", default=15.0, lower=2.0, upper=600.0, grid=(5.0, 15.0, 60.0)
        ),
    ],
    source="Grease that warms up: exponential approach to the warm friction",
    recognise="Friction that fades from the start of each log.",
    dissipative=True,
)
def friction_warmup(xp: Namespace, joint: Joint, fraction: Number, time_constant: Number) -> Number:
    """Extra friction of a cold axis [N]: f exp(-t/T) (F_v v + F_c tanh(v/eps))."""
    warm = joint.base.viscous * joint.rate + joint.base.coulomb * direction(xp, joint)
    return fraction * xp.exp(-joint.time / time_constant) * warm


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("share", "1", lower=0.0, upper=0.9, size=0.1)],
    source="Gear losses that grow with the transmitted torque: Linderoth et al., IROS 2013",
    recognise="Friction that grows when the axis accelerates or lifts, not only with speed.",
    dissipative=True,
)
def load_dependent_friction(xp: Namespace, joint: Joint, share: Number) -> Number:
    """Gear friction in proportion to the force that acts [N]: s |F| tanh(v/eps)."""
    return share * xp.abs(joint.force) * direction(xp, joint)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("asymmetry", "1", lower=-0.9, upper=0.9, size=0.05)],
    source="An amplifier whose two directions have gains of their own",
    recognise="The residual follows the absolute value of the effort.",
)
def asymmetric_gain(xp: Namespace, joint: Joint, asymmetry: Number) -> Number:
    """Part of the effort that is lost one way and won the other [N]: g |F|."""
    return asymmetry * xp.abs(joint.force)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("stiffness", "N/m", lower=-10.0, upper=10.0, size=0.1)],
    source="Hooke's law; negative next to an unstable equilibrium",
    recognise="The residual grows along the travel: a spring, a cable, a counterweight.",
)
def spring(xp: Namespace, joint: Joint, stiffness: Number) -> Number:
    """Force in proportion to the position [N]: c x; the base model's offset sets its zero."""
    return stiffness * joint.position


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[
        Parameter("sine", "N", lower=-10.0, upper=10.0, size=0.1),
        Parameter("cosine", "N", lower=-10.0, upper=10.0, size=0.1),
        Parameter(
            "period",
            "m",
            default=0.25,
            lower=1e-3,
            # What has not come again one and a half times is a bend along the travel, as a spring
            # makes it, and no period.
            upper=0.75,
            grid=tuple(1.0 / (0.5 * k) for k in range(3, 25)),
        ),
    ],
    source="Cogging of magnets and the pitch of a screw or belt: a force periodic in the position",
    recognise="The residual repeats itself along the travel.",
)
def cogging(xp: Namespace, joint: Joint, sine: Number, cosine: Number, period: Number) -> Number:
    """Force that is periodic in the position [N]: a sin(2 pi x/p) + b cos(2 pi x/p)."""
    angle = 6.283185307179586 * joint.position / period
    return sine * xp.sin(angle) + cosine * xp.cos(angle)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("slope", "N/m", lower=-10.0, upper=10.0, size=0.1)],
    source="A guide or gear that is tighter at one end of the travel",
    recognise="A residual against the motion that grows along the travel.",
)
def position_dependent_friction(xp: Namespace, joint: Joint, slope: Number) -> Number:
    """Dry friction that changes along the travel [N]: k x tanh(v/eps)."""
    return slope * joint.position * direction(xp, joint)


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=JOINT,
    parameters=[Parameter("rate", "N/s", lower=-1.0, upper=1.0, size=5e-3)],
    source="Thermal drift of the effort's measurement",
    recognise="The residual's mean moves steadily over the log.",
)
def force_drift(xp: Namespace, joint: Joint, rate: Number) -> Number:
    """Offset that drifts [N]: k t, t from the log's start."""
    return rate * joint.time


@effect(
    registry=AXIS_CATALOGUE,
    acts_at=TURNING,
    parameters=[
        Parameter("sine", "N", lower=-10.0, upper=10.0, size=0.2),
        Parameter("cosine", "N", lower=-10.0, upper=10.0, size=0.2),
    ],
    source="Weight of an arm whose centre of mass lies off the axis",
    recognise="The residual goes once round with the angle: an arm that gravity turns.",
)
def arm_weight(xp: Namespace, joint: Joint, sine: Number, cosine: Number) -> Number:
    """Moment of the weight of an arm [N m]: a sin(q) + b cos(q)."""
    return sine * xp.sin(joint.position) + cosine * xp.cos(joint.position)


# The two below act on the effort alone, so their functions are those of the platform.
effect(
    registry=AXIS_CATALOGUE,
    acts_at=CLOCK,
    # Negative where it is the speed that is recorded late.
    parameters=[Parameter("delay", "s", lower=-0.2, upper=0.5, size=0.01)],
    source="Transport and logging delays",
    recognise="The residual follows the rate of the effort, by a time that is always the same.",
)(catalogue.torque_delay)

effect(
    registry=AXIS_CATALOGUE,
    acts_at=ACTUATOR,
    # A drive ten times faster than any log can show, but not so fast that nothing can follow it.
    parameters=[Parameter("time_constant", "s", lower=1e-4, upper=1.0, size=0.01)],
    source="First-order model of a drive's current loop",
    recognise="The residual follows the rate of the effort: the axis answers late.",
)(catalogue.actuator_lag)
