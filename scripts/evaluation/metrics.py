"""Metrics of a closed loop, and their means over seeds with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.interface import Array
from controllers.loop import Trace
from identification.signals.filters import integral_of

AXES = ("VX", "VY", "W")
"""Axes of a twist, in every list of three below."""

WORST = 95
"""Percentile of the absolute error: exceeded 5 % of the time."""

STRETCH = 5.0
"""Length [s] of the stretches whose errors are given one by one."""

CONFIDENCE = 0.95


def integrated_pose(twist: Array, period: float, start: Array) -> Array:
    """Poses (n, 3) [m, m, rad] of a platform that moves with body twists (n, 3) exactly.

    Trapezoidal rule, one twist a period [s]: 1e-5 m for the references here.
    """
    yaw = start[2] + integral_of(twist[:, 2], period)
    c, s = np.cos(yaw), np.sin(yaw)
    x = start[0] + integral_of(c * twist[:, 0] - s * twist[:, 1], period)
    y = start[1] + integral_of(s * twist[:, 0] + c * twist[:, 1], period)
    return np.column_stack([x, y, yaw])


def judge(trace: Trace, start: float = 0.0) -> dict[str, Any]:
    """Numbers of one closed loop from ``start`` [s] on, JSON-able; lists are by axis.

    ``rmse`` [m/s, m/s, rad/s] is of the true twist; ``nrmse`` the same over the reference's root
    mean square, None on an axis at rest; ``worst`` the 95th percentile of the absolute error over
    it. ``position_drift`` [m] and ``heading_drift`` [rad] are how far the platform ends from where
    the integrated reference does. ``effort`` [N m] is the root mean square of the commanded
    torques, ``torque_rate`` [N m/s] that of their rate, ``saturation`` the share of instants at
    which a wheel is at its limit; ``course`` the normalised RMSE, mean of the moving axes, in one
    stretch of ``STRETCH`` after the other. A loop that diverged has its time in ``diverged`` and no
    more.
    """
    if trace.diverged is not None:
        return {"diverged": trace.diverged}
    # Less 1e-9: rounding must not leave the first sample out.
    inside = trace.time >= start - 1e-9
    period = trace.period
    error = (trace.twist - trace.reference)[inside]
    size = np.sqrt(np.mean(trace.reference[inside] ** 2, axis=0))
    rmse = np.sqrt(np.mean(error**2, axis=0))
    worst = np.percentile(np.abs(error), WORST, axis=0)
    # From the whole run, not from `start` on: drift during the ramp counts too.
    wanted = integrated_pose(trace.reference, period, trace.pose[0])
    off = trace.pose[-1] - wanted[-1]
    rate = np.diff(trace.command[inside], axis=0) / period
    return {
        "diverged": None,
        "rmse": rmse.tolist(),
        "nrmse": _ratios(rmse, size),
        "worst": _ratios(worst, size),
        "position_drift": float(math.hypot(off[0], off[1])),
        "heading_drift": abs(float(off[2])),
        "effort": float(np.sqrt(np.mean(trace.command[inside] ** 2))),
        "torque_rate": float(np.sqrt(np.mean(rate**2))),
        "saturation": float(np.mean(trace.saturated[inside])),
        "course": _course(error, size, round(STRETCH / period)),
    }


def _course(error: Array, size: Array, rows: int) -> list[float]:
    """Errors by stretch, over the rms of the whole reference.

    Over its rms in the stretch alone, a slow part of the reference would give a large ratio.
    """
    moving = size > 0
    shares = error[:, moving] / size[moving]
    whole = shares[: len(shares) // rows * rows].reshape(-1, rows, shares.shape[1])
    return np.sqrt(np.mean(whole**2, axis=1)).mean(axis=1).tolist() if moving.any() else []


def _ratios(value: Array, size: Array) -> list[float | None]:
    return [float(v / s) if s > 0 else None for v, s in zip(value, size, strict=True)]


def mean_nrmse(numbers: dict[str, Any]) -> float:
    """Mean normalised RMSE over the axes that move; NaN of a loop that diverged."""
    moving = [value for value in numbers.get("nrmse", ()) if value is not None]
    return float(np.mean(moving)) if moving else math.nan


def interval(values: Sequence[float]) -> dict[str, Any]:
    """Mean of independent runs and the half width of its 95 % interval by Student's t.

    The half width is None for a single run; both are None where there is no run at all.
    """
    found = np.asarray(values, float)
    if len(found) == 0:
        return {"mean": None, "half": None, "runs": 0}
    if len(found) == 1:
        return {"mean": float(found[0]), "half": None, "runs": 1}
    from scipy.stats import t  # its import takes half a second, and a single run does not need it

    reach = float(t.ppf(0.5 + CONFIDENCE / 2, len(found) - 1))
    half = reach * float(found.std(ddof=1)) / math.sqrt(len(found))
    return {"mean": float(found.mean()), "half": half, "runs": len(found)}
