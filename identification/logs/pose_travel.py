"""What a pose says of each wheel: its gain, and by how much speeds and pose are out of step.

A pose shows all three motions of a platform, hence how far each wheel rolls. The ways of pieces of
a second are compared, so that the noise of a pose is small beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding
from identification.logs.log import Log
from identification.logs.settings import LogSettings
from identification.signals.filters import integral_of, vertex
from youbot_env.physics.geometry import WHEELS, Geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseTravel:
    """Wheels beside a pose.

    Attributes
    ----------
    lag : [s] by which the speeds come later than the pose; 0 where the pose tells no lag
    gain : (4,) angle by the speeds over angle by the pose, once both are in step
    std : (4,) its standard deviation
    """

    lag: float
    gain: Array
    std: Array

    def odd_wheels(self, settings: LogSettings) -> NDArray[np.intp]:
        """Wheels whose gain is not that of the others."""
        usual = float(np.median(self.gain))
        certain = settings.scale_deviations * self.std / max(usual, 1e-300)
        off = np.abs(self.gain / max(usual, 1e-300) - 1)
        return np.flatnonzero(off > np.maximum(settings.min_scale_difference, certain))


def pose_travel(log: Log, geometry: Geometry, settings: LogSettings) -> PoseTravel | None:
    """Lag and gains of the wheels of a log; None where pose or wheels travel too little."""
    if log.pose is None:
        return None
    rows = max(round(settings.lag_grid / log.dt), 1)
    step = rows * log.dt
    piece = max(round(settings.scale_time / step), 1)
    rolled = np.diff(integral_of(log.velocity, log.dt)[::rows], axis=0)
    ways = _Ways(rolled, _way_of_pose(log.pose[::rows]), piece, geometry)
    if float((geometry.wheel_speeds(ways.moved) ** 2).mean()) < (
        (settings.min_compared_size * step) ** 2
    ):
        return None
    most = min(round(settings.kinematics.max_delay / step), len(rolled) // 3)
    lags = np.arange(-most, most + 1)
    left = np.array([ways.fitted(int(lag))[2] for lag in lags])
    best = int(np.argmin(left))
    shifted = lags[best] != 0 and left[best] < settings.max_left_by_lag * left[most]
    gain, std, unexplained = ways.fitted(int(lags[best]) if shifted else 0)
    if unexplained > settings.max_unlike_pose:
        return None  # another fault: a wrong order, axis or clock
    return PoseTravel(step * _peak(lags, left, best) if shifted else 0.0, gain, std)


def _way_of_pose(pose: Array) -> Array:
    """(m, 3) ways and turns of a pose (m + 1, 3), in its own axes [m, m, rad]."""
    yaw = np.unwrap(pose[:, 2])
    way, turned, middle = np.diff(pose[:, :2], axis=0), np.diff(yaw), 0.5 * (yaw[1:] + yaw[:-1])
    c, s = np.cos(middle), np.sin(middle)
    return np.column_stack([c * way[:, 0] + s * way[:, 1], c * way[:, 1] - s * way[:, 0], turned])


@dataclass(frozen=True)
class _Ways:
    """Ways of short pieces: rolled (m, 4) by the wheels [rad], and moved (m, 3) by the pose.

    ``piece``: how many of them are summed before they are compared.
    """

    rolled: Array
    moved: Array
    piece: int
    geometry: Geometry

    def fitted(self, lag: int) -> tuple[Array, Array, float]:
        """Gain (4,), its standard deviation (4,), and the share of the squares left, at a lag."""
        late, early = self.rolled[max(lag, 0) :], self.moved[max(-lag, 0) :]
        count = min(len(late), len(early)) // self.piece * self.piece
        wheels, moved = (
            x[:count].reshape(-1, self.piece, x.shape[1]).sum(axis=1) for x in (late, early)
        )
        shown = self.geometry.wheel_speeds(self._in_frame(moved, wheels))
        square = np.maximum((shown**2).sum(axis=0), 1e-300)
        gain = (wheels * shown).sum(axis=0) / square
        off = wheels - gain * shown
        std = np.sqrt(((off * shown) ** 2).sum(axis=0)) / square
        return gain, std, float((off**2).sum() / max((wheels**2).sum(), 1e-300))

    def _in_frame(self, moved: Array, wheels: Array) -> Array:
        """The pose's ways (k, 3) in the wheels' frame, against which the pose's may be turned."""
        body = self.geometry.body_twist(wheels)
        way = moved[:, 0] + 1j * moved[:, 1]
        way = way * np.exp(-1j * np.angle(np.vdot(body[:, 0] + 1j * body[:, 1], way)))
        return np.column_stack([way.real, way.imag, moved[:, 2]])


def _peak(lags: NDArray[np.intp], left: Array, best: int) -> float:
    """Where the parabola through three residuals about the best is least, in steps."""
    if not 0 < best < len(lags) - 1:
        return float(lags[best])
    return float(lags[best] + vertex(*left[best - 1 : best + 2]))


def told_by_pose(found: PoseTravel, settings: LogSettings) -> Iterator[Finding]:
    """Clocks out of step, and wheels that are not like the others."""
    if found.lag:
        late, early = ("speeds come", "pose") if found.lag > 0 else ("pose comes", "speeds")
        message = f"the {late} {abs(found.lag):.2f} s later than the {early}"
        cure = (
            "stamp both by one clock; youbot kinematics says it more exactly, and youbot import "
            f"undoes it ([{'velocity' if found.lag > 0 else 'pose'}] delay)"
        )
        yield Finding("warning", message, cure=cure)
    odd, usual = found.odd_wheels(settings), float(np.median(found.gain))
    if len(odd) and usual > 0:
        told = ", ".join(
            f"velocity_{WHEELS[k]} {found.gain[k] / usual:.3f} +- "
            f"{settings.interval_deviations * found.std[k] / usual:.1g}"
            for k in odd
        )
        message = f"beside the pose and the other wheels: {told} times (95 %)"
        cure = (
            "a wheel of another radius or a channel of another gain: youbot kinematics measures "
            "it, youbot diagnose names it; or mend that channel"
        )
        yield Finding("warning", message, cure=cure)
