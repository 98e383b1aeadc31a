"""By how much the wheels' speeds come later than pose or gyro, with its interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import signal

from identification.importing.settings import ImportSettings
from identification.importing.tables import Array, rate_of
from youbot_env.physics.geometry import SIGN_LATERAL, SIGN_Y


@dataclass(frozen=True)
class Delay:
    """How late one channel is.

    Attributes
    ----------
    channel, behind : names, such as "velocity" and "pose"
    value : [s], positive where the channel comes later
    std : its standard deviation [s], over stretches left out in turn
    """

    channel: str
    behind: str
    value: float
    std: float

    @property
    def certain(self) -> bool:
        """Whether it is told: not zero by its 95 % interval, and not negligible."""
        least = max(ImportSettings.interval_deviations * self.std, ImportSettings.min_delay)
        return abs(self.value) > least

    def __str__(self) -> str:
        reach = ImportSettings.interval_deviations * self.std
        return (
            f"{self.channel} comes {1e3 * self.value:.1f} ms after {self.behind} "
            f"(95 %: {1e3 * (self.value - reach):.1f} ... {1e3 * (self.value + reach):.1f})"
        )


def channel_delays(
    time: Array, channels: Mapping[str, Array], settings: ImportSettings = ImportSettings()
) -> list[Delay]:
    """Delays of the speeds behind the pose and behind the gyro, where both show one motion.

    No length and no unit is needed: the motion that the wheels show is fitted to the other one, a
    scale for each axis, and the shift is that of the best fit.

    Parameters
    ----------
    time : (n,) [s]
    channels : "velocity" (n, 4), and "pose" (n, 3) or "gyro" (n, 1) if there is one
    """
    found = []
    for behind in ("pose", "gyro"):
        if behind in channels:
            delay = _delay(time, channels["velocity"], channels[behind], behind, settings)
            if delay is not None:
                found.append(delay)
    return found


def _delay(
    time: Array, speeds: Array, other: Array, behind: str, settings: ImportSettings
) -> Delay | None:
    known = np.isfinite(speeds).all(axis=1) & np.isfinite(other).all(axis=1)
    rate = min(settings.delay_rate, rate_of(time))
    reach = int(settings.max_delay * settings.delay_rate)
    if known.mean() < settings.min_number_share or not np.isfinite(rate):
        return None
    step = 1 / settings.delay_rate
    grid = np.arange(time[known][0], time[known][-1], step)
    if len(grid) < 4 * settings.delay_blocks * reach / 3 or rate < 2.5 * settings.delay_cutoff:
        return None
    low_pass = signal.butter(2, settings.delay_cutoff, fs=settings.delay_rate, output="sos")

    def smooth(columns: Array) -> Array:
        at = [np.interp(grid, time[known], column[known]) for column in columns.T]
        return signal.sosfiltfilt(low_pass, np.column_stack(at), axis=0)

    # Forward, sideways and turning, each in wheel speeds.
    patterns = np.column_stack([np.ones(4), SIGN_LATERAL, -np.array(SIGN_Y)]) / 4
    wheels = smooth(speeds) @ patterns
    wanted = _body_motion(smooth(other), step) if behind == "pose" else smooth(other)
    pairs = [(wheels[:, :2], wanted[:, :2]), (wheels[:, 2:], wanted[:, 2:])]
    pairs = pairs if behind == "pose" else [(wheels[:, 2:], wanted)]
    moments = [_Moments(u, y, reach, settings.delay_blocks) for u, y in pairs]
    best = _best_shift(moments, np.ones(settings.delay_blocks), reach, step)
    left = min(float(m.unexplained(np.ones(m.blocks)).min()) for m in moments)
    if best is None or left > 1 - settings.min_delay_correlation**2:
        return None
    return Delay("velocity", behind, best, _jackknife(moments, reach, step))


def _body_motion(pose: Array, step: float) -> Array:
    """Velocity of O in the body frame, and yaw rate, (n, 3) of poses (n, 3)."""
    vx, vy, turn = np.gradient(pose, step, axis=0).T
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.column_stack([c * vx + s * vy, c * vy - s * vx, turn])


class _Moments:
    """Sums of squares and products of two motions, by block and by shift, for quick refits."""

    def __init__(self, u: Array, y: Array, reach: int, blocks: int) -> None:
        self.blocks, self.axes = blocks, y.shape[1]
        inner = slice(reach, len(u) - reach)
        edges = np.linspace(reach, len(u) - reach, blocks + 1).astype(int)
        self.yy = np.add.reduceat((y[inner] ** 2).sum(axis=1), edges[:-1] - reach)
        self.uu, self.uy = [], []
        for shift in range(-reach, reach + 1):
            # Speeds that come late by the shift show at t + shift what happened at t.
            moved = u[inner.start + shift : inner.stop + shift]
            outer = moved[:, :, None] * moved[:, None, :]
            cross = moved[:, :, None] * y[inner][:, None, :]
            self.uu.append(np.add.reduceat(outer, edges[:-1] - reach, axis=0))
            self.uy.append(np.add.reduceat(cross, edges[:-1] - reach, axis=0))

    def unexplained(self, weights: Array) -> Array:
        """Share of y's squares that no linear map of u explains, by shift; of weighted blocks."""
        total = max(float(weights @ self.yy), 1e-300)
        left = []
        for uu, uy in zip(self.uu, self.uy, strict=True):
            a, b = np.tensordot(weights, uu, 1), np.tensordot(weights, uy, 1)
            gain = np.linalg.lstsq(a, b, rcond=1e-9)[0]
            left.append(1 - float((gain * b).sum()) / total)
        return np.maximum(left, 1e-12)


def _best_shift(moments: list[_Moments], weights: Array, reach: int, step: float) -> float | None:
    """Shift [s] at which motions fit best; None where that is the largest one looked at."""
    # The likelihood of Gaussian noise of unknown size: an axis that hardly moves counts little.
    cost = np.sum([m.axes * np.log(m.unexplained(weights)) for m in moments], axis=0)
    k = int(np.argmin(cost))
    if k in (0, len(cost) - 1):
        return None
    # A parabola through the least value and its neighbours.
    before, at, after = cost[k - 1 : k + 2]
    bend = before - 2 * at + after
    offset = (before - after) / (2 * bend) if bend > 0 else 0.0
    return (k - reach + offset) * step


def _jackknife(moments: list[_Moments], reach: int, step: float) -> float:
    blocks = moments[0].blocks
    found = []
    for k in range(blocks):
        weights = np.ones(blocks)
        weights[k] = 0.0
        best = _best_shift(moments, weights, reach, step)
        found.append(np.nan if best is None else best)
    spread = np.array(found) - np.nanmean(found)
    return float(np.sqrt((blocks - 1) / blocks * np.nansum(spread**2)))
