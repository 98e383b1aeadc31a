"""Inverse dynamics, the only statement of physics, and everything that is derived from it.

All functions take the namespace ``xp`` first (numpy, floats, symbols, tensors; see
:mod:`youbot_env.physics.namespaces`) and work on components: a twist is a tuple of three numbers,
arrays of one shape, or symbols. Frames: twist, acceleration and generalised force belong to the
body frame at O; the acceleration is the time derivative (VX', VY', W') of the twist's components.
Pose is (x, y, yaw) in the world. What effects see of a motion is in
:mod:`youbot_env.physics.points`. Sources: the paper's model (README, Equations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from youbot_env.errors import InputError
from youbot_env.physics.effect import ACTUATOR, CHANNEL, CLOCK, Actuator, Channel, Clock, Effect
from youbot_env.physics.geometry import Triple, allocate, body_force, wheel_rates
from youbot_env.physics.points import EffectPoints, Instant, component_wrench
from youbot_env.physics.structure import ModelStructure


def _sum(*forces: Triple) -> Triple:
    first, second, third = zip(*forces, strict=True)
    return sum(first), sum(second), sum(third)


def wrench(xp: Any, structure: ModelStructure, geometry: Any, theta: Any, at: Instant) -> Triple:
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
    structure: ModelStructure,
    components: Sequence[tuple[Effect, slice]],
    geometry: Any,
    theta: Any,
    at: Instant,
) -> Triple:
    points = EffectPoints(xp, geometry, theta, at, structure.carriers)
    return _sum(*(component_wrench(xp, item, theta[where], points) for item, where in components))


def actuator_command(
    xp: Any, structure: ModelStructure, theta: Any, at: Instant
) -> tuple[Any, ...]:
    """Commands [N m] behind the drives that ``at.torque`` and ``at.torque_rate`` demand."""
    command = at.torque
    for item, where in structure.at(ACTUATOR):
        points = [Actuator(at.torque[i], at.torque_rate[i], at.time) for i in range(4)]
        command = tuple(item.evaluate(xp, points[i], theta[where], i) for i in range(4))
    return command


def channel_torque(
    xp: Any, structure: ModelStructure, theta: Any, torque: Sequence[Any], time: Any
) -> tuple[Any, ...]:
    """True torque [N m] (behind a drive: its true command) that an interface torque stands for."""
    true = tuple(torque)
    for item, where in structure.at(CHANNEL):
        true = tuple(item.evaluate(xp, Channel(true[i], time), theta[where], i) for i in range(4))
    return true


def torque_delay(xp: Any, structure: ModelStructure, theta: Any) -> Any:
    """Delay d [s] of the torque channels: what acts at t is what the interface said at t - d.

    All else here speaks of one instant and is the same for any delay; whoever has a whole course
    of torques moves it by this much.
    """
    shifts = structure.at(CLOCK)
    return sum((item.evaluate(xp, Clock(), theta[where]) for item, where in shifts), 0.0)


def interface_torque(
    xp: Any, structure: ModelStructure, theta: Any, at: Instant
) -> tuple[Any, ...]:
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
    structure: ModelStructure,
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
    xp: Any, structure: ModelStructure, geometry: Any, theta: Any, at: Instant
) -> tuple[Any, ...]:
    """Interface torques [N m] (fl, fr, bl, br) that drive a motion: the feed-forward.

    With an actuator ``at.torque_rate`` must hold the rate of the acting torques. With a delay the
    torques must be commanded that much before the motion: evaluate them on the reference
    :func:`torque_delay` ahead.
    """
    torque = acting_torque(xp, structure, geometry, theta, at)
    return interface_torque(xp, structure, theta, replace(at, torque=torque))


def mass_matrix(
    xp: Any, structure: ModelStructure, geometry: Any, theta: Any, at: Instant
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
    xp: Any, structure: ModelStructure, geometry: Any, theta: Any, at: Instant
) -> Triple:
    """Acceleration (VX', VY', W') under the torques ``at.torque`` that act at the wheels."""
    still = wrench(xp, structure, geometry, theta, replace(at, acceleration=(0.0, 0.0, 0.0)))
    driving = body_force(geometry, at.torque)
    rows = mass_matrix(xp, structure, geometry, theta, at)
    return solve3(rows, [a - b for a, b in zip(driving, still, strict=True)])


def state_derivative(
    xp: Any, structure: ModelStructure, geometry: Any, theta: Any, state: Any, torque: Any
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
    xp: Any, structure: ModelStructure, theta: Any, at: Instant, command: Sequence[Any]
) -> tuple[Any, ...]:
    """Rates [N m/s] of the acting torques under a command: an actuator is affine in the rate."""
    zero = actuator_command(xp, structure, theta, replace(at, torque_rate=(0.0,) * 4))
    one = actuator_command(xp, structure, theta, replace(at, torque_rate=(1.0,) * 4))
    return tuple((command[i] - zero[i]) / (one[i] - zero[i]) for i in range(4))
