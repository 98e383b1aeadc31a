"""Variables of a log that a force residual may depend on."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from identification.signals.filters import filter_samples

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

    def between(self, begin: int, end: int) -> MotionVariables:
        """The samples from one number to another, and the intervals between them."""
        parts: dict[str, Array] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                ends = field.name.endswith("_ends")
                parts[field.name] = value[:, begin : end - 1] if ends else value[begin:end]
        return replace(self, **parts)

    def for_curves(self) -> MotionVariables:
        """The same without what is in no curve, which is two thirds of it."""
        none = np.zeros((0, 0))
        others = ("rates", "jerk", "load", "torque_rate", "acceleration_ends", "torque_ends")
        return replace(self, departure=None, **dict.fromkeys(others, none))


def smooth(values: Array, rate: float, dt: float) -> Array:
    """Values (N, ...) through a filter of ``rate`` [rad/s] forwards, then backwards: no delay."""
    for _ in range(2):
        # The filter starts from zero. Less its first value, a signal starts from zero too, without
        # a transient.
        start = values[:1]
        values = (start + filter_samples(values - start, rate, dt))[::-1]
    return values
