"""A second simulator of a mecanum platform, for blind tests; it shares no code with the first.

The equations are written in world coordinates, as balances of linear and angular momentum with the
wheels and rollers as bodies driven through their no-slip rates, and stepped by Runge-Kutta. The
package's own dynamics (body coordinates, one function for each effect) are never imported, so that
a mistake in one of the two shows as a difference. Wheel order fl, fr, bl, br.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from youbot_env.caching import njit

Array = NDArray[np.float64]

GRAVITY = 9.80665
TICK = 0.002
"""About how long [s] the speed loop holds a command."""

PROPORTIONAL, INTEGRAL, TORQUE_LIMIT = 0.12, 0.30, 4.0
"""Gains and limit of the given logs' loop, by regression: [N m s/rad], [N m/rad], [N m]."""

TORQUE_NOISE, SPEED_NOISE = 0.03, 0.01
"""White noise [N m], [rad/s] of a measurement at a noise factor of one."""

NEVER = 1e9
"""A time [s] that no log reaches."""


class Physics(NamedTuple):
    """Parameters of a platform and its effects, SI units; zero (for the load: `NEVER`) means none.

    The first block is the platform, the second are the effects of the catalogue, the third
    effects outside the catalogue. ``drag`` and ``gain`` are (4,), one value a wheel.
    """

    drag: Array
    gain: Array
    half_width: float = 0.15
    half_length: float = 0.2355
    wheel_radius: float = 0.0475
    roller_radius: float = 0.014
    m0: float = 35.3
    I0: float = 4.4
    I1: float = 6.0e-3
    moment_x: float = 0.0
    moment_y: float = 0.0
    mu1: float = 0.11
    mu2: float = 5.78e-3

    coulomb: float = 0.0
    breakaway: float = 0.0
    stribeck_speed: float = 0.5
    dry_width: float = 0.03
    roller_coulomb: float = 0.0
    roller_dry_width: float = 0.1
    quadratic: float = 0.0
    load_share: float = 0.0
    cold: float = 0.0
    warming_time: float = 30.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    tether: float = 0.0
    anchor_x: float = 0.0
    anchor_y: float = 0.0
    lag: float = 0.0
    ripple: float = 0.0
    ripple_cycles: float = 0.0
    ripple_phase: float = 0.0
    roller_inertia: float = 0.0
    load: float = 0.0
    load_x: float = 0.0
    load_y: float = 0.0
    load_time: float = NEVER

    nap: float = 0.0
    nap_direction: float = 0.0
    line_stiffness: float = 0.0
    line_direction: float = 0.0
    line_offset: float = 0.0
    patch: float = 0.0
    patch_x: float = 0.0
    patch_y: float = 0.0
    patch_radius: float = 1.0
    wind: float = 0.0
    wind_direction: float = 0.0
    drift: float = 0.0
    bump: float = 0.0
    bump_x: float = 0.0
    bump_y: float = 0.0
    bump_width: float = 1.0
    joints: float = 0.0
    joint_distance: float = 1.0
    joint_phase: float = 0.0


@njit(cache=True)
def _wheel_friction(p: Physics, i: int, rate: float, angle: float, torque: float, time: float):
    """Torque [N m] that resists at one wheel joint."""
    viscous = p.mu1 + p.drag[i]
    if p.cold != 0.0:
        viscous += p.mu1 * p.cold * math.exp(-time / p.warming_time)
    total = viscous * rate + p.quadratic * rate * abs(rate)
    dry = p.coulomb + p.load_share * abs(torque)
    if p.breakaway != 0.0:
        dry += p.breakaway * math.exp(-((rate / p.stribeck_speed) ** 2))
    if dry != 0.0:
        total += dry * math.tanh(rate / p.dry_width)
    if p.ripple != 0.0:
        total += p.ripple * math.sin(p.ripple_cycles * angle + p.ripple_phase)
    return total


