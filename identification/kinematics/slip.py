"""How much wheels slip, and where: what a pose does beyond what they roll."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from identification.kinematics.motion import Motion
from identification.kinematics.pose_fit import Residual
from identification.kinematics.settings import KinematicsSettings

NO_SLIP = np.array([1.0, 1.0, -1.0, -1.0]) / 2


@dataclass(frozen=True)
class SlipPlace:
    """A stretch of a log in which wheels slip: times [s] and share of the usual way."""

    log: str
    start: float
    end: float
    share: float
    row: int | None


@dataclass(frozen=True)
class SlipFound:
    """Slip of some logs, as shares (root mean square) of what the wheels roll.

    share : of the way, that the pose and the wheels differ by; None without a pose
    identity : of the wheel speeds, that no rigid motion explains
    where : stretches with much of it
    """

    share: float | None
    identity: float
    where: list[SlipPlace]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        places = [
            {"log": p.log, "from": p.start, "to": p.end, "share": p.share, "row": p.row}
            for p in self.where
        ]
        return {"share": self.share, "identity": self.identity, "where": places}


def identity_share(motions: Sequence[Motion]) -> float:
    """Share (root mean square) of the wheel speeds along what no rigid motion does."""
    along = sum(float(((m.velocity @ NO_SLIP) ** 2).sum()) for m in motions)
    total = sum(float((m.velocity**2).sum()) for m in motions)
    return float(np.sqrt(along / max(total, 1e-300)))


def slip_of_pose(
    motions: Sequence[Motion],
    residuals: Sequence[Residual],
    settings: KinematicsSettings = KinematicsSettings(),
) -> SlipFound:
    """Slip of logs with a pose, from what their fit leaves over windows of ``slip_window``."""
    squares, ways, where = 0.0, 0.0, []
    for motion, residual in zip(motions, residuals, strict=True):
        good = np.flatnonzero(residual.used)
        time = motion.time[residual.rows[good]]
        ends = [0]
        for k in range(1, len(good)):
            if time[k] - time[ends[-1]] >= settings.slip_window:
                ends.append(k)
        # Means around the ends of a window: their noise is less than that of one pose.
        near = round(settings.slip_mean_time / 2 / float(np.median(np.diff(time))))
        at = np.array(ends)
        smooth = np.array(
            [residual.path[good[max(k - near, 0) : k + near + 1], :2].mean(axis=0) for k in at]
        )
        slid = np.hypot(*np.diff(smooth, axis=0).T)
        way = np.diff(residual.travelled[good[at]])
        noise = 2 * residual.pose_noise / np.sqrt(2 * near + 1)
        squares += float(np.maximum(slid**2 - noise**2, 0).sum())
        ways += float((way**2).sum())
        usual = float(np.sqrt((way**2).mean()))
        far = slid > np.maximum(settings.min_slip_share * usual, settings.slip_deviations * noise)
        where += _places(motion, residual.rows[good[at]], far, slid / max(usual, 1e-300))
    share = float(np.sqrt(squares / max(ways, 1e-300)))
    return SlipFound(share, identity_share(motions), where)


def _places(
    motion: Motion, ends: np.ndarray, far: np.ndarray, share: np.ndarray
) -> list[SlipPlace]:
    """Windows that slip, neighbours joined."""
    found: list[SlipPlace] = []
    for k in np.flatnonzero(far):
        start, end = float(motion.time[ends[k]]), float(motion.time[ends[k + 1]])
        row = None if motion.rows is None else int(motion.rows[ends[k]])
        if found and found[-1].end >= start:
            last = found.pop()
            found.append(
                SlipPlace(*(motion.name, last.start, end), max(last.share, share[k]), last.row)
            )
        else:
            found.append(SlipPlace(motion.name, start, end, float(share[k]), row))
    return found
