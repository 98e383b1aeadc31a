"""The mecanum platform as the identification engine sees it.

The engine knows a mechanism by a handful of methods: samples of a log, measured and demanded
generalised forces, columns of the regressor, a free run. Forces are (L F_X, L F_Y, M_W) [N m] and
speeds (VX/L, VY/L, W) [rad/s] as in the paper, so that all axes weigh alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.filters import FILTER_RATE, slope_ends
from identification.logs import Log
from identification.mechanism import Label, Mechanism
from identification.noise import white_noise
from identification.resampling import RATE_SMOOTHING, moved, smoothed
from youbot_env import dynamics
from youbot_env.effects import BASE, CATALOGUE, CHANNEL, Effect, Parameter
from youbot_env.errors import InputError
from youbot_env.geometry import WHEELS, Geometry, Triple, allocate, body_force
from youbot_env.points import Instant, Points, component_wrench
from youbot_env.structure import Structure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """One log as motion and torque on a uniform time base.

    name : of the log; time (N,) [s] from the log's start; dt [s]
    twist (N, 3) body frame [m/s, m/s, rad/s]; pose (N, 3) world [m, m, rad]
    wheel_angle, wheel_speed (N, 4) [rad, rad/s]; torque (N, 4) as logged [N m]
    internal (N,): the part of the torque that does not move the platform, see INTERNAL [N m]
    angle_measured : whether the angles have columns of their own, or are integrated
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

    def __len__(self) -> int:
        return len(self.time)

    @property
    def channels(self) -> tuple[Array, Array]:
        """Wheel speeds and torques (N, 4)."""
        return self.wheel_speed, self.torque

    @cached_property
    def internal(self) -> Array:
        """(N,) how much of ``INTERNAL`` the logged torques hold [N m]."""
        return internal_of(self.torque, self.dt)


INTERNAL = np.array([1.0, 1.0, -1.0, -1.0])
"""Four torques that exert no force: what a motion demands settles three, and leaves this free."""

INTERNAL_SMOOTHING = 0.05
"""Window [s] over which the internal torque is averaged: its noise would enter the columns."""


def internal_of(torque: Array, dt: float) -> Array:
    """(N,) how much of ``INTERNAL`` torques (N, 4) hold, smoothed [N m]."""
    return smoothed(torque @ INTERNAL / 4.0, INTERNAL_SMOOTHING / dt)


SLIPPING = 4.0
"""Deviations of the random walk that noise on a wheel's speed makes; beyond them it slips."""

ROUGH = 0.02
"""Angle [rad] that a pose may be off by rounding and by turning between samples."""


def _integrate(rate: Array, dt: float) -> Array:
    total = np.zeros_like(rate)
    np.cumsum(0.5 * dt * (rate[1:] + rate[:-1]), axis=0, out=total[1:])
    return total


def _wheel_angles(log: Log, geometry: Geometry, dt: float) -> tuple[Array, bool]:
    """Wheel angles (N, 4) [rad] and whether they are free of drift.

    Position columns are taken as they are. Integrated speeds drift with their noise, which blurs
    what is periodic in the angle; where the wheels do not slip, a pose shows the way they went.
    """
    if log.position is not None:
        return log.position, True
    integrated = _integrate(log.velocity, dt)
    if log.pose is None:
        return integrated, False
    yaw = log.pose[:, 2]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    c, s = np.cos(middle), np.sin(middle)
    dx, dy, turn = np.diff(log.pose, axis=0).T
    # From the chord to the arc that was driven: a part in 10^5, but a ripple counts each turn.
    arc = 1.0 / np.sinc(turn / (2 * np.pi))
    dx, dy = arc * dx, arc * dy
    way = geometry.wheel_speeds(np.column_stack([c * dx + s * dy, c * dy - s * dx, turn]))
    rolled = np.vstack([np.zeros(4), np.cumsum(way, axis=0)])
    drift = white_noise(log.velocity) * np.sqrt(dt * dt * len(log))
    # Noise alone leaves a random walk; anything beyond is slip, and the wheels know better.
    slips = np.abs(rolled - integrated).max(axis=0) > SLIPPING * drift + ROUGH
    return (integrated, False) if slips.any() else (rolled, True)


