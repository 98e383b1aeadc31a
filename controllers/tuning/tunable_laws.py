"""Control laws with free numbers, for tuning: as linear systems, and for many rows at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from controllers.interface import Array, Loop
from controllers.kinematic import Gains
from controllers.linear.linear_system import LinearSystem, drive_lag, effective_mass
from controllers.linear.margins import Complex, MarginSettings
from controllers.pid.design import (
    PIDGains,
    PIDSettings,
    bandwidths,
    linear_pid,
    response as pid_response,
)
from controllers.pid.pid import BodyLoops
from youbot_env.errors import check_settings
from youbot_env.model.model import Model
from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True)
class GainRanges:
    """Where the free numbers of the laws are sought."""

    proportional: tuple[float, float] = field(
        default=(0.01, 10.0),
        metadata={"unit": "N m s/rad", "reason": "three decades about the stock gain of 0.12"},
    )
    integral: tuple[float, float] = field(
        default=(0.03, 300.0),
        metadata={"unit": "N m/rad", "reason": "four decades about the stock gain of 0.30"},
    )
    min_lead: float = field(
        default=1e-3,
        metadata={"unit": "s", "reason": "no lead, as a point of a logarithmic grid"},
    )
    max_lead_beyond_delay: float = field(
        default=0.05,
        metadata={
            "unit": "s",
            "reason": "a lead makes up for twice the loop's delay and sample, and for so much lag "
            "beyond",
        },
    )
    bandwidth_share: tuple[float, float] = field(
        default=(0.3, 4.0),
        metadata={
            "unit": "1",
            "reason": "of the bandwidths that just keep the margins; free gains give margins up",
        },
    )
    damping: tuple[float, float] = field(
        default=(0.6, 2.0),
        metadata={"unit": "1", "reason": "from an overshoot of a tenth to two separate real poles"},
    )
    damping_count: int = field(
        default=7,
        metadata={
            "unit": "1",
            "reason": "dampings at which PID's bandwidths are sought; between them they are "
            "interpolated",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


class WheelLoops:
    """``KinematicControl`` for many rows at once: the same numbers, to rounding."""

    def __init__(self, gains: Sequence[Gains], geometry: Geometry, loop: Loop) -> None:
        self.lead = np.array([g.lead for g in gains])
        self._proportional = np.array([[g.proportional] for g in gains])
        self._step = np.array([[g.integral * loop.sample_time] for g in gains])
        self._to_wheels, self._limit = geometry.wheel_jacobian.T, loop.torque_limit
        self._integral = np.zeros((len(gains), 4))

    def __call__(self, wheel_speed: Array, reference: Array) -> Array:
        error = reference @ self._to_wheels - wheel_speed
        step = self._step * error
        wanted = self._proportional * error + self._integral + step
        torque = np.clip(wanted, -self._limit, self._limit)
        # Conditional integration: not while the limit holds and the error would push further.
        self._integral += np.where((wanted - torque) * error <= 0.0, step, 0.0)
        return torque


class TunableKinematic:
    """Wheel-speed PI: its two gains are free, and on request the lead of its reference.

    Without slip four equal wheel loops are three loops of the body force: each wheel's gain times
    ``geometry.wheel_jacobian``'s column squares.
    """

    def __init__(self, model: Model, loop: Loop, *, lead: bool = False) -> None:
        self.model, self.loop = model, loop
        self.names: tuple[str, ...] = ("proportional", "integral", "lead")[: 2 + lead]
        ranges = GainRanges()
        longest = ranges.max_lead_beyond_delay + 2 * (loop.delay + loop.sample_time)
        spans = (ranges.proportional, ranges.integral, (ranges.min_lead, longest))
        self.span: tuple[tuple[float, float], ...] = spans[: 2 + lead]

    def gains(self, point: Array) -> Gains:
        """The point as ``KinematicControl`` takes it."""
        return Gains(**dict(zip(self.names, np.asarray(point, float).tolist(), strict=True)))

    def controller(self, point: Array) -> LinearSystem:
        return wheel_loops(self.gains(point), self.model.geometry, self.loop.sample_time)

    def response(self, point: Array, frequency: Array) -> Complex:
        gains, period = self.gains(point), self.loop.sample_time
        z = np.exp(1j * frequency * period)
        each = gains.proportional + gains.integral * period * z / (z - 1.0)
        to_force = np.diag((self.model.geometry.wheel_jacobian**2).sum(axis=0))
        return np.asarray(each[:, None, None] * to_force, np.complex128)

    def rows(self, points: Array, motions: int) -> WheelLoops:
        each = [gains for gains in map(self.gains, points) for _ in range(motions)]
        return WheelLoops(each, self.model.geometry, self.loop)


class TunablePID:
    """PID on the body twist: pole placement whose bandwidths and damping are free.

    ``share`` multiplies the bandwidths of the three axes that just keep the margins wanted; so one
    number makes all axes faster or slower alike.
    """

    def __init__(
        self,
        model: Model,
        loop: Loop,
        *,
        gain_margin: float = MarginSettings.gain_margin,
        phase_margin: float = MarginSettings.phase_margin,
    ) -> None:
        ranges = GainRanges()
        wanted = PIDSettings(gain_margin=gain_margin, phase_margin=phase_margin)
        self.model, self.loop = model, loop
        self.names: tuple[str, ...] = ("share", "damping")
        self.span: tuple[tuple[float, float], ...] = (
            ranges.bandwidth_share,
            ranges.damping,
        )
        self._inertia, lag = effective_mass(model), drive_lag(model)
        self._lead = {"derivative_time": lag, "filter_time": wanted.filter_share * lag}
        self._damping = np.geomspace(*ranges.damping, ranges.damping_count)
        self._bandwidth = np.log(
            [bandwidths(model, loop, self._shape(d), wanted) for d in self._damping.tolist()]
        )

    def _shape(self, damping: float) -> PIDGains:
        return PIDGains((1.0, 1.0, 1.0), damping, **self._lead)

    def gains(self, point: Array) -> PIDGains:
        """The point as ``PID`` takes it."""
        share, damping = np.asarray(point, float).tolist()
        at = np.log(damping), np.log(self._damping)
        # Bandwidths change smoothly with the damping, so interpolation replaces a search a point.
        x, y, w = (share * float(np.exp(np.interp(*at, one))) for one in self._bandwidth.T)
        return replace(self._shape(damping), bandwidth=(x, y, w))

    def controller(self, point: Array) -> LinearSystem:
        return linear_pid(self._inertia, self.gains(point), self.loop.sample_time)

    def response(self, point: Array, frequency: Array) -> Complex:
        return pid_response(self._inertia, self.gains(point), self.loop.sample_time, frequency)

    def rows(self, points: Array, motions: int) -> BodyLoops:
        each = [gains for gains in map(self.gains, points) for _ in range(motions)]
        return BodyLoops(self.model, self.loop, each)


def wheel_loops(gains: Gains, geometry: Geometry, period: float) -> LinearSystem:
    """Twist error (3,) to body force (3,) of equal PI loops at the wheels."""
    to_force = np.diag((geometry.wheel_jacobian**2).sum(axis=0))
    step = gains.integral * period * to_force
    direct = gains.proportional * to_force + step
    return LinearSystem(np.eye(3), step, np.eye(3), direct, period)
