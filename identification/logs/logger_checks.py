"""Checks of how channels were logged: stale, unsigned, exchanged or counted; foreign drives.

Such a log looks sound row by row, and makes a wrong model all the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from identification.logs.columns import joint_columns
from identification.logs.findings import Finding, percent
from identification.logs.log import Log
from identification.logs.settings import LogSettings
from identification.logs.timebase import runs_of
from identification.logs.wheel_checks import CheckLimits
from identification.signals.filters import block_mean
from identification.signals.held import fresh_rows
from identification.signals.noise import thinned, white_noise

Array = NDArray[np.float64]


def moving(
    speed: NDArray[np.float64],
    noise: NDArray[np.float64],
    settings: LogSettings = LogSettings(),
) -> NDArray[np.bool_]:
    """(n, k) whether joints move: faster than their noise (k,) and a small share of their speed."""
    size = np.abs(speed)
    share = settings.moving_speed_share
    usual = usual_speed(speed, settings)
    # Of coarse counts the noise may be above all speeds.
    most = settings.max_resting_speed_share * usual
    by_noise = np.minimum(settings.moving_noise_deviations * noise, most)
    return size > np.maximum(by_noise, share * usual)


def usual_speed(speed: Array, settings: LogSettings = LogSettings()) -> Array:
    """(k,) the speed that each joint hardly exceeds, of the time in which it may move."""
    usual = np.zeros(speed.shape[1])
    for k, channel in enumerate(np.abs(speed).T):
        # A joint that hardly ever moves has a usual speed too.
        some = channel[channel > settings.moving_speed_share * channel.max()]
        if some.size:
            some = thinned(some, settings.noise.max_samples)
            usual[k] = np.quantile(some, settings.usual_speed_quantile)
    return usual


def counted_step(speed: Array, settings: LogSettings = LogSettings()) -> float:
    """Step [rad/s] in which counted speeds (n, k) come; 0 where they are not counted.

    Counts over a sample time are zero or one step or more: nothing lies between.
    """
    size = np.abs(speed).ravel()
    some = size[size > 0]
    usual = usual_speed(speed, settings).max(initial=0.0)
    if some.size < settings.min_rows or (size == 0).mean() < settings.min_zero_share:
        return 0.0
    least = float(some.min())
    if least < settings.min_counted_step * usual:
        return 0.0
    # Sample times that vary make one step's speeds vary; two steps begin at twice the least.
    return float(np.median(some[some < settings.max_one_step * least]))


def counted_speeds(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Speeds that are differences of few counts: noise that least squares cannot bear."""
    step = counted_step(log.velocity, limits.settings)
    if not step:
        return
    unit = "rad/s" if len(log.joints) > 1 else "the speed's unit"
    share = step / usual_speed(log.velocity, limits.settings).max()
    message = f"speeds come in steps of {step:.3g} {unit}, {percent(share)} of the usual speed"
    cure = "log the counts as position_*, or difference them over a longer time"
    if share > limits.settings.max_counted_step:
        yield Finding("error", message, cure=cure)
    else:
        yield Finding("warning", message, cure=cure)


def channels_of(log: Log, *kinds: str) -> Iterator[tuple[str, Array]]:
    """Names and signals (n,) of a log's channels of some kinds, as far as it has them."""
    for kind in kinds:
        block = getattr(log, kind)
        if block is not None:
            yield from zip(joint_columns(kind, log.joints), block.T, strict=True)


