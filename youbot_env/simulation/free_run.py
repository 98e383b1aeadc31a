"""Free-run simulation of a model: compiled, in steps fine enough for its stiffest friction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.geometry import Geometry, wheel_rates
from youbot_env.physics.hardware import MAX_BODY_SPEED, MAX_WHEEL_TORQUE
from youbot_env.physics.points import Instant
from youbot_env.physics.structure import ModelStructure
from youbot_env.simulation.compiled import rollout

Array = NDArray[np.float64]

SLOWEST = 15.0
"""Rate [1/s] that is resolved even by a model without anything so fast: a log at 50 Hz then gets
two steps a sample."""

MAX_SUBSTEPS = 2000

FULL_SPEED = (MAX_BODY_SPEED, 0.25 * MAX_BODY_SPEED, 0.5)
"""Twist [m/s, m/s, rad/s] at which one wheel turns at its greatest speed."""


PHASE_SHARE = 1.0 / 3.0
"""Share of a ripple's frequency that counts as stiffness: it drives the twist and does not feed
back, so that three quarters of a radian in a step cost only 1e-4 of what it adds."""


def initial_state(
    model: Model,
    *,
    twist: ArrayLike = (0.0, 0.0, 0.0),
    pose: ArrayLike = (0.0, 0.0, 0.0),
    wheel_angle: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    torque: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    time: float = 0.0,
) -> Array:
    """State (S,) in the order of ``model.structure.state_names``.

    twist (VX, VY, W) [m/s, m/s, rad/s], pose (x, y, yaw) [m, m, rad], wheel angles [rad], torques
    [N m] that already act (read by models with an actuator), time [s].
    """
    given = {"twist": (twist, 3), "pose": (pose, 3), "wheel_angle": (wheel_angle, 4)}
    parts = [_vector(name, *value) for name, value in given.items()] + [np.array([time])]
    if model.structure.has_actuator:
        parts.append(_vector("torque", torque, 4))
    return np.concatenate(parts)


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    array = np.asarray(value, float)
    if array.shape != (size,):
        raise InputError(f"{name} must hold {size} numbers, not shape {array.shape}")
    return array


def stiffness(structure: ModelStructure, geometry: Geometry, theta: Array) -> float:
    """Fastest rate [1/s] of the twist (and drives) under full torque.

    Sought at rest, where dry friction is stiffest, and at full speed, where drag is.
    """
    shift = 1e-5 * np.concatenate([np.eye(3), -np.eye(3)])
    twists = np.array([np.zeros(3), FULL_SPEED])[:, None] + shift
    at = Instant((twists[..., 0], twists[..., 1], twists[..., 2]), torque=(MAX_WHEEL_TORQUE,) * 4)
    acceleration = np.stack(
        np.broadcast_arrays(*dynamics.forward_dynamics(np, structure, geometry, theta, at)), axis=-1
    )
    jacobian = (acceleration[:, :3] - acceleration[:, 3:]) / 2e-5
    if not np.isfinite(jacobian).all():
        return float("nan")
    rates = [float(np.abs(np.linalg.eigvals(jacobian)).max())]
    if structure.has_actuator:
        slow, fast = (
            dynamics.drive_rates(
                np, structure, theta, Instant((0.0, 0.0, 0.0), torque=(t,) * 4), (0.0,) * 4
            )
            for t in (0.0, 1.0)
        )
        rates.append(float(np.max(np.abs(np.subtract(fast, slow)))))
    if structure.depends_on_angle:
        rates.append(PHASE_SHARE * ripple_rate(structure, geometry, theta))
    return float(np.max(rates))  # not max(): a rate that is no number must show


def ripple_rate(structure: ModelStructure, geometry: Geometry, theta: Array) -> float:
    """Angular frequency [rad/s] at full speed of forces that vary with the wheels' angles."""
    step = 0.01
    angle = step * np.arange(700)
    at = Instant(FULL_SPEED, wheel_angle=(angle,) * 4)
    force = np.stack(np.broadcast_arrays(*dynamics.wrench(np, structure, geometry, theta, at)))
    swing = np.abs(force - force.mean(axis=1, keepdims=True)).max()
    if swing <= 1e-9 * np.abs(force).max():
        return 0.0
    bend = np.abs(np.diff(force, 2, axis=1)).max() / step**2
    fastest = np.abs(wheel_rates(geometry, FULL_SPEED)).max()
    return float(np.sqrt(bend / swing) * fastest)


