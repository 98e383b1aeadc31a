"""Logs as motion and torque of a mechanism, the force that such a motion demands, and its columns.

N samples, A axes, J joints, D coordinates of the pose, P parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Generic, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.settings import MechanismSettings
from identification.signals.filters import at_both_ends, block_mean, integral_of, slope_ends
from identification.signals.resampling import low_passed, moved, smoothed
from identification.threads import cached_property
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CHANNEL, CONTACT, SPEED, Effect, Parameter
from youbot_env.physics.mechanism import (
    Components,
    EffectPoints,
    Geometry,
    Instant,
    ModelStructure,
    component_force,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """One log as motion and torque on a uniform time base, in the units of its mechanism.

    name : of the log; time (N,) [s] from the log's start; dt [s]
    twist (N, A), pose (N, D) : of a platform in the body frame and in the world
    wheel_angle (N, J) : of the joints; (N, 0) where the pose says it all
    wheel_speed, torque (N, J) : of the joints, as logged
    angle_measured : whether the angles have columns of their own, or are integrated
    angle_noise : (J,) white noise of the angles [rad] whose differences the speeds are; None where
        the speeds were measured as such
    bandwidth : of the speeds [Hz] that is left for a force fit, see :attr:`for_fit`
    start : [s] of the log on the clock that the logs share; 0 where it is alone
    pose_measured : whether the pose has columns of its own, or is integrated from the joints
    moves : (N,) False where the mechanism rests, and dry friction may hold any force up to its
        own: no row of a fit is made of it. None: it is not known to rest
    """

    name: str
    time: Array
    dt: float
    twist: Array
    pose: Array
    wheel_angle: Array
    wheel_speed: Array
    torque: Array
    angle_measured: bool = False
    angle_noise: tuple[float, ...] | None = None
    bandwidth: float = np.inf
    moves: NDArray[np.bool_] | None = None
    start: float = 0.0
    pose_measured: bool = False

    def __len__(self) -> int:
        return len(self.time)

    @property
    def for_fit(self) -> Samples:
        """What columns and forces are computed of: speeds and torques without what is too fast.

        Noise on speeds is noise on columns and biases a fit. Differences of counted angles hold it
        at high frequencies, where there is no motion. The torques pass the same filter, so what is
        linear in both stays unbiased.
        """
        # Not kept where it is the same: what holds itself stays in memory until somebody looks.
        return self._slow if np.isfinite(self.bandwidth) else self

    @cached_property
    def _slow(self) -> Samples:
        """What the filter leaves."""
        slow = partial(low_passed, cutoff=self.bandwidth, dt=self.dt)
        return replace(
            self,
            twist=slow(self.twist),
            wheel_speed=slow(self.wheel_speed),
            torque=slow(self.torque),
            bandwidth=np.inf,
        )

    def smoothed(self, channel: str, window: float) -> Array:
        """(N, J) a channel smoothed over some samples; computed once, for it is asked many times.

        ``channel``: "torque" or "wheel_speed".
        """
        known, key = self._smoothed, (channel, window)
        if key not in known:
            known[key] = _smoothed(getattr(self, channel), window)
        return known[key]

    def speed_rates(self, window: float) -> Array:
        """(N, J) slope of the speeds smoothed over some samples; computed once."""
        known, key = self._smoothed, ("slope of wheel_speed", window)
        if key not in known:
            known[key] = rates = np.empty_like(self.wheel_speed)
            for k, column in enumerate(self.wheel_speed.T):
                rates[:, k] = np.gradient(smoothed(column, window), self.dt)
        return known[key]

    @cached_property
    def _smoothed(self) -> dict[tuple[str, float], Array]:
        return {}

    @property
    def channels(self) -> tuple[Array, Array]:
        """Speeds and efforts (N, J) of the joints, as logged."""
        return self.wheel_speed, self.torque


class Part(NamedTuple):
    """A stretch of a log that is judged apart: its kind, in a word, and its samples."""

    kind: str
    samples: Samples

    @property
    def start(self) -> float:
        """Seconds from the log's start."""
        return float(self.samples.time[0])

    @property
    def end(self) -> float:
        """Seconds from the log's start."""
        return float(self.samples.time[-1])


