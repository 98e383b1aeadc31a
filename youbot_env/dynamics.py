"""Inverse dynamics, the only statement of physics, and everything that is derived from it.

All functions take the namespace ``xp`` first (numpy, floats, symbols, tensors; see
:mod:`youbot_env.backends`) and work on components: a twist is a tuple of three numbers, arrays of
one shape, or symbols. Frames: twist, acceleration and generalised force belong to the body frame at
O; the acceleration is the time derivative (VX', VY', W') of the twist's components. Pose is
(x, y, yaw) in the world. Sources: the paper's model (README, Equations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import youbot_env.catalogue  # noqa: F401 - fills the registries
from youbot_env.backends import floats
from youbot_env.composition import Composition
from youbot_env.effects import (
    ACTUATOR,
    BASE,
    BODY,
    CATALOGUE,
    CHANNEL,
    CLOCK,
    WHEEL,
    WORLD,
    Actuator,
    Body,
    Channel,
    Clock,
    Effect,
    Roller,
    Wheel,
    World,
)
from youbot_env.errors import InputError
from youbot_env.geometry import COS_ROLLER, SIGN_LATERAL, SIGN_X, SIGN_Y, Geometry

STATE = (
    *("velocity_x", "velocity_y", "yaw_rate"),
    *("x", "y", "yaw"),
    *("angle_fl", "angle_fr", "angle_bl", "angle_br"),
    "time",
)
"""Components of a platform's state, before those of its drives."""

DRIVE_STATE = ("torque_fl", "torque_fr", "torque_bl", "torque_br")
"""The state that an actuator effect adds: the torques that act."""

Triple = tuple[Any, Any, Any]


class Base(NamedTuple):
    """The base parameters in their linear form: m_aX = m aX and m_aY = m aY [kg m]."""

    m0: Any
    I0: Any
    m_aX: Any
    m_aY: Any
    I1: Any
    mu1: Any
    mu2: Any


@dataclass(frozen=True)
class Instant:
    """What a motion is at one instant (or at many: components may be arrays of one shape).

    ``torque`` holds the four torques that truly act [N m]; only effects that depend on the load
    read them. ``torque_rate`` [N m/s] matters to actuators alone.
    """

    twist: Triple
    acceleration: Triple = (0.0, 0.0, 0.0)
    pose: Triple = (0.0, 0.0, 0.0)
    wheel_angle: tuple[Any, ...] = (0.0, 0.0, 0.0, 0.0)
    torque: tuple[Any, ...] = (0.0, 0.0, 0.0, 0.0)
    torque_rate: tuple[Any, ...] = (0.0, 0.0, 0.0, 0.0)
    time: Any = 0.0


@dataclass(frozen=True)
class Structure(Composition):
    """Which effects a model of a platform holds beside the paper's base model."""

    base = BASE
    catalogue = CATALOGUE
    motion_state = STATE
    drive_state = DRIVE_STATE

    @cached_property
    def load_readers(self) -> tuple[tuple[Effect, slice], ...]:
        """Wheel effects that read the torque: probed, so that no effect has to declare it."""
        light, heavy = (Wheel(0.7, 0.7, 0.7, t, 0.7, Base(*[1.0] * 7)) for t in (0.3, 1.9))
        return self._telling_apart(light, heavy)

    @cached_property
    def depends_on_load(self) -> bool:
        """Whether a wheel effect reads the torque."""
        return bool(self.load_readers)

    @cached_property
    def depends_on_angle(self) -> bool:
        """Whether a wheel effect reads the wheel's angle: probed."""
        here, there = (Wheel(0.7, 0.7, a, 0.7, 0.7, Base(*[1.0] * 7)) for a in (0.3, 1.9))
        return bool(self._telling_apart(here, there))

    def _telling_apart(self, first: Wheel, second: Wheel) -> tuple[tuple[Effect, slice], ...]:
        return tuple(
            (item, where)
            for item, where in self.at(WHEEL)
            if item.evaluate(floats, first, [0.5] * (where.stop - where.start))
            != item.evaluate(floats, second, [0.5] * (where.stop - where.start))
        )

    @cached_property
    def only_wrenches(self) -> bool:
        """Whether the interface torque is the torque that acts, at some time: no drive, no
        channel."""
        return all(item.acts_at.kind in ("wrench", "shift") for item, _ in self.slices)

    @cached_property
    def base_readers(self) -> frozenset[str]:
        """Names of the components that refer to base parameters: probed, not declared."""
        return frozenset(
            item.name
            for item, where in self.wrenches
            if _reads_base(item, where.stop - where.start)
        )

    @cached_property
    def is_linear(self) -> bool:
        """Whether the interface force is linear in the base parameters, whatever the others are."""
        return self.only_wrenches and not self.base_readers and not self.depends_on_load

    @cached_property
    def nonlinear(self) -> frozenset[str]:
        """Names of the effects in whose own parameters the interface force is not linear, even if
        all else is given: shifts, and wrenches that are found so by probing."""
        return frozenset(
            item.name
            for item, _ in self.slices
            if item.acts_at is CLOCK or (item.acts_at.kind == "wrench" and not _is_linear(item))
        )

    @cached_property
    def carriers(self) -> tuple[tuple[Effect, slice], ...]:
        """The loads: components that others reckon with beside the base parameters."""
        return tuple(row for row in self.slices if row[0].carries is not None)


