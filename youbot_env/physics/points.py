"""What a motion is at one instant, the points at which effects then act, and what each demands.

Frames and arithmetic are those of :mod:`youbot_env.physics.inverse_dynamics`, which adds up the
demands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from youbot_env.physics.effect import BODY, WHEEL, WORLD, Body, Effect, Roller, Wheel, World
from youbot_env.physics.geometry import Triple, body_force, roller_force, roller_rates, wheel_rates


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


class EffectPoints:
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


def component_wrench(xp: Any, item: Effect, values: Any, points: EffectPoints) -> Triple:
    """One component's share of the generalised force: its own formula, moved to O."""
    if item.acts_at is BODY:
        return item.evaluate(xp, points.body, values)
    if item.acts_at is WORLD:
        return _world_force(xp, points.at.pose[2], item.evaluate(xp, points.world, values))
    if item.acts_at is WHEEL:
        torques = [item.evaluate(xp, point, values, i) for i, point in enumerate(points.wheels)]
        return body_force(points.geometry, torques)
    torques = [item.evaluate(xp, point, values, i) for i, point in enumerate(points.rollers)]
    return roller_force(points.geometry, torques)


def _world_force(xp: Any, yaw: Any, force: Triple) -> Triple:
    fx, fy, mz = force
    c, s = xp.cos(yaw), xp.sin(yaw)
    return c * fx + s * fy, c * fy - s * fx, mz


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
