"""Which columns, signs or axes are exchanged, seen by pose and wheels together; the clocks' lag.

A pose tells each wheel's place: only the right order and signs of four speeds make its way, in a
world that may be mirrored. Pieces of a second are compared, so that the noise of a pose is small.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from scipy.ndimage import median_filter

from identification.kinematics.motion import (
    Array,
    Complex,
    Motion,
    angles_at,
    fresh_pose,
    turned_paths,
)
from identification.kinematics.settings import KinematicsSettings
from identification.kinematics.wheel_order import described
from identification.signals.filters import vertex
from youbot_env.physics.geometry import SIGN_LATERAL, SIGN_Y, WHEELS

_LATERAL = np.array(SIGN_LATERAL)
_TURNING = -np.array(SIGN_Y)


@dataclass(frozen=True)
class Orientation:
    """How the columns of a log stand to the platform, and how well that explains its pose.

    Attributes
    ----------
    order : (4,) the column, by its place in WHEELS, that holds each wheel's speed
    signs : (4,) by which those columns are multiplied
    mirrored : whether the world of pose_x and pose_y is left-handed
    yaw_sign : of pose_yaw
    c : complex, 1/4 of what makes ways of turned wheels [m/rad]
    g : the same for the yaw [rad/rad]
    others : that explain as much and change little more
    share : of the pose's ways, or of its turns if that is less, that this explains; 1 at most
    """

    order: tuple[int, ...]
    signs: tuple[float, ...]
    mirrored: bool
    yaw_sign: float
    c: complex
    g: float
    share: float
    others: tuple[Orientation, ...] = ()

    @property
    def changes(self) -> float:
        """How much is changed of what the log says: columns, signs, axes."""
        moved = sum(k != i for i, k in enumerate(self.order))
        turned = sum(sign < 0 for sign in self.signs)
        frame = abs(np.angle(self.c)) > np.pi / 6
        # All four at once are one fault, a driver that counts the other way. In a frame that is
        # turned by 180 degrees it is two, and opposite corners are exchanged more likely.
        if turned == len(self.signs) and not frame:
            turned = 1
        # Signs of single wheels are rarer than exchanged columns or a mirrored world. A frame that
        # is turned by 90 or 180 degrees is possible too.
        pose = 2.0 * self.mirrored + 2.0 * (self.yaw_sign < 0)
        return moved + 1.5 * turned + pose + 0.5 * frame

    @property
    def as_logged(self) -> bool:
        """Whether columns and axes are what they say, a turn of the frame aside."""
        kept = self.order == (0, 1, 2, 3) and min(self.signs) > 0
        return kept and not self.mirrored and self.yaw_sign > 0

    def corrected(self, motion: Motion) -> Motion:
        """The motion with columns and axes as this says."""
        speed = motion.velocity[:, self.order] * self.signs
        position = motion.position
        if position is not None:
            position = position[:, self.order] * self.signs
        pose = motion.pose
        if pose is not None:
            pose = pose * np.array([1.0, -1.0 if self.mirrored else 1.0, self.yaw_sign])
        return Motion(motion.name, motion.time, speed, pose, motion.gyro_z, position, motion.rows)


@dataclass(frozen=True)
class Pieces:
    """Ways of pieces of a motion: of the pose, and of each wheel as if it were the only one.

    way (k,) complex, turned (k,), rolled {yaw sign: (k, 4) complex}, angle (k, 4)
    """

    way: Complex
    turned: Array
    rolled: dict[float, Complex]
    angle: Array


def pieces_of(motion: Motion, delay: float, settings: KinematicsSettings) -> Pieces:
    """Pieces of ``coarse_time``, from pose to pose."""
    assert motion.pose is not None
    rows = fresh_pose(motion, settings)
    pose = _without_leaps(motion, rows, settings)
    yaw = np.interp(motion.time, motion.time[rows], pose[:, 2])
    angle = angles_at(motion, delay)
    ends = [0]
    time = motion.time[rows]
    for k in range(1, len(rows)):
        if time[k] - time[ends[-1]] >= settings.coarse_time:
            ends.append(k)
    at = rows[ends]
    way = np.diff(pose[ends, 0] + 1j * pose[ends, 1])
    rolled = {sign: np.diff(turned_paths(angle, sign * yaw, at), axis=0) for sign in (1.0, -1.0)}
    return Pieces(way, np.diff(pose[ends, 2]), rolled, np.diff(angle[at], axis=0))


def _without_leaps(motion: Motion, rows: np.ndarray, settings: KinematicsSettings) -> Array:
    """The poses (m, 3) through a running median, which takes single outliers out."""
    assert motion.pose is not None
    pose = motion.pose[rows].copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    return median_filter(pose, (settings.median_poses, 1), mode="nearest")


def orientation_of(
    pieces: Pieces, settings: KinematicsSettings, only_as_logged: bool = False
) -> Orientation:
    """The simplest change of columns and axes that explains the pose best."""
    found = []
    for order, signs, mirrored, yaw_sign in _changes(only_as_logged):
        found.append(_explain(pieces, order, signs, mirrored, yaw_sign, settings))
    best = max(one.share for one in found)
    least = best - settings.share_tolerance * (1 - min(best, 1 - 1e-3))
    near = [one for one in found if one.share >= min(least, best - 1e-3)]
    simplest = min(near, key=lambda one: one.changes)
    most = simplest.changes + settings.alternative_changes
    others = [one for one in near if one is not simplest and one.changes <= most]
    return replace(simplest, others=tuple(sorted(others, key=lambda one: one.changes)[:1]))


def _changes(
    only_as_logged: bool,
) -> Iterator[tuple[tuple[int, ...], tuple[float, ...], bool, float]]:
    yield (0, 1, 2, 3), (1.0,) * 4, False, 1.0
    if only_as_logged:
        return
    for order in permutations(range(4)):
        for signs in product((1.0, -1.0), repeat=4):
            # All four signs turned are a frame turned by 180 degrees and a yaw of other sign.
            for mirrored in (False, True):
                for yaw_sign in (1.0, -1.0):
                    yield order, signs, mirrored, yaw_sign


def _explain(
    pieces: Pieces,
    order: tuple[int, ...],
    signs: tuple[float, ...],
    mirrored: bool,
    yaw_sign: float,
    settings: KinematicsSettings,
) -> Orientation:
    """Best c and g of one change, and the share that they explain; g must be positive."""
    chosen, sign = list(order), np.array(signs)
    way = np.conj(pieces.way) if mirrored else pieces.way
    single = pieces.rolled[yaw_sign][:, chosen] * sign
    rolled = single.sum(axis=1) + 1j * (single @ _LATERAL)
    turned = yaw_sign * pieces.turned
    wheels = (pieces.angle[:, chosen] * sign) @ _TURNING
    c = complex(np.vdot(rolled, way) / max(float(np.vdot(rolled, rolled).real), 1e-300))
    g = max(float(wheels @ turned) / max(float(wheels @ wheels), 1e-300), 0.0)
    share = _share(np.abs(way), np.abs(way - c * rolled))
    if float(np.abs(turned).sum()) > settings.min_turning:
        share = min(share, _share(turned, turned - g * wheels))
    return Orientation(order, signs, mirrored, yaw_sign, c, g, share)


def _share(measured: Array, left: Array) -> float:
    """Share that is explained. Of sizes, not of squares: a few outliers must not decide."""
    return 1 - float(np.abs(left).sum()) / max(float(np.abs(measured).sum()), 1e-300)


def clock_lag(motion: Motion, settings: KinematicsSettings) -> float:
    """By how much [s] the speeds come later than the pose, from how busy both are.

    Works for any order, sign and frame: of the wheels the root mean square speed is taken, of the
    pose that of its velocity and yaw rate.
    """
    assert motion.pose is not None
    rows = fresh_pose(motion, settings)
    pose = _without_leaps(motion, rows, settings)
    step = max(2 * motion.dt, settings.lag_step)
    grid = np.arange(motion.time[0], motion.time[-1], step)
    way = np.column_stack([np.interp(grid, motion.time[rows], c) for c in pose.T])
    rate = np.gradient(way, axis=0) * np.array([1.0, 1.0, settings.usual_arm])
    busy = np.sqrt((rate**2).sum(axis=1))
    # Central differences over two steps: the wheels' speeds are averaged over as much.
    angle = angles_at(motion, 0.0)
    turned = np.column_stack([np.interp(grid, motion.time, c) for c in angle.T])
    wheels = np.sqrt((np.gradient(turned, axis=0) ** 2).sum(axis=1))
    most = min(round(settings.max_clock_difference / step), len(grid) // 3)
    lags = np.arange(-most, most + 1)
    match = np.array([_correlation(busy, wheels, int(lag)) for lag in lags])
    k = int(np.argmax(match))
    if not 0 < k < len(lags) - 1:
        return 0.0
    return float(step * (lags[k] + vertex(*match[k - 1 : k + 2])))


def _correlation(first: Array, second: Array, lag: int) -> float:
    """Of first[k] with second[k + lag]."""
    n = len(first) - abs(lag)
    a, b = first[max(-lag, 0) :][:n], second[max(lag, 0) :][:n]
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / max(np.sqrt(float(a @ a) * float(b @ b)), 1e-300))


def describe(found: Orientation) -> tuple[str, str]:
    """What is wrong, and what cures it, in words; empty where nothing is."""
    if found.as_logged:
        return "", ""
    message, cure = _described(found)
    for other in found.others:
        more, or_else = _described(other)
        # A mirrored world and exchanged sides are told as one already.
        if more and "mirrored" not in message:
            message, cure = f"{message}, or {more}", f"{cure}; or {or_else}"
    return message, cure


def _described(found: Orientation) -> tuple[str, str]:
    wrong, cures = [], []
    turned = [WHEELS[k] for k, sign in zip(found.order, found.signs, strict=True) if sign < 0]
    pairs = described(found.order)
    if pairs:
        wrong.append(f"{pairs} are exchanged")
        cures.append("put velocity_* (and effort_*) in the order fl, fr, bl, br")
    if turned:
        names = " and ".join(f"velocity_{wheel}" for wheel in turned)
        wrong.append(f"the sign of {names} is wrong")
        cures.append(f"multiply {names} by -1")
    if found.mirrored or found.yaw_sign < 0:
        message, cure = _pose_fault(found)
        wrong.append(message)
        cures.append(cure)
    return " and ".join(wrong), "; ".join(cures)


def _pose_fault(found: Orientation) -> tuple[str, str]:
    turned = float(np.degrees(np.angle(found.c)))
    if found.mirrored and found.yaw_sign < 0:
        return (
            "the pose is mirrored (y to the right, yaw clockwise), or left and right wheels are "
            "exchanged",
            "multiply pose_y and pose_yaw by -1, or exchange the wheels' columns",
        )
    if not found.mirrored:
        return "pose_yaw grows clockwise", "multiply pose_yaw by -1"
    if abs(abs(turned) - 90) < 45:
        return "pose_x and pose_y are exchanged", "exchange pose_x and pose_y"
    name = "pose_y" if abs(turned) < 45 else "pose_x"
    return f"{name} has the wrong sign", f"multiply {name} by -1"