def cut(samples: Samples, start: int, stop: int) -> Samples:
    """Rows ``start`` to ``stop`` of samples, under the same name and time."""
    arrays = {field.name: getattr(samples, field.name) for field in fields(samples)}
    return replace(
        samples, **{k: v[start:stop] for k, v in arrays.items() if isinstance(v, np.ndarray)}
    )


def without_angles(samples: Samples) -> Samples:
    """The samples for a structure that reads no angle of a joint: the first one stands for all.

    The angles of an hour at 1 kHz take a tenth of a gigabyte.
    """
    # A copy: a view of one row keeps all of them.
    first = np.broadcast_to(samples.wheel_angle[:1].copy(), samples.wheel_angle.shape)
    return replace(samples, wheel_angle=first)


def averaged_down(samples: Samples, rate: float) -> Samples:
    """The samples averaged over successive blocks, to ``rate`` [Hz] or just above.

    A block in which the mechanism rests at some time counts as rest.
    """
    # Plus 1e-6: rounding of an exact whole ratio must not shorten a block.
    size = max(1, int(1.0 / (rate * samples.dt) + 1e-6))
    if size == 1:
        return samples
    arrays = {field.name: getattr(samples, field.name) for field in fields(samples)}
    means = {
        name: block_mean(np.asarray(value, np.float64), size)
        for name, value in arrays.items()
        if isinstance(value, np.ndarray)
    }
    moves = None if samples.moves is None else means["moves"] == 1.0
    return replace(samples, **{**means, "dt": size * samples.dt, "moves": moves})


@dataclass(frozen=True)
class AddedNoise:
    """Noise on the speeds of a log, put on the whole of it or on a part.

    speed (N, J); angle (N, J): what it adds up to, None where nothing reads that; to_twist (J, A)
    """

    speed: Array
    angle: Array | None
    to_twist: Array

    def on(self, part: Samples, begin: int) -> Samples:
        """Samples that begin with number ``begin`` of the log, with the noise."""
        rows = slice(begin, begin + len(part))
        extra, angle = self.speed[rows], part.wheel_angle
        return replace(
            part,
            wheel_angle=angle if self.angle is None else angle + self.angle[rows],
            twist=part.twist + extra @ self.to_twist,
            wheel_speed=part.wheel_speed + extra,
        )


def planar_pose(twist: Array, dt: float) -> Array:
    """(N, 3) x, y, yaw in the world from (0, 0, 0), from a body twist (N, 3)."""
    yaw = integral_of(twist[:, 2], dt)
    c, s = np.cos(yaw), np.sin(yaw)
    velocity = np.column_stack(
        [c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]]
    )
    return np.column_stack([integral_of(velocity, dt), yaw])


def rolled(
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Array,
    samples: Samples,
    settings: MechanismSettings,
) -> Samples:
    """The samples with the motion that really was, where effects change kinematics or speeds.

    Twist and speeds of the joints are corrected, and what was integrated of them. Measured torques
    and those columns of pose and angles that a log has stay as they are.
    """
    if not structure.changes_kinematics:
        return samples
    s = samples
    twist, speed = rolled_speeds(structure, geometry, theta, s, settings)
    angle = s.wheel_angle if s.angle_measured else s.wheel_angle[:1] + integral_of(speed, s.dt)
    pose = s.pose if s.pose_measured else planar_pose(twist, s.dt)
    return replace(s, twist=twist, wheel_speed=speed, wheel_angle=angle, pose=pose)


