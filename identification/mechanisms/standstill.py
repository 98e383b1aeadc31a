"""Where a mechanism rests: what holds it there tells nothing of what moves it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.settings import MechanismSettings
from identification.signals.noise import white_noise

Array = NDArray[np.float64]


def moving_rows(speed: Array, dt: float, settings: MechanismSettings) -> NDArray[np.bool_]:
    """(N,) False where a mechanism rests: for longer than a passage through standstill takes.

    Dry friction holds what rests, with any force up to its own: no law of the motion tells it.

    Parameters
    ----------
    speed : (N, J) of all joints; the mechanism moves where one of them does
    dt : time between rows [s]
    """
    moves: NDArray[np.bool_] = np.logical_or.reduce(_turning(speed, dt, settings), axis=1)
    return _without_passages(moves, dt, settings)


def held_rows(speed: Array, dt: float, settings: MechanismSettings) -> NDArray[np.bool_]:
    """(N,) True where one of the joints stands, if only for a moment: friction may hold it."""
    turning, short = _turning(speed, dt, settings), settings.min_stop_duration
    moves = [_without_passages(column, dt, settings, short) for column in turning.T]
    return ~np.all(moves, axis=0)


def _turning(speed: Array, dt: float, settings: MechanismSettings) -> NDArray[np.bool_]:
    """(N, J) whether a joint's averaged speed is more than its noise: creeping counts as motion."""
    size = min(max(1, round(settings.acceleration_averaging_time / dt)), len(speed))
    least = np.maximum(
        settings.min_creep_deviations * white_noise(speed) / np.sqrt(size),
        settings.min_creep_share * np.abs(speed).max(axis=0),
    )
    window = np.full(size, 1.0 / size)
    mean = np.column_stack([np.convolve(column, window, mode="same") for column in speed.T])
    return np.abs(mean) > least


def _without_passages(
    moves: NDArray[np.bool_], dt: float, settings: MechanismSettings, least: float | None = None
) -> NDArray[np.bool_]:
    """``moves`` (N,), where what lasts less than ``least`` [s] is motion: it takes its turn there,
    or creeps. By default the least rest of a mechanism."""
    least = settings.min_rest_duration if least is None else least
    found = moves.copy()
    for stretch in np.split(np.arange(len(moves)), np.flatnonzero(np.diff(moves)) + 1):
        if len(stretch) * dt < least:
            found[stretch] = True
    return found