def overflows(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Channels that leap to their other end where they would go on: a number that overflows."""
    for name, channel in channels_of(log, "velocity", "effort"):
        at, leap = _leaps_back(channel, limits.settings)
        if len(at):
            message = (
                f"leaps by {leap:.4g} at {len(at)} places, to its other end, and goes on as "
                "before: the number overflows"
            )
            cure = "log a wider type of number, or one with coarser units"
            yield Finding("error", message, int(log.rows[at[0] + 1]), name, cure)


def _leaps_back(channel: Array, settings: LogSettings) -> tuple[NDArray[np.intp], float]:
    """Indices of the samples before a leap against the way that a channel goes, over nearly all its
    span; and the usual size of a leap. None where such leaps are few, or not all alike.

    A command that switches between two ends leaps as far, but stands there.
    """
    none = np.zeros(0, np.intp)
    steps = np.diff(channel)
    span = float(np.ptp(channel))
    at = np.flatnonzero(np.abs(steps) > settings.min_overflow_share * span)
    # A few samples of slope before and behind: noise is small against them at an end.
    near = settings.overflow_surroundings
    at = at[(at >= near) & (at < len(channel) - near - 1)]
    if len(at) < settings.min_overflows:
        return none, 0.0
    leap = steps[at]
    before, after = channel[at] - channel[at - near], channel[at + 1 + near] - channel[at + 1]
    goes_on = (before * leap < 0) & (after * leap < 0)
    if goes_on.mean() < settings.min_overflow_agreement:
        return none, 0.0
    return at, float(np.median(np.abs(leap)))


def stale_channels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Channels that take a new value every few rows only, and always as few: of a kind, or one."""
    for kind in ("velocity", "effort"):
        columns = joint_columns(kind, log.joints)
        block = getattr(log, kind)
        name = kind if len(log.joints) == 1 else f"{kind}_*"
        alone = zip(columns, np.hsplit(block, len(columns)), strict=True)
        for told, channels in ((name, block), *(alone if len(columns) > 1 else ())):
            found = fresh_rows(channels, limits.settings.held)
            if found is None:
                continue
            usual, fresh = found
            message = f"{told} is new every {1e3 * usual * log.dt:.3g} ms only"
            cure = "log at the rate at which it is measured; what is held is late by half of that"
            yield Finding("warning", message, int(log.rows[fresh[0]]), cure=cure)
            if told == name:
                break


def interpolated_channels(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Channels that go straight from one measured value to the next, over rows in between."""
    for kind in ("velocity", "effort"):
        columns = joint_columns(kind, log.joints)
        rows = [_rows_of_lines(channel, limits.settings) for channel in getattr(log, kind).T]
        if not any(rows):
            continue
        told = [name for name, count in zip(columns, rows, strict=True) if count]
        name = f"{kind}_*" if len(told) == len(columns) > 1 else " and ".join(told)
        time = 1e3 * float(np.median([count for count in rows if count])) * log.dt
        message = f"{name} lies on straight lines of {time:.3g} ms: interpolated from a slower log"
        cure = "log at the rate of the rows; what is faster than these lines is lost"
        yield Finding("warning", message, cure=cure)


def _rows_of_lines(channel: Array, settings: LogSettings) -> float:
    """Rows from one bend to the next of a channel (n,) of straight lines; 0 of any other."""
    slope = np.diff(channel)
    bend = np.abs(np.diff(slope))
    moving = np.abs(slope[1:]) > 0
    if moving.sum() < settings.min_rows or not bend.any():
        return 0.0
    size = float(np.sqrt((bend**2).mean()))
    # Of digits that a file drops a smooth signal has many equal slopes too, but no large bends.
    digits = float(bend[bend > 0].min())
    if size < settings.min_bend_digits * digits:
        return 0.0
    straight = float((bend[moving] < settings.max_straight_bend * size).mean())
    return 1 / (1 - straight) if settings.min_straight_share < straight < 1 else 0.0


def unsigned_efforts(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """An effort without its sign: it comes down to zero again and again and never goes beyond."""
    settings = limits.settings
    moves = moving(log.velocity, log.speed_noise, settings)
    for k, joint in enumerate(joint_columns("effort", log.joints)):
        effort, speed = log.effort[:, k], log.velocity[:, k]
        sign = 1.0 if effort.max() > -effort.min() else -1.0
        size = sign * effort
        ways = [float((moves[:, k] & (way * speed > 0)).mean()) for way in (1.0, -1.0)]
        # A weight may hold an effort on one side too, but then well away from zero.
        small = float((size < settings.small_effort_share * size.max()).mean())
        both = min(ways) > settings.min_share_of_way
        if size.min() >= 0 and size.max() > 0 and both and small > settings.min_small_share:
            side = "negative" if sign > 0 else "positive"
            turned = joint_columns("velocity", log.joints)[k]
            message = f"is never {side} though {turned} reverses: it has lost its sign"
            yield Finding("error", message, None, joint, "log the effort with its sign")


def foreign_drive(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Stretches in which joints speed up while no effort is more than noise: somebody pushes."""
    settings = limits.settings
    size = max(round(settings.push_window / log.dt), 1)
    noise = white_noise(log.effort, log.valid, settings.noise)
    effort = np.sqrt(block_mean(log.effort**2, size))
    speed = np.sqrt(block_mean((log.velocity**2).mean(axis=1), size))
    usual = float(np.sqrt((usual_speed(log.velocity, settings) ** 2).mean()))
    idle = (effort < settings.max_idle_effort * noise).all(axis=1)
    # Where efforts are never more than noise, there is none to compare with.
    if idle.mean() > settings.max_idle_share:
        return
    for start, stop in runs_of(np.asarray(idle)):
        part = speed[start:stop]
        rise = float(np.max(part - np.minimum.accumulate(part)))
        if rise > settings.min_pushed_rise * usual and len(part) >= settings.min_push_windows:
            rows = log.rows[start * size], log.rows[min(stop * size, len(log)) - 1]
            message = (
                f"rows {rows[0]} to {rows[1]}: the joints speed up while the efforts are noise: "
                "something else drives"
            )
            yield Finding("error", message, int(rows[0]), None, "cut these rows off")
            return


def effort_order(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Efforts of wheels in another order than the speeds, which are in the right one.

    Each force along the body is mostly inertia and friction of its own axis, and the torques that
    cancel are small. An order in which this holds much better is the right one.
    """
    settings = limits.settings
    size = max(round(settings.power_time / log.dt), 1)
    effort = block_mean(log.effort, size)
    twist = limits.geometry.body_twist(block_mean(log.velocity, size))
    # Orthonormal: sums of torques that make F_X, F_Y, M_W, and those that cancel.
    columns = limits.geometry.wheel_jacobian
    sums = (columns / np.sqrt((columns**2).sum(axis=0))).T
    rate = np.gradient(twist, axis=0)
    bases = [np.linalg.qr(np.column_stack([twist[:, i], rate[:, i]]))[0] for i in range(3)]
    total = max(float((effort**2).sum()), 1e-300)

    def left(order: tuple[int, ...], signs: tuple[float, ...]) -> float:
        force = (effort[:, order] * signs) @ sums.T
        # The sign of what friction explains tells a force from its negative.
        along = [float(force[:, i] @ twist[:, i]) for i in range(3)]
        parts = (
            float(((base.T @ force[:, i]) ** 2).sum())
            for i, base in enumerate(bases)
            if along[i] > 0
        )
        return 1.0 - sum(parts) / total

    as_logged = (0, 1, 2, 3), (1.0,) * 4
    now = left(*as_logged)
    if now < settings.max_other_force:
        return
    changes = product(permutations(range(4)), product((1.0, -1.0), repeat=4))
    found = {change: left(*change) for change in changes}
    least = min(found.values())
    near = [change for change in found if found[change] <= least + 0.1 * (now - least)]
    best = min(near, key=_changes)
    if best == as_logged or found[best] > settings.max_other_order_share * now:
        return
    yield _order_fault(*best, joint_columns("effort", log.joints))


def _changes(change: tuple[tuple[int, ...], tuple[float, ...]]) -> int:
    order, signs = change
    return sum(k != i for i, k in enumerate(order)) + 2 * sum(sign < 0 for sign in signs)


def _order_fault(
    order: tuple[int, ...], signs: tuple[float, ...], names: tuple[str, ...]
) -> Finding:
    given = ", ".join(f"{names[i]} from {names[k]}" for i, k in enumerate(order) if i != k)
    turned = " and ".join(names[k] for k, sign in zip(order, signs, strict=True) if sign < 0)
    messages, cures = [], []
    if given:
        messages.append("the efforts are in another order than the speeds")
        cures.append(f"in the order that fits, take the columns {given}")
    if turned:
        messages.append(f"the sign of {turned} is wrong")
        cures.append(f"multiply {turned} by -1")
    return Finding("error", " and ".join(messages), cure="; ".join(cures))