def _reads_base(item: Effect, count: int) -> bool:
    """Whether an effect's value changes with the base parameters alone."""
    at = Instant((0.3, 0.4, 0.5), (0.6, 0.7, 0.8), (0.1, 0.2, 0.3), (0.5,) * 4, (0.6,) * 4)
    lengths = Geometry()
    values = [0.5] * count
    # Not in proportion, so that a ratio such as the centre of mass m_aX/m0 is seen to change.
    first, second = (
        Points(floats, lengths, [scale**k for k in range(1, 8)], at) for scale in (1.3, 1.9)
    )
    return component_wrench(floats, item, values, first) != component_wrench(
        floats, item, values, second
    )


def _is_linear(item: Effect) -> bool:
    """Whether an effect's wrench is linear in its own parameters, shape constants apart."""
    declared = [item.parameter(name) for name in item.parameter_names]
    shape = [parameter.default or 0.0 for parameter in declared]
    size = [0.0 if parameter.is_shape else parameter.size for parameter in declared]
    at = Instant((0.3, 0.4, 0.5), (0.6, 0.7, 0.8), (0.1, 0.2, 0.3), (0.5,) * 4, (0.6,) * 4)
    # Early and late, since some effects begin and others fade.
    points = [
        Points(floats, Geometry(), [1.0] * 7, replace(at, time=time)) for time in (0.7, 1000.0)
    ]

    def force(*parts: float) -> list[float]:
        # Neighbours get parts out of proportion, so that products and ratios are seen to change.
        share = [parts[k % len(parts)] for k in range(len(declared))]
        values = [c + s * part for c, s, part in zip(shape, size, share, strict=True)]
        return [f for point in points for f in component_wrench(floats, item, values, point)]

    rows = zip(force(0.5, 0.7, 0.3), force(0.4, 0.2, 0.8), force(1.3, 1.1, 1.9), strict=True)
    return all(abs(a + 2 * b - both) <= 1e-9 * (abs(a) + abs(b)) for a, b, both in rows)


def wheel_rates(geometry: Any, twist: Triple) -> tuple[Any, ...]:
    """No slip: the four wheel rates [rad/s] of a body twist."""
    vx, vy, wz = twist
    lever = geometry.l + geometry.h
    return tuple(
        (vx + SIGN_LATERAL[i] * vy - SIGN_Y[i] * lever * wz) / geometry.R for i in range(4)
    )


def roller_rates(geometry: Any, twist: Triple) -> tuple[Any, ...]:
    """No slip: rates [rad/s] of the four rollers on the floor."""
    _, vy, wz = twist
    return tuple(-(vy + SIGN_X[i] * geometry.h * wz) / (geometry.r * COS_ROLLER) for i in range(4))


def body_force(geometry: Any, torque: Sequence[Any]) -> Triple:
    """Generalised force (F_X, F_Y, M_W) of four wheel torques: the transpose of the rates."""
    t1, t2, t3, t4 = torque
    lever = geometry.l + geometry.h
    return (
        (t1 + t2 + t3 + t4) / geometry.R,
        (-t1 + t2 + t3 - t4) / geometry.R,
        lever * (-t1 + t2 - t3 + t4) / geometry.R,
    )


