"""Logs of one axis: motion and effort on a uniform time base, and what is typical for the axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import AXIS, Log
from identification.mechanisms.axis_effects import Scales
from identification.signals.filters import FilterSettings, block_mean
from identification.signals.noise import white_noise
from youbot_env.errors import InputError

Array = NDArray[np.float64]

BANDS = (100.0, 30.0)
"""Bandwidths [rad/s] that a fit may take beyond the filter's own 10 rad/s."""

ATTENUATION = 1e-3
"""Share of the inertia that noise of the speed may hide in a fit."""

_ACCELERATION_TIME = 0.05
"""Seconds over which a speed is averaged before its typical rate is judged."""


@dataclass(frozen=True)
class AxisSamples:
    """One log of an axis on a uniform time base.

    name : of the log; time (N,) [s] from the log's start; dt [s]
    velocity, position, effort : (N,) in the log's units
    """

    name: str
    time: Array
    dt: float
    velocity: Array
    position: Array
    effort: Array

    def __len__(self) -> int:
        return len(self.time)

    @property
    def channels(self) -> tuple[Array, Array]:
        """Speed and effort (N, 1)."""
        return self.velocity[:, None], self.effort[:, None]


def axis_samples(log: Log) -> AxisSamples:
    """Motion and effort of a log; without a position column the position starts at 0.

    Raises
    ------
    InputError
        If the log is not that of one axis.
    """
    if tuple(log.joints) != AXIS:
        raise InputError(f"{log.source or log.name}: not the log of one axis")
    time = log.time - log.time[0]
    velocity = log.velocity[:, 0]
    if log.position is not None:
        position = log.position[:, 0]
    else:
        way = 0.5 * log.dt * (velocity[1:] + velocity[:-1])
        position = np.concatenate([[0.0], np.cumsum(way)])
    return AxisSamples(log.name, time, log.dt, velocity, position, log.effort[:, 0])


def typical(logs: Sequence[Log], *, turns: bool) -> Scales:
    """What is typical for the axis that some logs are of.

    Raises
    ------
    InputError
        If the axis never moves or no effort is ever made.
    """
    samples = [axis_samples(log) for log in logs]
    speed = _rms([item.velocity for item in samples])
    force = _rms([item.effort for item in samples])
    if not speed or not force:
        raise InputError("the axis never moves in these logs: record a motion that excites it")
    width = [max(1, round(_ACCELERATION_TIME / item.dt)) for item in samples]
    rates = [
        np.diff(block_mean(item.velocity, n)) / (n * item.dt)
        for item, n in zip(samples, width, strict=True)
    ]
    travel = max(float(np.ptp(item.position)) for item in samples)
    numbers = (speed, _rms(rates), force, travel)
    # Three digits: the scales stand in the model file, and nothing depends on more.
    rounded = [float(f"{value:.3g}") for value in numbers]
    return Scales(turns, *rounded, bandwidth=_bandwidth(samples, rounded[1]))


def _bandwidth(samples: Sequence[AxisSamples], acceleration: float) -> float:
    """How fast a filter all logs bear: noise in the acceleration attenuates the inertia.

    White noise s of the speed leaves 2 a^3 s^2 dt of variance in the acceleration that has passed
    a filter of the rate a and the mean over a row of 1/(2 a).
    """
    for band in BANDS:
        noise = [2 * band**3 * white_noise(s.velocity[:, None])[0] ** 2 * s.dt for s in samples]
        fine = all(band * s.dt <= 0.3 for s in samples)
        if fine and max(noise) <= ATTENUATION * acceleration**2:
            return band
    return FilterSettings.rate


def _rms(parts: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
