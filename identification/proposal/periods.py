"""Forces that repeat themselves over the floor or over an angle: a scan over all periods.

What a wave explains of filtered residual rows is their product with the filtered wave. The filter's
transpose on the rows makes that a product with the wave itself, and so, binned by place, a Fourier
transform: thousands of periods and directions in one. Its highest peaks are looked at closely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identification.proposal.settings import ProposalSettings

Array = NDArray[np.float64]


def periods_over_floor(
    place: Array, force: Array, speed: Array, filter_rate: float, settings: ProposalSettings
) -> list[tuple[float, float]]:
    """Periods [m] and directions [rad] of the strongest forces that repeat themselves along a
    direction of the floor; the strongest first.

    Parameters
    ----------
    place : (N, 2) [m] at the samples
    force : taken back through the filter, (N, 2) along the world, of which the part along that
        direction is looked at, or (N, 1) of another direction
    speed : (N,) of O [m/s]; filter_rate : of the filter of forces [rad/s]
    """
    reach = float(np.ptp(place, axis=0).max())
    if reach < 2 * settings.shortest_period:
        return []
    cell = settings.shortest_period / 4
    size = _power_of_two(2 * reach / cell, MOST_CELLS_A_SIDE)
    cell = max(cell, 2 * reach / size)
    index = np.floor((place - place.min(axis=0)) / cell).astype(int)
    flat = np.ravel_multi_index(tuple(index.T), (size, size))
    # Of what does not depend on the place, the wave would be that of how often each was visited.
    swing = force - force.mean(axis=0)
    binned = [np.bincount(flat, part, size * size).reshape(size, size) for part in swing.T]
    waves = np.stack([np.fft.fft2(part) for part in binned])
    k = 2 * np.pi * np.fft.fftfreq(size, cell)
    kx, ky = np.meshgrid(k, k, indexing="ij")
    length = np.hypot(kx, ky)
    along = waves[0]
    if len(waves) > 1:
        along = (kx * waves[0] + ky * waves[1]) / np.maximum(length, 1e-300)
    # Driven in any direction, a wave swings at k v cos(a): the mean over a of what passes.
    passed = sum(1.0 / np.sqrt(1.0 + (length * v / filter_rate) ** 2) for v in _usual(speed))
    power = np.abs(along) ** 2 / passed
    low, high = 2 * np.pi / (0.7 * reach), 2 * np.pi / settings.shortest_period
    power[(length < low) | (length > high) | (kx < 0)] = 0.0
    return [
        (2 * math.pi / float(length[i, j]), math.atan2(ky[i, j], kx[i, j]))
        for i, j in _peaks(power, settings.periods)
    ]


def cycles_of_angles(
    angles: Sequence[Array],
    torques: Sequence[Array],
    speed: Array,
    filter_rate: float,
    settings: ProposalSettings,
) -> list[float]:
    """Cycles a turn of the strongest torques that repeat themselves with the angles of joints.

    Parameters
    ----------
    angles, torques : (N,) of each joint [rad]; taken back through the filter
    speed : (N,) of all joints [rad/s]; filter_rate : of the filter of forces [rad/s]
    """
    lowest = min(float(angle.min()) for angle in angles)
    reach = max(float(angle.max()) for angle in angles) - lowest
    cell = 2 * np.pi / settings.most_cycles / 4
    if reach < 4 * np.pi or 2 * reach / cell > MOST_CELLS:
        return []
    size = _power_of_two(2 * reach / cell, MOST_CELLS)
    power = np.zeros(size // 2 + 1)
    for angle, torque in zip(angles, torques, strict=True):
        index = np.floor((angle - lowest) / cell).astype(int)
        power += np.abs(np.fft.rfft(np.bincount(index, torque, size))) ** 2
    cycles: Array = np.asarray(2 * np.pi * np.fft.rfftfreq(size, cell), float)
    passed = sum(1.0 / (1.0 + (cycles * v / filter_rate) ** 2) for v in _usual(speed))
    power = power / passed
    power[(cycles < settings.least_cycles) | (cycles > settings.most_cycles)] = 0.0
    return [float(cycles[i]) for (i,) in _peaks(power, settings.periods)]


MOST_CELLS_A_SIDE = 1 << 11
"""Bound on memory: of the floor."""

MOST_CELLS = 1 << 20
"""Bound on memory: of an angle."""


def _usual(speed: Array) -> Array:
    """Speeds that each stand for a tenth of the time: how much of a wave the filter leaves depends
    on them all, since slow motion shows the finest waves."""
    return np.quantile(np.abs(speed), np.linspace(0.05, 0.95, 10))


def _power_of_two(least: float, most: int) -> int:
    return min(most, 1 << max(6, math.ceil(math.log2(max(least, 1.0)))))


def _peaks(power: Array, most: int) -> list[tuple[int, ...]]:
    """Places of the highest peaks, each with its neighbourhood taken out before the next."""
    power, found = power.copy(), []
    for _ in range(most):
        at = np.unravel_index(int(np.argmax(power)), power.shape)
        place = tuple(int(i) for i in at)
        if power[place] <= 0:
            break
        found.append(place)
        power[tuple(slice(max(i - 3, 0), i + 4) for i in place)] = 0.0
    return found