def rolled_speeds(
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    theta: Array,
    samples: Samples,
    settings: MechanismSettings,
    rows: slice = slice(None),
) -> tuple[Array, Array]:
    """Twist (N, A) and speeds of the joints (N, J) of the same, of some rows."""
    s, kind = samples, structure.mechanism
    twist, speed, time = s.twist[rows], s.wheel_speed[rows], s.time[rows]
    if not structure.changes_kinematics:
        return twist, speed
    rates = np.zeros_like(speed)
    if structure.filters_speed:
        rates = s.speed_rates(settings.torque_rate_smoothing_time / s.dt)[rows]
    # The torque that a wheel creeps by is smoothed: its noise would be in the motion too.
    torque = s.smoothed("torque", settings.internal_torque_smoothing_time / s.dt)[rows]
    at = Instant(tuple(twist.T), time=time, start=s.start)
    acting = dynamics.channel_torque(np, structure, geometry, theta, tuple(torque.T), at)
    channels = (tuple(speed.T), tuple(rates.T), acting)
    true = dynamics.true_speed(np, structure, theta, *channels, time)
    rolling = dynamics.rolling_geometry(np, structure, geometry, theta)
    # Only mechanisms of which a joint can roll otherwise than it should have such effects.
    assert kind.twist_of is not None
    return np.stack(kind.twist_of(rolling, true), axis=1), np.stack(true, axis=1)


def passed_torque(
    structure: ModelStructure[Geometry], geometry: Geometry, theta: Array, samples: Samples
) -> Array:
    """(N, J) of the logged torques what channels that are not affine let pass."""
    s = samples
    if not structure.has_nonlinear_channel:
        return s.torque
    at = Instant(tuple(s.twist.T), time=s.time, start=s.start)
    taken = dynamics.taken_torque(np, structure, geometry, theta, tuple(s.torque.T), at)
    return s.torque - np.stack(taken, axis=1)


def _smoothed(signal: Array, window: float) -> Array:
    found = np.empty_like(signal)
    for k, column in enumerate(signal.T):
        found[:, k] = smoothed(column, window)
    return found


LOAD_STEP = 5e-7
"""Share of the full torque over which the slope of a friction under load is taken."""

LOAD_TOLERANCE = 5e-11
"""Share of the full torque by which torques under load may still move when they count as found."""


def _ends(signal: Array) -> tuple[Array, ...]:
    """Components (2, N - 1) of a signal at the start and at the end of each interval."""
    return tuple(np.stack([signal[:-1, i], signal[1:, i]]) for i in range(signal.shape[1]))


