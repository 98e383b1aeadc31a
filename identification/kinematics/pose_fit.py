"""Radius, frame, lever and delay from wheel angles and poses: robust generalised least squares.

Way of the tracked point between two poses, as a complex number x + i y in the world:

    dP = c (X + i Y) + q d(e^(i yaw)),   c = R/4 e^(-i psi),   q = e^(-i psi) (px + i py)

with X + i Y the integral of e^(i yaw) (sum phi' + i sum s phi'), s the signs of VY; yaw is the
measured one, psi what it is ahead of the platform's heading, (px, py) the tracked point in the
body; and turned yaw = g dPsi, g = R/(4 L). All but the delay of the speeds is linear.

A pose has white noise, so increments of it correlate; wheels slip, so what they say drifts. Both
variances are measured from the residuals' covariances, and the increments are whitened by them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded
from scipy.ndimage import median_filter, uniform_filter1d

from identification.kinematics.motion import (
    Array,
    Complex,
    Motion,
    angles_at,
    fresh_pose,
    turned_paths,
)
from identification.kinematics.settings import KinematicsSettings
from youbot_env.physics.geometry import SIGN_LATERAL, SIGN_Y

LATERAL = np.array(SIGN_LATERAL)
TURNING = -np.array(SIGN_Y)
"""Signs (4,) of the wheels' rates for VY and for W."""

PARAMETERS = ("a", "b", "lever_a", "lever_b", "g", "delay")
"""c = (a + i b)/4, q = lever_a + i lever_b [m], g [-] times 4, delay [s]."""

_A, _B, _U, _V, _G, _DELAY = range(len(PARAMETERS))


@dataclass(frozen=True)
class PoseFit:
    """Estimate of `PARAMETERS`, with what is left.

    Attributes
    ----------
    theta : (6,)
    covariance : (6, 6), from blocks of time that are left out in turn; its intervals are Gaussian
    residuals : per log `Residual`
    """

    theta: Array
    covariance: Array
    residuals: list[Residual]


@dataclass(frozen=True)
class Residual:
    """What a fit leaves of one log.

    Attributes
    ----------
    rows : (m,) samples at which the pose was used
    path : (m, 3) measured less predicted x, y [m], yaw [rad], from the first pose on
    used : (m,) False where the pose was an outlier
    travelled, turned : (m,) way [m] and turning [rad] that the wheels say, from the first pose on
    pose_noise : [m], yaw_noise : [rad] standard deviations of the white noise of the pose
    """

    rows: NDArray[np.intp]
    path: Array
    used: NDArray[np.bool_]
    travelled: Array
    turned: Array
    pose_noise: float
    yaw_noise: float


