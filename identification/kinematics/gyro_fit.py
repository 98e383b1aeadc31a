"""The ratio R/L and the delay of the wheels from a gyro: turned angle = g dPsi + bias time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.kinematics.motion import Array, Motion, angles_at
from identification.kinematics.pose_fit import TURNING
from identification.kinematics.settings import KinematicsSettings
from identification.signals.filters import integral_of


@dataclass(frozen=True)
class _Turns:
    """Pieces of some logs: turned angle of the gyro (k,) and of the wheels per g (k,), its change
    with the delay (k,), duration by log (k, logs), and the block (k,) of each."""

    gyro: Array
    wheels: Array
    by_delay: Array
    bias: Array
    block: NDArray[np.intp]

    def columns(self, g: float) -> Array:
        """(k, 2 + logs) derivatives by g, delay and the gyros' biases."""
        return np.column_stack([self.wheels, g * self.by_delay, self.bias])


def fit_gyro(
    motions: Sequence[Motion], settings: KinematicsSettings = KinematicsSettings()
) -> tuple[Array, Array, float]:
    """(g, delay) with g = R/L in the log's numbers, their covariance (2, 2), and yaw turned [rad].

    Pieces of ``slip_window`` are compared, far above the noise of both; a gyro's bias is a number
    of each log.
    """
    g, delay = _coarse(motions, settings)
    turns, weighted, left = _turns(motions, delay, settings), np.empty((0, 2)), np.empty(0)
    for _ in range(settings.iterations):
        turns = _turns(motions, delay, settings)
        columns = turns.columns(g)
        step, root = _robust(columns, turns.gyro - g * turns.wheels, settings)
        left = (turns.gyro - g * turns.wheels - columns @ step) * root
        weighted = columns * root[:, None]
        g += float(step[0])
        delay += float(np.clip(step[1], -2 * settings.delay_step, 2 * settings.delay_step))
    moves = np.array(
        [
            np.linalg.lstsq(weighted[turns.block != k], left[turns.block != k], rcond=None)[0][:2]
            for k in np.unique(turns.block)
        ]
    )
    spread, count = moves - moves.mean(axis=0), len(moves)
    covariance = (count - 1) / count * spread.T @ spread
    return np.array([g, delay]), covariance, float(np.abs(g * turns.wheels).sum())


def _coarse(motions: Sequence[Motion], settings: KinematicsSettings) -> tuple[float, float]:
    """g and delay of least squares on a grid of delays."""
    found = []
    for delay in np.arange(-settings.max_delay, settings.max_delay, settings.delay_step).tolist():
        turns = _turns(motions, delay, settings)
        columns = np.column_stack([turns.wheels, turns.bias])
        weights = np.linalg.lstsq(columns, turns.gyro, rcond=None)[0]
        left = turns.gyro - columns @ weights
        found.append((float(left @ left), float(weights[0]), delay))
    return min(found)[1:]


def _robust(columns: Array, left: Array, settings: KinematicsSettings) -> tuple[Array, Array]:
    """Step (p,) of least squares with Huber's weights, and their roots (k,)."""
    root = np.ones(len(left))
    step = np.zeros(columns.shape[1])
    for _ in range(settings.iterations):
        step = np.linalg.lstsq(columns * root[:, None], left * root, rcond=None)[0]
        size = np.abs(left - columns @ step)
        limit = settings.huber_deviations * 1.4826 * float(np.median(size))
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(size, 1e-300)))
    return np.asarray(step, np.float64), np.asarray(root, np.float64)


def _turns(motions: Sequence[Motion], delay: float, settings: KinematicsSettings) -> _Turns:
    gyro, wheels, by_delay, bias, block = [], [], [], [], []
    blocks = max(settings.blocks // len(motions), 4)
    for k, motion in enumerate(motions):
        assert motion.gyro_z is not None
        known = np.isfinite(motion.gyro_z)
        size = max(round(settings.slip_window / motion.dt), 1)
        ends = np.arange(0, len(known), size)
        whole = np.add.reduceat(~known, ends)[:-1] == 0
        angle = angles_at(motion, delay) @ TURNING / 4
        speed = np.gradient(angle, motion.dt)
        turned = integral_of(np.where(known, motion.gyro_z, 0.0), motion.dt)
        gyro.append(np.diff(turned[ends])[whole])
        wheels.append(np.diff(angle[ends])[whole])
        by_delay.append(np.diff(speed[ends])[whole])
        time = np.zeros((int(whole.sum()), len(motions)))
        time[:, k] = size * motion.dt
        bias.append(time)
        count = len(gyro[-1])
        block.append(k * blocks + np.arange(count) * blocks // max(count, 1))
    return _Turns(
        np.concatenate(gyro),
        np.concatenate(wheels),
        np.concatenate(by_delay),
        np.concatenate(bias),
        np.concatenate(block).astype(np.intp),
    )
