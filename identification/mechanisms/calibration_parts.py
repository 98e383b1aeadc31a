"""Parts of a log that are one calibration motion each, told by what the wheels do."""

from __future__ import annotations

import numpy as np

from identification.mechanisms.samples import Part, Samples, cut

WINDOW = 5.0
"""Seconds that are judged at once: about one period of a calibration motion."""

STEP = 0.5
"""Seconds from one window to the next."""

SHORTEST = 8.0
"""Shortest part [s] worth a judgement of its own."""

STILL = 0.2
"""Share of the fastest wheel's speed below which a wheel counts as standing (measured: 0.13)."""


ARM = 0.4
"""Lever [m] by which a yaw rate is compared with a speed: about L of the youBot."""


def parts_of(samples: Samples) -> list[Part]:
    """The motions of a log in order; a log too short to be judged is one part."""
    width = round(WINDOW / samples.dt)
    starts = range(0, len(samples) - width, max(1, round(STEP / samples.dt)))
    if len(starts) < 2:
        return [Part(kind_of_motion(samples), samples)]
    kinds = [kind_of_motion(cut(samples, a, a + width)) for a in starts]
    changes = [0, *(k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1]), len(kinds)]
    parts = []
    for first, last in zip(changes, changes[1:], strict=False):
        # A window that straddles two motions passes for one of them: half a window is cut off.
        a = starts[first] + (width // 2 if first > 0 else 0)
        b = starts[last - 1] + (width // 2 if last < len(kinds) else width)
        if (b - a) * samples.dt >= SHORTEST:
            parts.append(Part(kinds[first], cut(samples, a, b)))
    return parts or [Part("free", samples)]


def kind_of_motion(samples: Samples) -> str:
    """Which of the paper's motions a stretch looks like: I, II, III, IV or "free"."""
    wheel = np.sqrt((samples.wheel_speed**2).mean(axis=0))
    still = wheel < STILL * wheel.max()
    if still.tolist() == [True, False, True, False]:
        return "I"
    if still.tolist() == [False, False, True, True]:
        return "II"
    vx, vy, wz = samples.twist.T
    speed = np.sqrt((vx**2 + vy**2).mean())
    if np.sqrt((wz**2).mean()) * ARM < 0.1 * speed:
        return "III"
    c, s = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2])
    along = np.column_stack([c * vx - s * vy, s * vx + c * vy])
    return "IV" if along.std(axis=0).max() < STILL * speed else "free"
