"""Free-run simulation of a model: compiled, in steps fine enough for its stiffest friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Geometry as Lengths, Instant, ModelStructure
from youbot_env.physics.residual_maps import Places
from youbot_env.simulation.compiled import rollout

Array = NDArray[np.float64]


Model = Any
"""A `Model`. It is not named, so that this file need not import it: other mechanisms are simulated
without it. pyright does not match a Protocol with cached properties."""

SLOWEST = 15.0
"""Least rate [1/s] for which steps are chosen, also where a model is slower: a log at 50 Hz then
gets two steps a sample."""

MAX_SUBSTEPS = 2000

SPEED_STEP = 1.25e-5
"""Step, as a share of the greatest speed, of the difference that gives the slope of the
acceleration: narrower than the smoothed step of any dry friction."""

PHASE_SHARE = 1.0 / 3.0
"""Share of a ripple's frequency that counts as stiffness. A ripple drives the twist and is no
feedback, so a step of 0.75 rad of its phase makes an error of only 1e-4 of its effect."""


def initial_state(
    model: Model,
    *,
    twist: ArrayLike = (0.0, 0.0, 0.0),
    pose: ArrayLike = (0.0, 0.0, 0.0),
    wheel_angle: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    torque: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    time: float = 0.0,
    start: float = 0.0,
) -> Array:
    """State (S,) in the order of ``model.structure.state_names``.

    twist (VX, VY, W) [m/s, m/s, rad/s], pose (x, y, yaw) [m, m, rad], wheel angles [rad], torques
    [N m] that already act (read by models with an actuator), time [s] from the run's start, and
    that start [s] on the clock that runs share (read by models in which something drifts).
    """
    given = {"twist": (twist, 3), "pose": (pose, 3), "wheel_angle": (wheel_angle, 4)}
    parts = [_vector(name, *value) for name, value in given.items()] + [np.array([time])]
    if model.structure.has_actuator:
        parts.append(_vector("torque", torque, 4))
        # The rates of what drives of second order exert begin at zero.
        parts.append(np.zeros(4 * (model.structure.drive_order - 1)))
    if model.structure.reads_start:
        parts.append(np.array([start]))
    return np.concatenate(parts)


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    array = np.asarray(value, float)
    if array.shape != (size,):
        raise InputError(f"{name} must hold {size} numbers, not shape {array.shape}")
    return array


def stiffness(structure: ModelStructure[Lengths], geometry: Lengths, theta: Array) -> float:
    """Fastest rate [1/s] of the twist (and drives) under full torque.

    Evaluated at rest, where dry friction is stiffest, beside it, since friction that is the same
    both ways has no slope at rest, and at full speed, where drag is.
    """
    mechanism = structure.mechanism
    size, joints = len(mechanism.axes), len(mechanism.joints)
    fast = np.asarray(mechanism.full_speed(geometry), float)
    step = SPEED_STEP * float(np.abs(fast).max())
    # Central differences along each axis; all evaluations in one call.
    shift = step * np.concatenate([np.eye(size), -np.eye(size)])
    # In no direction in which some joint stands still.
    beside = step * (2.0 - 0.7 * np.arange(size))
    twists = np.array([np.zeros(size), beside, fast])[:, None] + shift
    at = Instant(
        tuple(np.moveaxis(twists, -1, 0)), torque=(mechanism.full_torque(geometry),) * joints
    )
    acceleration = np.stack(
        np.broadcast_arrays(*dynamics.forward_dynamics(np, structure, geometry, theta, at)), axis=-1
    )
    jacobian = (acceleration[:, :size] - acceleration[:, size:]) / (2 * step)
    # eigvals would raise.
    if not np.isfinite(jacobian).all():
        return float("nan")
    rates = [float(np.abs(np.linalg.eigvals(jacobian)).max())]
    if structure.has_actuator:
        rates.append(_drive_stiffness(structure, theta))
    if structure.depends_on_angle:
        rates.append(PHASE_SHARE * ripple_rate(structure, geometry, theta))
    return float(np.max(rates))  # not max(): a rate that is no number must show


def _drive_stiffness(structure: ModelStructure[Lengths], theta: Array) -> float:
    """Fastest rate [1/s] of the drives: linear systems in the torque and, of second order, its
    rate."""
    size, joints = len(structure.mechanism.axes), len(structure.mechanism.joints)

    def rates(torque: float, rate: float) -> Array:
        at = Instant((0.0,) * size, torque=(torque,) * joints, torque_rate=(rate,) * joints)
        found = dynamics.drive_rates(np, structure, theta, at, (0.0,) * joints)
        return np.array(found, float).reshape(structure.drive_order, joints)

    still = rates(0.0, 0.0)
    columns = [rates(1.0, 0.0) - still, rates(0.0, 1.0) - still][: structure.drive_order]
    matrices = np.moveaxis(np.array(columns), -1, 0)
    if not np.isfinite(matrices).all():
        return float("nan")
    return float(np.abs(np.linalg.eigvals(matrices)).max())


def ripple_rate(structure: ModelStructure[Lengths], geometry: Lengths, theta: Array) -> float:
    """Angular frequency [rad/s] at full speed of forces that vary with the joints' angles."""
    mechanism = structure.mechanism
    fast = mechanism.full_speed(geometry)
    # A little more than a turn, 7 rad; 15 points a period for the fastest ripple (40 a turn).
    step = 0.01
    angle = step * np.arange(700)
    at = Instant(fast, wheel_angle=(angle,) * len(mechanism.joints))
    force = np.stack(np.broadcast_arrays(*dynamics.wrench(np, structure, geometry, theta, at)))
    swing = np.abs(force - force.mean(axis=1, keepdims=True)).max()
    if swing <= 1e-9 * np.abs(force).max():
        return 0.0
    # Of a sine the second derivative over the amplitude is the square of its frequency.
    bend = np.abs(np.diff(force, 2, axis=1)).max() / step**2
    fastest = np.abs(mechanism.joint_rates(geometry, fast)).max()
    return float(np.sqrt(bend / swing) * fastest)


