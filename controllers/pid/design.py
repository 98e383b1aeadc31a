"""Gains of a PID on the body twist from masses, frictions and the loop's delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Array, Loop
from controllers.linear.linear_system import (
    Inertia,
    LinearSystem,
    closed,
    drive_lag,
    effective_mass,
    sampled_platform,
)
from controllers.linear.margins import Complex, MarginSettings, frequency_grid, margins
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model


@dataclass(frozen=True)
class PIDSettings(MarginSettings):
    """What a PID design is asked for, and how finely it is sought."""

    damping: float = field(
        default=1.0,
        metadata={"unit": "1", "reason": "two equal poles: the fastest step without overshoot"},
    )
    cancels_lag: bool = field(
        default=True,
        metadata={
            "unit": "1",
            "reason": "a drive's lag costs phase; a lead in series takes it back",
        },
    )
    filter_share: float = field(
        default=1.0 / 3.0,
        metadata={
            "unit": "of the derivative time",
            "reason": "the derivative's filter lets noise go up by three",
        },
    )
    slowest_bandwidth: float = field(
        default=0.1,
        metadata={
            "unit": "rad/s",
            "reason": "slower than any platform is driven: where this fails, all does",
        },
    )
    coarse_count: int = field(
        default=48,
        metadata={"unit": "1", "reason": "bandwidths tried up to the sample rate"},
    )
    fine_count: int = field(
        default=12,
        metadata={
            "unit": "1",
            "reason": "bandwidths between the best of them and the next: 1.5 % apart at 100 Hz",
        },
    )
    shrink_share: float = field(
        default=0.99,
        metadata={
            "unit": "1",
            "reason": "all axes get slower by one percent until the couplings bear the margins too",
        },
    )
    max_shrinks: int = field(
        default=100,
        metadata={
            "unit": "1",
            "reason": "to 0.37 of the bandwidths of single axes; more is a platform that no PID "
            "suits",
        },
    )


@dataclass(frozen=True)
class PIDGains:
    """Pole placement: without delay an axis of the platform gets s^2 + 2 damping b s + b^2.

    Attributes
    ----------
    bandwidth : (3,) b of VX, VY, W [rad/s]; an axis whose friction alone is faster than
        2 damping b keeps it, and gets integral control
    damping : 1 for two equal poles
    derivative_time : [s] of a lead 1 + derivative_time s in series; it cancels a drive's lag. 0
        without one: of a platform that is mass and friction, PI places both poles by itself, and a
        derivative would only add noise.
    filter_time : [s] of the derivative's low-pass filter

    Raises
    ------
    InputError
        If a number cannot be.
    """

    bandwidth: tuple[float, float, float]
    damping: float = 1.0
    derivative_time: float = 0.0
    filter_time: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.bandwidth, Sequence) or len(self.bandwidth) != 3:
            raise InputError("PID bandwidth: three numbers are needed, for VX, VY and W")
        for value in self.bandwidth:
            finite("PID bandwidth", value, positive=True)
        object.__setattr__(self, "bandwidth", tuple(map(float, self.bandwidth)))
        finite("PID damping", self.damping, positive=True)
        for name in ("derivative_time", "filter_time"):
            finite(f"PID {name}", getattr(self, name), least=0.0)
        if self.derivative_time > 0.0 and self.filter_time <= 0.0:
            raise InputError("PID filter_time: a derivative needs a positive one")


def matrices(inertia: Inertia, gains: PIDGains) -> tuple[Array, Array]:
    """Proportional [N s/m ...] and integral [N/m ...] gain (3, 3) of the body force.

    M v' + C v = F and F = K_p e + K_i int(e) give each axis the promised poles with
    K_p = M (2 damping b - M^-1 C), K_i = M b^2; the matrices hold the couplings, so none is left.
    """
    mass, friction = inertia
    decay, b = np.linalg.solve(mass, friction), np.array(gains.bandwidth)
    own = np.diag(decay)
    # An axis whose friction is faster than its poles would get a negative proportional gain.
    placed = np.maximum(2.0 * gains.damping * b, own)
    return mass @ (np.diag(placed) - decay), mass * b**2


def linear_pid(inertia: Inertia, gains: PIDGains, period: float) -> LinearSystem:
    """Measured twist error (3,) to commanded body force (3,)."""
    proportional, integral = matrices(inertia, gains)
    step = period * integral
    pi = LinearSystem(np.eye(3), step, np.eye(3), proportional + step, period)
    if gains.derivative_time == 0.0:
        return pi
    keep, rise = derivative_filter(gains, period)
    # states: filtered slope s, last error; out = e + T_d s(k), s(k) = keep s + rise (e - last)
    a = np.block([[keep * np.eye(3), -rise * np.eye(3)], [np.zeros((3, 6))]])
    b = np.vstack([rise * np.eye(3), np.eye(3)])
    lead = gains.derivative_time
    c, d = lead * a[:3], (1.0 + lead * rise) * np.eye(3)
    return LinearSystem(
        np.block([[a, np.zeros((6, 3))], [pi.b @ c, pi.a]]),
        np.vstack([b, pi.b @ d]),
        np.hstack([pi.d @ c, pi.c]),
        pi.d @ d,
        period,
    )


def response(inertia: Inertia, gains: PIDGains, period: float, frequency: Array) -> Complex:
    """Frequency response (w, 3, 3) of :func:`linear_pid`, in closed form for searches."""
    proportional, integral = matrices(inertia, gains)
    keep, rise = derivative_filter(gains, period)
    z = np.exp(1j * frequency * period)[:, None, None]
    lead = 1.0 + gains.derivative_time * rise * (z - 1.0) / (z - keep)
    return np.asarray(lead * (proportional + period * z / (z - 1.0) * integral), np.complex128)


def derivative_filter(gains: PIDGains, period: float) -> tuple[float, float]:
    """What the filtered slope keeps in a sample, and what a change of the error adds to it."""
    if gains.derivative_time == 0.0:
        return 0.0, 0.0
    keep = float(np.exp(-period / gains.filter_time))
    return keep, (1.0 - keep) / period


def bandwidths(
    model: Model, loop: Loop, shape: PIDGains, settings: PIDSettings = PIDSettings()
) -> tuple[float, float, float]:
    """The fastest poles of each axis that keep the margins, at the damping and lead of ``shape``.

    Exact but for the couplings that a delay leaves.

    Raises
    ------
    InputError
        If none does.
    """
    frequency, inertia = frequency_grid(loop.sample_time, settings), effective_mass(model)
    plant = sampled_platform(model, loop).response(frequency)

    def last_kept(tried: Array) -> NDArray[np.intp]:
        """By axis, how many of the bandwidths (n, 3) keep the margins before the first that does
        not. Later ones do not count: margins say nothing about an unstable loop."""
        each = [replace(shape, bandwidth=(x, y, w)) for x, y, w in tried.tolist()]
        gain = np.stack([response(inertia, one, loop.sample_time, frequency) for one in each])
        gap = margins(gain @ plant)
        kept = (gap.gain >= settings.gain_margin) & (gap.phase >= settings.phase_margin)
        return np.logical_and.accumulate(kept, axis=0).sum(axis=0)

    slowest = settings.slowest_bandwidth
    coarse = np.geomspace(slowest, 1.0 / loop.sample_time, settings.coarse_count)
    count = last_kept(np.stack([coarse] * 3, axis=1))
    if count.min() == 0:
        raise InputError(
            f"PID: no bandwidth of {('VX', 'VY', 'W')[int(count.argmin())]} from {slowest:g} rad/s "
            f"on keeps gain margin >= {settings.gain_margin:g} dB and phase margin >= "
            f"{settings.phase_margin:g} degrees; ask for less"
        )
    step = coarse[1] / coarse[0]
    # Between the fastest that keeps the margins and the next, which does not.
    fine = coarse[count - 1] * np.geomspace(1.0, step, settings.fine_count)[:, None]
    x, y, w = fine[np.maximum(last_kept(fine), 1) - 1, range(3)].tolist()
    return x, y, w


def design(model: Model, loop: Loop, settings: PIDSettings = PIDSettings()) -> PIDGains:
    """The fastest poles that keep the margins in a loop with its delays.

    Margins are those of :func:`controllers.linear.margins.margins`.

    Raises
    ------
    InputError
        If no bandwidth keeps them.
    """
    lag = drive_lag(model) if settings.cancels_lag else 0.0
    gains = PIDGains((1.0, 1.0, 1.0), settings.damping, lag, settings.filter_share * lag)
    gains = replace(gains, bandwidth=bandwidths(model, loop, gains, settings))
    plant = sampled_platform(model, loop)
    frequency = frequency_grid(loop.sample_time, settings)
    seen, inertia = plant.response(frequency), effective_mass(model)
    # The search judged an axis beside other bandwidths of the two others. With those that were
    # found the couplings differ, and the margins may be a little too small.
    for _ in range(settings.max_shrinks):
        gap = margins(response(inertia, gains, loop.sample_time, frequency) @ seen)
        kept = gap.gain.min() >= settings.gain_margin and gap.phase.min() >= settings.phase_margin
        if kept and closed(plant, linear_pid(inertia, gains, loop.sample_time)).is_stable:
            return gains
        gains = scaled(gains, settings.shrink_share)
    raise InputError("PID: the couplings of this platform leave no margins; ask for less")


def scaled(gains: PIDGains, share: float) -> PIDGains:
    """The same poles, all faster or slower."""
    x, y, w = (share * b for b in gains.bandwidth)
    return replace(gains, bandwidth=(x, y, w))