def allocate(geometry: Any, force: Triple) -> tuple[Any, ...]:
    """Least-norm wheel torques [N m] that exert a generalised force."""
    fx, fy, mz = force
    lever = geometry.l + geometry.h
    return tuple(
        geometry.R / 4 * (fx + SIGN_LATERAL[i] * fy - SIGN_Y[i] * mz / lever) for i in range(4)
    )


def _roller_force(geometry: Any, torque: Sequence[Any]) -> Triple:
    scaled = [-value / (geometry.r * COS_ROLLER) for value in torque]
    yaw = sum(SIGN_X[i] * geometry.h * scaled[i] for i in range(4))
    return 0.0, sum(scaled), yaw


def _world_force(xp: Any, yaw: Any, force: Triple) -> Triple:
    fx, fy, mz = force
    c, s = xp.cos(yaw), xp.sin(yaw)
    return c * fx + s * fy, c * fy - s * fx, mz


def _sum(*forces: Triple) -> Triple:
    first, second, third = zip(*forces, strict=True)
    return sum(first), sum(second), sum(third)


def wrench(xp: Any, structure: Structure, geometry: Any, theta: Any, at: Instant) -> Triple:
    """Inverse dynamics: the generalised force (F_X, F_Y, M_W) that a motion demands.

    Parameters
    ----------
    xp : namespace of the arithmetic
    structure : which effects are at work
    geometry : object with l, h, R, r [m]
    theta : parameters in the order of ``structure.parameter_names``
    at : the motion; ``at.torque`` are the torques that truly act

    Returns
    -------
    F_X, F_Y [N], M_W [N m] about O in the body frame, as the paper defines them.
    """
    return _wrench_of(xp, structure, structure.wrenches, geometry, theta, at)


def _wrench_of(
    xp: Any,
    structure: Structure,
    components: Sequence[tuple[Effect, slice]],
    geometry: Any,
    theta: Any,
    at: Instant,
) -> Triple:
    points = Points(xp, geometry, theta, at, structure.carriers)
    return _sum(*(component_wrench(xp, item, theta[where], points) for item, where in components))


class Points:
    """The points at which effects act in a motion, made once for all components."""

    def __init__(
        self,
        xp: Any,
        geometry: Any,
        theta: Any,
        at: Instant,
        carriers: Sequence[tuple[Effect, slice]] = (),
    ) -> None:
        self.xp, self.geometry, self.theta, self.at = xp, geometry, theta, at
        self.carriers = carriers

    @cached_property
    def base(self) -> Base:
        """The base parameters with what the platform carries, for effects that refer to them."""
        m0, inertia, m_ax, m_ay, wheel_inertia, mu1, mu2 = self.theta[:7]
        for item, where in self.carriers:
            assert item.carries is not None
            more = item.carries(self.xp, self.at.time, *self.theta[where])
            m0, inertia = m0 + more[0], inertia + more[1]
            m_ax, m_ay = m_ax + more[2], m_ay + more[3]
        return Base(m0, inertia, m_ax, m_ay, wheel_inertia, mu1, mu2)

    @cached_property
    def body(self) -> Body:
        """The platform in the body frame."""
        return Body(self.at.twist, self.at.acceleration, self.at.time, self.base)

    @cached_property
    def wheels(self) -> list[Wheel]:
        """The four wheel joints."""
        at = self.at
        rates = wheel_rates(self.geometry, at.twist)
        accelerations = wheel_rates(self.geometry, at.acceleration)
        rows = zip(rates, accelerations, at.wheel_angle, at.torque, strict=True)
        return [Wheel(*row, at.time, self.base) for row in rows]

    @cached_property
    def rollers(self) -> list[Roller]:
        """The four rollers on the floor."""
        rates = roller_rates(self.geometry, self.at.twist)
        accelerations = roller_rates(self.geometry, self.at.acceleration)
        rows = zip(rates, accelerations, strict=True)
        return [Roller(*row, self.at.time, self.base) for row in rows]

    @cached_property
    def world(self) -> World:
        """The platform in the world frame."""
        return _world_point(self.xp, self.at, self.base)


def component_wrench(xp: Any, item: Effect, values: Any, points: Points) -> Triple:
    """One component's share of the generalised force: its own formula, moved to O."""
    if item.acts_at is BODY:
        return item.evaluate(xp, points.body, values)
    if item.acts_at is WORLD:
        return _world_force(xp, points.at.pose[2], item.evaluate(xp, points.world, values))
    if item.acts_at is WHEEL:
        torques = [item.evaluate(xp, point, values, i) for i, point in enumerate(points.wheels)]
        return body_force(points.geometry, torques)
    torques = [item.evaluate(xp, point, values, i) for i, point in enumerate(points.rollers)]
    return _roller_force(points.geometry, torques)


