"""Speeds of wheels that were measured at other times than those of the others.

Drives that are asked one after the other, or one whose speed is filtered longer, break the no-slip
identity as slip does, but in step with the wheels' accelerations.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding
from identification.logs.log import Log
from identification.logs.wheel_checks import CheckLimits
from identification.signals.filters import block_mean
from youbot_env.physics.geometry import WHEELS

Array = NDArray[np.float64]


def late_wheels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Wheels whose speeds come before or after the others', by more than is negligible."""
    delays = wheel_delays(log, limits)
    if delays is None:
        return
    far = np.abs(delays) > max(limits.settings.min_wheel_delay, np.abs(delays).max() / 2)
    told = [
        f"velocity_{wheel} comes {1e3 * abs(delay):.2g} ms {'after' if delay > 0 else 'before'}"
        for wheel, delay, is_far in zip(WHEELS, delays, far, strict=True)
        if is_far
    ]
    if told:
        yield Finding(
            "warning",
            f"{' and '.join(told)} the other wheels' speeds: it breaks the no-slip identity as "
            "slip would",
            cure="log the four speeds of one instant, filtered alike; if they are, that wheel "
            "creeps under its torque",
        )


def wheel_delays(log: Log, limits: CheckLimits) -> Array | None:
    """(4,) [s] by how much each wheel's speed comes after the others'; None if that is not what
    breaks the identity, or the motion does not tell the wheels apart.

    The delays are those of a line through what breaks it over the wheels' accelerations, in blocks
    that noise averages out of.
    """
    settings, normal = limits.settings, limits.no_slip
    size = max(round(settings.wheel_delay_block / log.dt), 1)
    speed = block_mean(log.velocity, size)
    if len(speed) < settings.min_rows:
        return None
    broken = speed @ normal
    columns = -normal * np.gradient(speed, size * log.dt, axis=0)
    # A delay that all share breaks nothing: three directions are left to see.
    values, vectors = np.linalg.eigh(columns.T @ columns)
    if values[1] < settings.min_delay_eigenvalue * values[-1]:
        return None
    seen = vectors[:, 1:]
    delays = seen @ ((seen.T @ (columns.T @ broken)) / values[1:])
    noise = len(speed) * float(normal**2 @ log.speed_noise**2) / size
    before = float(broken @ broken) - noise
    after = float(((broken - columns @ delays) ** 2).sum()) - noise
    if before < settings.min_delay_evidence * noise or after > settings.max_left_by_delay * before:
        return None
    return delays - np.median(delays)
