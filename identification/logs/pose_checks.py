"""Wheels against the pose in all axes: exchanged columns, mirrored axes, units, foreign clocks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from identification.kinematics.motion import Motion, fresh_pose, is_new
from identification.kinematics.settings import KinematicsSettings
from identification.logs.findings import Finding, percent
from identification.logs.log import Log
from identification.logs.wheel_checks import CheckLimits, off_forward
from identification.signals.filters import integral_of
from identification.signals.noise import thinned
from youbot_env.physics.geometry import Geometry


def motion_of(log: Log) -> Motion:
    """The motion of a log of wheels."""
    return Motion(log.name, log.time, log.velocity, log.pose, log.gyro_z, log.position, log.rows)


def pose_against_wheels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """What order, signs, axes and clock make the wheels go where the pose went."""
    if log.pose is None:
        return
    motion, settings = motion_of(log), limits.settings.kinematics
    # Imported here: it loads scipy, and most logs have no pose.
    from identification.kinematics.kinematics import aligned, units_a_metre

    if len(fresh_pose(motion, settings)) < settings.min_poses or not _travels(log, limits):
        return
    # The youBot's lengths may stand for none: then they decide nothing.
    given = None if limits.geometry == Geometry() else limits.geometry
    found = aligned(motion, settings, given)
    orientation, findings = found.orientation, found.findings
    for finding in findings:
        yield Finding("error", finding.message, None, finding.column, finding.cure)
    if findings:
        return
    if orientation.share < settings.min_related_share:
        yield _unrelated(orientation.share)
        return
    if orientation.share < settings.min_explained_share or orientation.g <= 0:
        return
    arm = abs(orientation.c) / orientation.g
    metre = units_a_metre(arm, limits.geometry, settings)
    turned = float(np.abs(np.diff(log.pose[:: max(round(1 / log.dt), 1), 2])).sum())
    if metre != 1.0 and turned > settings.min_turning:
        name = {100.0: "centimetres", 1000.0: "millimetres"}[metre]
        message = f"like pose_y looks like {name}: the wheels' arm L would be {arm:.4g} m"
        yield Finding("error", message, None, "pose_x", f"divide both by {metre:g}")
    forward = float(np.angle(orientation.c))
    if abs(forward) > settings.doubtful_frame_yaw:
        yield off_forward(forward)


def lost_poses(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Stretches in which the pose stands while the wheels roll, and leaps that none rolled."""
    if log.pose is None:
        return
    settings = limits.settings
    fresh = np.flatnonzero(is_new(log.pose))
    if len(fresh) < settings.kinematics.min_poses:
        return
    speed = np.hypot(*limits.geometry.body_twist(log.velocity)[:, :2].T)
    rolled, time = np.diff(integral_of(speed, log.dt)[fresh]), np.diff(log.time[fresh])
    longest = max(settings.lost_pose_time, settings.lost_pose_periods * float(np.median(time)))
    lost = (time > longest) & (rolled > settings.min_lost_way)
    if lost.any():
        at = int(np.argmax(lost))
        message = (
            f"the pose stands still for {time[at]:.2g} s while the wheels roll {rolled[at]:.2g} m"
            f" ({percent(float(time[lost].sum()) / log.duration)} of the log): tracking was lost"
        )
        yield _lost(log, int(fresh[at]), message)
    beyond = np.hypot(*np.diff(log.pose[fresh, :2], axis=0).T) - rolled
    some = thinned(np.abs(beyond), settings.noise.max_samples)
    usual = float(np.quantile(some, settings.usual_step_quantile))
    leaps = beyond > max(settings.min_lost_way, settings.outlier_steps * usual)
    if leaps.any():
        at = int(np.argmax(beyond))
        message = (
            f"the pose leaps by {beyond[at]:.2g} m ({leaps.sum()} such): no wheel rolled there"
        )
        yield _lost(log, int(fresh[at + 1]), message)


def _lost(log: Log, at: int, message: str) -> Finding:
    cure = "split the log there, or leave the pose columns out"
    return Finding("warning", message, int(log.rows[at]), "pose_x", cure)


def _travels(log: Log, limits: CheckLimits) -> bool:
    """Whether wheels and pose both go so far that they can be compared."""
    assert log.pose is not None
    settings: KinematicsSettings = limits.settings.kinematics
    way = float(np.abs(np.diff(log.pose[:: max(round(1 / log.dt), 1), :2], axis=0)).sum())
    rolled = float(np.abs(log.velocity).mean()) * log.duration * limits.geometry.R
    return min(way, rolled) > settings.min_travel


def _unrelated(share: float) -> Finding:
    message = (
        "the pose does not follow the wheels, in no order, sign or axis "
        f"({100 * max(share, 0.0):.0f} % of its way is explained)"
    )
    cure = "is it of the same run, by the same clock? leave the pose columns out otherwise"
    return Finding("error", message, cure=cure)
