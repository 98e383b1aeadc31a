"""Parts of a log that are one calibration motion each, told by what the wheels do."""

from __future__ import annotations

import numpy as np

from identification.mechanisms.samples import Part, Samples, cut
from identification.mechanisms.settings import MechanismSettings


def parts_of(samples: Samples, settings: MechanismSettings = MechanismSettings()) -> list[Part]:
    """The motions of a log in order; a log too short to be judged is one part."""
    width = round(settings.part_window_duration / samples.dt)
    step = max(1, round(settings.part_window_step / samples.dt))
    starts = range(0, len(samples) - width, step)
    if len(starts) < 2:
        return [Part(kind_of_motion(samples, settings), samples)]
    kinds = [kind_of_motion(cut(samples, a, a + width), settings) for a in starts]
    changes = [0, *(k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1]), len(kinds)]
    parts = []
    for first, last in zip(changes, changes[1:], strict=False):
        # A window that straddles two motions passes for one of them: half a window is cut off.
        a = starts[first] + (width // 2 if first > 0 else 0)
        b = starts[last - 1] + (width // 2 if last < len(kinds) else width)
        if (b - a) * samples.dt >= settings.min_part_duration:
            parts.append(Part(kinds[first], cut(samples, a, b)))
    return parts or [Part("free", samples)]


def kind_of_motion(samples: Samples, settings: MechanismSettings) -> str:
    """Which of the paper's motions a stretch looks like: I, II, III, IV or "free"."""
    wheel = np.sqrt((samples.wheel_speed**2).mean(axis=0))
    still = wheel < settings.max_still_speed_share * wheel.max()
    if still.tolist() == [True, False, True, False]:
        return "I"
    if still.tolist() == [False, False, True, True]:
        return "II"
    vx, vy, wz = samples.twist.T
    speed = np.sqrt((vx**2 + vy**2).mean())
    turning = np.sqrt((wz**2).mean()) * settings.yaw_lever
    if turning < settings.max_yaw_speed_share * speed:
        return "III"
    c, s = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2])
    along = np.column_stack([c * vx - s * vy, s * vx + c * vy])
    steady = along.std(axis=0).max() < settings.max_velocity_scatter_share * speed
    return "IV" if steady else "free"
