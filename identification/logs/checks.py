"""Checks of a log's channels: units, signs, order of the wheels, dead sensors, motion.

What the file or its time column can have wrong is found while reading (`parsing`, `timebase`,
`repair`); here the data are finite and uniformly sampled, and are judged as measurements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.logs import wheel_checks
from identification.logs.columns import joint_columns
from identification.logs.findings import Finding, Level, percent
from identification.logs.force_checks import (
    effort_offsets,
    efforts_at_rest,
    low_passed_speeds,
    units_of_motion,
)
from identification.logs.log import Log
from identification.logs.logger_checks import (
    channels_of,
    counted_speeds,
    counted_step,
    effort_order,
    foreign_drive,
    interpolated_channels,
    moving,
    overflows,
    stale_channels,
    unsigned_efforts,
)
from identification.logs.pose_checks import lost_poses, pose_against_wheels
from identification.logs.settings import LogSettings
from identification.logs.timebase import runs_of
from identification.logs.wheel_checks import CheckLimits, power_share, unsigned_speeds
from identification.logs.wheel_timing import late_wheels
from identification.signals.filters import block_mean, integral_of
from identification.signals.noise import thinned, white_noise
from youbot_env.physics.geometry import WHEELS, Geometry


def limits_for(
    log: Log,
    max_speed: float | None,
    max_effort: float | None,
    geometry: Geometry | None,
    settings: LogSettings = LogSettings(),
) -> CheckLimits:
    """The given limits; for wheels those of the settings by default, as the geometry scales them.

    One axis has no default limits, since its units may be m and N.
    """
    wheels, own = log.joints == WHEELS, geometry or Geometry()
    # Smaller wheels turn faster, and a larger platform needs more torque. Never less than of the
    # youBot: lengths tell what a robot may have, not what it must have.
    radius = own.R / Geometry.R
    speed = settings.max_wheel_speed * max(1.0, 1.0 / radius) if wheels else np.inf
    effort = settings.max_wheel_effort * max(1.0, own.bulk * radius) if wheels else np.inf
    return CheckLimits(
        speed if max_speed is None else max_speed,
        effort if max_effort is None else max_effort,
        own,
        settings,
    )


def noise_estimate(log: Log) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """White noise of the speeds and of the efforts: standard deviations (k,), (k,).

    Notes
    -----
    Effort noise is what is white in the effort channel as it stands. Where a controller feeds
    speed noise back, part of it is real torque, and the differences of the two channels
    correlate. They do not (below 0.02) on simulated logs whose loop sees clean speeds; they do,
    with coefficients of 0.1 to 0.3, where the loop acts on a ripple that the speeds really have.
    """
    return log.speed_noise, white_noise(log.effort, log.valid, log.noise_settings)


def check(log: Log, limits: CheckLimits) -> list[Finding]:
    """All findings on a log's channels, errors among them; nothing is changed or raised.

    There are four stages. A stage is left out if an earlier one has found an error, because its
    checks assume that the earlier ones passed.
    """
    four = log.joints == WHEELS
    wheels, forces = (_WHEELS, _FORCES) if four else ((), ())
    findings: list[Finding] = []
    # Wheels before joints: with columns swapped or of a wrong sign the power of a joint means
    # nothing, and forces still less.
    for stage in (_SENSORS, wheels, _JOINTS, forces):
        for one in stage:
            # Exchanged wheels make the later checks of wheels tell nonsense.
            if stage is wheels and _has_error(findings):
                break
            findings += one(log, limits)
        if _has_error(findings):
            break
    return findings


def _has_error(findings: list[Finding]) -> bool:
    return any(finding.level == "error" for finding in findings)


def _at(
    log: Log, level: Level, message: str, cure: str, at: int | None = None, column: str = ""
) -> Finding:
    row = None if at is None else int(log.rows[at])
    return Finding(level, message, row, column or None, cure)


def _length(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    least = limits.settings.min_motion_time
    if log.duration < least:
        message = f"lasts only {log.duration:.3g} s"
        yield _at(log, "error", message, f"record at least {least:g} s of motion")


def _motion(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    settings = limits.settings
    speed = np.abs(log.velocity).max(axis=1)
    noise = float(log.speed_noise.max())
    # A quantile sorts its samples, which is slow for long logs.
    some = thinned(speed, settings.noise.max_samples)
    usual = float(np.quantile(some, settings.usual_speed_quantile))
    least = settings.min_motion_time
    cure = "record a motion that excites all wheels, for instance with youbot record"
    by_noise = settings.moving_noise_deviations * noise
    # 1e-9: without noise and motion both other limits are zero, and rounding would count as motion.
    above = speed > max(by_noise, settings.moving_speed_share * usual, 1e-9)
    seconds = float(above.sum()) * log.dt
    if seconds < least and counted_step(log.velocity, settings):
        return  # coarse counts look like noise: told by `counted_speeds`
    if seconds == 0:
        yield _at(log, "error", "nothing moves", cure)
    elif seconds < least <= log.duration:
        message = f"something moves for {seconds:.2g} s only"
        yield _at(log, "error", message, f"record at least {least:g} s of motion")
    elif log.joints == WHEELS and usual < settings.min_wheel_speed:
        message = f"little motion: the wheels stay below {usual:.2g} rad/s"
        yield _at(log, "warning", message, cure)


def _units(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    cases = (
        ("velocity", limits.max_speed, "rad/s", "convert it to rad/s (rpm: times 0.10472; "
         "deg/s: times 0.0174533; of the motor: over the gear's ratio)"),
        ("effort", limits.max_effort, "N m", "convert it to N m (from mN m: times 0.001)"),
    )  # fmt: skip
    too_fast = np.abs(log.velocity).max() > limits.max_speed
    too_strong = np.abs(log.effort).max() > limits.max_effort
    if log.joints == WHEELS and (too_fast or too_strong):
        # The pose or the masses name the unit, which the limit alone does not.
        named = (*wheel_checks.scale_of_pose(log, limits), *units_of_motion(log, limits))
        column = "velocity_*" if too_fast else "effort_*"
        told = [replace(one, level="error") for one in named if one.column == column]
        if told:
            yield told[0]
            return
    for kind, limit, unit, cure in cases:
        for column, signal in channels_of(log, kind):
            size = np.abs(signal)
            peak = int(np.argmax(size))
            if size[peak] > limit:
                message = f"{signal[peak]:.4g} {unit} cannot be (limit {limit:g})"
                yield _at(log, "error", message, cure, peak, column)
            elif size[peak] > limits.settings.doubtful_limit_share * limit:
                message = f"{signal[peak]:.4g} {unit} is a lot"
                yield _at(log, "warning", message, "check the unit", peak, column)


def _dead_channels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    if not np.ptp(log.velocity, axis=0).any():
        return  # nothing moves: _motion has reported it
    # When a platform turns about a point beside it, two wheels may stand still without any slip.
    # A constant speed is then no proof of a dead sensor.
    most = limits.settings.resting_slip
    may_rest = log.joints == WHEELS and wheel_checks.slip_ratio(log.velocity) < most
    # Without position or command a log can still be fitted: these are warnings below.
    levels: dict[str, Level] = {"velocity": "warning" if may_rest else "error", "effort": "error"}
    for kind in ("velocity", "effort", "position", "command"):
        for column, signal in channels_of(log, kind):
            if np.ptp(signal) == 0:
                message = f"is {signal[0]:.4g} all the time"
                cure = "check the sensor and the logger"
                yield _at(log, levels.get(kind, "warning"), message, cure, 0, column)


def _frozen_channels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """A noisy channel that holds one value for long is frozen, unless it is at a limit."""
    settings = limits.settings
    least = max(settings.frozen_samples, int(settings.frozen_time / log.dt))
    off = np.asarray((log.effort == 0).all(axis=1) & (log.velocity != 0).any(axis=1))
    start, stop = max(runs_of(off), key=lambda run: run[1] - run[0], default=(0, 0))
    if stop - start >= least and not off.all():
        rows = int(log.rows[start]), int(log.rows[stop - 1])
        message = (
            f"rows {rows[0]} to {rows[1]}: all efforts are 0 for {(stop - start) * log.dt:.2g} s "
            "while the wheels turn: the motors are off, or something else drives"
        )
        yield _at(log, "error", message, "cut these rows off", start)
        return
    for column, signal in channels_of(log, "velocity", "effort"):
        same = np.diff(signal) == 0
        longest = max(runs_of(same), key=lambda run: run[1] - run[0], default=(0, 0))
        length = longest[1] - longest[0]
        # A coarse channel repeats values everywhere, a frozen one only in this stretch.
        elsewhere = (same.sum() - length) / max(len(same) - length, 1)
        value = signal[longest[0]]
        # A saturated torque is constant too, and its sensor is not frozen.
        extreme = value in (signal.min(), signal.max())
        at_limit = extreme and column.startswith("effort")
        coarse = elsewhere >= settings.max_repeated_share
        # A wheel that comes to rest and leaves it gently stands at zero, where noise is small.
        rests = column.startswith("velocity") and _rests(signal, *longest, settings)
        ordinary = coarse or at_limit or rests
        if length >= least and not ordinary and np.ptp(signal) > 0:
            message = f"stands still at {value:.4g} for {length * log.dt:.2g} s"
            cure = "cut that part off; check the sensor and its cable"
            if extreme and value:
                message, cure = wheel_checks.clipped(float(value), length * log.dt)
            yield _at(log, "error", message, cure, longest[0], column)


def _rests(signal: NDArray[np.float64], start: int, last: int, settings: LogSettings) -> bool:
    """Whether a signal (n,) is zero from one sample to another, and gets there in usual steps."""
    steps = np.abs(np.diff(signal))
    if signal[start] != 0.0 or not steps.any():
        return False
    some = thinned(steps[steps > 0], settings.noise.max_samples)
    beside = steps[[k for k in (start - 1, last) if 0 <= k < len(steps)]]
    return bool(beside.max(initial=0.0) <= np.quantile(some, settings.usual_step_quantile))


def _stale_rows(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Rows that equal the row before although something moves: logged faster than measured."""
    data = np.hstack([log.velocity, log.effort])
    # At rest equal rows are normal.
    moving = np.abs(log.velocity).max(axis=1) > 0
    stale = (data[1:] == data[:-1]).all(axis=1) & moving[1:]
    if stale.mean() > limits.settings.max_stale_share:
        at = int(np.argmax(stale)) + 1
        message = f"{percent(stale.mean())} of the rows repeat the row before"
        yield _at(log, "warning", message, "log at the rate at which it is measured", at)


