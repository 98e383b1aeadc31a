"""Gains of a PID on the body twist from masses, frictions and the loop's delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from controllers.linear.margins import Complex, frequency_grid, margins
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model

FILTER_SHARE = 1.0 / 3.0
"""Time constant of the derivative's filter over the derivative time: noise goes up by three."""

SLOWEST, TRIED, REFINED = 0.1, 48, 12
"""Least bandwidth [rad/s] that is tried, how many up to the sample rate, and how many between the
best of them and the next: 1.5 % apart at 100 Hz."""


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
    model: Model, loop: Loop, shape: PIDGains, gain_margin: float, phase_margin: float
) -> tuple[float, float, float]:
    """The fastest poles of each axis that keep the margins, at the damping and lead of ``shape``.

    Exact but for the couplings that a delay leaves.

    Raises
    ------
    InputError
        If none does.
    """
    frequency, inertia = frequency_grid(loop.sample_time), effective_mass(model)
    plant = sampled_platform(model, loop).response(frequency)

    def last_kept(tried: Array) -> NDArray[np.intp]:
        """How many of the bandwidths (n, 3) keep the margins, by axis, before the first that does
        not; beyond, a loop may cross where it is unstable."""
        each = [replace(shape, bandwidth=(x, y, w)) for x, y, w in tried.tolist()]
        gain = np.stack([response(inertia, one, loop.sample_time, frequency) for one in each])
        gap = margins(gain @ plant)
        kept = (gap.gain >= gain_margin) & (gap.phase >= phase_margin)
        return np.logical_and.accumulate(kept, axis=0).sum(axis=0)

    coarse = np.geomspace(SLOWEST, 1.0 / loop.sample_time, TRIED)
    count = last_kept(np.stack([coarse] * 3, axis=1))
    if count.min() == 0:
        raise InputError(
            f"PID: no bandwidth of {('VX', 'VY', 'W')[int(count.argmin())]} from {SLOWEST:g} rad/s "
            f"on keeps gain margin >= {gain_margin:g} dB and phase margin >= {phase_margin:g} "
            "degrees; ask for less"
        )
    step = coarse[1] / coarse[0]
    fine = coarse[count - 1] * np.geomspace(1.0, step, REFINED)[:, None]
    x, y, w = fine[np.maximum(last_kept(fine), 1) - 1, range(3)].tolist()
    return x, y, w


def design(
    model: Model,
    loop: Loop,
    *,
    damping: float = 1.0,
    gain_margin: float = 6.0,
    phase_margin: float = 45.0,
    derivative: bool = True,
) -> PIDGains:
    """The fastest poles that keep the margins [dB], [degrees] in a loop with its delays.

    ``derivative=False`` leaves a drive's lag alone. Margins are those of
    :func:`controllers.linear.margins.margins`.

    Raises
    ------
    InputError
        If no bandwidth keeps them.
    """
    lag = drive_lag(model) if derivative else 0.0
    gains = PIDGains((1.0, 1.0, 1.0), damping, lag, FILTER_SHARE * lag)
    limits = gain_margin, phase_margin
    gains = replace(gains, bandwidth=bandwidths(model, loop, gains, *limits))
    plant, frequency = sampled_platform(model, loop), frequency_grid(loop.sample_time)
    seen, inertia = plant.response(frequency), effective_mass(model)
    for _ in range(100):
        gap = margins(response(inertia, gains, loop.sample_time, frequency) @ seen)
        wide = gap.gain.min() >= gain_margin and gap.phase.min() >= phase_margin
        if wide and closed(plant, linear_pid(inertia, gains, loop.sample_time)).is_stable:
            return gains
        gains = scaled(gains, 0.99)
    raise InputError("PID: the couplings of this platform leave no margins; ask for less")


def scaled(gains: PIDGains, share: float) -> PIDGains:
    """The same poles, all faster or slower."""
    x, y, w = (share * b for b in gains.bandwidth)
    return replace(gains, bandwidth=(x, y, w))