def samples_of(log: Log, geometry: Geometry) -> Samples:
    """Motion and torque of a log.

    The twist is the least-squares projection of the four wheel speeds. Without pose columns the
    pose is integrated from the wheels from (0, 0, 0); without positions wheel angles start at 0.

    Raises
    ------
    InputError
        If the log is not that of a platform with four wheels.
    """
    if tuple(log.joints) != WHEELS:
        raise InputError(f"{log.source or log.name}: not the log of a mecanum platform")
    time = log.time - log.time[0]
    dt = float(time[-1] / (len(time) - 1))
    twist = geometry.body_twist(log.velocity)
    if log.pose is not None:
        pose = log.pose
    else:
        yaw = _integrate(twist[:, 2], dt)
        c, s = np.cos(yaw), np.sin(yaw)
        velocity = np.column_stack(
            [c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]]
        )
        pose = np.column_stack([_integrate(velocity, dt), yaw])
    angle, measured = _wheel_angles(log, geometry, dt)
    return Samples(log.name, time, dt, twist, pose, angle, log.velocity, log.effort, measured)


LOAD_STEP = 1e-6
"""Torque [N m] over which the slope of a friction under load is taken."""

Rows3 = list[list[Any]]
"""Rows of 3x3 matrices, one at each instant."""

PAPER_ORDER = (0, 1, 4, 2, 3, 5, 6)
"""theta's base parameters (m0, I0, m_aX, m_aY, I1, mu1, mu2) in the order of x1 ... x7."""


@dataclass(frozen=True)
class Mecanum(Mechanism):
    """A mecanum platform with given effects: what it measures, demands and simulates."""

    geometry: Geometry
    structure: Structure = Structure()

    axes = ("VX", "VY", "W")
    joints = WHEELS
    filter_rate = FILTER_RATE
    scaling = "as in the paper"
    catalogue = CATALOGUE

    def with_effects(self, effects: tuple[str, ...]) -> Mecanum:
        """The same mechanism with other effects beside the base model."""
        return replace(self, structure=Structure(effects))

    def best_experiment(
        self,
        favourite: tuple[str, Mecanum, Array],
        rivals: list[tuple[str, Mecanum, Array]],
        noise: float,
        seed: int,
    ) -> dict[str, Any]:
        """See :func:`identification.experiments.best_experiment`."""
        from identification.experiments import best_experiment

        return best_experiment(favourite, rivals, noise, seed)

    @cached_property
    def force_scale(self) -> Array:
        """(3,) factors that turn (F_X, F_Y, M_W) into (L F_X, L F_Y, M_W)."""
        return np.array([self.geometry.L, self.geometry.L, 1.0])

    @cached_property
    def speed_scale(self) -> Array:
        """(3,) factors that turn (VX, VY, W) into (VX/L, VY/L, W)."""
        return 1.0 / self.force_scale

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What is known of each parameter beforehand, in the order of theta."""
        found = []
        for item, _ in self.structure.slices:
            for name in item.parameter_names:
                parameter = item.parameter(name)
                group = f"{item.name}.{parameter.name}" if parameter.relative_to else None
                found.append(Label(item.name, name, parameter, group))
        return tuple(found)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) and (P,): physical bounds; none on values relative to each other."""
        free = Parameter("", "")
        declared = [free if label.group else label.parameter for label in self.labels]
        return np.array([p.lower for p in declared]), np.array([p.upper for p in declared])

    @property
    def is_linear(self) -> bool:
        """Whether the demanded force is linear in the free parameters."""
        return self.structure.is_linear and not self.structure.nonlinear

    @cached_property
    def scale(self) -> Array:
        """(P,) factors from theta to the paper's x = (m0 L^2, I0, 4 I1 L^2/R^2, ...) [N m].

        Effects' parameters are scaled by their catalogue size.
        """
        g = self.geometry
        paper = {
            "m0": g.L**2,
            "I0": 1.0,
            "I1": 4 * g.L**2 / g.R**2,
            "m_aX": g.L,
            "m_aY": g.L,
            "mu1": 4 * g.L**2 / g.R**2,
            "mu2": 8 * g.h**2 / g.r**2,
        }
        return np.array(
            [paper.get(label.name, 1.0 / label.parameter.size) for label in self.labels]
        )

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """Indices of the free parameters in the order of the paper's x1 ... x7, effects after."""
        rest = np.flatnonzero(self.free)[len(PAPER_ORDER) :]
        return np.array([*PAPER_ORDER, *rest], dtype=np.intp)

    def samples(self, log: Log) -> Samples:
        """See :func:`samples_of`."""
        return samples_of(log, self.geometry)

    def measured_force(self, samples: Samples) -> Array:
        """(N, 3) generalised force of the logged torques [N m]."""
        return self.geometry.body_force(samples.torque) * self.force_scale

    def measured_speed(self, samples: Samples) -> Array:
        """(N, 3) measured speeds (VX/L, VY/L, W) [rad/s]."""
        return samples.twist * self.speed_scale

    def joint_speed(self, speed: Array) -> Array:
        """(N, 4) wheel speeds [rad/s] for speeds (VX/L, VY/L, W) (N, 3)."""
        return self.geometry.wheel_speeds(speed / self.speed_scale)

    def noisy(
        self, samples: Samples, speed: Array, torque: Array, rng: np.random.Generator
    ) -> Samples:
        """The samples with white noise of these standard deviations (4,) put on."""
        shape = samples.torque.shape
        extra = speed * rng.standard_normal(shape)
        # Angles that are integrated from the speeds drift with their noise; a ripple sees it.
        drift = 0.0 if samples.angle_measured else _integrate(extra, samples.dt)
        return replace(
            samples,
            wheel_angle=samples.wheel_angle + drift,
            twist=samples.twist + self.geometry.body_twist(extra),
            wheel_speed=samples.wheel_speed + extra,
            torque=samples.torque + torque * rng.standard_normal(shape),
        )

    def parts(self, samples: Samples) -> list[Any]:
        """Stretches that are judged apart: the calibration motions in the log."""
        from identification.segments import parts_of

        return parts_of(samples)

    def advice(self, direction: Array) -> str:
        """What to record where the parameters' ``direction`` (F,) in x cannot be seen."""
        from identification.observability import motion_that_shows

        return (
            f"record motion {motion_that_shows(self, direction)} too "
            f"(youbot record --motions, or drive it) and give both logs"
        )

    def fitted_model(self, fit: Any, **about: Any) -> Any:
        """See :func:`identification.physical.fitted_model`."""
        from identification.physical import fitted_model

        return fitted_model(self, fit, **about)

    def warnings(self, model: Any) -> list[str]:
        """See :func:`identification.plausibility.warnings_of`."""
        from identification.plausibility import warnings_of

        return warnings_of(model)

    def free_run(self, theta: Array, samples: Samples) -> Array:
        """(N, 3) speeds (VX/L, VY/L, W) from the log's first sample, driven by its torques alone.

        A run that diverges holds inf or NaN from there on.
        """
        from youbot_env.simulate import simulate_theta  # numba, which a force fit does without

        start = [*samples.twist[0], *samples.pose[0], *samples.wheel_angle[0], samples.time[0]]
        if self.structure.has_actuator:
            start += list(
                dynamics.channel_torque(np, self.structure, theta, samples.torque[0], 0.0)
            )
        duration = np.full(len(samples) - 1, samples.dt)
        states = simulate_theta(
            self.structure, self.geometry, theta, duration, samples.torque, start
        )
        return states[:, :3] * self.speed_scale

    def demand(self, theta: Array, samples: Samples) -> Demand:
        """Generalised force that the logged motion demands at parameters theta (P,)."""
        return Demand(self, np.asarray(theta, float), samples)


