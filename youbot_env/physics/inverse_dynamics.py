"""Inverse dynamics, the only place that states the physics, and all that is derived from it.

All functions take the namespace ``xp`` first (numpy, floats, symbols, tensors; see
:mod:`youbot_env.physics.namespaces`) and work on components: a twist is a tuple of numbers, arrays
of one shape, or symbols, one for each of the mechanism's A axes; torques are one for each of its J
joints. What effects see of a motion is the mechanism's own: see
:mod:`youbot_env.physics.mechanism`. Frames and units are those of the mechanism; of the platform
they stand in :mod:`youbot_env.physics.mecanum`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from youbot_env.errors import NoTorqueError
from youbot_env.physics.effect import (
    ACTUATOR,
    CHANNEL,
    CLOCK,
    CONTACT,
    SPEED,
    Actuator,
    Channel,
    Clock,
    Effect,
    SpeedChannel,
)
from youbot_env.physics.mechanism import (
    Components,
    EffectPoints,
    Geometry,
    Instant,
    ModelStructure,
    component_force,
)
from youbot_env.physics.namespaces import N, Namespace, Number, Values


def _sum(*forces: Components[N]) -> Components[N]:
    # For the type checker: sum begins with the integer 0.
    return cast("Components[N]", tuple(sum(parts) for parts in zip(*forces, strict=True)))


def wrench(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> Components[N]:
    """Inverse dynamics: the generalised force (A) that a motion demands.

    Parameters
    ----------
    xp : namespace of the arithmetic
    structure : which mechanism, with which effects at work
    geometry : object with the mechanism's ``lengths`` [m]
    theta : parameters in the order of ``structure.parameter_names``
    at : the motion; ``at.torque`` are the torques that truly act

    Returns
    -------
    Of the platform F_X, F_Y [N], M_W [N m] about O in the body frame, as the paper defines them.
    """
    return _wrench_of(xp, structure, structure.wrenches, geometry, theta, at)


def effect_points(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> EffectPoints[Geometry, N]:
    """The points at which the effects of a structure act in a motion."""
    rolling = rolling_geometry(xp, structure, geometry, theta)
    return EffectPoints(xp, structure.mechanism, rolling, theta, at, structure.carriers)


def rolling_geometry(
    xp: Namespace, structure: ModelStructure[Geometry], geometry: Geometry, theta: Values[N]
) -> Geometry:
    """The geometry as the joints really roll; the given one without an effect on that.

    The maps of the mechanism (``joint_rates``, ``force_of``, ``torque_of``) take it. All functions
    here take the given one.
    """
    changes, uneven = structure.at(CONTACT), structure.mechanism.uneven
    if not changes or uneven is None:
        return geometry
    contacts = structure.mechanism.contacts(geometry)
    factors: list[tuple[Number, ...]] = [(1.0, 1.0, 1.0) for _ in contacts]
    for item, where in changes:
        for i, contact in enumerate(contacts):
            more = cast("tuple[Number, ...]", item.evaluate(xp, contact, theta[where], i))
            factors[i] = tuple(a * b for a, b in zip(more, factors[i], strict=True))
    return uneven(geometry, factors)


def joint_rates(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    twist: Sequence[N],
) -> Components[N]:
    """Rates (J) at which the joints roll at a twist (A)."""
    rolling = rolling_geometry(xp, structure, geometry, theta)
    return structure.mechanism.joint_rates(rolling, twist)


def true_speed(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    theta: Values[N],
    speed: Sequence[N],
    speed_rate: Sequence[N | float],
    torque: Sequence[N | float],
    time: N | float,
) -> Components[N]:
    """Rates (J) at which the joints roll where their speeds are logged as ``speed``."""
    true = tuple(speed)
    for item, where in structure.at(SPEED):
        rows = zip(speed, speed_rate, torque, strict=True)
        found = _of_joints(item, xp, [SpeedChannel(*row, time) for row in rows], theta[where])
        true = tuple(a + (b - c) for a, b, c in zip(true, found, speed, strict=True))
    return true


def logged_speed(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    theta: Values[N],
    rates: Sequence[N],
    torque: Sequence[N | float],
    time: N | float,
) -> tuple[Components[N], Components[N]]:
    """Speeds (J) that are logged of joints that roll at ``rates``, and time constants (J) [s].

    With a time constant T of zero they are what is logged; else it follows them by
    (speeds - logged) / T.
    """
    # Three evaluations give an affine function. 0 * value, not 0: arrays and symbols keep their
    # shape and type.
    none = [0.0 * value for value in rates]
    one = [value + 1.0 for value in none]
    offset = true_speed(xp, structure, theta, none, none, torque, time)
    slope = true_speed(xp, structure, theta, one, none, torque, time)
    lag = true_speed(xp, structure, theta, none, one, torque, time)
    rows = list(zip(rates, offset, slope, lag, strict=True))
    speeds = tuple((rate - o) / (s - o) for rate, o, s, _ in rows)
    return speeds, tuple((late - o) / (s - o) for _, o, s, late in rows)


def _wrench_of(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    components: Sequence[tuple[Effect, slice]],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> Components[N]:
    points = effect_points(xp, structure, geometry, theta, at)
    return _sum(*(component_force(item, theta[where], points) for item, where in components))


def actuator_command(
    xp: Namespace, structure: ModelStructure[Geometry], theta: Values[N], at: Instant[N]
) -> Components[N]:
    """Commands (J) behind the drives that ``at.torque`` and its rates demand."""
    command, joints = cast("Components[N]", at.torque), range(len(structure.mechanism.joints))
    for item, where in structure.at(ACTUATOR):
        points = [
            Actuator(at.torque[i], at.torque_rate[i], at.time, at.torque_second_rate[i])
            for i in joints
        ]
        command = _of_joints(item, xp, points, theta[where])
    return command


def channel_torque(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    torque: Values[N],
    at: Instant[N],
) -> Components[N]:
    """True torque (J) (behind a drive: its true command) that an interface torque stands for.

    Of ``at`` the twist and the times are read.
    """
    return torque_behind_channels(xp, structure, geometry, theta, torque, at)[-1]


def torque_behind_channels(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    torque: Values[N],
    at: Instant[N],
) -> list[Components[N]]:
    """Torques (J) at the interface, behind the first channel, behind the second, ... ."""
    found = [tuple(torque)]
    rolling = rolling_geometry(xp, structure, geometry, theta)
    for item, where in structure.at(CHANNEL):
        points = _channels(structure, rolling, found[-1], at)
        found.append(_of_joints(item, xp, points, theta[where]))
    return found


def _channels(
    structure: ModelStructure[Geometry], geometry: Geometry, torque: Values[N], at: Instant[N]
) -> list[Channel]:
    rates = structure.mechanism.joint_rates(geometry, at.twist)
    return [Channel(*pair, at.time, at.start) for pair in zip(torque, rates, strict=True)]


def _of_joints(
    item: Effect, xp: Namespace, points: Sequence[object], values: Values[N]
) -> Components[N]:
    """(J) what an effect returns at each joint."""
    found = tuple(item.evaluate(xp, point, values, i) for i, point in enumerate(points))
    return cast("Components[N]", found)


def torque_delay(xp: Namespace, structure: ModelStructure[Geometry], theta: Values[N]) -> N | float:
    """Delay d [s] of the torque channels: what acts at t is what the interface said at t - d.

    All other functions here describe one instant and do not depend on the delay. A caller that has
    torques over time shifts them by d.
    """
    shifts = structure.at(CLOCK)
    found = [_of_joints(item, xp, [Clock()], theta[where]) for item, where in shifts]
    return sum((delay for (delay,) in found), 0.0)


def interface_torque(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
    said: Sequence[Components[N]] = (),
) -> Components[N]:
    """Torque (J) at the interface (command, log) where ``at.torque`` acts on the joints.

    It is the command of the actuator, taken back through the channels. It belongs to a time
    earlier than ``at`` by :func:`torque_delay`.

    ``said`` : :func:`torque_behind_channels` of what the interface did say. What a channel that is
    not affine (a dead zone) took from it is known, where its inverse is not unique or does not
    exist.
    """
    torque = actuator_command(xp, structure, theta, at)
    channels = structure.at(CHANNEL)
    rolling = rolling_geometry(xp, structure, geometry, theta)
    for k in range(len(channels) - 1, -1, -1):
        item, where = channels[k]
        if item.inverse is None:
            torque = _affine_inverse(xp, structure, rolling, item, theta[where], torque, at)
        elif said:
            rows = zip(torque, said[k], said[k + 1], strict=True)
            torque = tuple(value + (before - after) for value, before, after in rows)
        else:
            points = enumerate(_channels(structure, rolling, torque, at))
            back = tuple(item.undo(xp, point, theta[where], i) for i, point in points)
            torque = cast("Components[N]", back)
    return torque


def taken_torque(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    torque: Values[N],
    at: Instant[N],
) -> Components[N]:
    """What channels that are not affine take from interface torques (J)."""
    passed = torque_behind_channels(xp, structure, geometry, theta, torque, at)
    taken = tuple(0.0 * value for value in torque)
    for k, (item, _) in enumerate(structure.at(CHANNEL)):
        if item.inverse is not None:
            rows = zip(taken, passed[k], passed[k + 1], strict=True)
            taken = tuple(value + (before - after) for value, before, after in rows)
    return taken


def _affine_inverse(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    item: Effect,
    values: Values[N],
    true: Components[N],
    at: Instant[N],
) -> Components[N]:
    """Torques (J) before a channel that is affine in them, from those behind it."""
    # Two evaluations give offset and slope. 0 * value, not 0: arrays, symbols and tensors keep
    # their shape and type.
    zero, one = (
        _of_joints(item, xp, _channels(structure, geometry, before, at), values)
        for before in ([0.0 * value for value in true], [0.0 * value + 1.0 for value in true])
    )
    return tuple((value - a) / (b - a) for value, a, b in zip(true, zero, one, strict=True))


DIVERGED = 1e6
"""Times the torque of the first round: a fixed point that comes to so much goes on to infinity."""


def acting_torque(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
    *,
    internal: Sequence[N | float] = (),
    tolerance: float = 0.0,
) -> Components[N]:
    """Torques (J) that a motion demands at the joints, losses under load included.

    Of all torques those of least norm, plus ``internal`` ones that exert no force.

    Friction that depends on the load makes the torque depend on itself: a fixed point. The shares
    are below one, so the iteration converges. It stops when no torque changes by more than
    ``tolerance``.

    Raises
    ------
    NoTorqueError
        If no torque can drive the motion: with a share near one friction takes all of it.
    """
    loads, torque_of = structure.load_readers, structure.mechanism.torque_of
    rolling = rolling_geometry(xp, structure, geometry, theta)
    if not loads:
        force = wrench(xp, structure, geometry, theta, at)
        return _with(internal, torque_of(rolling, force))
    others = [row for row in structure.wrenches if row not in loads]
    given = _wrench_of(xp, structure, others, geometry, theta, at)
    torque = _with(internal, torque_of(rolling, given))
    most = 0.0
    # With the largest share, 0.9, rounding is reached after 330 rounds.
    for _ in range(1000):
        last = torque
        lost = _wrench_of(xp, structure, loads, geometry, theta, replace(at, torque=last))
        torque = _with(internal, torque_of(rolling, _sum(given, lost)))
        moved = max(_largest(xp.abs(a - b)) for a, b in zip(torque, last, strict=True))
        size = max(_largest(xp.abs(a)) for a in torque)
        # Below 2e-15 of the size rounding alone moves the torques, and tolerance 0 would never end.
        if moved <= max(tolerance, 2e-15 * size):
            return torque
        most = most or DIVERGED * size
        if size > most:
            break
    names = " and ".join(item.name for item, _ in loads)
    raise NoTorqueError(f"no torque drives this motion: {names} takes as much of it as there is")


def _with(more: Sequence[N | float], torque: Components[N]) -> Components[N]:
    return tuple(a + b for a, b in zip(torque, more, strict=True)) if len(more) else torque


def _largest(value: Number) -> float:
    greatest = getattr(value, "max", None)  # of an array or a tensor
    return float(value if greatest is None else greatest())


def inverse_dynamics(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> Components[N]:
    """Interface torques (J) that drive a motion: the feed-forward.

    With an actuator ``at.torque_rate`` must hold the rate of the acting torques, with one of second
    order ``at.torque_second_rate`` the rate of that. With a delay the
    torques must be commanded that much before the motion: evaluate them on the reference
    :func:`torque_delay` ahead.
    """
    torque = acting_torque(xp, structure, geometry, theta, at)
    return interface_torque(xp, structure, geometry, theta, replace(at, torque=torque))


def mass_matrix(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> tuple[Components[N], ...]:
    """Rows of the A x A mass matrix of the acceleration at a state."""
    size = len(structure.mechanism.axes)
    # The force is affine in the acceleration, so unit accelerations give the columns exactly.
    still = wrench(xp, structure, geometry, theta, replace(at, acceleration=(0.0,) * size))
    columns: list[Components[N]] = []
    for axis in range(size):
        unit = tuple(1.0 if k == axis else 0.0 for k in range(size))
        force = wrench(xp, structure, geometry, theta, replace(at, acceleration=unit))
        columns.append(tuple(a - b for a, b in zip(force, still, strict=True)))
    return tuple(zip(*columns, strict=True))


def solve(rows: Sequence[Sequence[N]], right: Sequence[N]) -> Components[N]:
    """Solve a linear system of one, two or three unknowns by its adjugate.

    It has no branch (no pivoting), so it works on symbols and tensors too. It divides by the
    determinant, which is positive for a mass matrix.
    """
    return _SOLVERS[len(right)](rows, right)


def _solve1(rows: Sequence[Sequence[N]], right: Sequence[N]) -> Components[N]:
    return (right[0] / rows[0][0],)


def _solve2(rows: Sequence[Sequence[N]], right: Sequence[N]) -> Components[N]:
    (a, b), (c, d) = rows
    p, q = right
    determinant = a * d - b * c
    return (d * p - b * q) / determinant, (a * q - c * p) / determinant


def _solve3(rows: Sequence[Sequence[N]], right: Sequence[N]) -> Components[N]:
    (a, b, c), (d, e, f), (g, h, i) = rows
    p, q, r = right
    ei_fh, ch_bi, bf_ce = e * i - f * h, c * h - b * i, b * f - c * e
    determinant = a * ei_fh + d * ch_bi + g * bf_ce
    return (
        (ei_fh * p + ch_bi * q + bf_ce * r) / determinant,
        ((f * g - d * i) * p + (a * i - c * g) * q + (c * d - a * f) * r) / determinant,
        ((d * h - e * g) * p + (b * g - a * h) * q + (a * e - b * d) * r) / determinant,
    )


_SOLVERS = {1: _solve1, 2: _solve2, 3: _solve3}


def forward_dynamics(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    at: Instant[N],
) -> Components[N]:
    """Acceleration (A) under the torques ``at.torque`` that act at the joints."""
    zero = (0.0,) * len(structure.mechanism.axes)
    still = wrench(xp, structure, geometry, theta, replace(at, acceleration=zero))
    rolling = rolling_geometry(xp, structure, geometry, theta)
    driving = structure.mechanism.force_of(rolling, at.torque)
    rows = mass_matrix(xp, structure, geometry, theta, at)
    return solve(rows, [a - b for a, b in zip(driving, still, strict=True)])


def state_derivative(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Values[N],
    state: Values[N],
    torque: Values[N],
) -> Components[N | float]:
    """Time derivative of the state (``structure.state_names``) under interface torques (J).

    Where there is a delay ``torque`` is what the interface said that much earlier.
    """
    mechanism = structure.mechanism
    twist, pose, angle, time = mechanism.split(state)
    start = state[-1] if structure.reads_start else 0.0
    at = Instant(twist, pose=pose, wheel_angle=angle, time=time, start=start)
    command = channel_torque(xp, structure, geometry, theta, torque, at)
    first = len(mechanism.state)
    joints = len(mechanism.joints)
    drives = tuple(state[first : first + structure.drive_order * joints])
    at = replace(at, torque=drives[:joints] if drives else command)
    if structure.drive_order > 1:
        at = replace(at, torque_rate=drives[joints:])
    # Without an actuator the true command acts at once; with one the acting torques are states.
    moved = (
        *forward_dynamics(xp, structure, geometry, theta, at),
        *cast("Components[N]", mechanism.pose_rates(xp, pose, twist)),
        *(joint_rates(xp, structure, geometry, theta, twist) if angle else ()),
        1.0,  # time is a state, too
    )
    drives = drive_rates(xp, structure, theta, at, command) if structure.has_actuator else ()
    # When the log began stays as it is.
    return (*moved, *drives, *((0.0,) if structure.reads_start else ()))


def drive_rates(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    theta: Values[N],
    at: Instant[N],
    command: Sequence[N],
) -> Components[N]:
    """Rates of the drives' states under a command: (J) of the torques, in drives of second order
    (2 J): ``at.torque_rate``, and the rates of that."""
    # An actuator is affine in the highest rate: two evaluations invert it.
    joints = len(structure.mechanism.joints)
    second = structure.drive_order > 1

    def commanded(rate: float) -> Components[N]:
        rates = (rate,) * joints
        at_rate = (
            replace(at, torque_second_rate=rates) if second else replace(at, torque_rate=rates)
        )
        return actuator_command(xp, structure, theta, at_rate)

    zero, one = commanded(0.0), commanded(1.0)
    highest = tuple((command[i] - zero[i]) / (one[i] - zero[i]) for i in range(joints))
    return (*cast("Components[N]", at.torque_rate), *highest) if second else highest
