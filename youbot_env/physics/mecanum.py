"""The mecanum platform as a mechanism: where effects act on it and what they see of a motion.

Frames: twist, acceleration and generalised force belong to the body frame at O; the acceleration is
the time derivative (VX', VY', W') of the twist's components. Pose is (x, y, yaw) in the world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import youbot_env.physics.catalogue  # noqa: F401  # pyright: ignore - fills the registries
import youbot_env.physics.kinematic_effects  # noqa: F401  # pyright: ignore - fills them too
from youbot_env.physics.effect import (
    BASE,
    BODY,
    CATALOGUE,
    ROLLER,
    WHEEL,
    WORLD,
    Body,
    Contact,
    Roller,
    Wheel,
    World,
)
from youbot_env.physics.geometry import (
    SIGN_LATERAL,
    SIGN_X,
    SIGN_Y,
    SLANTS,
    TANGENTS,
    Geometry,
    Lengths,
    allocate,
    body_force,
    nearest_twist,
    roller_force,
    roller_rates,
    uneven_contacts,
    wheel_rates,
)
from youbot_env.physics.hardware import MAX_BODY_SPEED, WHEELS
from youbot_env.physics.mechanism import (
    Components,
    EffectPoints,
    Geometry as Known,
    MechanismKind,
    ModelStructure,
    Site,
)
from youbot_env.physics.namespaces import Namespace, Number, Triple
from youbot_env.physics.residual_maps import PREFIX, residual_map_effect

STATE = (
    *("velocity_x", "velocity_y", "yaw_rate"),
    *("x", "y", "yaw"),
    *("angle_fl", "angle_fr", "angle_bl", "angle_br"),
    "time",
)
"""Components of a platform's state, before those of its drives."""

DRIVE_STATE = ("torque_fl", "torque_fr", "torque_bl", "torque_br")
"""The state that an actuator effect adds: the torques that act."""

FULL_SPEED = (MAX_BODY_SPEED, 0.25 * MAX_BODY_SPEED, 0.5)
"""Twist [m/s, m/s, rad/s] at which one wheel turns at its greatest speed."""


class Base(NamedTuple):
    """The base parameters in their linear form: m_aX = m aX and m_aY = m aY [kg m]."""

    m0: Number
    I0: Number
    m_aX: Number
    m_aY: Number
    I1: Number
    mu1: Number
    mu2: Number


def base_of(points: EffectPoints[Geometry, Number]) -> Base:
    """The base parameters with what the platform carries, for effects that refer to them."""
    # theta begins with the base parameters, in the order in which they are registered.
    m0, inertia, m_ax, m_ay, wheel_inertia, mu1, mu2 = points.theta[:7]
    for item, where in points.carriers:
        assert item.carries is not None
        more = item.carries(points.xp, points.at.time, *points.theta[where])
        m0, inertia = m0 + more[0], inertia + more[1]
        m_ax, m_ay = m_ax + more[2], m_ay + more[3]
    return Base(m0, inertia, m_ax, m_ay, wheel_inertia, mu1, mu2)


def body_points(points: EffectPoints[Known, Number]) -> list[Body]:
    """The platform in the body frame."""
    at = points.at
    return [Body(at.twist, at.acceleration, at.time, points.base, at.start)]


def _wheels(points: EffectPoints[Geometry, Number]) -> list[Wheel]:
    """The four wheel joints."""
    at, base = points.at, points.base
    rates, accelerations, total = points.once(_wheel_motion)
    rows = zip(rates, accelerations, at.wheel_angle, at.torque, strict=True)
    return [
        Wheel(*row, at.time, base, at.start, total, contact)
        for row, contact in zip(rows, points.once(_places), strict=True)
    ]


def _wheel_motion(
    points: EffectPoints[Geometry, Number],
) -> tuple[Components[Number], Components[Number], Number]:
    """Rates and accelerations of the four wheels, and their absolute torques, added up."""
    at, geometry = points.at, points.geometry
    first, *others = (points.xp.abs(torque) for torque in at.torque)
    rates = wheel_rates(geometry, at.twist)
    return rates, wheel_rates(geometry, at.acceleration), sum(others, start=first)


