"""Mechanisms: their axes, joints and parameters, and the places where effects act on them.

A kind of mechanism is a value of `MechanismKind`; `ModelStructure` says which effects a model of it
holds beside the base. The inverse dynamics and all that is derived from it are the same for every
one. A twist is the velocity of its A axes, a torque the effort of its J joints, a force the
generalised force of its axes. All functions compute with whatever numbers the namespace ``xp``
takes: floats, arrays of one shape, symbols, tensors; what they return is of the kind ``N`` that the
motion is of.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar, cast

from youbot_env.errors import InputError
from youbot_env.physics.effect import (
    ACTUATOR,
    CHANNEL,
    CLOCK,
    CONTACT,
    SPEED,
    Actuator,
    BaseParameters,
    Channel,
    Contact,
    Effect,
    Parameter,
    Place,
    Registry,
)
from youbot_env.physics.namespaces import N, Namespace, Number, Values, floats

Components = tuple[N, ...]
"""Components of a twist, an acceleration, a force, or the torques of joints."""

Geometry = TypeVar("Geometry")
"""Known lengths: any object that has the names in `MechanismKind.lengths`; symbols for codes."""

Lengths = TypeVar("Lengths", contravariant=True)
Found = TypeVar("Found")
N_co = TypeVar("N_co", bound=Number, covariant=True)


@dataclass(frozen=True)
class Instant(Generic[N_co]):
    """What a motion is at one instant (or at many: components may be arrays of one shape).

    twist, acceleration : (A) of the axes; the acceleration is the derivative of the components
    pose : (D) coordinates of the mechanism's position
    wheel_angle : (J) of the joints, where a mechanism has them beside its pose
    torque : (J) that truly act; only effects that depend on the load read them
    torque_rate : (J) only actuators read them
    time : [s] from the log's start
    start : [s] of the log, on the clock that the logs share; 0 where there is none
    torque_second_rate : (J) only actuators of second order read it

    What is left out is zero, in as many components as a platform has.
    """

    twist: Components[N_co]
    acceleration: Components[N_co | float] = (0.0,) * 3
    pose: Components[N_co | float] = (0.0,) * 3
    wheel_angle: Components[N_co | float] = (0.0,) * 4
    torque: Components[N_co | float] = (0.0,) * 4
    torque_rate: Components[N_co | float] = (0.0,) * 4
    time: N_co | float = 0.0
    start: N_co | float = 0.0
    torque_second_rate: Components[N_co | float] = (0.0,) * 4


@dataclass(frozen=True)
class Site(Generic[Geometry]):
    """Where effects act on a mechanism.

    points(at) : the points there, one for each time that an effect acts
    force(at, efforts) : generalised force (A) of what an effect returns at these points, one number
        after the other
    """

    points: Callable[[EffectPoints[Geometry, Number]], Sequence[object]]
    force: Callable[[EffectPoints[Geometry, Number], Sequence[Number]], Components[Number]]


class LinearMap(Protocol[Lengths]):
    """A linear map of components that depends on the lengths alone: of rates, or of forces."""

    def __call__(self, geometry: Lengths, values: Sequence[N], /) -> Components[N]: ...


class EffectPoints(Generic[Geometry, N_co]):
    """The points at which effects act in a motion, made once for all components.

    ``carriers``: loads with their places in theta, which the base parameters are to hold too.
    """

    def __init__(
        self,
        xp: Namespace,
        mechanism: MechanismKind[Geometry],
        geometry: Geometry,
        theta: Values[Number],
        at: Instant[N_co],
        carriers: Sequence[tuple[Effect, slice]] = (),
    ) -> None:
        self.xp, self.mechanism, self.geometry = xp, mechanism, geometry
        self.theta, self.at, self.carriers = theta, at, carriers
        self._made: dict[Place, Sequence[object]] = {}
        self._of_motion: dict[object, object] = {}

    def at_theta(self, theta: Values[Number]) -> EffectPoints[Geometry, N_co]:
        """The points of the same motion at other parameters."""
        args = self.xp, self.mechanism, self.geometry, theta, self.at, self.carriers
        return EffectPoints(*args).sharing(self)

    def sharing(self, other: EffectPoints[Geometry, N_co]) -> EffectPoints[Geometry, N_co]:
        """Itself, with what others of the same motion and geometry have worked out of these."""
        self._of_motion = other._of_motion
        return self

    def once(self, of_motion: Callable[[EffectPoints[Geometry, N_co]], Found]) -> Found:
        """What a function makes of the motion and the geometry alone; computed once."""
        if of_motion not in self._of_motion:
            self._of_motion[of_motion] = of_motion(self)
        return cast("Found", self._of_motion[of_motion])

    @cached_property
    def base(self) -> BaseParameters:
        """The base parameters with what the mechanism carries, for effects that refer to them."""
        return cast(BaseParameters, self.mechanism.base_of(self))

    def of(self, place: Place) -> Sequence[object]:
        """The points of a place.

        Raises
        ------
        InputError
            If the mechanism has no such place.
        """
        # Several effects act at one place; its points are computed once.
        if place not in self._made:
            self._made[place] = self.mechanism.site(place).points(self)
        return self._made[place]


def component_force(
    item: Effect,
    values: Values[Number],
    points: EffectPoints[Geometry, N],
    joint: int | None = None,
) -> Components[N]:
    """Generalised force (A) of one component: its formula at each point, mapped to the axes.

    ``joint``: the only one at which it acts; None for all.
    """
    efforts: list[Number] = []
    for i, point in enumerate(points.of(item.acts_at)):
        if joint is not None and i != joint:
            efforts.append(cast(Number, 0.0))
            continue
        effort = item.evaluate(points.xp, point, values, i)
        efforts += effort if isinstance(effort, tuple) else (effort,)
    force = points.mechanism.site(item.acts_at).force(points, efforts)
    # A formula may take any number; of the motion's kind it makes numbers of that kind.
    return cast("Components[N]", force)


def _as_it_is(item: Effect, geometry: object) -> Effect:
    return item


def _any_effect(item: Effect, geometry: object) -> bool:
    return True


def _nothing(geometry: object) -> tuple[()]:
    return ()


def _no_fault(geometry: object, values: Mapping[str, float]) -> str:
    return ""


@dataclass(frozen=True, eq=False)
class MechanismKind(Generic[Geometry]):
    """One kind of mechanism. It is compared by identity, and pickled as the name of its home.

    Attributes
    ----------
    name : in model files and on the command line
    home : where the value is found, as ``package.module:NAME``
    axes : names of the A axes; joints : of the J joints, in the order of torques
    base, catalogue : the components of its base model, and the effects that can be added
    velocity_state, pose_state, angle_state, drive_state : names of the state's components, of
        which ``angle_state`` may be empty; those of drives are there with an actuator effect alone
    lengths : names of the geometry that its formulas read
    geometry : an example of it, to try effects with
    sites : where effects may act that demand a force
    base_of(points) : the base parameters by name, as effects read them
    joint_rates(geometry, twist) : (J) rates of the joints
    force_of(geometry, torque) : generalised force (A) of joint torques; transpose of the rates
    torque_of(geometry, force) : the least-norm torques (J) that exert a generalised force
    pose_rates(xp, pose, twist) : (D) derivative of the pose
    full_speed(geometry), full_torque(geometry) : a twist (A) and a torque that are about the
        greatest, to judge how finely it must be simulated
    internal(geometry) : (J) torques that exert no force, which a motion leaves open; () if there
        are none
    stated : names of the base parameters as people state them, in the order of files and tables;
        () for that of the base model's components
    declared(effect, geometry) : the effect with units, bounds and sizes of the mechanism at hand
    holds(effect, geometry) : whether the mechanism at hand can have the effect
    fault(geometry, values) : why base parameters, as stated, cannot be; "" if they can
    uneven(geometry, factors) : the geometry whose joints roll as J triples of factors say (see
        `effect.Contact`), which ``joint_rates`` and the other maps take as well; None where no
        effect of the catalogue acts there
    contacts(geometry) : (J) what these effects see of the joints
    twist_of(geometry, rates) : the twist whose joint rates come nearest to given ones
    """

    name: str
    home: str
    axes: tuple[str, ...]
    joints: tuple[str, ...]
    base: Registry
    catalogue: Registry
    velocity_state: tuple[str, ...]
    pose_state: tuple[str, ...]
    angle_state: tuple[str, ...]
    drive_state: tuple[str, ...]
    lengths: tuple[str, ...]
    geometry: Geometry
    sites: Mapping[Place, Site[Geometry]] = field(repr=False)
    base_of: Callable[[EffectPoints[Geometry, Number]], object] = field(repr=False)
    joint_rates: LinearMap[Geometry] = field(repr=False)
    force_of: LinearMap[Geometry] = field(repr=False)
    torque_of: LinearMap[Geometry] = field(repr=False)
    pose_rates: Callable[[Namespace, Sequence[Number], Sequence[Number]], Components[Number]] = (
        field(repr=False)
    )
    full_speed: Callable[[Geometry], tuple[float, ...]] = field(repr=False)
    full_torque: Callable[[Geometry], float] = field(repr=False)
    internal: Callable[[Geometry], tuple[float, ...]] = field(default=_nothing, repr=False)
    stated: tuple[str, ...] = ()
    declared: Callable[[Effect, Geometry], Effect] = field(default=_as_it_is, repr=False)
    holds: Callable[[Effect, Geometry], bool] = field(default=_any_effect, repr=False)
    fault: Callable[[Geometry, Mapping[str, float]], str] = field(default=_no_fault, repr=False)
    uneven: Callable[[Geometry, Sequence[Sequence[Number]]], Geometry] | None = field(
        default=None, repr=False
    )
    contacts: Callable[[Geometry], Sequence[Contact]] = field(default=_nothing, repr=False)
    twist_of: LinearMap[Geometry] | None = field(default=None, repr=False)

    @property
    def state(self) -> tuple[str, ...]:
        """Names of the state's components, before those of drives: velocity, pose, angles, time."""
        return (*self.velocity_state, *self.pose_state, *self.angle_state, "time")

    @property
    def module(self) -> str:
        """Name of the module that states its formulas."""
        return self.home.partition(":")[0]

    def site(self, place: Place) -> Site[Geometry]:
        """Where effects of a place act.

        Raises
        ------
        InputError
            If it has no such place.
        """
        if place not in self.sites:
            raise InputError(f"mechanism {self.name} has no place {place.name!r} for an effect")
        return self.sites[place]

    def split(self, state: Values[N]) -> tuple[Components[N], Components[N], Components[N], N]:
        """Twist, pose, joint angles and time of a state."""
        sizes = (len(self.velocity_state), len(self.pose_state), len(self.angle_state))
        a, b, c = sizes[0], sizes[0] + sizes[1], sum(sizes)
        return tuple(state[:a]), tuple(state[a:b]), tuple(state[b:c]), state[c]

    def base_parameters(self, geometry: Geometry) -> dict[str, Parameter]:
        """Declarations of the base parameters as people state them, by name."""
        items = [self.declared(item, geometry) for item in self.base]
        found = {name: item.public_parameter(name) for item in items for name in item.public_names}
        return {name: found[name] for name in self.stated or found}

    def effect(self, name: str, geometry: Geometry) -> Effect:
        """An effect of the catalogue, as the mechanism at hand declares it."""
        return self.declared(self.catalogue[name], geometry)

    def __reduce__(self) -> tuple[Callable[[str], object], tuple[str]]:
        # It holds lambdas, which cannot be pickled, and it is compared by identity.
        return _found, (self.home,)