def _world_point(xp: Any, at: Instant, base: Base) -> World:
    x, y, yaw = at.pose
    vx, vy, _ = at.twist
    c, s = xp.cos(yaw), xp.sin(yaw)
    com_x, com_y = base.m_aX / base.m0, base.m_aY / base.m0
    return World(
        *(x, y, yaw),
        *(c * vx - s * vy, s * vx + c * vy),
        *(c * com_x - s * com_y, s * com_x + c * com_y),
        at.time,
        base,
    )


def actuator_command(xp: Any, structure: Structure, theta: Any, at: Instant) -> tuple[Any, ...]:
    """Commands [N m] behind the drives that ``at.torque`` and ``at.torque_rate`` demand."""
    command = at.torque
    for item, where in structure.at(ACTUATOR):
        points = [Actuator(at.torque[i], at.torque_rate[i], at.time) for i in range(4)]
        command = tuple(item.evaluate(xp, points[i], theta[where], i) for i in range(4))
    return command


def channel_torque(
    xp: Any, structure: Structure, theta: Any, torque: Sequence[Any], time: Any
) -> tuple[Any, ...]:
    """True torque [N m] (behind a drive: its true command) that an interface torque stands for."""
    true = tuple(torque)
    for item, where in structure.at(CHANNEL):
        true = tuple(item.evaluate(xp, Channel(true[i], time), theta[where], i) for i in range(4))
    return true


def torque_delay(xp: Any, structure: Structure, theta: Any) -> Any:
    """Delay d [s] of the torque channels: what acts at t is what the interface said at t - d.

    All else here speaks of one instant and is the same for any delay; whoever has a whole course
    of torques moves it by this much.
    """
    shifts = structure.at(CLOCK)
    return sum((item.evaluate(xp, Clock(), theta[where]) for item, where in shifts), 0.0)


def interface_torque(xp: Any, structure: Structure, theta: Any, at: Instant) -> tuple[Any, ...]:
    """Torque [N m] at the interface (command, log) where ``at.torque`` acts on the wheels.

    Inverts the channels, which are affine in the torque, and asks the actuator for its command.
    It belongs to a time earlier than ``at`` by :func:`torque_delay`.
    """
    wanted = actuator_command(xp, structure, theta, at)
    zero = channel_torque(xp, structure, theta, [0.0 * value for value in wanted], at.time)
    one = channel_torque(xp, structure, theta, [0.0 * value + 1.0 for value in wanted], at.time)
    return tuple((wanted[i] - zero[i]) / (one[i] - zero[i]) for i in range(4))


def acting_torque(
    xp: Any,
    structure: Structure,
    geometry: Any,
    theta: Any,
    at: Instant,
    *,
    internal: Sequence[Any] = (0.0, 0.0, 0.0, 0.0),
    tolerance: float = 0.0,
) -> tuple[Any, ...]:
    """Torques [N m] that a motion demands at the wheels, losses under load included.

    Of all torques those of least norm, plus ``internal`` ones that exert no force.

    A friction that depends on the load makes this a fixed point; the loads' shares are below one,
    so the iteration contracts. It stops when nothing moves by more than ``tolerance``.

    Raises
    ------
    InputError
        If the losses eat what is put in (a share near one) and no torque can drive the motion.
    """
    loads = structure.load_readers
    if not loads:
        return _with(internal, allocate(geometry, wrench(xp, structure, geometry, theta, at)))
    others = [row for row in structure.wrenches if row not in loads]
    given = _wrench_of(xp, structure, others, geometry, theta, at)
    torque = _with(internal, allocate(geometry, given))
    # At the largest share, 0.9, it takes 330 rounds to come down to rounding.
    for _ in range(1000):
        last = torque
        lost = _wrench_of(xp, structure, loads, geometry, theta, replace(at, torque=last))
        torque = _with(internal, allocate(geometry, _sum(given, lost)))
        moved = max(_largest(xp.abs(a - b)) for a, b in zip(torque, last, strict=True))
        size = max(_largest(xp.abs(a)) for a in torque)
        if moved <= max(tolerance, 2e-15 * size):
            return torque
    raise InputError("no torque drives this motion: friction grows as fast as the torque")


