"""Each wheel's own radius, roller angle and arm, from its angle and the way of the pose.

Without slip  r_i phi_i' = VX + t_i VY + k_i W  with t_i the tangent of the roller's angle and k_i
the wheel's arm. The pose is noisy, and least squares on it would be too flat: the ways that the
wheels say take the place of instruments (Reiersol 1945), whose noise has nothing to do with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.kinematics.motion import Array, Motion, angles_at
from identification.kinematics.pose_fit import LATERAL, TURNING, LogTerms, PoseFit
from identification.kinematics.settings import KinematicsSettings

TWIST = np.column_stack([np.ones(4), LATERAL, TURNING]) / 4
"""(4, 3): what a twist makes of four equal wheels, over 4."""


@dataclass(frozen=True)
class WheelFit:
    """One wheel: value and standard deviation of each quantity, None where it is not shown.

    radius [m], roller_angle [rad] (positive as in `geometry.SIGN_LATERAL`), arm [m]
    """

    radius: tuple[float, float]
    roller_angle: tuple[float, float] | None
    arm: tuple[float, float] | None


def fit_wheels(
    motions: Sequence[Motion], fit: PoseFit, settings: KinematicsSettings
) -> tuple[list[WheelFit], Array]:
    """Each wheel's own lengths, and the covariance (4, 4) of the radii over their mean.

    Raises
    ------
    ValueError
        If there are too few pieces.
    """
    tables = [_pieces(motion, fit, settings) for motion in motions]
    way, angle = (np.concatenate([table[i] for table in tables]) for i in (0, 1))
    if len(way) < settings.min_pieces:
        raise ValueError("too few pieces")
    size = np.sqrt((way**2).mean(axis=0)) * np.array([1.0, 1.0, settings.usual_arm])
    shown = size > settings.min_excited_share * size.max()
    if not shown[0] and not shown[1]:
        raise ValueError("no way")
    use = np.flatnonzero(shown)
    instrument = angle @ TWIST[:, use]
    keep = np.ones(len(way), bool)
    for _ in range(3):
        rates = _solve(instrument[keep], way[keep][:, use], angle[keep])
        left = angle - way[:, use] @ rates
        scale = 1.4826 * np.median(np.abs(left), axis=0)
        keep = (np.abs(left) < settings.outlier_deviations * np.maximum(scale, 1e-12)).all(axis=1)
    instrument, way, angle = instrument[keep], way[keep][:, use], angle[keep]
    rates = _solve(instrument, way, angle)
    if set(use.tolist()) >= {0, 1}:
        # The frame's yaw was fitted with equal wheels.
        way = _turned(way, _frame_error(rates, settings))
        rates = _solve(instrument, way, angle)
    drawn = np.array(
        [
            _lengths(_solve(instrument[part], way[part], angle[part]), use)
            for part in _left_out(len(way), settings.blocks)
        ]
    )
    value = _lengths(rates, use)
    count = len(drawn)
    moved = drawn - drawn.mean(axis=0)
    std = np.sqrt((count - 1) / count * (moved**2).sum(axis=0))
    ratio = drawn[:, :, 0] / drawn[:, :, 0].mean(axis=1)[:, None]
    ratio = ratio - ratio.mean(axis=0)
    covariance = (count - 1) / count * ratio.T @ ratio
    wheels = []
    for k in range(4):
        angle_of = (value[k, 1], std[k, 1]) if 1 in use and 0 in use else None
        arm = (value[k, 2], std[k, 2]) if 2 in use else None
        wheels.append(WheelFit((value[k, 0], std[k, 0]), angle_of, arm))
    return wheels, covariance


def _solve(instrument: Array, way: Array, angle: Array) -> Array:
    found = np.linalg.lstsq(instrument.T @ way, instrument.T @ angle, rcond=None)[0]
    return np.asarray(found, np.float64)


def _frame_error(rates: Array, settings: KinematicsSettings) -> float:
    """Angle by which the ways are turned if few wheels are to differ from the rest.

    A turn by a small angle e looks like radii that differ by e in the pattern of the rollers and
    like all rollers turned by e. Of all that explain the ways the one with the least sum of
    sizes is taken: it has few wheels that differ (as the lasso has few coefficients).
    """
    trials = np.linspace(-settings.max_frame_error, settings.max_frame_error, 401)
    sums = []
    for trial in trials.tolist():
        turned = _turned(rates.T, trial).T
        radii = np.log(np.abs(turned[0]))
        angles = np.arctan2(turned[1] * LATERAL, turned[0]) - np.pi / 4
        sums.append(float(np.abs(radii - np.median(radii)).sum() + np.abs(angles).sum()))
    return float(trials[int(np.argmin(sums))])


def _turned(way: Array, angle: float) -> Array:
    """Ways (k, u) whose first two components are turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    found = way.copy()
    found[:, 0], found[:, 1] = c * way[:, 0] - s * way[:, 1], s * way[:, 0] + c * way[:, 1]
    return found