def _found(home: str) -> object:
    module, _, name = home.partition(":")
    return getattr(importlib.import_module(module), name)


# What an effect reads, and whether it is linear, is found by evaluating it; no effect declares it.
# With numbers, not symbols: 0.4 ms for a structure; sympy takes 70 ms, and a second to load.


@dataclass(frozen=True)
class ModelStructure(Generic[Geometry]):
    """Which effects a model of a mechanism holds beside the base: fixes the order of theta.

    Raises
    ------
    InputError
        If an effect is unknown or named twice, or two of them are actuators.
    """

    effects: tuple[str, ...]
    mechanism: MechanismKind[Geometry]

    def __post_init__(self) -> None:
        if len(set(self.effects)) < len(self.effects):
            raise InputError(f"an effect is named twice: {', '.join(self.effects)}")
        if sum(item.acts_at is ACTUATOR for item in self.components) > 1:
            raise InputError("a model holds one actuator effect at most")

    def __getstate__(self) -> dict[str, object]:
        # Without the cached properties: effects may hold lambdas, which cannot be pickled. They are
        # found again by name.
        return {"effects": self.effects, "mechanism": self.mechanism}

    def with_effects(self, effects: Sequence[str]) -> ModelStructure[Geometry]:
        """The structure of the same mechanism with other effects."""
        return ModelStructure(tuple(effects), self.mechanism)

    @cached_property
    def components(self) -> tuple[Effect, ...]:
        """Base components, then the effects by name."""
        catalogue = self.mechanism.catalogue
        return (*self.mechanism.base, *(catalogue[name] for name in self.effects))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of ``theta``: the base parameters, then ``effect.parameter``."""
        base = self.mechanism.base
        names = [name for item in base for name in item.parameter_names]
        for item in self.components[len(base) :]:
            names += [f"{item.name}.{name}" for name in item.parameter_names]
        return tuple(names)

    @cached_property
    def base_names(self) -> tuple[str, ...]:
        """Parameters of the base model, in the order of theta, which begins with them."""
        return tuple(name for item in self.mechanism.base for name in item.parameter_names)

    @cached_property
    def slices(self) -> tuple[tuple[Effect, slice], ...]:
        """Each component with its place in ``theta``."""
        found: list[tuple[Effect, slice]] = []
        start = 0
        for item in self.components:
            found.append((item, slice(start, start + len(item.parameter_names))))
            start = found[-1][1].stop
        return tuple(found)

    @cached_property
    def wrenches(self) -> tuple[tuple[Effect, slice], ...]:
        """The components that demand a force."""
        return tuple(row for row in self.slices if row[0].acts_at.kind == "wrench")

    def at(self, place: Place) -> list[tuple[Effect, slice]]:
        """The components that act at a place."""
        return [(item, where) for item, where in self.slices if item.acts_at is place]

    @cached_property
    def has_actuator(self) -> bool:
        """Whether what acts (the drives' torques, a force) is a state of its own."""
        return bool(self.at(ACTUATOR))

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Components of the state of a mechanism with these effects."""
        return (
            *self.mechanism.state,
            *self.drive_states,
            *(("start",) if self.reads_start else ()),
        )

    @cached_property
    def drive_order(self) -> int:
        """How many derivatives of the torque the drives' command depends on: 0 without drives."""
        orders = [0]
        for item, where in self.at(ACTUATOR):
            points = (Actuator(0.6, 0.5, 0.7, second) for second in (0.0, 30.0))
            values = [0.5] * (where.stop - where.start)
            first, second = (item.evaluate(floats, point, values) for point in points)
            orders.append(1 if first == second else 2)
        return max(orders)

    @cached_property
    def drive_states(self) -> tuple[str, ...]:
        """States of the drives: what acts and, in drives of second order, its rate."""
        names = self.mechanism.drive_state
        rates = tuple(f"{name}_rate" for name in names)
        return (names + rates)[: self.drive_order * len(names)]

    def can_hold(self, name: str) -> bool:
        """Whether an effect fits beside those that it holds: there is one kind of drive."""
        item = self.mechanism.catalogue[name]
        return not (self.has_actuator and item.acts_at is ACTUATOR)

    @cached_property
    def carriers(self) -> tuple[tuple[Effect, slice], ...]:
        """The loads: components that add to the base parameters which other effects read."""
        return tuple(row for row in self.slices if row[0].carries is not None)

    @cached_property
    def changes_kinematics(self) -> bool:
        """Whether joints roll, or their speeds are logged, otherwise than the geometry says."""
        return bool(self.at(CONTACT) or self.at(SPEED))

    @cached_property
    def filters_speed(self) -> bool:
        """Whether the logged speeds follow the true ones late, so that they are a state."""
        return bool(self._telling_speeds_apart((0.0, 0.5), (1.0, 0.5)))

    @cached_property
    def creeps(self) -> tuple[str, ...]:
        """Effects that make a joint's speed another by the torque that acts."""
        return self._telling_speeds_apart((0.0, 0.5), (0.0, 0.9))

    def _telling_speeds_apart(
        self, first: tuple[float, float], second: tuple[float, float]
    ) -> tuple[str, ...]:
        """Effects at speed channels that differ between two pairs of the speed's rate and the
        torque."""
        return tuple(
            item.name
            for item, _ in self.at(SPEED)
            for values in [[0.5] * len(item.parameter_names)]
            if item.evaluate(floats, SPEED.point(0.3, *first, 0.7), values)
            != item.evaluate(floats, SPEED.point(0.3, *second, 0.7), values)
        )

    @cached_property
    def only_wrenches(self) -> bool:
        """Whether the interface torque acts unchanged, at most later: no drive, no channel; and
        joints roll as the geometry says."""
        return all(item.acts_at.kind in ("wrench", "shift") for item, _ in self.slices)

    @cached_property
    def has_nonlinear_channel(self) -> bool:
        """Whether a channel is not affine in the torque, and so has an inverse of its own."""
        return any(item.inverse is not None for item, _ in self.at(CHANNEL))

    # What effects read: found by evaluating them ------------------------------------------------

    @cached_property
    def load_readers(self) -> tuple[tuple[Effect, slice], ...]:
        """Effects that read the torque that acts."""
        light, heavy = self._two_sets()
        return self._telling_apart(
            replace(self._somewhere, torque=light), replace(self._somewhere, torque=heavy)
        )

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether an effect reads the torque that acts."""
        return bool(self.load_readers)

    @cached_property
    def smooth_components(self) -> frozenset[str]:
        """Names of the components whose force does not jump at a sample of a log.

        An acceleration does, which is a difference of samples, and so does what it demands.
        """
        points = self._tried_at(self._somewhere, [1.0] * len(self.base_names))
        return frozenset(
            item.name
            for item, where in self.wrenches
            if _fields_read(item, where, points.of(item.acts_at)[0]) <= SMOOTH_FIELDS
        )

    @cached_property
    def depends_on_angle(self) -> bool:
        """Whether an effect reads the angle of a joint."""
        here, there = self._two_sets()
        found = self._telling_apart(
            replace(self._somewhere, wheel_angle=here), replace(self._somewhere, wheel_angle=there)
        )
        return bool(found)

    @cached_property
    def reads_start(self) -> bool:
        """Whether an effect reads when the log began, on the clock that the logs share."""
        # No whole number of the periods that are tried: what swings would look the same.
        later = 31.7
        here, there = (Channel(0.6, 0.5, 0.7, start) for start in (0.0, later))
        of_channels = any(
            item.evaluate(floats, here, values) != item.evaluate(floats, there, values)
            for item, where in self.at(CHANNEL)
            for values in [[0.5] * (where.stop - where.start)]
        )
        early = replace(self._somewhere, start=0.0)
        return of_channels or bool(self._telling_apart(early, replace(early, start=later)))

    def _two_sets(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Two sets of torques, or of angles. Not proportional: an effect may read a ratio."""
        joints = range(len(self.mechanism.joints))
        return tuple(0.3 + 0.1 * k for k in joints), tuple(1.9 - 0.17 * k for k in joints)

    @cached_property
    def base_readers(self) -> frozenset[str]:
        """Names of the components that refer to base parameters."""
        # The two sets are not proportional: a ratio such as the centre of mass m_aX/m0 would be the
        # same in proportional ones, and the effect would seem not to read it.
        first, second = (
            self._tried_at(self._somewhere, [scale**k for k in range(1, len(self.base_names) + 1)])
            for scale in (1.3, 1.9)
        )
        return frozenset(
            item.name
            for item, where in self.wrenches
            if _tried(item, where, first) != _tried(item, where, second)
        )

    @cached_property
    def is_linear(self) -> bool:
        """Whether the interface force is linear in the base parameters, whatever the others are."""
        return self.only_wrenches and not self.base_readers and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the interface force is not linear, even if
        all else is given: shifts, what changes kinematics, channels with an inverse of their
        own, and wrenches that are found so by trying."""
        return frozenset(
            item.name
            for item, _ in self.slices
            if item.acts_at in (CLOCK, CONTACT, SPEED)
            or item.inverse is not None
            or (item.acts_at.kind == "wrench" and not self._is_linear(item))
        )

    @cached_property
    def _somewhere(self) -> Instant[float]:
        """A motion without a zero in it, at which effects are evaluated to see what they read."""
        mechanism = self.mechanism

        def some(start: float, names: Sequence[str]) -> tuple[float, ...]:
            return tuple(start + 0.1 * k for k in range(len(names)))

        return Instant(
            some(0.3, mechanism.axes),
            some(0.6, mechanism.axes),
            some(0.1, mechanism.pose_state),
            some(0.5, mechanism.joints),
            some(0.6, mechanism.joints),
        )

    def _tried_at(self, at: Instant[float], base: Sequence[float]) -> EffectPoints[Geometry, float]:
        return EffectPoints(floats, self.mechanism, self.mechanism.geometry, base, at)

    def _telling_apart(
        self, first: Instant[float], second: Instant[float]
    ) -> tuple[tuple[Effect, slice], ...]:
        ones = [1.0] * len(self.base_names)
        here, there = self._tried_at(first, ones), self._tried_at(second, ones)
        return tuple(
            (item, where)
            for item, where in self.wrenches
            if _tried(item, where, here) != _tried(item, where, there)
        )

    def _is_linear(self, item: Effect) -> bool:
        """Whether an effect's force is linear in its own parameters, shape constants apart."""
        declared = [item.parameter(name) for name in item.parameter_names]
        shape = [parameter.default or 0.0 for parameter in declared]
        size = [0.0 if parameter.is_shape else parameter.size for parameter in declared]
        ones = [1.0] * len(self.base_names)
        # Early and late: some effects begin at a time, others fade out.
        points = [
            self._tried_at(replace(self._somewhere, time=time), ones) for time in (0.7, 1000.0)
        ]

        def force(*parts: float) -> list[float]:
            # Neighbouring parameters change by different factors: a ratio of two would not change
            # if both changed alike.
            share = [parts[k % len(parts)] for k in range(len(declared))]
            values = [c + s * part for c, s, part in zip(shape, size, share, strict=True)]
            return [f for point in points for f in component_force(item, values, point)]

        # Linear means f(a) + 2 f(b) = f(a + 2 b); here 0.5 + 2 * 0.4 = 1.3 and so on.
        rows = zip(force(0.5, 0.7, 0.3), force(0.4, 0.2, 0.8), force(1.3, 1.1, 1.9), strict=True)
        return all(abs(a + 2 * b - both) <= 1e-9 * (abs(a) + abs(b)) for a, b, both in rows)


SMOOTH_FIELDS = frozenset(
    [*("twist", "rate", "angle", "wheel_angle", "time", "start", "base", "contact")]
    + [*("x", "y", "yaw", "velocity_x", "velocity_y", "yaw_rate", "com_x", "com_y")]
)
"""Fields of points that are functions of the speeds and of what is integrated of them."""


class _Watched:
    """A point that notes which of its fields are read: all of them, where it is unpacked."""

    def __init__(self, point: object) -> None:
        self._point, self.read = point, set[str]()

    def __getattr__(self, name: str) -> object:
        self.read.add(name)
        return getattr(self._point, name)

    def __iter__(self) -> Iterator[object]:
        self.read.add("all")
        return iter(cast("Iterable[object]", self._point))

    def __getitem__(self, index: int) -> object:
        return list(self)[index]


def _fields_read(item: Effect, where: slice, point: object) -> set[str]:
    """Fields of a point that an effect reads, whether they make a difference there or not."""
    watched = _Watched(point)
    try:
        item.evaluate(floats, watched, [0.5] * (where.stop - where.start))
    except (ArithmeticError, ValueError):
        watched.read.add("all")  # what it would have read is not known
    return watched.read


def _tried(item: Effect, where: slice, points: EffectPoints[Geometry, float]) -> Components[float]:
    try:
        return component_force(item, [0.5] * (where.stop - where.start), points)
    except InputError:
        raise
    except (ArithmeticError, ValueError) as error:
        raise InputError(
            f"effect {item.name}: fails at some motions ({error}); keep roots, logarithms and "
            "divisions from what is zero or below, by xp.maximum(..., 1e-6), say"
        ) from None