def _with(more: Sequence[Any], torque: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(a + b for a, b in zip(torque, more, strict=True))


def _largest(value: Any) -> float:
    return float(value.max()) if hasattr(value, "max") else float(value)


def inverse_dynamics(
    xp: Any, structure: Structure, geometry: Any, theta: Any, at: Instant
) -> tuple[Any, ...]:
    """Interface torques [N m] (fl, fr, bl, br) that drive a motion: the feed-forward.

    With an actuator ``at.torque_rate`` must hold the rate of the acting torques. With a delay the
    torques must be commanded that much before the motion: evaluate them on the reference
    :func:`torque_delay` ahead.
    """
    torque = acting_torque(xp, structure, geometry, theta, at)
    return interface_torque(xp, structure, theta, replace(at, torque=torque))


def mass_matrix(
    xp: Any, structure: Structure, geometry: Any, theta: Any, at: Instant
) -> tuple[Triple, Triple, Triple]:
    """Rows of the 3x3 mass matrix of (VX', VY', W') at a state."""
    still = wrench(xp, structure, geometry, theta, replace(at, acceleration=(0.0, 0.0, 0.0)))
    columns = []
    for unit in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        force = wrench(xp, structure, geometry, theta, replace(at, acceleration=unit))
        columns.append(tuple(a - b for a, b in zip(force, still, strict=True)))
    return tuple(zip(*columns, strict=True))  # type: ignore[return-value]


def solve3(rows: Sequence[Sequence[Any]], right: Sequence[Any]) -> Triple:
    """Solve a 3x3 linear system by its adjugate: branch-free, so it works on every backend."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    p, q, r = right
    ei_fh, ch_bi, bf_ce = e * i - f * h, c * h - b * i, b * f - c * e
    determinant = a * ei_fh + d * ch_bi + g * bf_ce
    return (
        (ei_fh * p + ch_bi * q + bf_ce * r) / determinant,
        ((f * g - d * i) * p + (a * i - c * g) * q + (c * d - a * f) * r) / determinant,
        ((d * h - e * g) * p + (b * g - a * h) * q + (a * e - b * d) * r) / determinant,
    )


def forward_dynamics(
    xp: Any, structure: Structure, geometry: Any, theta: Any, at: Instant
) -> Triple:
    """Acceleration (VX', VY', W') under the torques ``at.torque`` that act at the wheels."""
    still = wrench(xp, structure, geometry, theta, replace(at, acceleration=(0.0, 0.0, 0.0)))
    driving = body_force(geometry, at.torque)
    rows = mass_matrix(xp, structure, geometry, theta, at)
    return solve3(rows, [a - b for a, b in zip(driving, still, strict=True)])


def state_derivative(
    xp: Any, structure: Structure, geometry: Any, theta: Any, state: Any, torque: Any
) -> tuple[Any, ...]:
    """Time derivative of the state (``structure.state_names``) under interface torques [N m].

    Where there is a delay ``torque`` is what the interface said that much earlier.
    """
    twist, pose, angle, time = state[0:3], state[3:6], state[6:10], state[10]
    command = channel_torque(xp, structure, theta, torque, time)
    acting = tuple(state[11:15]) if structure.has_actuator else command
    at = Instant(tuple(twist), pose=tuple(pose), wheel_angle=tuple(angle), torque=acting, time=time)
    c, s = xp.cos(pose[2]), xp.sin(pose[2])
    vx, vy, wz = twist
    moved = (
        *forward_dynamics(xp, structure, geometry, theta, at),
        *(c * vx - s * vy, s * vx + c * vy, wz),
        *wheel_rates(geometry, tuple(twist)),
        1.0,
    )
    if not structure.has_actuator:
        return moved
    return moved + drive_rates(xp, structure, theta, at, command)


def drive_rates(
    xp: Any, structure: Structure, theta: Any, at: Instant, command: Sequence[Any]
) -> tuple[Any, ...]:
    """Rates [N m/s] of the acting torques under a command: an actuator is affine in the rate."""
    zero = actuator_command(xp, structure, theta, replace(at, torque_rate=(0.0,) * 4))
    one = actuator_command(xp, structure, theta, replace(at, torque_rate=(1.0,) * 4))
    return tuple((command[i] - zero[i]) / (one[i] - zero[i]) for i in range(4))