def equalised(velocity: Array, wheels: Sequence[WheelFit]) -> Array:
    """Speeds (n, 4) that four equal wheels with rollers at 45 degrees would have had instead."""
    radius = np.array([wheel.radius[0] for wheel in wheels])
    mean = float(radius.mean())
    if any(wheel.roller_angle is None or wheel.arm is None for wheel in wheels):
        return velocity * (radius / mean)
    lateral = np.tan([wheel.roller_angle[0] for wheel in wheels if wheel.roller_angle])
    arm = np.array([wheel.arm[0] for wheel in wheels if wheel.arm])
    own = np.column_stack([np.ones(4), lateral, TURNING * arm]) / radius[:, None]
    equal = np.column_stack([np.ones(4), LATERAL, TURNING * arm.mean()]) / mean
    return velocity @ np.linalg.pinv(own).T @ equal.T


def _left_out(count: int, blocks: int) -> list[np.ndarray]:
    """For each block of neighbours the rows outside it."""
    number = (np.arange(count) * min(blocks, count) // count).astype(int)
    return [np.flatnonzero(number != k) for k in np.unique(number)]


def _lengths(rates: Array, use: np.ndarray) -> Array:
    """(4, 3): radius, roller angle, arm of each wheel, of the rates (u, 4) of what is shown."""
    found = np.zeros((4, 3))
    column = {int(axis): rates[k] for k, axis in enumerate(use)}
    first = column.get(0, column.get(1, np.ones(4)) * LATERAL)
    found[:, 0] = 1 / first
    if 1 in column:
        found[:, 1] = np.arctan2(column[1], first * 1.0)
    if 2 in column:
        found[:, 2] = np.abs(column[2] / first)
    return found


def _pieces(motion: Motion, fit: PoseFit, settings: KinematicsSettings) -> tuple[Array, Array]:
    """Ways (k, 3) along VX, VY and W of the body, by the pose, and angles (k, 4) of the wheels."""
    terms = LogTerms(motion, settings)
    terms.drop_outliers(fit.theta)
    a, b, u, v, g, delay = fit.theta.tolist()
    angle = angles_at(motion, delay)
    yaw = terms.smooth_yaw(angle, g)[terms.rows]
    turn = np.exp(-1j * np.angle(a + 1j * b))
    heading = np.exp(1j * yaw)
    place = terms.measured[:, 0] + 1j * terms.measured[:, 1] - (u + 1j * v) * heading
    used = np.flatnonzero(terms.used)
    # The measured yaw is ahead of the robot's by the frame's; the way is turned into the body.
    middle = np.exp(-0.5j * (yaw[used][1:] + yaw[used][:-1])) * turn
    body = np.r_[0.0, np.cumsum(middle * np.diff(place[used]))]
    time, ends = terms.time[used], [0]
    for k in range(1, len(used)):
        if time[k] - time[ends[-1]] >= settings.coarse_time:
            ends.append(k)
    way = np.diff(body[ends])
    turned = np.diff(terms.measured[used][ends, 2])
    return np.column_stack([way.real, way.imag, turned]), np.diff(
        angle[terms.rows[used][ends]], axis=0
    )
