"""What physics knows of a mechanism: its axes, joints and parameters, and where effects act on it.

A kind of mechanism is a value of `MechanismKind`; the inverse dynamics and all that is derived from
it are the same for every one. A twist is the velocity of its
A axes, a torque the effort of its J joints, a force the generalised force of its axes. All
functions compute with whatever numbers the namespace ``xp`` takes: floats, arrays of one shape,
symbols, tensors.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from youbot_env.errors import InputError
from youbot_env.physics.effect import Effect, Parameter, Place, Registry

Number = Any
"""A float, array, symbol or tensor."""

Components = tuple[Number, ...]
"""Components of a twist, an acceleration, a force, or the torques of joints."""

Geometry = Any
"""Known lengths: any object that has the names in `MechanismKind.lengths`; symbols for codes."""


@dataclass(frozen=True)
class Instant:
    """What a motion is at one instant (or at many: components may be arrays of one shape).

    twist, acceleration : (A) of the axes; the acceleration is the derivative of the components
    pose : (D) what else the position of the mechanism is told by
    wheel_angle : (J) of the joints, where a mechanism keeps them apart from its pose
    torque : (J) that truly act; only effects that depend on the load read them
    torque_rate : (J) matters to actuators alone
    time : [s]

    What is left out is zero, in as many components as a platform has.
    """

    twist: Components
    acceleration: Components = (0.0,) * 3
    pose: Components = (0.0,) * 3
    wheel_angle: Components = (0.0,) * 4
    torque: Components = (0.0,) * 4
    torque_rate: Components = (0.0,) * 4
    time: Number = 0.0


@dataclass(frozen=True)
class Site:
    """Where effects act on a mechanism.

    points(at) : the points there, one for each time that an effect acts
    force(at, efforts) : generalised force (A) of an effort at each point
    """

    points: Callable[[EffectPoints], Sequence[Any]]
    force: Callable[[EffectPoints, Sequence[Any]], Components]


class EffectPoints:
    """The points at which effects act in a motion, made once for all components.

    ``carriers``: loads with their places in theta, which the base parameters are to hold too.
    """

    def __init__(
        self,
        xp: Any,
        mechanism: MechanismKind,
        geometry: Geometry,
        theta: Any,
        at: Instant,
        carriers: Sequence[tuple[Effect, slice]] = (),
    ) -> None:
        self.xp, self.mechanism, self.geometry = xp, mechanism, geometry
        self.theta, self.at, self.carriers = theta, at, carriers
        self._made: dict[Place, Sequence[Any]] = {}

    @cached_property
    def base(self) -> Any:
        """The base parameters with what the mechanism carries, for effects that refer to them."""
        return self.mechanism.base_of(self)

    def of(self, place: Place) -> Sequence[Any]:
        """The points of a place.

        Raises
        ------
        InputError
            If the mechanism has no such place.
        """
        if place not in self._made:
            self._made[place] = self.mechanism.site(place).points(self)
        return self._made[place]


def component_force(item: Effect, values: Any, points: EffectPoints) -> Components:
    """One component's share of the generalised force (A): its own formula, moved to the axes."""
    efforts = [
        item.evaluate(points.xp, point, values, i)
        for i, point in enumerate(points.of(item.acts_at))
    ]
    return points.mechanism.site(item.acts_at).force(points, efforts)


def _as_it_is(item: Effect, geometry: Geometry) -> Effect:
    return item


def _any_effect(item: Effect, geometry: Geometry) -> bool:
    return True


def _no_fault(geometry: Geometry, values: Mapping[str, float]) -> str:
    return ""


@dataclass(frozen=True, eq=False)
class MechanismKind:
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
    internal : (J) torques that exert no force, which a motion leaves open; () if there are none
    stated : names of the base parameters as people state them, in the order of files and tables;
        () for that of the base model's components
    declared(effect, geometry) : the effect with units, bounds and sizes of the mechanism at hand
    holds(effect, geometry) : whether the mechanism at hand can have the effect
    fault(geometry, values) : why base parameters, as stated, cannot be; "" if they can
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
    sites: Mapping[Place, Site] = field(repr=False)
    base_of: Callable[[EffectPoints], Any] = field(repr=False)
    joint_rates: Callable[[Geometry, Components], Components] = field(repr=False)
    force_of: Callable[[Geometry, Sequence[Number]], Components] = field(repr=False)
    torque_of: Callable[[Geometry, Components], Components] = field(repr=False)
    pose_rates: Callable[[Any, Components, Components], Components] = field(repr=False)
    full_speed: Callable[[Geometry], tuple[float, ...]] = field(repr=False)
    full_torque: Callable[[Geometry], float] = field(repr=False)
    internal: tuple[float, ...] = ()
    stated: tuple[str, ...] = ()
    declared: Callable[[Effect, Geometry], Effect] = field(default=_as_it_is, repr=False)
    holds: Callable[[Effect, Geometry], bool] = field(default=_any_effect, repr=False)
    fault: Callable[[Geometry, Mapping[str, float]], str] = field(default=_no_fault, repr=False)

    @property
    def state(self) -> tuple[str, ...]:
        """Names of the state's components, before those of drives: velocity, pose, angles, time."""
        return (*self.velocity_state, *self.pose_state, *self.angle_state, "time")

    @property
    def module(self) -> str:
        """Name of the module that states its formulas."""
        return self.home.partition(":")[0]

    def site(self, place: Place) -> Site:
        """Where effects of a place act.

        Raises
        ------
        InputError
            If it has no such place.
        """
        if place not in self.sites:
            raise InputError(f"mechanism {self.name} has no place {place.name!r} for an effect")
        return self.sites[place]

    def split(self, state: Sequence[Number]) -> tuple[Components, Components, Components, Number]:
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

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return _found, (self.home,)


def _found(home: str) -> MechanismKind:
    module, _, name = home.partition(":")
    return getattr(importlib.import_module(module), name)
