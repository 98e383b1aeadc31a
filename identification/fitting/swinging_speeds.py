"""Wheels whose speeds swing with their own angle: an encoder out of centre, a wheel out of round.

Such a speed breaks the wheels' common rigid motion as slip does, but once or twice a turn. What no
rigid motion explains is fitted by each speed times a sine and a cosine of its own angle, per log,
since an angle that is counted from a log's start has another phase in each.
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
    total = left = weight = 0.0
    squares = np.zeros(len(joints))
    for samples, slip in zip(logs, slips, strict=True):
        columns = _columns(samples, len(slip), internal, settings)
        half = len(slip) // 2
        if half < settings.min_rows_of_swing * columns.shape[1]:
            continue
        for known, unseen in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
            sizes = np.linalg.lstsq(columns[known], slip[known], rcond=None)[0]
            total += float((slip[unseen] ** 2).sum())
            left += float(((slip[unseen] - columns[unseen] @ sizes) ** 2).sum())
        sizes = np.linalg.lstsq(columns, slip, rcond=None)[0]
        squares += len(slip) * (sizes.reshape(-1, len(joints)) ** 2).sum(axis=0)
        weight += len(slip)
    if total <= 0.0 or 1.0 - left / total < settings.min_share_of_swings:
        return {}
    found = np.sqrt(squares / weight)
    least = settings.min_share_of_largest_swing * found.max()
    sizes_of = dict(zip(joints, found.tolist(), strict=True))
    return {joint: size for joint, size in sizes_of.items() if size >= least}


def _columns(
    samples: Samples, rows: int, internal: Array, settings: WheelEvidenceSettings
) -> Array:
    """(n, orders * 2 * J) what each speed adds where it swings so many times a turn."""
    size = max(1, round(settings.row_time / samples.dt))
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