def substeps(model: Model, duration: float) -> int:
    """Runge-Kutta steps for ``duration`` [s]: the stiffest mode moves by a quarter in each.

    Raises
    ------
    InputError
        If the model is too stiff to simulate (a time constant next to zero, say).
    """
    return _substeps(model.structure, model.geometry, model.theta, duration)


def _substeps(structure: ModelStructure, geometry: Geometry, theta: Array, duration: float) -> int:
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = duration * max(stiffness(structure, geometry, theta), SLOWEST) / 0.25
    if not 0 <= rate <= MAX_SUBSTEPS:
        raise InputError(
            f"too stiff to simulate in steps of {duration:g} s "
            "(a friction's smoothing or a drive's time constant is next to zero)"
        )
    return max(math.ceil(rate), 1)


def simulate(model: Model, time: ArrayLike, torque: ArrayLike, start: ArrayLike) -> Array:
    """Free run: states (N, S) at ``time`` (N,) [s] from ``start`` (S,).

    ``torque`` (N, 4) [N m] is what the interface commands or logs, linear between samples. With a
    delay it acts that much later, and its first value before.
    A run that diverges holds inf or NaN from there on.

    Raises
    ------
    InputError
        If the shapes do not fit the model, time does not increase, or the model is too stiff.
    """
    time, torque = np.asarray(time, float), np.asarray(torque, float)
    if time.ndim != 1 or not len(time) or torque.shape != (len(time), 4):
        raise InputError(f"torque must be (N, 4) for time (N,), not {torque.shape}, {time.shape}")
    duration = np.diff(time)
    if not (duration > 0).all():
        raise InputError("time must be finite and increase from sample to sample")
    return simulate_theta(model.structure, model.geometry, model.theta, duration, torque, start)


def simulate_theta(
    structure: ModelStructure,
    geometry: Geometry,
    theta: Array,
    duration: Array,
    torque: Array,
    start: ArrayLike,
) -> Array:
    """The same for bare parameters theta (P,) and intervals ``duration`` (N - 1,) [s].

    For searches, which pass through parameters that no :class:`Model` would accept.
    """
    state = _vector("start", start, len(structure.state_names))
    time = np.concatenate([[0.0], np.cumsum(duration)])
    delay = float(dynamics.torque_delay(np, structure, theta))
    grid = _grid(time, delay)
    fine, torque = np.diff(grid), np.asarray(torque, float)
    acting = np.stack([np.interp(grid - delay, time, column) for column in torque.T], axis=1)
    out = np.empty((len(grid), len(state)))
    lengths = np.array([geometry.l, geometry.h, geometry.R, geometry.r])
    count = _substeps(structure, geometry, theta, float(fine.max(initial=0.0)))
    theta = np.ascontiguousarray(theta, float)
    rollout(structure)(state, acting, fine, lengths, theta, count, out)
    return out[np.searchsorted(grid, time)]


def _grid(time: Array, delay: float) -> Array:
    """Instants (M,) between which the torques that act are linear, those of ``time`` among them.

    A gap between samples must be as finely stepped as the rest, so it is cut.
    """
    duration = np.diff(time)
    if not len(duration):
        return time
    usual = float(np.median(duration))
    pieces = np.ceil(duration / (1.5 * usual)).astype(int)
    at = np.repeat(np.arange(len(pieces)), pieces)
    part = (np.arange(len(at)) - (np.cumsum(pieces) - pieces)[at]) / pieces[at]
    grid = np.append(time[at] + part * duration[at], time[-1])
    if delay == 0.0:
        return grid
    # Late samples bend the course of the torque between the grid's own instants.
    late = time + delay
    late = late[(late > time[0]) & (late < time[-1])]
    after = np.searchsorted(grid, late).clip(1, len(grid) - 1)
    apart = np.minimum(late - grid[after - 1], grid[after] - late)
    return np.union1d(grid, late[apart > 1e-6 * usual])