@njit(cache=True)
def _outside(p: Physics, x: float, y: float, yaw: float, u: float, v: float):
    """World force (X, Y) [N] at O of the tether and of effects outside the catalogue."""
    fx = -p.tether * (x - p.anchor_x)
    fy = -p.tether * (y - p.anchor_y)
    if p.nap != 0.0:
        c, s = math.cos(p.nap_direction), math.sin(p.nap_direction)
        push = -p.nap * math.tanh((c * u + s * v) / 0.01)
        fx, fy = fx + push * c, fy + push * s
    if p.line_stiffness != 0.0:
        c, s = math.cos(p.line_direction), math.sin(p.line_direction)
        push = -p.line_stiffness * (c * x + s * y - p.line_offset)
        fx, fy = fx + push * c, fy + push * s
    if p.patch != 0.0:
        far = math.hypot(x - p.patch_x, y - p.patch_y)
        inside = 0.5 - 0.5 * math.tanh((far - p.patch_radius) / 0.02)
        # Smoothed near zero, where the direction of friction is not defined.
        speed = math.sqrt(u * u + v * v + 0.005**2)
        fx, fy = fx - p.patch * inside * u / speed, fy - p.patch * inside * v / speed
    if p.wind != 0.0:
        # Twice the angle: the body looks the same after half a turn.
        push = p.wind * math.cos(2.0 * (yaw - p.wind_direction))
        fx += push * math.cos(p.wind_direction)
        fy += push * math.sin(p.wind_direction)
    if p.drift != 0.0:
        ahead = math.cos(yaw) * u + math.sin(yaw) * v
        push = p.drift * ahead * abs(ahead)
        fx, fy = fx - push * math.sin(yaw), fy + push * math.cos(yaw)
    if p.bump != 0.0:
        dx, dy = x - p.bump_x, y - p.bump_y
        # The factor exp(0.5) makes p.bump the largest force, at one width from the centre.
        slope = p.bump / p.bump_width * math.exp(0.5 - 0.5 * (dx * dx + dy * dy) / p.bump_width**2)
        fx, fy = fx + slope * dx, fy + slope * dy
    if p.joints != 0.0:
        fx += p.joints * math.sin(2.0 * math.pi * x / p.joint_distance + p.joint_phase)
    return fx, fy


@njit(cache=True)
def _solve(a: Array, b: Array, out: Array):
    """Gaussian elimination of a symmetric positive definite 3x3 system, in place.

    Positive definite: no pivoting is needed.
    """
    for i in range(3):
        for j in range(i + 1, 3):
            factor = a[j, i] / a[i, i]
            for k in range(i, 3):
                a[j, k] -= factor * a[i, k]
            b[j] -= factor * b[i]
    for i in range(2, -1, -1):
        total = b[i]
        for k in range(i + 1, 3):
            total -= a[i, k] * out[k]
        out[i] = total / a[i, i]


@njit(cache=True)
def _couple(a: Array, b: Array, row: Array, inertia: float, bias: float, torque: float):
    """Add a body whose rate is row . velocity, with rate' = row . acceleration + bias."""
    for i in range(3):
        b[i] += row[i] * (torque - inertia * bias)
        for j in range(3):
            a[i, j] += inertia * row[i] * row[j]


@njit(cache=True)
def derivative(
    p: Physics, q: Array, command: Array, time: float, loaded: bool, work: Array, dq: Array
):
    """State q: x, y, yaw, their world rates u, v, W, four wheel angles, four acting torques."""
    c, s, w = math.cos(q[2]), math.sin(q[2]), q[5]
    mass, mx, my, inertia = p.m0, p.moment_x, p.moment_y, p.I0
    if loaded:
        mass, mx, my = mass + p.load, mx + p.load * p.load_x, my + p.load * p.load_y
        inertia += p.load * (p.load_x**2 + p.load_y**2)
    sx, sy = c * mx - s * my, s * mx + c * my

    a, b, row = work[:3], work[3], work[4]
    a[0, 0], a[0, 1], a[0, 2] = mass, 0.0, -sy
    a[1, 0], a[1, 1], a[1, 2] = 0.0, mass, sx
    a[2, 0], a[2, 1], a[2, 2] = -sy, sx, inertia
    fx, fy = _outside(p, q[0], q[1], q[2], q[3], q[4])
    slope_x, slope_y = -GRAVITY * math.sin(p.tilt_x), -GRAVITY * math.sin(p.tilt_y)
    # Centripetal acceleration of the centre of mass, whose first moment is (sx, sy).
    b[0] = w * w * sx + fx + mass * slope_x
    b[1] = w * w * sy + fy + mass * slope_y
    b[2] = sx * slope_y - sy * slope_x

    for i in range(4):
        x = p.half_length if i < 2 else -p.half_length
        y = p.half_width if i % 2 == 0 else -p.half_width
        lean = 1.0 if i == 1 or i == 2 else -1.0
        # The wheel: speed of its contact along the roller's axis, over R cos(45 degrees).
        jx, jy = 1.0 / p.wheel_radius, lean / p.wheel_radius
        row[0], row[1], row[2] = c * jx - s * jy, s * jx + c * jy, (lean * x - y) / p.wheel_radius
        rate = row[0] * q[3] + row[1] * q[4] + row[2] * w
        bias = w * (row[0] * q[4] - row[1] * q[3])
        torque = q[10 + i] if p.lag > 0.0 else (1.0 + p.gain[i]) * command[i]
        resists = _wheel_friction(p, i, rate, q[6 + i], torque, time)
        _couple(a, b, row, p.I1, bias, torque - resists)
        dq[6 + i] = rate
        dq[10 + i] = ((1.0 + p.gain[i]) * command[i] - q[10 + i]) / p.lag if p.lag > 0.0 else 0.0
        # Its roller: sideways speed of the contact, over r cos(45 degrees).
        j = -math.sqrt(2.0) / p.roller_radius
        row[0], row[1], row[2] = -s * j, c * j, x * j
        rate = row[0] * q[3] + row[1] * q[4] + row[2] * w
        bias = w * (row[0] * q[4] - row[1] * q[3])
        resists = p.mu2 * rate
        if p.roller_coulomb != 0.0:
            resists += p.roller_coulomb * math.tanh(rate / p.roller_dry_width)
        _couple(a, b, row, p.roller_inertia, bias, -resists)

    dq[0], dq[1], dq[2] = q[3], q[4], w
    _solve(a, b, dq[3:6])


