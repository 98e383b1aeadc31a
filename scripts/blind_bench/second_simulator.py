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
    effects outside the catalogue. Arrays are (4,), one value a wheel; ``radius`` is true over
    nominal, ``roller_angle`` that of a roller's axis to X, without its sign.
    """

    drag: Array
    gain: Array
    offset: Array
    dry: Array
    roller_dry: Array
    ripple_phase: Array
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
    roller_inertia: float = 0.0
    load: float = 0.0
    load_x: float = 0.0
    load_y: float = 0.0
    load_time: float = NEVER
    radius: Array = np.ones(4)
    roller_angle: Array = np.full(4, math.pi / 4)
    began: float = 0.0  # [s] of the run, on the clock that a session's runs share
    fall: float = 0.0
    fall_time: float = 60.0
    back_emf: float = 0.0
    torque_limit: float = 0.0
    zone: float = 0.0
    swing: float = 0.0
    swing_damping: float = 0.0
    forward_dry: float = 0.0
    forward_viscous: float = 0.0
    forward_width: float = 0.1
    scrub: float = 0.0
    scrub_width: float = 0.02
    trail: float = 0.0
    trail_width: float = 0.005
    twist_stiffness: float = 0.0
    twist_neutral: float = 0.0

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
    one_way: float = 0.0
    one_way_wheel: float = 0.0
    one_way_sign: float = 1.0
    late_drag: float = 0.0
    late_time: float = NEVER
    air: float = 0.0
    cog: float = 0.0
    cog_wheel: float = 0.0
    cog_cycles: float = 1.0
    rub: float = 0.0  # dry friction of all wheels around one speed
    rub_speed: float = 1.0
    rub_width: float = 1.0
    strip: float = 0.0
    strip_x: float = 0.0
    strip_width: float = 1.0
    gust: float = 0.0
    gust_direction: float = 0.0
    gust_time: float = 0.0
    gust_width: float = 1.0
    brush: float = 0.0
    brush_width: float = 0.05
    magnet: float = 0.0
    magnet_neutral: float = 0.0
    ramp: float = 0.0
    ramp_direction: float = 0.0
    ramp_edge: float = 0.0
    grain: float = 0.0  # dry drag that depends on the heading
    grain_direction: float = 0.0
    weave_x: float = 0.0  # dry drag of its own size along each axis of the world
    weave_y: float = 0.0
    sticking: float = 0.0  # dry friction of one roller axle around one speed
    sticking_wheel: float = 0.0
    sticking_speed: float = 1.0
    sticking_width: float = 1.0
    mat: float = 0.0  # [N/m] away from a spot, inside of a radius
    mat_x: float = 0.0
    mat_y: float = 0.0
    mat_radius: float = 1.0
    growing: float = 0.0  # [N] of dry drag after a minute, from none
    weak_drive: float = 0.0  # share of a torque beyond an edge that a drive loses one way
    weak_edge: float = 0.0
    wall: float = 0.0  # [N/m] of a spring beyond a line
    wall_x: float = 0.0
    rubbing: float = 0.0  # dry friction of one wheel that swings with its angle
    rubbing_wheel: float = 0.0
    saddle: float = 0.0  # [N/m] of a floor that is a saddle
    fan: float = 0.0  # [N m/m] moment that grows along world x
    root_drag: float = 0.0  # [N (s/m)^0.5] against the motion, with the root of the speed
    pile: float = 0.0  # viscous friction of turning that depends on the heading
    pile_direction: float = 0.0
    lame: float = 0.0  # share of one wheel's torque that swings with its angle
    lame_wheel: float = 0.0
    lame_phase: float = 0.0
    failing: float = 0.0  # share of one wheel's torque that is lost from a time on
    failing_wheel: float = 0.0
    failing_time: float = NEVER
    sag: float = 0.0  # share of a torque that is lost for each N m that all wheels take together
    trailer: float = 0.0  # [kg] that resist forward motion alone: what is in its wheels
    pulling: float = 0.0  # [N] of a pull along the world after a minute, from nothing
    pulling_direction: float = 0.0
    jet: float = 0.0  # [N] of a push that turns with the body, from a time on
    jet_direction: float = 0.0
    jet_time: float = NEVER
    rough: float = 0.0  # dry friction of the wheels beyond a line of the floor
    rough_x: float = 0.0
    whirl: float = 0.0  # [N m] of a moment that comes and goes
    whirl_time: float = 0.0
    whirl_width: float = 1.0


@njit(cache=True)
def _wheel_friction(p: Physics, i: int, rate: float, angle: float, torque: float, time: float):
    """Torque [N m] that resists at one wheel joint."""
    viscous = p.mu1 + p.drag[i]
    if p.cold != 0.0:
        viscous += p.mu1 * p.cold * math.exp(-time / p.warming_time)
    total = viscous * rate + p.quadratic * rate * abs(rate)
    dry = p.coulomb + p.dry[i] + p.load_share * abs(torque)
    if p.breakaway != 0.0:
        dry += p.breakaway * math.exp(-((rate / p.stribeck_speed) ** 2))
    if dry != 0.0:
        total += dry * math.tanh(rate / p.dry_width)
    if p.one_way != 0.0 and i == int(p.one_way_wheel):
        total += p.one_way_sign * p.one_way * max(p.one_way_sign * math.tanh(rate / p.dry_width), 0)
    if p.ripple != 0.0:
        total += p.ripple * math.sin(p.ripple_cycles * angle + p.ripple_phase[i])
    if p.cog != 0.0 and i == int(p.cog_wheel):
        total += p.cog * math.sin(p.cog_cycles * angle)
    if p.rubbing != 0.0 and i == int(p.rubbing_wheel):
        total += p.rubbing * (0.5 + 0.5 * math.cos(angle)) * math.tanh(rate / p.dry_width)
    if p.rub != 0.0:
        near = (abs(rate) - p.rub_speed) / p.rub_width
        total += p.rub * math.exp(-near * near) * math.tanh(rate / p.dry_width)
    # Larger forwards: the same sign whichever way the wheel turns.
    if p.forward_dry != 0.0 or p.forward_viscous != 0.0:
        total += p.forward_dry * abs(math.tanh(rate / p.forward_width))
        total += p.forward_viscous * abs(rate)
    return total


@njit(cache=True)
def _exerted(
    p: Physics, i: int, command: float, rate: float, time: float, angle: float, together: float
):
    """Torque [N m] that a command becomes, before the drive's own dynamics; ``together``: the
    absolute commands of all wheels, added up."""
    if p.torque_limit > 0.0:
        command = min(max(command, -p.torque_limit), p.torque_limit)
    if p.zone > 0.0:
        command = math.copysign(max(abs(command) - p.zone, 0.0), command)
    torque = (1.0 + p.gain[i]) * command + p.offset[i]
    if p.back_emf > 0.0:
        torque *= 1.0 - p.back_emf * abs(rate) / 10.0
    if p.weak_drive != 0.0:
        torque -= p.weak_drive * max(torque - p.weak_edge, 0.0)
    if p.lame != 0.0 and i == int(p.lame_wheel):
        torque *= 1.0 + p.lame * math.sin(angle + p.lame_phase)
    if p.failing != 0.0 and i == int(p.failing_wheel) and time >= p.failing_time:
        torque *= 1.0 - p.failing
    if p.sag != 0.0:
        torque *= 1.0 - p.sag * together
    if p.fall != 0.0:
        torque *= 1.0 - p.fall + p.fall * math.exp(-(p.began + time) / p.fall_time)
    return torque


@njit(cache=True)
def _outside(p: Physics, x: float, y: float, yaw: float, u: float, v: float, time: float):
    """World force (X, Y) [N] at O of the tether and of effects outside the catalogue."""
    fx = -p.tether * (x - p.anchor_x)
    fy = -p.tether * (y - p.anchor_y)
    if p.trail != 0.0:
        speed = math.sqrt(u * u + v * v + p.trail_width**2)
        fx, fy = fx - p.trail * u / speed, fy - p.trail * v / speed
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
    if p.late_drag != 0.0 and time >= p.late_time:
        speed = math.sqrt(u * u + v * v + 0.005**2)
        fx, fy = fx - p.late_drag * u / speed, fy - p.late_drag * v / speed
    if p.air != 0.0:
        speed = math.sqrt(u * u + v * v)
        fx, fy = fx - p.air * speed * u, fy - p.air * speed * v
    if p.strip != 0.0:
        way = (x - p.strip_x) / p.strip_width
        fx += p.strip * way * math.exp(0.5 - 0.5 * way * way)
    if p.gust != 0.0:
        push = p.gust * math.exp(-(((time - p.gust_time) / p.gust_width) ** 2))
        fx += push * math.cos(p.gust_direction)
        fy += push * math.sin(p.gust_direction)
    if p.brush != 0.0:
        # Against sideways motion of the body, levelling off.
        left = math.cos(yaw) * v - math.sin(yaw) * u
        push = -p.brush * math.tanh(left / p.brush_width)
        fx, fy = fx - push * math.sin(yaw), fy + push * math.cos(yaw)
    if p.ramp != 0.0 and x > p.ramp_edge:
        fx += p.ramp * math.cos(p.ramp_direction)
        fy += p.ramp * math.sin(p.ramp_direction)
    if p.grain != 0.0:
        speed = math.sqrt(u * u + v * v + 0.005**2)
        drag = p.grain * (0.5 + 0.5 * math.cos(yaw - p.grain_direction))
        fx, fy = fx - drag * u / speed, fy - drag * v / speed
    if p.weave_x != 0.0 or p.weave_y != 0.0:
        fx -= p.weave_x * math.tanh(u / 0.01)
        fy -= p.weave_y * math.tanh(v / 0.01)
    if p.mat != 0.0 and math.hypot(x - p.mat_x, y - p.mat_y) < p.mat_radius:
        fx += p.mat * (x - p.mat_x)
        fy += p.mat * (y - p.mat_y)
    if p.growing != 0.0:
        speed = math.sqrt(u * u + v * v + 0.005**2)
        drag = p.growing * time / 60.0
        fx, fy = fx - drag * u / speed, fy - drag * v / speed
    if p.saddle != 0.0:
        fx, fy = fx + p.saddle * y, fy + p.saddle * x
    if p.root_drag != 0.0:
        speed = math.sqrt(u * u + v * v + 0.005**2)
        fx -= p.root_drag * u / math.sqrt(speed)
        fy -= p.root_drag * v / math.sqrt(speed)
    if p.wall != 0.0:
        fx -= p.wall * max(x - p.wall_x, 0.0)
    if p.pulling != 0.0:
        fx += p.pulling * time / 60.0 * math.cos(p.pulling_direction)
        fy += p.pulling * time / 60.0 * math.sin(p.pulling_direction)
    if p.jet != 0.0 and time >= p.jet_time:
        fx += p.jet * math.cos(yaw + p.jet_direction)
        fy += p.jet * math.sin(yaw + p.jet_direction)
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
    """State q: x, y, yaw, their world rates u, v, W, four wheel angles, four acting torques and the
    rates of these."""
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
    fx, fy = _outside(p, q[0], q[1], q[2], q[3], q[4], time)
    slope_x, slope_y = -GRAVITY * math.sin(p.tilt_x), -GRAVITY * math.sin(p.tilt_y)
    # Centripetal acceleration of the centre of mass, whose first moment is (sx, sy).
    b[0] = w * w * sx + fx + mass * slope_x
    b[1] = w * w * sy + fy + mass * slope_y
    b[2] = sx * slope_y - sy * slope_x
    b[2] -= p.scrub * math.tanh(w / p.scrub_width) + p.twist_stiffness * (q[2] - p.twist_neutral)
    b[2] -= p.magnet * math.sin(2.0 * (q[2] - p.magnet_neutral))
    b[2] += p.fan * q[0]
    if p.whirl != 0.0:
        b[2] += p.whirl * math.exp(-(((time - p.whirl_time) / p.whirl_width) ** 2))
    if p.trailer != 0.0:
        row[0], row[1], row[2] = c, s, 0.0
        _couple(a, b, row, p.trailer, w * (row[0] * q[4] - row[1] * q[3]), 0.0)
    b[2] -= p.pile * w * (0.5 + 0.5 * math.cos(2.0 * (q[2] - p.pile_direction)))

    together = abs(command[0]) + abs(command[1]) + abs(command[2]) + abs(command[3])
    for i in range(4):
        x = p.half_length if i < 2 else -p.half_length
        y = p.half_width if i % 2 == 0 else -p.half_width
        lean = 1.0 if i == 1 or i == 2 else -1.0
        # The wheel: speed of its contact along the roller's axis, over R times that axis' cosine.
        radius = p.wheel_radius * p.radius[i]
        jx, jy = 1.0 / radius, lean * math.tan(p.roller_angle[i]) / radius
        row[0], row[1], row[2] = c * jx - s * jy, s * jx + c * jy, jy * x - jx * y
        rate = row[0] * q[3] + row[1] * q[4] + row[2] * w
        bias = w * (row[0] * q[4] - row[1] * q[3])
        wanted = _exerted(p, i, command[i], rate, time, q[6 + i], together)
        torque = q[10 + i] if p.lag > 0.0 or p.swing > 0.0 else wanted
        resists = _wheel_friction(p, i, rate, q[6 + i], torque, time)
        if p.rough != 0.0 and q[0] + c * x - s * y > p.rough_x:
            resists += p.rough * math.tanh(rate / p.dry_width)
        _couple(a, b, row, p.I1, bias, torque - resists)
        dq[6 + i] = rate
        dq[10 + i] = (wanted - q[10 + i]) / p.lag if p.lag > 0.0 else 0.0
        dq[14 + i] = 0.0
        if p.swing > 0.0:
            dq[10 + i] = q[14 + i]
            dq[14 + i] = p.swing**2 * (wanted - q[10 + i])
            dq[14 + i] -= 2.0 * p.swing_damping * p.swing * q[14 + i]
        # Its roller: sideways speed of the contact, over r times the cosine of its axis.
        j = -1.0 / (math.cos(p.roller_angle[i]) * p.roller_radius)
        row[0], row[1], row[2] = -s * j, c * j, x * j
        rate = row[0] * q[3] + row[1] * q[4] + row[2] * w
        bias = w * (row[0] * q[4] - row[1] * q[3])
        resists = p.mu2 * rate
        roller_dry = p.roller_coulomb + p.roller_dry[i]
        if roller_dry != 0.0:
            resists += roller_dry * math.tanh(rate / p.roller_dry_width)
        if p.sticking != 0.0 and i == int(p.sticking_wheel):
            near = (abs(rate) - p.sticking_speed) / p.sticking_width
            resists += p.sticking * math.exp(-near * near) * math.tanh(rate / p.roller_dry_width)
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
    for i in range(4):
        x = p.half_length if i < 2 else -p.half_length
        y = p.half_width if i % 2 == 0 else -p.half_width
        lean = math.tan(p.roller_angle[i])
        if i == 0 or i == 3:
            lean = -lean
        centre = ahead - q[5] * y + lean * (left + q[5] * x)
        out[i] = centre / (p.wheel_radius * p.radius[i])


@njit(cache=True)
def _drive(p, wanted, dt, steps, limits, speed, command, pose):
    q = np.zeros(18)
    work, k = np.empty((5, 3)), np.empty((5, 18))
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
    wheel = (
        p.coulomb + p.dry.max() + p.breakaway + p.load_share * 2.0 + p.one_way + p.rub
    ) / p.dry_width
    wheel += (p.rubbing + p.rough) / p.dry_width
    wheel += abs(p.forward_dry) / p.forward_width
    roller = (p.roller_coulomb + p.roller_dry.max()) / p.roller_dry_width
    inertia = 0.25 * p.m0 * p.wheel_radius**2 + p.I1
    rate = wheel / inertia + 8.0 * roller / (p.roller_radius**2 * p.m0)
    small = 15.0 * p.root_drag * 0.005 + p.patch + p.late_drag + p.grain + 4.0 * p.growing
    rate += ((p.nap + p.weave_x + p.weave_y) / 0.01 + small / 0.005) / p.m0 + (
        1.0 / p.lag if p.lag > 0.0 else 0.0
    )
    rate += p.trail / p.trail_width / p.m0 + p.scrub / p.scrub_width / p.I0 + p.swing
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


@njit(cache=True)
def _replay(p, torque, dt, steps, q, speed):
    work, k = np.empty((5, 3)), np.empty((5, 18))
    command = np.empty(4)
    for n in range(len(torque)):
        _speeds(p, q, speed[n])
        if n + 1 < len(torque):
            command[:] = 0.5 * (torque[n] + torque[n + 1])
            for m in range(steps):
                time = n * dt + m * dt / steps
                _step(p, q, command, time, dt / steps, work, k)


def replay(p: Physics, torque: Array, dt: float, twist: Array, pose: Array) -> Array:
    """(N, 4) wheel speeds [rad/s] of the true platform, driven by logged torques alone.

    Parameters
    ----------
    torque : (N, 4) [N m] as logged, dt apart; between two rows their mean acts
    twist, pose : (3,) where it starts: body twist [m/s, m/s, rad/s], pose [m, m, rad]
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ahead, left, turn = twist
    q = np.zeros(18)
    q[:3], q[3:6] = pose, (c * ahead - s * left, s * ahead + c * left, turn)
    q[10:14] = torque[0]
    speed = np.empty_like(torque)
    _replay(p, np.ascontiguousarray(torque, float), dt, steps_for(p, dt), q, speed)
    return speed


def measured(
    speed: Array, effort: Array, factor: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Wheel speeds and efforts (N, 4) as they are logged: with ``factor`` times the white noise."""
    effort = effort + factor * TORQUE_NOISE * rng.standard_normal(effort.shape)
    return speed + factor * SPEED_NOISE * rng.standard_normal(effort.shape), effort
