"""Speeds that break the wheels' common rigid motion as slip does, but for a reason of their own.

They swing with the wheel's angle (an encoder out of centre, a wheel out of round): what no rigid
motion explains is fitted by each speed times a sine and a cosine of its own angle, per log, since
an angle that is counted from a log's start has another phase in each. Or they come later than the
others: then it is fitted by each wheel's acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import WheelEvidenceSettings
from identification.mechanisms.samples import Samples
from identification.signals.filters import block_mean

Array = NDArray[np.float64]


def swings_of_speeds(
    logs: Sequence[Samples],
    slips: Sequence[Array],
    internal: Array,
    joints: Sequence[str],
    settings: WheelEvidenceSettings,
) -> Mapping[str, float]:
    """Joints whose speeds swing with their angle, with the amplitude as a share of the speed.

    {} where this explains less than most of the slip, judged on the half of each log that it was
    not fitted to.

    Parameters
    ----------
    slips : per log (n,) [rad/s] rows of what no rigid motion explains, see `slip_rows`
    internal : (J,) by how much each speed enters it
    """
    columns = [
        _swings(samples, len(slip), internal, settings)
        for samples, slip in zip(logs, slips, strict=True)
    ]
    if _explained(columns, slips, settings) < settings.min_share_of_swings:
        return {}
    squares, weight = np.zeros(len(joints)), sum(map(len, slips))
    for own, slip in zip(columns, slips, strict=True):
        sizes = np.linalg.lstsq(own, slip, rcond=None)[0]
        squares += len(slip) / weight * (sizes.reshape(-1, len(joints)) ** 2).sum(axis=0)
    found = np.sqrt(squares)
    least = settings.min_share_of_largest_swing * found.max()
    sizes_of = dict(zip(joints, found.tolist(), strict=True))
    return {joint: size for joint, size in sizes_of.items() if size >= least}


def late_speeds(
    logs: Sequence[Samples],
    slips: Sequence[Array],
    internal: Array,
    joints: Sequence[str],
    settings: WheelEvidenceSettings,
) -> Mapping[str, float]:
    """Joints whose speeds come after the others', with the delay [s]; below zero if before.

    {} where delays explain less than most of the slip, judged as swings are, or where the motion
    does not tell the joints apart.
    """
    columns = [
        -internal * _row_rates(samples, len(slip), settings)
        for samples, slip in zip(logs, slips, strict=True)
    ]
    if _explained(columns, slips, settings) < settings.min_share_of_swings:
        return {}
    all_columns = np.concatenate(columns)
    power, directions = np.linalg.eigh(all_columns.T @ all_columns)
    # A delay that all share breaks nothing; all others must be seen.
    if power[1] < settings.min_delay_eigenvalue * power[-1]:
        return {}
    seen = directions[:, 1:]
    delays = seen @ ((seen.T @ (all_columns.T @ np.concatenate(slips))) / power[1:])
    delays = delays - np.median(delays)
    least = settings.min_share_of_largest_swing * np.abs(delays).max()
    delay_of = dict(zip(joints, delays.tolist(), strict=True))
    return {joint: delay for joint, delay in delay_of.items() if abs(delay) >= least}


def _explained(
    columns: Sequence[Array], slips: Sequence[Array], settings: WheelEvidenceSettings
) -> float:
    """Share of the slip's squares that columns explain of the half of a log not fitted to."""
    total = left = 0.0
    for own, slip in zip(columns, slips, strict=True):
        half = len(slip) // 2
        if half < settings.min_rows_of_swing * own.shape[1]:
            continue
        for known, unseen in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
            sizes = np.linalg.lstsq(own[known], slip[known], rcond=None)[0]
            total += float((slip[unseen] ** 2).sum())
            left += float(((slip[unseen] - own[unseen] @ sizes) ** 2).sum())
    return 1.0 - left / total if total > 0.0 else 0.0


def _row_rates(samples: Samples, rows: int, settings: WheelEvidenceSettings) -> Array:
    """(n, J) rates of the speeds in the first rows."""
    size = settings.row_size(samples.dt)
    means = block_mean(samples.wheel_speed, size)[:rows]
    if rows < 2:  # one row has no rate
        return np.zeros_like(means)
    return np.gradient(means, size * samples.dt, axis=0)


def _swings(samples: Samples, rows: int, internal: Array, settings: WheelEvidenceSettings) -> Array:
    """(n, orders * 2 * J) what each speed adds where it swings so many times a turn."""
    size = settings.row_size(samples.dt)
    most = max(1, settings.max_samples_at_once // size)
    parts = []
    for begin in range(0, rows, most):
        piece = slice(begin * size, min(begin + most, rows) * size)
        speed = internal * samples.wheel_speed[piece]
        angle = samples.wheel_angle[piece]
        swings = [
            speed * of(order * angle) for order in settings.swings_a_turn for of in (np.cos, np.sin)
        ]
        parts.append(block_mean(np.concatenate(swings, axis=1), size))
    return np.concatenate(parts)