def _saturation(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Channels that stay at a limit, which hides the true value.

    A limit is met again and again, from nearby and from ever other values, while the joint moves. A
    commanded step is met by a jump, a square wave from the same values, and what holds a joint that
    stands still is met once at each stop.
    """
    settings = limits.settings
    moves = moving(log.velocity, log.speed_noise, settings)
    for k, (column, signal) in enumerate(channels_of(log, "effort", "command")):
        span = float(np.ptp(signal))
        size = float(np.abs(signal).max())
        for extreme in (signal.min(), signal.max()):
            held = (signal == extreme) & moves[:, k % len(log.joints)]
            long = held.sum() >= settings.saturated_samples
            long = long and held.mean() > settings.max_saturated_share
            # Zero is the value of a channel at rest, and so may be what is small beside the rest.
            small = abs(extreme) < settings.min_limit_share * size
            if small or not long or span == 0:
                continue
            if _is_met_as_a_limit(signal, signal == extreme, span, settings):
                message = f"stays at its extreme {extreme:.4g} for {percent(held.mean())} of time"
                cure = "drive more gently: a saturated channel hides the true value"
                yield _at(log, "warning", message, cure, int(np.argmax(held)), column)


def _is_met_as_a_limit(
    signal: NDArray[np.float64], held: NDArray[np.bool_], span: float, settings: LogSettings
) -> bool:
    """Whether a signal (n,) comes to where it is held often, from nearby and from other values."""
    before = [signal[start - 1] for start, _ in runs_of(held) if start > 0]
    if len(before) < settings.saturated_runs:
        return False
    near = np.abs(np.array(before) - signal[held][0]) < settings.max_limit_step * span
    return len(set(np.array(before)[near].tolist())) >= settings.saturated_runs


def _power(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Friction only dissipates energy, so a joint's net power over a log must be positive.

    A load (weight, another wheel) may drive a joint, so the sign is blamed only where what is left
    beside inertia and load feeds power in as well, in a motion both ways.
    """
    settings = limits.settings
    most = -settings.max_fed_back_power
    # A joint without a share is NaN, and NaN < x is False: it is never reported.
    driven = power_share(log, settings) < most
    if not driven.any():
        return
    wrong = driven & (dissipated_share(log, settings) < most)
    columns = joint_columns("effort", log.joints)
    if wrong.any():
        names = " and ".join(name for name, bad in zip(columns, wrong, strict=True) if bad)
        message = f"the motion takes power from {names}: its sign is wrong, or columns are swapped"
        cure = f"multiply {names} by -1, or put the columns in order"
        yield _at(log, "error", message, cure)
        return
    names = " and ".join(name for name, bad in zip(columns, driven, strict=True) if bad)
    message = f"the motion takes power from {names}: a load drives, or its sign is wrong"
    cure = "a motion both ways, at several speeds, would tell"
    yield _at(log, "warning", message, cure)


def dissipated_share(log: Log, settings: LogSettings = LogSettings()) -> NDArray[np.float64]:
    """Power (k,) of each joint's friction over its gross power, from -1 to 1 or so.

    Friction is what follows the speed and its sign, fitted together with inertia, a constant load
    and, of one axis, a load that depends on the position. NaN where a joint moves one way only, or
    where inertia says that the sign is right.
    """
    size = max(round(settings.power_time / log.dt), 1)
    speed, effort = block_mean(log.velocity, size), block_mean(log.effort, size)
    place = log.position if log.position is not None else integral_of(log.velocity, log.dt)
    place = block_mean(place, size)
    found = np.full(len(log.joints), np.nan)
    for k in range(len(log.joints)):
        v, e, q = speed[:, k], effort[:, k], place[:, k]
        moves = np.abs(v) > settings.moving_speed_share * np.abs(v).max(initial=0.0)
        ways = [float((moves & (np.sign(v) == way)).mean()) for way in (1.0, -1.0)]
        if min(ways) < settings.min_share_of_way:
            continue
        friction = np.column_stack([v, np.sign(v) * moves])
        load = [np.ones(len(v)), *([q, np.sin(q), np.cos(q)] if log.joints != WHEELS else [])]
        columns = np.column_stack([friction, np.gradient(v), *load])
        fitted = np.linalg.lstsq(columns / _size(columns), e, rcond=None)[0] / _size(columns)
        if fitted[2] <= 0:
            gross = max(float(np.abs(v * e).mean()), 1e-300)
            found[k] = float((friction @ fitted[:2] * v).mean()) / gross
    return found


def _size(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)


def _position(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Positions against the integral of the speeds, over pieces of ``position_time``."""
    if log.position is None:
        return
    piece = max(int(limits.settings.position_time / log.dt), 1)
    if len(log) <= 2 * piece:
        return
    travelled = integral_of(log.velocity, log.dt)[::piece]
    for i, column in enumerate(joint_columns("position", log.joints)):
        # Differences of pieces, since a position's zero is arbitrary and the integral drifts.
        way, expected = np.diff(log.position[::piece, i]), np.diff(travelled[:, i])
        gain = float(way @ expected / max(expected @ expected, 1e-300))
        left = float(np.sqrt(np.mean((way - expected) ** 2) / max(np.mean(expected**2), 1e-300)))
        if left > limits.settings.max_position_error:
            message = f"does not follow the integral of the speed (gain {gain:.3g})"
            cure = "check its unit and sign, and whether it wraps"
            yield _at(log, "warning", message, cure, None, column)


_SENSORS = (
    _length,
    _motion,
    _units,
    overflows,
    _dead_channels,
    _frozen_channels,
    _stale_rows,
    stale_channels,
    interpolated_channels,
    counted_speeds,
    unsigned_efforts,
    _saturation,
    # It compares no wheel with another, and what it finds would look like exchanged wheels.
    foreign_drive,
)
_JOINTS = (_power, _position)
_WHEELS = (
    unsigned_speeds,
    pose_against_wheels,
    lost_poses,
    late_wheels,
    *wheel_checks.CHECKS,
    effort_order,
    units_of_motion,
)
_FORCES = (efforts_at_rest, effort_offsets, low_passed_speeds)
