"""Variables of a log that a force residual may depend on, and how samples become rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.signals.filters import block_mean, filter_samples, first_order, settled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionVariables:
    """Variables of one log of N samples; a mechanism may lack those that may be None.

    Attributes
    ----------
    axes, joints, places : names of the A axes, W joints and D coordinates, with which the names
        of variables end
    time : (N,) [s]
    twist : (N, A) as in the log, its acceleration and jerk (N, A)
    rates : (N, K) functions of the twist at which surfaces slide (body, wheels, rollers)
    torque : (N, W) that the model predicts; load: its size; torque_rate: its rate
    position : (N, D) [m] in the world
    heading : (N,) [rad]
    angle, speed : (N, W) of the wheels [rad], [rad/s]
    departure : (N, W) part of the wheels' speeds that no rigid motion explains
    turns : of one axis, whether it turns (rad, N m) or slides (m, N)
    acceleration_ends, torque_ends : (2, N - 1, A) and (2, N - 1, W) at both ends of intervals, as
        the model's own columns are made
    """

    axes: tuple[str, ...]
    joints: tuple[str, ...]
    places: tuple[str, ...]
    time: Array
    twist: Array
    rates: Array
    # Acceleration and torque are not smoothed, because the model's columns are not either. Noise in
    # the columns makes fitted masses too small (attenuation bias). A smoothed acceleration has less
    # noise and would seem to explain what is then missing, although the model is right: the mean of
    # two intervals does already, at 50 Hz. So features are made of both at the intervals' ends.
    # Jerk, load and torque_rate are smoothed: they would be mostly noise.
    acceleration: Array
    jerk: Array
    torque: Array
    load: Array
    torque_rate: Array
    position: Array
    acceleration_ends: Array
    torque_ends: Array
    heading: Array | None = None
    angle: Array | None = None
    speed: Array | None = None
    departure: Array | None = None
    turns: bool | None = None

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float(self.time[1] - self.time[0])


def smooth(values: Array, rate: float, dt: float) -> Array:
    """Values (N, ...) through a filter of ``rate`` [rad/s] forwards, then backwards: no delay."""
    for _ in range(2):
        # The filter starts from zero. Less its first value, a signal starts from zero too, without
        # a transient.
        start = values[:1]
        values = (start + filter_samples(values - start, rate, dt))[::-1]
    return values


@dataclass(frozen=True)
class RowReduction:
    """From samples (N, ...) at ``dt`` [s] to rows (n, ...): the filter, then means of blocks.

    rate: of the filter [rad/s]; settling: its time constants until its start is forgotten; size:
    samples in a row.
    """

    rate: float
    settling: float
    dt: float
    size: int

    @property
    def step(self) -> float:
        """From one row to the next [s]."""
        return self.size * self.dt

    def __call__(self, signal: Array) -> Array:
        return self._averaged(filter_samples(signal, self.rate, self.dt))

    def of_any(self, signal: Array) -> Array:
        """Of a matrix that has rows for samples (N, Q), or for both ends of intervals."""
        return self(signal) if signal.ndim == 2 else self.of_interval_ends(signal)

    def of_interval_ends(self, ends: Array) -> Array:
        """The same of a signal given at both ends of each interval (2, N - 1, ...)."""
        return self._averaged(first_order(ends[0], ends[1], self.rate, self.dt))

    def _averaged(self, filtered: Array) -> Array:
        return block_mean(filtered[settled(self.rate, self.dt, self.settling) :], self.size)