class LogTerms:
    """The terms of the fit for one log: what is measured, and how it follows from the wheels."""

    def __init__(self, motion: Motion, settings: KinematicsSettings) -> None:
        assert motion.pose is not None
        self.motion, self.settings = motion, settings
        self.rows = fresh_pose(motion, settings)
        self.time = motion.time[self.rows]
        self.measured = motion.pose[self.rows]
        self.used = np.ones(len(self.rows), bool)

    def smooth_yaw(self, angle: Array, g: float) -> Array:
        """Yaw (n,) of all samples: that of the wheels, its slow part corrected by the pose."""
        wheels = g / 4 * (angle @ TURNING)
        drift = self.measured[:, 2] - wheels[self.rows]
        # A yaw that was unwrapped over an outlier may be off by whole turns from there on.
        drift = np.unwrap(drift)
        good = np.flatnonzero(self.used)
        step = float(np.median(np.diff(self.time)))
        size = max(round(self.settings.yaw_smoothing_time / step), 1) | 1
        smooth = median_filter(drift[good], size, mode="nearest")
        smooth = uniform_filter1d(smooth, size, mode="nearest")
        return wheels + np.interp(self.motion.time, self.time[good], smooth)

    def predicted(self, theta: Array, delay: float) -> tuple[Complex, Complex, Array]:
        """At the poses: way per c (m,), e^(i yaw) (m,), turned angle per g/4 (m,)."""
        angle = angles_at(self.motion, delay)
        yaw = self.smooth_yaw(angle, float(theta[_G]))
        path = turned_paths(angle, yaw)
        rolled = path.sum(axis=1) + 1j * (path @ LATERAL)
        return rolled[self.rows] / 4, np.exp(1j * yaw[self.rows]), (angle @ TURNING)[self.rows] / 4

    def residual_path(self, theta: Array) -> Array:
        """Measured less predicted (m, 3) from the first pose on."""
        rolled, heading, turned = self.predicted(theta, float(theta[_DELAY]))
        way = (theta[_A] + 1j * theta[_B]) * rolled + (theta[_U] + 1j * theta[_V]) * heading
        left = self.measured[:, 0] + 1j * self.measured[:, 1] - way
        yaw = self.measured[:, 2] - theta[_G] * turned
        yaw = np.unwrap(yaw)
        found = np.column_stack([left.real, left.imag, yaw])
        return found - found[0]

    def increments(self, theta: Array) -> tuple[Array, Array, Array]:
        """Residuals (k, 3), their negative derivatives (k, 3, 6) and times (k,) between poses."""
        delay, small = float(theta[_DELAY]), 0.25 * self.motion.dt
        c = theta[_A] + 1j * theta[_B]
        rolled, heading, turned = self.predicted(theta, delay)
        later, earlier = (self.predicted(theta, delay + side * small) for side in (1.0, -1.0))
        by_delay = c * (later[0] - earlier[0]) / (2 * small)
        yaw_by_delay = theta[_G] * (later[2] - earlier[2]) / (2 * small)
        used = np.flatnonzero(self.used)
        columns = np.zeros((len(used), 3, len(PARAMETERS)))
        for name, way in ((_A, rolled), (_B, 1j * rolled), (_U, heading), (_V, 1j * heading),
                          (_DELAY, by_delay)):  # fmt: skip
            columns[:, 0, name], columns[:, 1, name] = way[used].real, way[used].imag
        columns[:, 2, _G], columns[:, 2, _DELAY] = turned[used], yaw_by_delay[used]
        left = self.residual_path(theta)[used]
        step = np.diff(left, axis=0)
        step[:, 2] = (step[:, 2] + np.pi) % (2 * np.pi) - np.pi
        return step, np.diff(columns, axis=0), np.diff(self.time[used])

    def drop_outliers(self, theta: Array) -> None:
        """Set aside the poses that leap away from a running median of what is left."""
        left = self.residual_path(theta)
        step = float(np.median(np.diff(self.time)))
        size = max(round(self.settings.outlier_time / step), 5) | 1
        leap = left - median_filter(left, (size, 1), mode="nearest")
        scale = 1.4826 * np.median(np.abs(leap), axis=0)
        far = np.abs(leap) > self.settings.outlier_deviations * np.maximum(scale, 1e-9)
        self.used = ~far.any(axis=1)


def whitened(values: Array, noise: float, drift: Array) -> Array:
    """Increments (k, w) of a signal with white noise and a drift, made white with variance 1.

    ``noise`` is the variance of the signal's white noise, ``drift`` (k,) the variances of the
    drift's steps. The covariance is tridiagonal, so that the cost is linear.
    """
    banded = np.zeros((2, len(drift)))
    banded[0] = 2 * noise + drift
    banded[1, :-1] = -noise
    factor = cholesky_banded(banded, lower=True)
    return solve_banded((1, 0), factor, values)


def variances(path: Array, lag: int) -> tuple[float, float]:
    """Variance of a signal's (n, w) white noise, and of its drift over a usual step.

    Increments over one step vary by two noises and a drift, those over ``lag`` steps by two noises
    and as many drifts. Medians, since outliers and bouts of slip are neither.
    """
    near, far = (_spread(path[step:] - path[:-step]) ** 2 for step in (1, lag))
    drift = max((far - near) / max(lag - 1, 1), 1e-6 * near)
    noise = max(near - drift, 1e-3 * near) / 2
    return max(noise, 1e-18), max(drift, 1e-18)