@njit(cache=True)
def _step(p: Physics, q: Array, command: Array, time: float, dt: float, work: Array, k: Array):
    """One classical Runge-Kutta step of q in place; a load is put on at the start of a step."""
    loaded = time + 0.5 * dt >= p.load_time
    half, trial = 0.5 * dt, k[4]
    derivative(p, q, command, time, loaded, work, k[0])
    trial[:] = q + half * k[0]
    derivative(p, trial, command, time + half, loaded, work, k[1])
    trial[:] = q + half * k[1]
    derivative(p, trial, command, time + half, loaded, work, k[2])
    trial[:] = q + dt * k[2]
    derivative(p, trial, command, time + dt, loaded, work, k[3])
    for i in range(q.size):
        q[i] += dt / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])


@njit(cache=True)
def _speeds(p: Physics, q: Array, out: Array):
    c, s = math.cos(q[2]), math.sin(q[2])
    ahead, left = c * q[3] + s * q[4], c * q[4] - s * q[3]
    lever = q[5] * (p.half_width + p.half_length)
    out[0] = (ahead - left - lever) / p.wheel_radius
    out[1] = (ahead + left + lever) / p.wheel_radius
    out[2] = (ahead + left - lever) / p.wheel_radius
    out[3] = (ahead - left + lever) / p.wheel_radius


@njit(cache=True)
def _drive(p, wanted, dt, steps, limits, speed, command, pose):
    q = np.zeros(14)
    work, k = np.empty((5, 3)), np.empty((5, 14))
    total = np.zeros(4)
    for n in range(len(wanted)):
        _speeds(p, q, speed[n])
        pose[n] = q[:3]
        for i in range(4):
            error = wanted[n, i] - speed[n, i]
            total[i] += limits[1] * error * dt
            asked = limits[0] * error + total[i]
            command[n, i] = min(max(asked, -limits[2]), limits[2])
        for m in range(steps):
            _step(p, q, command[n], n * dt + m * dt / steps, dt / steps, work, k)


def steps_for(p: Physics, dt: float) -> int:
    """Runge-Kutta steps in dt [s]: each is shorter than the fastest time constant.

    That of a smoothed dry friction at rest is inertia times width over torque. With much longer
    steps the method would be unstable.
    """
    wheel = (p.coulomb + p.breakaway + p.load_share * 2.0) / p.dry_width
    roller = p.roller_coulomb / p.roller_dry_width
    inertia = 0.25 * p.m0 * p.wheel_radius**2 + p.I1
    rate = wheel / inertia + 8.0 * roller / (p.roller_radius**2 * p.m0)
    rate += (p.nap / 0.01 + p.patch / 0.005) / p.m0 + (1.0 / p.lag if p.lag > 0.0 else 0.0)
    return max(1, math.ceil(rate * dt))


def drive(p: Physics, wanted: Array, dt: float = TICK) -> tuple[Array, Array, Array]:
    """Drive the platform from rest at (0, 0, 0) by a PI loop at each wheel that reads true speeds.

    Parameters
    ----------
    p : the platform and what acts on it
    wanted : (N, 4) wheel speeds [rad/s] asked for at each tick
    dt : [s] between ticks; a command is held that long

    Returns
    -------
    speed (N, 4) [rad/s], command (N, 4) [N m] given at each tick, pose (N, 3) [m, m, rad].
    """
    wanted = np.ascontiguousarray(wanted, float)
    speed, command = np.empty_like(wanted), np.empty_like(wanted)
    pose = np.empty((len(wanted), 3))
    limits = (PROPORTIONAL, INTEGRAL, TORQUE_LIMIT)
    _drive(p, wanted, dt, steps_for(p, dt), limits, speed, command, pose)
    return speed, command, pose


def measured(
    speed: Array, effort: Array, factor: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Wheel speeds and efforts (N, 4) as they are logged: with ``factor`` times the white noise."""
    effort = effort + factor * TORQUE_NOISE * rng.standard_normal(effort.shape)
    return speed + factor * SPEED_NOISE * rng.standard_normal(effort.shape), effort
