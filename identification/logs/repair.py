"""Repairs of a log's channels: missing values and single outliers. Each one is reported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.logs.columns import POSE, Draft
from identification.logs.settings import LogSettings
from identification.logs.timebase import bridge, gap_limit, nominal_step, runs_of
from identification.signals.noise import thinned, white_noise

_NO_LOSS = "check the sensor and the logger"


def mark_absurd(draft: Draft) -> None:
    """Take numbers beyond any physical quantity for missing ones."""
    for name in draft.names:
        channel = draft.channel(name)
        absurd = np.abs(channel) > draft.settings.max_magnitude
        if absurd.any():
            at = int(np.argmax(absurd))
            message = f"{absurd.sum()} value(s) such as {channel[at]:.3g} taken as missing"
            draft.report("warning", message, _NO_LOSS, at, name)
            channel[absurd] = np.nan


def trim_ends(draft: Draft) -> None:
    """Drop rows at both ends that lack a required channel: there is nothing to interpolate from.

    Raises
    ------
    InputError
        If more of the log would go than may be missing.
    """
    required = [draft.names.index(name) for name in draft.required]
    whole = np.flatnonzero(np.isfinite(draft.data[:, required]).all(axis=1))
    if whole.size == 0:
        _refuse_missing(draft)
    first, last = int(whole[0]), int(whole[-1])
    dropped = len(draft.time) - (last + 1 - first)
    if dropped == 0:
        return
    if dropped > draft.settings.max_missing_share * len(draft.time):
        _refuse_missing(draft)
    # The first dropped row: row 0 if rows go at the start, else the one after the last whole row.
    at = 0 if first else last + 1
    message = f"{dropped} row(s) at an end of the log lack values: dropped"
    draft.report("repaired", message, _NO_LOSS, at)
    keep = np.zeros(len(draft.time), bool)
    keep[first : last + 1] = True
    draft.keep(keep)


def _refuse_missing(draft: Draft) -> None:
    """Name the required channel that lacks most values."""
    missing = {name: int(np.isnan(draft.channel(name)).sum()) for name in draft.required}
    worst = max(missing, key=lambda name: missing[name])
    at = int(np.argmax(np.isnan(draft.channel(worst))))
    count, total = missing[worst], len(draft.time)
    what = "has no values" if count == total else f"lacks {count} of {total} values"
    raise draft.fault(what, "record it again, or cut that part off", at, worst)


def fill_missing(draft: Draft, joints: tuple[str, ...], left: tuple[str, ...] = ()) -> None:
    """Interpolate short runs of missing values, but for channels that are ``left`` as they are.

    A required channel with a long run is refused; an optional one is left out, with its group.

    Raises
    ------
    InputError
        If a required channel lacks a long run of values, or many.
    """
    limit = gap_limit(nominal_step(draft.time), draft.settings)
    inserted = ~draft.valid
    for name in draft.names:
        # An earlier channel of the same group may have been refused, and the whole group dropped.
        if name in left or name not in draft.names or not np.isnan(draft.channel(name)).any():
            continue
        missing = np.isnan(draft.channel(name))
        runs = runs_of(missing)
        longest = max(runs, key=lambda run: run[1] - run[0])
        many = missing.mean() > draft.settings.max_missing_share
        too_long = longest[1] - longest[0] > limit or many
        if not too_long:
            _bridge_runs(draft, name, runs, inserted)
        elif name in draft.required:
            length = longest[1] - longest[0]
            message = f"lacks {missing.sum()} values, up to {length} in a row"
            cure = "split the log there into two, or record it again"
            raise draft.fault(message, cure, longest[0], name)
        else:
            message = f"lacks {missing.sum()} values: not used, nor what belongs to it"
            draft.report("warning", message, _NO_LOSS, longest[0], name)
            draft.drop_group_of(name, joints)


def _bridge_runs(
    draft: Draft, name: str, runs: list[tuple[int, int]], inserted: NDArray[np.bool_]
) -> None:
    """Interpolate runs of one channel; inserted rows (n,) have been reported already."""
    channel = draft.channel(name)
    values = np.isnan(channel) & ~inserted
    if values.any():
        message = f"{values.sum()} missing value(s): interpolated"
        draft.report("repaired", message, _NO_LOSS, int(np.argmax(values)), name)
    for start, stop in runs:
        bridge(channel, start, stop, draft.settings.bridge_samples)
        if name in draft.required:
            draft.valid[start:stop] = False


def replace_outliers(draft: Draft, left: tuple[str, ...] = ()) -> None:
    """Interpolate single outliers: a few samples that leap away from a smooth signal.

    The leap must be much larger than the channel's noise and its usual steps, and the samples
    around must be smooth: a step of the torque, a chattering friction or a wheel's ripple is no
    outlier. Channels with many outliers are left as they are, with a warning, and so are those
    that are ``left``.
    """
    for name in draft.names:
        if name in left:
            continue
        channel = draft.channel(name)
        runs = find_outliers(channel, draft.settings)
        count = sum(stop - start for start, stop in runs)
        if not runs:
            continue
        at = runs[0][0]
        if count > draft.settings.max_outlier_share * len(channel):
            message = f"{count} samples leap away from their neighbours: left as they are"
            draft.report("warning", message, _NO_LOSS, at, name)
            continue
        message = f"{count} outlier(s) such as {channel[at]:.4g}: interpolated"
        draft.report("repaired", message, _NO_LOSS, at, name)
        # All outliers are removed first, so that none is used to interpolate another one.
        for start, stop in runs:
            channel[start:stop] = np.nan
        for start, stop in runs:
            bridge(channel, start, stop, draft.settings.bridge_samples)
            if name in draft.required:
                draft.valid[start:stop] = False


def find_outliers(
    signal: NDArray[np.float64], settings: LogSettings = LogSettings()
) -> list[tuple[int, int]]:
    """Ranges (start, stop) of a few samples of a finite signal (n,) that are outliers."""
    if len(signal) < 4 * settings.outlier_surroundings:
        return []
    steps = np.abs(np.diff(signal))
    noise = float(white_noise(signal[:, None], settings=settings.noise)[0])
    some = thinned(steps, settings.noise.max_samples)
    usual_step = float(np.quantile(some, settings.usual_step_quantile))
    threshold = max(settings.outlier_deviations * noise, settings.outlier_steps * usual_step)
    # A channel without noise and motion, constant but for single values, gives no scale for a leap.
    if threshold == 0:
        return []
    leaps = np.flatnonzero(steps > settings.min_leap_share * threshold)
    found: list[tuple[int, int]] = []
    for leap in leaps.tolist():
        start = leap + 1
        # The step back from an outlier to the signal is no new outlier.
        if found and start <= found[-1][1]:
            continue
        width = _outlier_width(signal, start, threshold, settings)
        if width:
            found.append((start, start + width))
    return _outlier_at_end(signal, threshold, found, settings)


def _outlier_at_end(
    signal: NDArray[np.float64],
    threshold: float,
    found: list[tuple[int, int]],
    settings: LogSettings,
) -> list[tuple[int, int]]:
    """The ranges found, with the first and the last sample where these are outliers too."""
    n, near = len(signal), settings.outlier_surroundings
    quiet = settings.max_surrounding_step
    # At an end there is no step back, so `_outlier_width` cannot see an outlier there.
    for at, inward in ((0, signal[1 : near + 1]), (n - 1, signal[-2 : -near - 2 : -1])):
        leap = abs(signal[at] - inward[0])
        if leap > threshold and np.abs(np.diff(inward)).max() < quiet * leap:
            found.append((at, at + 1))
    return sorted(set(found))


def _outlier_width(
    signal: NDArray[np.float64], start: int, threshold: float, settings: LogSettings
) -> int:
    """Number of samples from start on that form an outlier; 0 if they form none."""
    near = settings.outlier_surroundings
    for width in range(1, settings.max_outlier_samples + 1):
        stop = start + width
        before = signal[max(start - near, 0) : start]
        after = signal[stop : stop + near]
        if before.size < 2 or after.size < 2:
            return 0
        around = np.r_[before, after]
        line = np.interp(np.arange(start, stop), [start - 1, stop], [before[-1], after[0]])
        leap = signal[start:stop] - line
        # An outlier lies on one side of the line between its neighbours; both signs mean an
        # oscillation.
        same_side = bool((np.abs(leap) > threshold).all() and np.ptp(np.sign(leap)) == 0)
        most = settings.max_surrounding_step * float(np.abs(leap).min())
        if same_side and float(np.abs(np.diff(around)).max()) < most:
            return width
    return 0


def unwrap_yaw(draft: Draft) -> None:
    """Make pose_yaw continuous [rad]; rows without it stay so.

    Raises
    ------
    InputError
        If it looks like degrees, whose wraps an unwrapping in radians would garble.
    """
    if POSE[2] not in draft.names:
        return
    yaw = draft.channel(POSE[2])
    known = np.isfinite(yaw)
    if known.sum() < 2:
        return
    wraps = np.abs(np.diff(yaw[known]))
    # A wrap of degrees is a step of 360 less the motion in one sample. A step of 340 rad cannot be
    # a motion.
    if ((wraps > 340) & (wraps < 380)).any():
        at = int(np.flatnonzero(known)[int(np.argmax(wraps > 340)) + 1])
        cure = "convert it to radians (times pi/180)"
        raise draft.fault("wraps at 360, so it is in degrees", cure, at, POSE[2])
    yaw[known] = np.unwrap(yaw[known])