def _rollers(points: EffectPoints[Geometry, Number]) -> list[Roller]:
    """The four rollers on the floor."""
    at, base = points.at, points.base
    rows = zip(*points.once(_roller_motion), at.wheel_angle, strict=True)
    return [
        Roller(rate, change, at.time, base, at.start, angle, contact)
        for (rate, change, angle), contact in zip(rows, points.once(_places), strict=True)
    ]


def _roller_motion(
    points: EffectPoints[Geometry, Number],
) -> tuple[Components[Number], Components[Number]]:
    """Rates and accelerations of the four rollers on the floor."""
    at, geometry = points.at, points.geometry
    return roller_rates(geometry, at.twist), roller_rates(geometry, at.acceleration)


class _Contact:
    """Where a wheel touches the floor; worked out when it is asked for, since few effects ask."""

    def __init__(self, place: Callable[[], tuple[Number, Number]]) -> None:
        self._place = cache(place)

    @property
    def x(self) -> Number:
        return self._place()[0]

    @property
    def y(self) -> Number:
        return self._place()[1]

    def __getitem__(self, axis: int) -> Number:
        return self._place()[axis]


def _places(points: EffectPoints[Geometry, Number]) -> list[_Contact]:
    """Where the four wheels touch the floor."""
    xp, geometry, (x, y, yaw) = points.xp, points.geometry, points.at.pose

    # Not `turn` of the points: they keep what is returned here, which must not hold them in turn.
    @cache
    def turned() -> tuple[Number, Number]:
        return xp.cos(yaw), xp.sin(yaw)

    def place(wheel: int) -> tuple[Number, Number]:
        (c, s), ahead, left = turned(), SIGN_X[wheel] * geometry.h, SIGN_Y[wheel] * geometry.l
        return x + c * ahead - s * left, y + s * ahead + c * left

    return [_Contact(partial(place, wheel)) for wheel in range(4)]


def turn(points: EffectPoints[Known, Number]) -> tuple[Number, Number]:
    """Cosine and sine of the heading, of a mechanism whose pose is (x, y, yaw)."""
    yaw = points.at.pose[2]
    return points.xp.cos(yaw), points.xp.sin(yaw)


def into_body(points: EffectPoints[Known, Number], force: Sequence[Number]) -> Triple:
    """A force along the world's axes, with its moment, in the body frame."""
    fx, fy, mz = force
    # The inverse rotation, from world to body. The moment is about O in both frames.
    c, s = points.once(turn)
    return c * fx + s * fy, c * fy - s * fx, mz


def _world(points: EffectPoints[Geometry, Number]) -> list[World]:
    """The platform in the world frame."""
    at, base, (c, s) = points.at, points.base, points.once(turn)
    # Of the whole platform: the wheels lie symmetrically about O, so they add mass and no moment.
    com_x, com_y = base.m_aX / base.m0, base.m_aY / base.m0
    centre = c * com_x - s * com_y, s * com_x + c * com_y
    x, y, yaw = at.pose
    velocity = points.once(_world_velocity)
    return [World(x, y, yaw, *velocity, *centre, at.time, base, at.start, at.twist[2])]


def _world_velocity(points: EffectPoints[Geometry, Number]) -> tuple[Number, Number]:
    """Of O, along the world's axes."""
    (vx, vy, _), (c, s) = points.at.twist, points.once(turn)
    return c * vx - s * vy, s * vx + c * vy


def planar_rates(xp: Namespace, pose: Sequence[Number], twist: Sequence[Number]) -> Triple:
    """Rates (x', y', yaw') in the world of a platform with a body twist."""
    vx, vy, wz = twist
    c, s = xp.cos(pose[2]), xp.sin(pose[2])
    return c * vx - s * vy, s * vx + c * vy, wz


def _as_they_are(points: object, efforts: Sequence[Number]) -> Components[Number]:
    return tuple(efforts)


