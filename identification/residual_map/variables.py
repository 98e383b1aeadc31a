"""Variables of a log that a force residual may depend on, as functions of time."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.signals.filters import block_mean, filter_samples

if TYPE_CHECKING:
    from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]

RATE = 100.0
"""Hz: logs above it are averaged down to it; a ripple of 120 rad/s still lies well below."""

SMOOTHING = 20.0
"""Rate [rad/s] of the filter, once forwards and once backwards, ahead of products and jerks."""


@dataclass(frozen=True)
class Signals:
    """Variables of one log of N samples; a mechanism may lack those that may be None.

    time (N,) [s]; twist (N, A) as in the log, its acceleration and jerk (N, A); rates (N, K):
    functions of the twist at which surfaces slide (body, wheels, rollers); torque (N, W) that the
    model predicts, its size, load, and its rate; heading (N,) [rad], position (N, D) [m] in the
    world; angle (N, W) [rad], speed (N, W) of the wheels; departure (N, W): what no rigid motion
    explains in the speeds. axes, joints, places: names of A, W and D, as variables end on them;
    turns: of one axis, whether it turns (rad, N m) or slides (m, N).

    Acceleration and torque are not smoothed: the model's columns are not either, and what holds
    less noise than they do would seem to explain the residual of a sound model, whose masses noise
    has attenuated. Jerk, load and torque_rate are.
    """

    axes: tuple[str, ...]
    joints: tuple[str, ...]
    places: tuple[str, ...]
    time: Array
    twist: Array
    rates: Array
    acceleration: Array
    jerk: Array
    torque: Array
    load: Array
    torque_rate: Array
    position: Array
    heading: Array | None = None
    angle: Array | None = None
    speed: Array | None = None
    departure: Array | None = None
    turns: bool | None = None


def slowed(samples: Any) -> Any:
    """The samples averaged over successive blocks, to RATE or just above."""
    size = max(1, int(1.0 / (RATE * samples.dt) + 1e-6))
    if size == 1:
        return samples
    means = {
        field.name: block_mean(value, size)
        for field in fields(samples)
        if isinstance(value := getattr(samples, field.name), np.ndarray)
    }
    return replace(samples, dt=size * samples.dt, **means)


def signals_of(mechanism: Mechanism, samples: Any, demanded: Array) -> Signals:
    """Variables of a log.

    Parameters
    ----------
    demanded : (2, N - 1, A) force that the model demands at both ends of each interval [N m]
    """
    force = np.concatenate(
        [demanded[0, :1], 0.5 * (demanded[1, :-1] + demanded[0, 1:]), demanded[1, -1:]]
    )
    found = mechanism.variables(samples)
    torque = mechanism.joint_torque(force)
    known: dict[str, Any] = found._asdict() | _derived(found.twist, torque, samples.dt)
    return Signals(time=samples.time, **known)


def _derived(twist: Array, torque: Array, dt: float) -> dict[str, Array]:
    slow = smooth(torque, dt)
    return {
        "acceleration": np.gradient(twist, dt, axis=0),
        "jerk": np.gradient(smooth(np.gradient(smooth(twist, dt), dt, axis=0), dt), dt, axis=0),
        "torque": torque,
        "load": np.abs(slow),
        "torque_rate": np.gradient(slow, dt, axis=0),
    }


def smooth(values: Array, dt: float) -> Array:
    """Without delay: the filter runs forwards, then backwards."""
    for _ in range(2):
        start = values[:1]
        values = (start + filter_samples(values - start, SMOOTHING, dt))[::-1]
    return values