def _spread(values: Array) -> float:
    """Standard deviation of most of some numbers."""
    return 1.4826 * float(np.median(np.abs(values))) or float(np.abs(values).mean())


def _drift_share(terms: LogTerms, steps: Array, settings: KinematicsSettings) -> Array:
    """Variance (k,) of each step's slip over that of a usual one: it grows with time and speed."""
    speed = np.abs(terms.motion.velocity).mean(axis=1)
    used = np.flatnonzero(terms.used)
    way = np.diff(np.cumsum(speed)[terms.rows[used]])
    square = (way / np.maximum(np.diff(terms.rows[used]), 1)) ** 2
    even = settings.even_slip_share
    return (even + (1 - even) * square / max(float(square.mean()), 1e-300)) * steps / steps.mean()


@dataclass(frozen=True)
class _Rows:
    """Whitened residuals (k, 3), columns (k, 3, 6) and the blocks (k,) to which they belong."""

    left: Array
    columns: Array
    block: NDArray[np.intp]
    noise: tuple[float, float]


def _whitened_rows(terms: LogTerms, theta: Array, settings: KinematicsSettings) -> _Rows:
    left, columns, steps = terms.increments(theta)
    share = _drift_share(terms, steps, settings)
    out, white, noises = np.empty_like(left), np.empty_like(columns), []
    lag = min(max(round(settings.drift_time / float(np.median(steps))), 2), len(left) // 4)
    for axes in ([0, 1], [2]):
        path = np.cumsum(left[:, axes], axis=0)
        noise, drift = variances(path, lag)
        # What wheels do to a rigid motion is never exact: without a floor of the drift the fit
        # would believe the slowest motions most, which small errors of the yaw bend.
        square = theta[_G] ** 2 if axes == [2] else theta[_A] ** 2 + theta[_B] ** 2
        name = _G if axes == [2] else _A
        way = float((columns[:, axes, name] ** 2).sum(axis=1).mean()) * square
        step = float(steps.mean())
        least = settings.min_slip**2 * way * settings.slip_memory / step
        drift = max(drift, least) / float(share.mean())
        noises.append(float(np.sqrt(noise)))
        for axis in axes:
            stacked = np.column_stack([left[:, axis], columns[:, axis]])
            result = whitened(stacked, noise, drift * share)
            scale = 1.4826 * float(np.median(np.abs(result[:, 0]))) or 1.0
            result /= scale
            out[:, axis], white[:, axis] = result[:, 0], result[:, 1:]
    size = np.abs(out)
    weight = np.minimum(1.0, settings.huber_deviations / np.maximum(size, 1e-12))
    root = np.sqrt(weight)
    time = terms.time[np.flatnonzero(terms.used)]
    span = float(time[-1] - time[0])
    count = max(int(min(settings.blocks, span / settings.min_block_time)), 4)
    block = np.minimum(((time[1:] - time[0]) / span * count).astype(np.intp), count - 1)
    return _Rows(out * root, white * root[..., None], block, (noises[0], noises[1]))


def fit_pose(
    motions: Sequence[Motion],
    start: Array,
    settings: KinematicsSettings = KinematicsSettings(),
) -> PoseFit:
    """Fit `PARAMETERS` to logs with a pose, from a start (6,) near the answer."""
    logs = [LogTerms(motion, settings) for motion in motions]
    theta = np.array(start, float)
    for terms in logs:
        terms.drop_outliers(theta)
    prior = np.zeros((len(PARAMETERS),) * 2)
    prior[_U, _U] = prior[_V, _V] = settings.lever_prior**-2
    rows: list[_Rows] = []
    for k in range(settings.iterations):
        if k in (1, 2):
            for terms in logs:
                terms.drop_outliers(theta)
        rows = [_whitened_rows(terms, theta, settings) for terms in logs]
        information = sum((np.einsum("kap,kaq->pq", r.columns, r.columns) for r in rows), prior)
        score = sum(np.einsum("kap,ka->p", r.columns, r.left) for r in rows)
        score = score - prior @ np.where([False, False, True, True, False, False], theta, 0)
        step = np.linalg.lstsq(information, score, rcond=None)[0]
        step[_DELAY] = np.clip(step[_DELAY], -settings.delay_step * 2, settings.delay_step * 2)
        theta = np.asarray(theta + step, np.float64)
    covariance = block_covariance(rows, prior, theta, settings)
    residuals = []
    for terms, r in zip(logs, rows, strict=True):
        angle = angles_at(terms.motion, float(theta[_DELAY]))
        twist = np.diff(angle, axis=0) / 4
        way = np.hypot(twist.sum(axis=1), twist @ LATERAL) * np.hypot(theta[_A], theta[_B])
        turned = np.abs(twist @ TURNING) * abs(theta[_G])
        travelled, turning = (np.r_[0.0, np.cumsum(v)][terms.rows] for v in (way, turned))
        residuals.append(
            Residual(
                terms.rows, terms.residual_path(theta), terms.used, travelled, turning, *r.noise
            )
        )
    return PoseFit(theta, covariance, residuals)


def block_covariance(
    rows: Sequence[_Rows], prior: Array, theta: Array, settings: KinematicsSettings
) -> Array:
    """Covariance (6, 6) by leaving out blocks of time in turn, to first order.

    It is widened so that Gaussian intervals hold 95 % although blocks are few.

    The jackknife over blocks needs no model of how slip and noise correlate within a block, and
    knows which block carries what (Efron and Stein, Annals of Statistics 9(3), 1981). Where slip
    lasts longer than a block, neighbouring blocks correlate: the variance is that of a first-order
    autoregression, as in prewhitening (Andrews and Monahan, Econometrica 60(4), 1992).
    """
    information = sum((np.einsum("kap,kaq->pq", r.columns, r.columns) for r in rows), prior)
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    moves, starts = [], []
    for r in rows:
        starts.append(len(moves))
        for block in np.unique(r.block):
            of = r.block == block
            own = np.einsum("kap,kaq->pq", r.columns[of], r.columns[of])
            score = np.einsum("kap,ka->p", r.columns[of], r.left[of])
            rest = (information - own) * scale[:, None] * scale
            moves.append(scale * np.linalg.lstsq(rest, -scale * score, rcond=1e-12)[0])
    # Along c lies the radius, across it the frame's yaw.
    size = float(np.hypot(theta[_A], theta[_B])) or 1.0
    basis = np.eye(len(PARAMETERS))
    basis[:2, :2] = np.array([[theta[_A], -theta[_B]], [theta[_B], theta[_A]]]) / size
    found = np.array(moves) @ basis
    count = len(found)
    found = found - found.mean(axis=0)
    spread = (count - 1) / count * found.T @ found
    next_to = np.setdiff1d(np.arange(1, count), starts)
    alike = (found[next_to] * found[next_to - 1]).sum(axis=0)
    alike = alike / np.maximum((found[next_to] ** 2).sum(axis=0), 1e-300)
    # An autocorrelation of n numbers is 1/n too low in the mean.
    alike = np.clip(alike + 1 / count, 0.0, settings.max_block_correlation)
    longer = (1 + alike) / (1 - alike)
    wider = np.sqrt(longer) * _t_factor(_freedom(found) / longer)
    return basis @ (spread * wider[:, None] * wider) @ basis.T


def _freedom(moves: Array) -> Array:
    """Degrees of freedom (p,) of sums of squares (n, p) whose terms are not alike: few carry most.

    Satterthwaite's (Biometrics Bulletin 2(6), 1946), with fourth powers of Gaussian numbers, which
    are three times the squares of their variances.
    """
    square, fourth = (moves**2).sum(axis=0), (moves**4).sum(axis=0)
    return np.minimum(3 * square**2 / np.maximum(fourth, 1e-300), len(moves) - 1)


def _t_factor(freedom: Array) -> Array:
    """How much wider than Gaussian 95 % intervals are, with so many degrees of freedom."""
    from scipy.special import stdtrit

    return stdtrit(np.maximum(freedom, 3.0), 0.975) / 1.959964