def _uneven(geometry: Lengths, factors: Sequence[Sequence[Number]]) -> Lengths:
    """The platform whose wheels roll as four triples say: ahead, sideways, and their rollers."""
    return uneven_contacts(geometry, *zip(*factors, strict=True))  # type: ignore[return-value]


def _contacts(geometry: Lengths) -> list[Contact]:
    """The four wheels on the floor, each to its own side: the tangent is positive in X."""
    signed = [getattr(geometry, name, SIGN_LATERAL[i]) for i, name in enumerate(TANGENTS)]
    return [Contact(SIGN_LATERAL[i] * tangent) for i, tangent in enumerate(signed)]


def _full_speed(geometry: Geometry) -> tuple[float, ...]:
    """The youBot's, or what turns the fastest wheel as fast as it can."""
    if geometry.speed_limit is None:
        return FULL_SPEED
    fastest = max(abs(rate) for rate in wheel_rates(geometry, FULL_SPEED))
    return tuple(geometry.speed_limit / fastest * part for part in FULL_SPEED)


def _fault(geometry: Geometry, values: Mapping[str, float]) -> str:
    for name in ("m0", "I0"):
        if values[name] <= 0:
            return f"{name} = {values[name]:g} must be positive"
    for name in ("I1", "mu1", "mu2"):
        if values[name] < 0:
            return f"{name} = {values[name]:g} must not be negative"
    # aX and aY are moments over this difference.
    wheels = 4 * geometry.m1
    if values["m0"] <= wheels:
        return f"m0 = {values['m0']:g} kg must exceed the mass of the four wheels, {wheels:g} kg"
    return ""


CATALOGUE.make[PREFIX] = residual_map_effect

MECANUM = MechanismKind(
    name="mecanum",
    home="youbot_env.physics.mecanum:MECANUM",
    axes=("VX", "VY", "W"),
    joints=WHEELS,
    base=BASE,
    catalogue=CATALOGUE,
    velocity_state=STATE[:3],
    pose_state=STATE[3:6],
    angle_state=STATE[6:10],
    drive_state=DRIVE_STATE,
    lengths=("l", "h", "R", "r"),
    geometry=Geometry(),
    sites={
        BODY: Site(body_points, _as_they_are),
        WHEEL: Site(_wheels, lambda points, torque: body_force(points.geometry, torque)),
        ROLLER: Site(_rollers, lambda points, torque: roller_force(points.geometry, torque)),
        WORLD: Site(_world, into_body),
    },
    base_of=base_of,
    joint_rates=wheel_rates,
    force_of=body_force,
    torque_of=allocate,
    pose_rates=planar_rates,
    full_speed=_full_speed,
    full_torque=lambda geometry: geometry.max_wheel_torque,
    internal=lambda geometry: geometry.internal,
    stated=("m0", "I0", "I1", "aX", "aY", "mu1", "mu2"),
    fault=_fault,
    uneven=_uneven,  # type: ignore[arg-type]  # formulas take any object with these lengths
    contacts=_contacts,
    twist_of=nearest_twist,
)
"""The mecanum platform with four wheels, whose rollers stand at 45 degrees in X."""

ANY_ROLLERS = replace(
    MECANUM,
    home="youbot_env.physics.mecanum:ANY_ROLLERS",
    lengths=(*MECANUM.lengths, *TANGENTS, *SLANTS),
    geometry=Geometry(arrangement="O"),
)
"""The same with rollers in O, or at other angles: codes read each roller's tangent and slant."""


def mecanum_kind(geometry: Geometry) -> MechanismKind[Geometry]:
    """The kind of mechanism that a geometry is of."""
    return MECANUM if geometry.is_plain else ANY_ROLLERS


def mecanum_structure(
    effects: Sequence[str] = (), geometry: Geometry = MECANUM.geometry
) -> ModelStructure[Geometry]:
    """The structure of a platform's model with these effects beside the base."""
    return ModelStructure(tuple(effects), mecanum_kind(geometry))