def _ends(signal: Array) -> tuple[Array, ...]:
    """Components (2, N - 1) of a signal at the start and at the end of each interval."""
    return tuple(np.stack([signal[:-1, i], signal[1:, i]]) for i in range(signal.shape[1]))


class Demand:
    """Force (2, N - 1, 3) demanded at both ends of each interval, and its columns in theta.

    The acceleration's mean over an interval is the difference of the twist, so the filtered force
    holds the paper's filtered derivative a_f (s - s_f).
    """

    def __init__(self, mechanism: Mecanum, theta: Array, samples: Samples) -> None:
        self.mechanism, self.theta, self.samples = mechanism, theta, samples
        self.instant = self._instant()
        if mechanism.structure.depends_on_load:
            torque = dynamics.acting_torque(
                *(np, mechanism.structure, mechanism.geometry, theta, self.instant),
                internal=tuple(part * self._acting_internal(theta) for part in INTERNAL),
                tolerance=1e-10,
            )
            self.instant = replace(self.instant, torque=torque)

    def _instant(self) -> Instant:
        s = self.samples
        ends = slope_ends(s.twist, s.dt)
        acceleration = tuple(np.moveaxis(ends, -1, 0))
        return Instant(
            twist=_ends(s.twist),  # type: ignore[arg-type]
            acceleration=acceleration,  # type: ignore[arg-type]
            pose=_ends(s.pose),  # type: ignore[arg-type]
            wheel_angle=_ends(s.wheel_angle),
            time=np.stack([s.time[:-1], s.time[1:]]),
        )

    @cached_property
    def force(self) -> Array:
        """(2, N - 1, 3) [N m] in units of the interface torque (as logged or commanded)."""
        return self._finish(self._body_force, self.theta)

    @cached_property
    def _body_force(self) -> Array:
        return sum(
            (
                self._component(item, self.theta[where], self._points)
                for item, where in self.mechanism.structure.wrenches
            ),
            start=np.zeros((2, len(self.samples) - 1, 3)),
        )

    def _component(self, item: Effect, values: Array, points: Points) -> Array:
        return self._scaled(component_wrench(np, item, values, points))

    def _scaled(self, force: Triple) -> Array:
        shape = (2, len(self.samples) - 1)
        scale = self.mechanism.force_scale
        out = np.empty((*shape, 3))
        for i in range(3):
            np.multiply(force[i], scale[i], out=out[..., i])
        return out

    def _unscaled(self, force: Array) -> Triple:
        """(F_X, F_Y, M_W) [N, N, N m] of a scaled force (..., 3)."""
        return tuple(np.moveaxis(force / self.mechanism.force_scale, -1, 0))  # type: ignore

    @cached_property
    def _losses(self) -> Rows3 | None:
        """I - dF/dF of friction under load: more force takes more torque, which loses more.

        None where no effect reads the torque.
        """
        structure, geometry = self.mechanism.structure, self.mechanism.geometry
        if not structure.depends_on_load:
            return None
        slopes = self._loss_slopes
        units = [allocate(geometry, tuple(unit)) for unit in np.eye(3)]  # type: ignore
        # What a unit of each force asks of the four wheels, times what they lose by it.
        lost = [sum(share * slope for share, slope in zip(u, slopes, strict=True)) for u in units]
        identity = np.eye(3)
        return [[identity[i, j] - np.asarray(lost[j])[i] for j in range(3)] for i in range(3)]

    @cached_property
    def _loss_slopes(self) -> list[Array]:
        return [self._loss_by(wheel) for wheel in range(4)]

    def _loss_by(self, wheel: int) -> Array:
        """(3, 2, N - 1): by how much the force lost grows with one wheel's torque."""
        ends = []
        for shift in (LOAD_STEP, -LOAD_STEP):
            torque = list(self.instant.torque)
            torque[wheel] = torque[wheel] + shift
            at = replace(self.instant, torque=tuple(torque))
            points = Points(
                np, self.mechanism.geometry, self.theta, at, self.mechanism.structure.carriers
            )
            readers = self.mechanism.structure.load_readers
            forces = [component_wrench(np, r, self.theta[where], points) for r, where in readers]
            ends.append(np.sum(forces, axis=0))
        return (ends[0] - ends[1]) / (2 * LOAD_STEP)

    def _responding(self, force: Array) -> Array:
        """A small force together with what friction under load makes of it."""
        if self._losses is None:
            return force
        return self._scaled(dynamics.solve3(self._losses, self._unscaled(force)))

    def _finish(self, force: Array, theta: Array) -> Array:
        """From the force that acts to the force of the interface torque."""
        delay = dynamics.torque_delay(np, self.mechanism.structure, theta)
        # What acts at t + delay was logged at t. The measured side stays as it is: to shift or
        # filter it would shrink its noise and make any delay look good.
        return moved(self._interface(force, theta), float(delay) / self.samples.dt)

    def _interface(self, force: Array, theta: Array) -> Array:
        structure, geometry = self.mechanism.structure, self.mechanism.geometry
        if structure.only_wrenches:
            return force
        torque = allocate(geometry, self._unscaled(force))
        at = replace(self.instant, torque=torque, torque_rate=self._rates(torque))
        logged = dynamics.interface_torque(np, structure, theta, at)
        if structure.at(CHANNEL):
            logged = self._with_internal(logged, theta, at)
        return self._scaled(body_force(geometry, logged))

    def _with_internal(
        self, logged: tuple[Array, ...], theta: Array, at: Instant
    ) -> tuple[Array, ...]:
        """Logged torques moved along the acting ones' ``INTERNAL`` until they hold what was logged.

        Where gains differ by wheel, torques that seem to cancel do not.
        """
        more = tuple(torque + part for torque, part in zip(at.torque, INTERNAL, strict=True))
        along = dynamics.interface_torque(
            np, self.mechanism.structure, theta, replace(at, torque=more)
        )
        way = [b - a for a, b in zip(logged, along, strict=True)]
        lacking = self._internal - INTERNAL @ np.stack(logged, axis=1) / 4.0
        amount = lacking / (INTERNAL @ np.stack(way, axis=1) / 4.0)
        return tuple(torque + amount * step for torque, step in zip(logged, way, strict=True))

    @cached_property
    def _internal(self) -> Array:
        """(2, N - 1) of the logged torques, at both ends of each interval [N m]."""
        return _ends(self.samples.internal[:, None])[0]

    def _acting_internal(self, theta: Array) -> Array:
        """The same of the torques behind the channels: what acts there loads the wheels."""
        s, structure = self.samples, self.mechanism.structure
        if not structure.at(CHANNEL):
            return self._internal
        true = dynamics.channel_torque(np, structure, theta, tuple(s.torque.T), s.time)
        return _ends(internal_of(np.stack(true, axis=1), s.dt)[:, None])[0]

    def _rates(self, torque: tuple[Array, ...]) -> tuple[Array, ...]:
        """Rates of the acting torques: differences between smoothed samples."""
        if not self.mechanism.structure.has_actuator:
            return torque  # nobody asks
        rates = []
        for value in torque:
            node = np.concatenate(
                [value[0, :1], 0.5 * (value[1, :-1] + value[0, 1:]), value[1, -1:]]
            )
            slope = np.diff(smoothed(node, RATE_SMOOTHING / self.samples.dt)) / self.samples.dt
            rates.append(np.broadcast_to(slope, value.shape))
        return tuple(rates)

    def columns(self, indices: Iterable[int]) -> Array:
        """d force / d theta[i] for each index: (len(indices), 2, N - 1, 3).

        Base parameters that nothing else refers to enter linearly, so theirs is the function on a
        unit vector; others take a difference over a small part of their catalogue size.
        """
        return np.stack([self._column(int(i)) for i in indices])

    def _column(self, index: int) -> Array:
        structure = self.mechanism.structure
        item, where = next(row for row in structure.slices if index < row[1].stop)
        step = self.mechanism.labels[index].parameter.difference
        if item.acts_at.kind != "wrench":
            theta = np.tile(self.theta, (2, 1))
            theta[:, index] += (step, -step)
            more = 0.5 * self._lost_between(*theta)
            ahead = self._finish(self._body_force + more, theta[0])
            behind = self._finish(self._body_force - more, theta[1])
            return (ahead - behind) / (2 * step)
        slope = self._responding(self._slope(item, where, index, step))
        if structure.only_wrenches:
            return self._finish(slope, self.theta)
        # From force to interface all is affine, or a drive of somebody's own: a small step does.
        return (self._finish(self._body_force + step * slope, self.theta) - self.force) / step

    def _lost_between(self, ahead: Array, behind: Array) -> Array | float:
        """By how much the force lost under load differs between two theta of drives and channels.

        What acts behind the channels loads the wheels, internal torques with the rest.
        """
        structure = self.mechanism.structure
        if not (structure.depends_on_load and structure.at(CHANNEL)):
            return 0.0
        moved = self._acting_internal(ahead) - self._acting_internal(behind)
        parts = zip(INTERNAL, self._loss_slopes, strict=True)
        lost = sum((part * slope for part, slope in parts), start=np.zeros((3, 1, 1)))
        return self._responding(self._scaled(tuple(lost * moved)))

    def _slope(self, owner: Effect, where: slice, index: int, step: float) -> Array:
        """d (body force) / d theta[index], from the components alone that the parameter enters."""
        if self._stands_alone(owner, index):
            # Linear: the force of this parameter alone is its column, times its size.
            size = self.mechanism.labels[index].parameter.size
            values = np.where(self.mechanism.free, 0.0, self.theta)
            values[index] = size
            return self._component(owner, values[where], self._points) / size
        ahead, behind = (self._entered(owner, index, sign * step) for sign in (1.0, -1.0))
        return (ahead - behind) / (2 * step)

    def _stands_alone(self, owner: Effect, index: int) -> bool:
        """Whether a parameter enters one component alone, and linearly."""
        structure = self.mechanism.structure
        if owner.name in BASE and structure.base_readers:
            return False
        linear = owner.name not in structure.nonlinear and bool(self.mechanism.free[index])
        return linear and owner.carries is None

    def _entered(self, owner: Effect, index: int, shift: float) -> Array:
        """With one parameter moved, the force of the components that it enters, alone."""
        structure = self.mechanism.structure
        theta = self.theta.copy()
        theta[index] += shift
        if owner.name not in BASE and owner.carries is None:
            where = next(place for item, place in structure.slices if item is owner)
            return self._component(owner, theta[where], self._points)
        changed = {owner.name, *structure.base_readers}
        points = Points(np, self.mechanism.geometry, theta, self.instant, structure.carriers)
        return sum(
            (
                self._component(item, theta[where], points)
                for item, where in structure.wrenches
                if item.name in changed
            ),
            start=np.zeros((2, len(self.samples) - 1, 3)),
        )

    @cached_property
    def _points(self) -> Points:
        structure, geometry = self.mechanism.structure, self.mechanism.geometry
        return Points(np, geometry, self.theta, self.instant, structure.carriers)
