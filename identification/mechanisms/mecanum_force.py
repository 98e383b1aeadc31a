"""Force that a platform's logged motion demands, and its columns in the parameters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mecanum_samples import INTERNAL, MecanumSamples, internal_of
from identification.mechanisms.mechanism import labels_of
from identification.mechanisms.paper_regressor import force_scale
from identification.signals.filters import slope_ends
from identification.signals.resampling import RATE_SMOOTHING, moved, smoothed
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import BASE, CHANNEL, Effect
from youbot_env.physics.geometry import Geometry, Triple, allocate, body_force
from youbot_env.physics.points import EffectPoints, Instant, component_wrench
from youbot_env.physics.structure import ModelStructure

Array = NDArray[np.float64]


LOAD_STEP = 1e-6
"""Torque [N m] over which the slope of a friction under load is taken."""

Rows3 = list[list[Any]]
"""Rows of 3x3 matrices, one at each instant."""


def _ends(signal: Array) -> tuple[Array, ...]:
    """Components (2, N - 1) of a signal at the start and at the end of each interval."""
    return tuple(np.stack([signal[:-1, i], signal[1:, i]]) for i in range(signal.shape[1]))


class MecanumForce:
    """Force (2, N - 1, 3) demanded at both ends of each interval, and its columns in theta.

    The acceleration's mean over an interval is the difference of the twist, so the filtered force
    holds the paper's filtered derivative a_f (s - s_f).
    """

    def __init__(
        self,
        structure: ModelStructure,
        geometry: Geometry,
        theta: Array,
        samples: MecanumSamples,
        like: MecanumForce | None = None,
    ) -> None:
        self.structure, self.geometry = structure, geometry
        self.theta, self.samples = theta, samples
        self.labels = labels_of(structure)
        self.instant = like.instant if like else self._instant()
        known = like is not None and like.structure.depends_on_load
        if structure.depends_on_load and not known:
            torque = dynamics.acting_torque(
                *(np, structure, geometry, theta, self.instant),
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
                for item, where in self.structure.wrenches
            ),
            start=np.zeros((2, len(self.samples) - 1, 3)),
        )

    def _component(self, item: Effect, values: Array, points: EffectPoints) -> Array:
        return self._scaled(component_wrench(np, item, values, points))

    def _scaled(self, force: Triple) -> Array:
        shape = (2, len(self.samples) - 1)
        scale = force_scale(self.geometry)
        out = np.empty((*shape, 3))
        for i in range(3):
            np.multiply(force[i], scale[i], out=out[..., i])
        return out

    def _unscaled(self, force: Array) -> Triple:
        """(F_X, F_Y, M_W) [N, N, N m] of a scaled force (..., 3)."""
        return tuple(np.moveaxis(force / force_scale(self.geometry), -1, 0))  # type: ignore

    @cached_property
    def _losses(self) -> Rows3 | None:
        """I - dF/dF of friction under load: more force takes more torque, which loses more.

        None where no effect reads the torque.
        """
        structure, geometry = self.structure, self.geometry
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
            points = EffectPoints(np, self.geometry, self.theta, at, self.structure.carriers)
            readers = self.structure.load_readers
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
        delay = dynamics.torque_delay(np, self.structure, theta)
        # What acts at t + delay was logged at t. The measured side stays as it is: to shift or
        # filter it would shrink its noise and make any delay look good.
        return moved(self._interface(force, theta), float(delay) / self.samples.dt)

    def _interface(self, force: Array, theta: Array) -> Array:
        structure, geometry = self.structure, self.geometry
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
        along = dynamics.interface_torque(np, self.structure, theta, replace(at, torque=more))
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
        s, structure = self.samples, self.structure
        if not structure.at(CHANNEL):
            return self._internal
        true = dynamics.channel_torque(np, structure, theta, tuple(s.torque.T), s.time)
        return _ends(internal_of(np.stack(true, axis=1), s.dt)[:, None])[0]

    def _rates(self, torque: tuple[Array, ...]) -> tuple[Array, ...]:
        """Rates of the acting torques: differences between smoothed samples."""
        if not self.structure.has_actuator:
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
        structure = self.structure
        item, where = next(row for row in structure.slices if index < row[1].stop)
        step = self.labels[index].parameter.difference
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
        structure = self.structure
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
            size = self.labels[index].parameter.size
            shapes = [label.parameter.is_shape for label in self.labels]
            values = np.where(shapes, self.theta, 0.0)
            values[index] = size
            return self._component(owner, values[where], self._points) / size
        ahead, behind = (self._entered(owner, index, sign * step) for sign in (1.0, -1.0))
        return (ahead - behind) / (2 * step)

    def _stands_alone(self, owner: Effect, index: int) -> bool:
        """Whether a parameter enters one component alone, and linearly."""
        structure = self.structure
        if owner.name in BASE and structure.base_readers:
            return False
        linear = owner.name not in structure.nonlinear and not self.labels[index].parameter.is_shape
        return linear and owner.carries is None

    def _entered(self, owner: Effect, index: int, shift: float) -> Array:
        """With one parameter moved, the force of the components that it enters, alone."""
        structure = self.structure
        theta = self.theta.copy()
        theta[index] += shift
        if owner.name not in BASE and owner.carries is None:
            where = next(place for item, place in structure.slices if item is owner)
            return self._component(owner, theta[where], self._points)
        changed = {owner.name, *structure.base_readers}
        points = EffectPoints(np, self.geometry, theta, self.instant, structure.carriers)
        return sum(
            (
                self._component(item, theta[where], points)
                for item, where in structure.wrenches
                if item.name in changed
            ),
            start=np.zeros((2, len(self.samples) - 1, 3)),
        )

    @cached_property
    def _points(self) -> EffectPoints:
        structure, geometry = self.structure, self.geometry
        return EffectPoints(np, geometry, self.theta, self.instant, structure.carriers)
