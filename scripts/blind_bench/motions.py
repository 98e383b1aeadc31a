"""References for blind tests, like those of the given logs, smooth at both ends.

Determined from the given logs by regression on their speeds and torques: the calibration run is
the same for every platform; a multisine has four tones of equal amplitude on each axis, drawn from
a band.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RAMP = 1.5
"""[s] at each end of a motion."""

PART = 35.0
"""[s] of each of the four calibration motions."""

MULTISINE = 60.0
"""[s]"""

PEAKS = (0.30, 0.30, 0.60)
"""Of a multisine's VX, VY [m/s] and W [rad/s]."""

BAND = (0.3, 3.0)
"""[rad/s]; a tone is drawn log-uniformly"""

TONES = 4
"""On each axis."""

LEVER = 0.15 + 0.2355
"""L = l + h [m]"""


def _window(t: Array, duration: float) -> Array:
    u = np.clip(np.minimum(t, duration - t) / RAMP, 0.0, 1.0)
    # A cubic with slope zero at both ends: no jump of acceleration at start and end.
    return u * u * (3.0 - 2.0 * u)


def calibration(dt: float) -> Array:
    """Twist (N, 3) [m/s, m/s, rad/s] of motions I, III, II, IV every dt [s], 140 s in all."""
    t = dt * np.arange(round(4 * PART / dt) + 1)
    twist = np.zeros((len(t), 3))
    part = np.minimum(t // PART, 3).astype(int)
    local = t - PART * part
    window = _window(local, PART)
    turning = 0.55 * np.sin(0.9 * t) * window
    for number, axis in ((0, 0), (2, 1)):  # I and II: about a point on the Y and on the X axis
        at = part == number
        twist[at, axis], twist[at, 2] = LEVER * turning[at], turning[at]
    at = part == 1
    circle = 0.22 * window[at]
    twist[at, 0], twist[at, 1] = circle * np.cos(t[at]), circle * np.sin(t[at])
    at = part == 3
    swing = 0.715 * np.sin(0.6 * local[at]) * window[at]
    # Straight in the world while turning: the body velocity turns against the heading.
    heading = np.cumsum(swing) * dt
    straight = 0.12 * window[at]
    twist[at] = np.column_stack([straight * np.cos(heading), -straight * np.sin(heading), swing])
    return twist


def multisine(rng: np.random.Generator, dt: float) -> Array:
    """Twist (N, 3) [m/s, m/s, rad/s] of a random multisine every dt [s], 60 s in all."""
    t = np.asarray(dt * np.arange(round(MULTISINE / dt) + 1), float)
    window = _window(t, MULTISINE)
    axes = []
    for peak in PEAKS:
        frequency = np.exp(rng.uniform(np.log(BAND[0]), np.log(BAND[1]), TONES))
        phase = rng.uniform(0.0, 2 * np.pi, TONES)
        wave = np.sin(np.multiply.outer(t, frequency) + phase).sum(axis=1) * window
        axes.append(peak * wave / np.abs(wave).max())
    return np.column_stack(axes)


def wheel_speeds(twist: Array, wheel_radius: float = 0.0475) -> Array:
    """Wheel speeds (N, 4) [rad/s] without slip; order fl, fr, bl, br."""
    ahead, left, turn = twist[:, 0], twist[:, 1], LEVER * twist[:, 2]
    rows = [ahead - left - turn, ahead + left + turn, ahead + left - turn, ahead - left + turn]
    return np.column_stack(rows) / wheel_radius


def twist_of(speed: Array, wheel_radius: float = 0.0475) -> Array:
    """Twist (N, 3) [m/s, m/s, rad/s] that is nearest to wheel speeds (N, 4); see `wheel_speeds`."""
    a, b, c, d = speed.T
    sums = [a + b + c + d, b + c - a - d, (b + d - a - c) / LEVER]
    return 0.25 * wheel_radius * np.column_stack(sums)
