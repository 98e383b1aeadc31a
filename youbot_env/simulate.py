"""Free-run simulation of a model: compiled, in steps fine enough for its stiffest friction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env import dynamics
from youbot_env.dynamics import Instant
from youbot_env.errors import InputError
from youbot_env.kernels import kernel
from youbot_env.model import Model

Array = NDArray[np.float64]

MAX_SUBSTEPS = 2000


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
    parts = [np.asarray(twist, float), np.asarray(pose, float), np.asarray(wheel_angle, float)]
    state = np.concatenate([*parts, [time]])
    return np.concatenate([state, np.asarray(torque, float)]) if _has_drive(model) else state


def _has_drive(model: Model) -> bool:
    return model.structure.has_actuator


def stiffness(model: Model) -> float:
    """Fastest rate [1/s] of the twist (and drives) at rest, where friction is stiffest."""
    size = 3
    shift = 1e-5
    twists = np.concatenate([shift * np.eye(size), -shift * np.eye(size)])
    at = Instant(tuple(twists.T), torque=(1.0,) * 4)
    acceleration = np.stack(
        np.broadcast_arrays(
            *dynamics.forward_dynamics(np, model.structure, model.geometry, model.theta, at)
        )
    )
    jacobian = (acceleration[:, :size] - acceleration[:, size:]) / (2 * shift)
    rates = [float(np.abs(np.linalg.eigvals(jacobian)).max())]
    if _has_drive(model):
        args = (np, model.structure, model.theta)
        slow, fast = (
            dynamics.drive_rates(*args, Instant((0.0,) * 3, torque=(t,) * 4), (0.0,) * 4)
            for t in (0.0, 1.0)
        )
        rates.append(float(np.max(np.abs(np.subtract(fast, slow)))))
    return max(rates)


def substeps(model: Model, duration: float) -> int:
    """Runge-Kutta steps for ``duration`` [s]: the stiffest mode moves by a quarter in each.

    Raises
    ------
    InputError
        If the model is too stiff to simulate (a time constant next to zero, say).
    """
    count = math.ceil(duration * max(stiffness(model), 10.0) / 0.25)
    if not 0 <= count <= MAX_SUBSTEPS:
        raise InputError(
            f"model {model.name}: too stiff to simulate in steps of {duration:g} s "
            "(a friction's smoothing or a time constant is next to zero)"
        )
    return max(count, 1)


def simulate(model: Model, time: ArrayLike, torque: ArrayLike, start: ArrayLike) -> Array:
    """Free run: states (N, S) at ``time`` (N,) [s] from ``start`` (S,).

    ``torque`` (N, 4) [N m] is what the interface commands or logs, linear between samples.
    A run that diverges holds inf or NaN from there on.
    """
    time, torque = np.asarray(time, float), np.ascontiguousarray(torque, float)
    duration = np.diff(time)
    out = np.empty((len(time), len(model.structure.state_names)))
    run = kernel(model.structure).rollout
    count = substeps(model, float(np.median(duration)))
    run(np.asarray(start, float), torque, duration, model.lengths, model.theta, count, out)
    return out