def substeps(model: Model, duration: float) -> int:
    """Runge-Kutta steps for ``duration`` [s]: the stiffest mode moves by a quarter in each.

    Raises
    ------
    InputError
        If the model is too stiff to simulate (a time constant next to zero, say).
    """
    return _substeps(model.structure, model.geometry, model.theta, duration)


def _substeps(
    structure: ModelStructure[Lengths], geometry: Lengths, theta: Array, duration: float
) -> int:
    # A search may try parameters with a singular mass matrix; the check below refuses them.
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = duration * max(stiffness(structure, geometry, theta), SLOWEST) / 0.25
    # Written so that NaN fails too.
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
        If the shapes do not fit the model, time does not increase, the model is too stiff, or the
        run goes where a map of the residual in it knows nothing.
    """
    time, torque = np.asarray(time, float), np.asarray(torque, float)
    if time.ndim != 1 or not len(time) or torque.shape != (len(time), 4):
        raise InputError(f"torque must be (N, 4) for time (N,), not {torque.shape}, {time.shape}")
    duration = np.diff(time)
    if not (duration > 0).all():
        raise InputError("time must be finite and increase from sample to sample")
    found = simulate_theta(model.structure, model.geometry, model.theta, duration, torque, start)
    model.refuse_unseen(places_of(found), "the free run")
    return found


def places_of(states: Array) -> Places:
    """Where a platform is in its states (..., S)."""
    return Places(states[..., :3], states[..., 3:6], states[..., 6:10], time=states[..., 10])


def simulate_theta(
    structure: ModelStructure[Lengths],
    geometry: Lengths,
    theta: Array,
    duration: Array,
    torque: Array,
    start: ArrayLike,
) -> Array:
    """The same of any mechanism, for bare parameters theta (P,) and intervals (N - 1,) [s].

    For searches: they try parameters that a `Model` would refuse.
    """
    state = _vector("start", start, len(structure.state_names))
    time = np.concatenate([[0.0], np.cumsum(duration)])
    delay = float(dynamics.torque_delay(np, structure, theta))
    grid = _grid(time, delay)
    fine, torque = np.diff(grid), np.asarray(torque, float)
    # np.interp keeps the first value before the first sample, as promised for a delay.
    acting = np.stack([np.interp(grid - delay, time, column) for column in torque.T], axis=1)
    out = np.empty((len(grid), len(state)))
    lengths = np.array([getattr(geometry, name) for name in structure.mechanism.lengths])
    count = _substeps(structure, geometry, theta, float(fine.max(initial=0.0)))
    theta = np.ascontiguousarray(theta, float)
    rollout(structure, dynamics)(state, acting, fine, lengths, theta, count, out)
    return out[np.searchsorted(grid, time)]


def _grid(time: Array, delay: float) -> Array:
    """Instants (M,) between which the torques that act are linear, those of ``time`` among them.

    A gap between samples must be as finely stepped as the rest, so it is cut.
    """
    duration = np.diff(time)
    if not len(duration):
        return time
    usual = float(np.median(duration))
    # Intervals up to 1.5 times the usual one are jitter and stay whole.
    pieces = np.ceil(duration / (1.5 * usual)).astype(int)
    at = np.repeat(np.arange(len(pieces)), pieces)
    part = (np.arange(len(at)) - (np.cumsum(pieces) - pieces)[at]) / pieces[at]
    grid = np.append(time[at] + part * duration[at], time[-1])
    if delay == 0.0:
        return grid
    # The delayed torque has its corners at the delayed sample times, so these join the grid, unless
    # they nearly coincide with one of its instants.
    late = time + delay
    late = late[(late > time[0]) & (late < time[-1])]
    after = np.searchsorted(grid, late).clip(1, len(grid) - 1)
    apart = np.minimum(late - grid[after - 1], grid[after] - late)
    return np.union1d(grid, late[apart > 1e-6 * usual])