class DemandedForce(Generic[Geometry]):
    """Force (2, N - 1, A) demanded at both ends of each interval, and its columns in theta.

    The acceleration's mean over an interval is the difference of the twist, so the filtered force
    holds the paper's filtered derivative a_f (s - s_f). ``silent``: indices of the parameters of
    effects that do not act in this log.
    """

    def __init__(
        self,
        structure: ModelStructure[Geometry],
        geometry: Geometry,
        force_scale: Array,
        declared: Sequence[Parameter],
        theta: Array,
        samples: Samples,
        settings: MechanismSettings,
        like: DemandedForce[Geometry] | None = None,
        silent: frozenset[int] = frozenset(),
    ) -> None:
        self.silent = silent
        self.structure, self.geometry, self.force_scale = structure, geometry, force_scale
        self.declared, self.theta, self.logged = declared, theta, samples
        self.settings = settings
        self.mechanism = structure.mechanism
        self.samples = rolled(structure, geometry, theta, samples, settings)
        self.rolling = dynamics.rolling_geometry(np, structure, geometry, theta)
        self.instant = like.instant if like else self._instant()
        self._like = like
        known = like is not None and like.structure.depends_on_load
        if structure.depends_on_load and not known:
            self.instant = replace(self.instant, torque=self._loads())

    def _loads(self) -> Components[Array]:
        internal: Components[Array] = ()
        if self._nominal_forceless:
            amount = self._acting_internal(self.theta)
            internal = tuple(part * amount for part in self._forceless)
        return dynamics.acting_torque(
            np,
            self.structure,
            self.geometry,
            self.theta,
            self.instant,
            internal=internal,
            tolerance=LOAD_TOLERANCE * self._full_torque,
        )

    @property
    def joint_torque(self) -> Components[Array]:
        """(J) of (2, N - 1): torques that act at the joints, with what exerts no force."""
        if self.structure.depends_on_load:
            return cast("Components[Array]", self.instant.torque)
        return self._loads()

    @cached_property
    def _nominal_forceless(self) -> tuple[float, ...]:
        return self.mechanism.internal(self.geometry)

    @cached_property
    def _forceless(self) -> Array:
        """(J,) torques that exert no force with the joints as they roll, sized as nominal ones."""
        nominal = np.array(self._nominal_forceless)
        if not self.structure.at(CONTACT):
            return nominal
        units = np.eye(len(self.mechanism.joints))
        forces = [self.mechanism.force_of(self.rolling, tuple(unit)) for unit in units]
        # The part of the nominal ones that the Jacobian's columns do not reach.
        reached, _ = np.linalg.qr(np.array(forces, float))
        left = nominal - reached @ (reached.T @ nominal)
        return left * np.linalg.norm(nominal) / np.linalg.norm(left)

    @cached_property
    def _full_torque(self) -> float:
        return self.mechanism.full_torque(self.geometry)

    def _instant(self) -> Instant[Array]:
        s = self.samples
        # Each axis by itself: many formulas read it, and between others it is read three times as
        # slowly.
        acceleration = tuple(np.moveaxis(slope_ends(s.twist, s.dt), -1, 0).copy())
        return Instant(
            twist=_ends(s.twist),
            acceleration=acceleration,
            pose=_ends(s.pose),
            wheel_angle=_ends(s.wheel_angle),
            time=np.stack([s.time[:-1], s.time[1:]]),
            start=s.start,
        )

    @cached_property
    def force(self) -> Array:
        """(2, N - 1, A) in units of the interface torque (as logged or commanded)."""
        return self._finish(self._body_force, self.theta)

    @cached_property
    def _body_force(self) -> Array:
        return sum(
            (
                self._component(item, self.theta[where], self.theta)
                for item, where in self.structure.wrenches
            ),
            start=self._no_force,
        )

    def _component(
        self,
        item: Effect,
        values: Array,
        theta: Array,
        joint: int | None = None,
    ) -> Array:
        """Its force (2, N - 1, A) at some values of its parameters, beside all others of theta."""
        smooth = item.name in self.structure.smooth_components
        points = self._points_of_samples if smooth else self._points
        if theta is not self.theta:
            points = points.at_theta(theta)
        force = component_force(item, values, points, joint)
        if not smooth:
            return self._scaled(force)
        # The same at the end of an interval and at the start of the next.
        return np.stack(at_both_ends(self._scaled(force, len(self.samples))))

    @property
    def _no_force(self) -> Array:
        return np.zeros((2, len(self.samples) - 1, len(self.force_scale)))

    def _scaled(self, force: Components[Array], *shape: int) -> Array:
        """(..., A) of components of some shape; by default at both ends of each interval."""
        shape = shape or (2, len(self.samples) - 1)
        out = np.empty((*shape, len(self.force_scale)))
        for i, scale in enumerate(self.force_scale):
            np.multiply(force[i], scale, out=out[..., i])
        return out

    def _unscaled(self, force: Array) -> Components[Array]:
        """Components of the generalised force behind a scaled one (..., A)."""
        return tuple(np.moveaxis(force / self.force_scale, -1, 0))

    @cached_property
    def _losses(self) -> list[list[Array]] | None:
        """I - dF/dF of friction under load: more force takes more torque, which loses more.

        Rows of A x A matrices, one at each instant; None where no effect reads the torque.
        """
        if not self.structure.depends_on_load:
            return None
        slopes, size = self._loss_slopes, len(self.force_scale)
        identity = np.eye(size)
        units = [self.mechanism.torque_of(self.rolling, tuple(unit)) for unit in identity]
        # What a unit of each force asks of the joints, times what they lose by it.
        lost = [sum(share * slope for share, slope in zip(u, slopes, strict=True)) for u in units]
        return [[identity[i, j] - np.asarray(lost[j])[i] for j in range(size)] for i in range(size)]

    @cached_property
    def _loss_slopes(self) -> list[Array]:
        return [self._loss_by(joint) for joint in range(len(self.mechanism.joints))]

    def _loss_by(self, joint: int) -> Array:
        """(A, 2, N - 1): by how much the force lost grows with one joint's torque."""
        step = LOAD_STEP * self._full_torque
        ends: list[Array] = []
        for shift in (step, -step):
            torque = list(self.instant.torque)
            torque[joint] = torque[joint] + shift
            at = replace(self.instant, torque=tuple(torque))
            points = dynamics.effect_points(np, self.structure, self.geometry, self.theta, at)
            readers = self.structure.load_readers
            forces = [component_force(r, self.theta[where], points) for r, where in readers]
            ends.append(np.sum(forces, axis=0))
        return (ends[0] - ends[1]) / (2 * step)

    def _responding(self, force: Array) -> Array:
        """A small force together with what friction under load makes of it."""
        if self._losses is None:
            return force
        return self._scaled(dynamics.solve(self._losses, self._unscaled(force)))

    def _finish(self, force: Array, theta: Array) -> Array:
        """From the force that acts to the force of the interface torque."""
        delay = dynamics.torque_delay(np, self.structure, theta)
        # What acts at t + delay was logged at t. The measured side stays as it is: to shift or
        # filter it would shrink its noise and make any delay look good.
        return moved(self._interface(force, theta), float(delay) / self.samples.dt)

    def _interface(self, force: Array, theta: Array) -> Array:
        structure, geometry = self.structure, self.geometry
        if structure.only_wrenches:
            return force
        at = self._acting(force)
        logged = self._logged(theta, at)
        if (structure.at(CHANNEL) or structure.at(CONTACT)) and self._nominal_forceless:
            own = theta is self.theta
            way = self._own_internal_way if own else self._internal_way(theta, at, logged)
            logged = self._with_internal(logged, way)
        # As the measured force: that of the nominal geometry.
        return self._scaled(self.mechanism.force_of(geometry, logged))

    def _acting(self, force: Array) -> Instant[Array]:
        """The motion with the torques that exert a force (2, N - 1, A), and their rates."""
        torque = self.mechanism.torque_of(self.rolling, self._unscaled(force))
        rate, second = self._rates(torque)
        return replace(self.instant, torque=torque, torque_rate=rate, torque_second_rate=second)

    def _with_internal(self, logged: Components[Array], way: Sequence[Array]) -> Components[Array]:
        """Logged torques moved along internal ones until they hold what was logged.

        Where gains differ by joint, or joints roll unevenly, torques that seem to cancel do not.
        """
        internal = np.array(self._nominal_forceless)
        size = internal @ internal
        lacking = self._internal - internal @ np.stack(logged, axis=1) / size
        amount = lacking / (internal @ np.stack(way, axis=1) / size)
        return tuple(torque + amount * step for torque, step in zip(logged, way, strict=True))

    def _internal_way(
        self, theta: Array, at: Instant[Array], logged: Components[Array]
    ) -> list[Array]:
        """(J) by how much logged torques rise with internal ones that act, (2, N - 1) each.

        ``logged``: at the torques of ``at``.
        """
        rows = zip(at.torque, self._forceless, strict=True)
        more = replace(at, torque=tuple(torque + part for torque, part in rows))
        along = self._logged(theta, more)
        return [b - a for a, b in zip(logged, along, strict=True)]

    @cached_property
    def _own_internal_way(self) -> list[Array]:
        """The same at theta, for all columns: what is logged is affine in the torques that act."""
        at = self._acting(self._body_force)
        return self._internal_way(self.theta, at, self._logged(self.theta, at))

    def _logged(self, theta: Array, at: Instant[Array]) -> Components[Array]:
        """(J) logged torques, (2, N - 1) each, of those of ``at``."""
        said = self._said(theta)
        return dynamics.interface_torque(np, self.structure, self.geometry, theta, at, said)

    def _said(self, theta: Array) -> Sequence[Components[Array]]:
        """Torques (2, N - 1) that were logged for what acts, and these behind each channel.

        Of channels that need to know them; () if there are none.
        """
        if not self.structure.has_nonlinear_channel:
            return ()
        return self._own_said if theta is self.theta else self._said_at(theta)

    @cached_property
    def _own_said(self) -> Sequence[Components[Array]]:
        """The same at theta, for all columns."""
        return self._said_at(self.theta)

    def _said_at(self, theta: Array) -> Sequence[Components[Array]]:
        torque = self.samples.torque
        delay = float(dynamics.torque_delay(np, self.structure, theta)) / self.samples.dt
        said = moved(np.stack([torque[:-1], torque[1:]]), -delay)
        logged = tuple(np.moveaxis(said, -1, 0))
        structure, geometry = self.structure, self.geometry
        return dynamics.torque_behind_channels(np, structure, geometry, theta, logged, self.instant)

    @cached_property
    def _internal(self) -> Array:
        """(2, N - 1) of the logged torques, at both ends of each interval [N m]."""
        return self._internal_of(self.samples.torque, np.array(self._nominal_forceless))

    def _acting_internal(self, theta: Array) -> Array:
        """The same of the torques behind the channels: what acts there loads the wheels."""
        s, structure = self.samples, self.structure
        if not (structure.at(CHANNEL) or structure.at(CONTACT)):
            return self._internal
        at = Instant(tuple(s.twist.T), time=s.time, start=s.start)
        true = dynamics.channel_torque(np, structure, self.geometry, theta, tuple(s.torque.T), at)
        return self._internal_of(np.stack(true, axis=1), self._forceless)

    def _internal_of(self, torque: Array, internal: Array) -> Array:
        """(2, N - 1) how much of the internal torques torques (N, J) hold, smoothed."""
        window = self.settings.internal_torque_smoothing_time / self.samples.dt
        amount = smoothed(torque @ internal / (internal @ internal), window)
        return _ends(amount[:, None])[0]

    def _rates(
        self, torque: tuple[Array, ...]
    ) -> tuple[tuple[Array, ...], Components[Array | float]]:
        """First and second rates of the acting torques: differences between smoothed samples."""
        order, dt = self.structure.drive_order, self.samples.dt
        if order == 0:
            return torque, torque  # nobody asks
        rates: list[Array] = []
        second: list[Array] = []
        window = self.settings.torque_rate_smoothing_time / dt
        for value in torque:
            node = np.concatenate(
                [value[0, :1], 0.5 * (value[1, :-1] + value[0, 1:]), value[1, -1:]]
            )
            slope = np.diff(smoothed(node, window)) / dt
            rates.append(np.broadcast_to(slope, value.shape))
            if order > 1:
                bend = np.gradient(smoothed(slope, window), dt)
                second.append(np.broadcast_to(bend, value.shape))
        return tuple(rates), tuple(second) or (0.0,) * len(torque)

    def columns(self, indices: Iterable[int]) -> Array:
        """d force / d theta[i] for each index: (len(indices), 2, N - 1, A).

        Base parameters that nothing else refers to enter linearly, so theirs is the function on a
        unit vector; others take a difference over a small part of their catalogue size. What is
        silent in this log has columns of zeros.
        """
        none = np.zeros((2, len(self.samples) - 1, len(self.force_scale)))
        found = [none if int(i) in self.silent else self._column(int(i)) for i in indices]
        return np.stack(found) if found else np.zeros((0, *self.force.shape))

    def _column(self, index: int) -> Array:
        structure = self.structure
        item, where = next(row for row in structure.slices if index < row[1].stop)
        step = self.declared[index].difference
        if item.acts_at in (CONTACT, SPEED):
            theta, width = self._apart(index, step)
            ahead, behind = (self._at(moved).force for moved in theta)
            return (ahead - behind) / width
        if item.acts_at.kind != "wrench":
            theta, width = self._apart(index, step)
            more = 0.5 * self._lost_between(*theta)
            ahead = self._finish(self._body_force + more, theta[0])
            behind = self._finish(self._body_force - more, theta[1])
            return (ahead - behind) / width
        slope = self._responding(self._slope(item, where, index, step))
        if structure.only_wrenches:
            return self._finish(slope, self.theta)
        # From force to interface all is affine, or a drive of somebody's own: a small step does.
        return (self._finish(self._body_force + step * slope, self.theta) - self.force) / step

    def _at(self, theta: Array) -> DemandedForce[Geometry]:
        """The same of another theta, which may tell of another motion."""
        known = (self.structure, self.geometry, self.force_scale, self.declared)
        return DemandedForce(*known, theta, self.logged, self.settings)

    def _lost_between(self, ahead: Array, behind: Array) -> Array | float:
        """By how much the force lost under load differs between two theta of drives and channels.

        What acts behind the channels loads the wheels, internal torques with the rest.
        """
        structure = self.structure
        internal = self._nominal_forceless
        if not (internal and structure.depends_on_load and structure.at(CHANNEL)):
            return 0.0
        moved = self._acting_internal(ahead) - self._acting_internal(behind)
        parts = zip(self._forceless, self._loss_slopes, strict=True)
        none = np.zeros((len(self.force_scale), 1, 1))
        lost = sum((part * slope for part, slope in parts), start=none)
        return self._responding(self._scaled(tuple(lost * moved)))

    def _slope(self, owner: Effect, where: slice, index: int, step: float) -> Array:
        """d (body force) / d theta[index], from the components alone that the parameter enters."""
        if self._stands_alone(owner, index):
            # Linear: the force of this parameter alone is its column, times its size.
            size = self.declared[index].size
            shapes = [parameter.is_shape for parameter in self.declared]
            values = np.where(shapes, self.theta, 0.0)
            values[index] = size
            parameter = self.declared[index]
            name = self.structure.parameter_names[index].rpartition(".")[2]
            joint = parameter.names.index(name) if parameter.each_wheel else None
            return self._component(owner, values[where], self.theta, joint) / size
        theta, width = self._apart(index, step)
        ahead, behind = (self._entered(owner, moved) for moved in theta)
        return (ahead - behind) / width

    def _apart(self, index: int, step: float) -> tuple[Array, float]:
        """(2, P) theta to both sides of itself in one parameter, and how far apart they are."""
        theta, back = np.tile(self.theta, (2, 1)), step
        if self.declared[index].is_shape:
            # Not beyond its bound: a period at its least would be tried at zero.
            back = float(np.clip(self.theta[index] - self.declared[index].lower, 0.0, step))
        theta[:, index] += (step, -back)
        return theta, step + back

    def _stands_alone(self, owner: Effect, index: int) -> bool:
        """Whether a parameter enters one component alone, and linearly."""
        structure = self.structure
        if owner.name in self.mechanism.base and structure.base_readers:
            return False
        linear = owner.name not in structure.nonlinear and not self.declared[index].is_shape
        return linear and owner.carries is None

    def _entered(self, owner: Effect, theta: Array) -> Array:
        """At theta moved in one of the owner's parameters, the force of all that this enters."""
        structure = self.structure
        if owner.name not in self.mechanism.base and owner.carries is None:
            where = next(place for item, place in structure.slices if item is owner)
            return self._component(owner, theta[where], self.theta)
        changed = {owner.name, *structure.base_readers}
        return sum(
            (
                self._component(item, theta[where], theta)
                for item, where in structure.wrenches
                if item.name in changed
            ),
            start=self._no_force,
        )

    @cached_property
    def _points(self) -> EffectPoints[Geometry, Array]:
        """At both ends of each interval."""
        like = self._like
        return self._points_at(self.instant, like._points if like else None)

    @cached_property
    def _points_of_samples(self) -> EffectPoints[Geometry, Array]:
        """At each sample, for what reads no acceleration."""
        s, known = self.samples, self._like._points_of_samples if self._like else None
        if known:
            return self._points_at(known.at, known)
        parts = (tuple(part.T.copy()) for part in (s.twist, s.pose, s.wheel_angle))
        twist, pose, angle = parts
        none = (np.nan,) * len(twist)  # nobody reads it: who did would see
        return self._points_at(Instant(twist, none, pose, angle, time=s.time, start=s.start))

    def _points_at(
        self, at: Instant[Array], known: EffectPoints[Geometry, Array] | None = None
    ) -> EffectPoints[Geometry, Array]:
        """Where effects act; ``known``: those of the structure that this one extends."""
        found = dynamics.effect_points(np, self.structure, self.geometry, self.theta, at)
        if known is None or known.at is not at or known.geometry is not found.geometry:
            return found
        return found.sharing(known)
