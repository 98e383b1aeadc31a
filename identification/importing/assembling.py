"""From tables and a map to the channels of a log: one time base, SI units, gaps kept."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from identification.importing.clock_columns import clock_named
from identification.importing.clocks import spread
from identification.importing.import_map import QUANTITIES, ROW, UNKNOWN, Channels, ImportMap, Pose
from identification.importing.settings import ImportSettings
from identification.importing.tables import Array, Table, find, rate_of
from identification.importing.vocabulary import POSITION, UNITS
from identification.logs.findings import Finding, fault
from identification.logs.timebase import interpolate_at, runs_of
from youbot_env.physics.hardware import WHEELS


@dataclass(eq=False)
class Series:
    """Columns (n, k) at increasing times (n,) [s], of a source; NaN for what is missing."""

    time: Array
    values: Array

    @property
    def rate(self) -> float:
        """Usual rate [Hz]."""
        return rate_of(self.time)


@dataclass(eq=False)
class Assembled:
    """A log before it is written.

    Attributes
    ----------
    time : (n,) [s]
    channels : (n, k) by part: "velocity", "effort", ..., "pose", "gyro"
    findings : what was mended or left out on the way
    """

    time: Array
    channels: dict[str, Array]
    findings: list[Finding] = field(default_factory=list)

    @property
    def columns(self) -> list[str]:
        """Names of the log's columns, in the order of :attr:`values`."""
        names = ["time"]
        for part in self.channels:
            if part in QUANTITIES:
                names += [f"{part}_{wheel}" for wheel in WHEELS]
            else:
                names += ["pose_x", "pose_y", "pose_yaw"] if part == "pose" else ["gyro_z"]
        return names

    @property
    def values(self) -> Array:
        """(n, columns)."""
        return np.column_stack([self.time, *self.channels.values()])

    def pieces(self, settings: ImportSettings = ImportSettings()) -> list[Assembled]:
        """The stretches between gaps that a reader of logs would not bridge."""
        cuts = np.flatnonzero(np.diff(self.time) > settings.split_gap) + 1
        edges = [0, *cuts.tolist(), len(self.time)]
        return [
            Assembled(self.time[a:b], {name: block[a:b] for name, block in self.channels.items()})
            for a, b in zip(edges[:-1], edges[1:], strict=True)
        ]


def assemble(
    chosen: ImportMap, tables: list[Table], settings: ImportSettings = ImportSettings()
) -> Assembled:
    """The channels that a map names, on the stamps of the wheels' speeds or at the map's rate.

    Other channels are interpolated there, low-passed before where they are faster. Where one of
    them pauses, it is NaN; where the speeds pause, there are no rows.

    Raises
    ------
    InputError
        If a column is missing, no clock is usable or nothing is left.
    """
    made = Assembled(np.empty(0), {})
    parts: dict[str, Series] = {}
    for quantity in QUANTITIES:
        found = chosen.of(quantity)
        if found is not None and found.unit == UNKNOWN and quantity in ("effort", "command"):
            message = "left out: the map says no unit of it (N m at the wheel, or A ...)"
            made.findings.append(Finding("warning", message, column=quantity))
        elif found is not None and not found.lacks():
            parts[quantity] = _joint_series(found, quantity, chosen, tables, made, settings)
        elif found is not None:
            message = f"left out: its {found.unit} need {found.lacks()} in the map"
            made.findings.append(Finding("warning", message, column=quantity))
    _leave_out_zeros(parts, made, settings)
    if chosen.pose is not None:
        parts["pose"] = _pose_series(chosen.pose, chosen, tables, made, settings)
    if chosen.gyro is not None:
        gyro = chosen.gyro
        series = _series([gyro.z], chosen, tables, made, settings, gyro.delay)
        factor = gyro.sign * UNITS[gyro.unit][1]
        parts["gyro"] = Series(series.time, factor * series.values)
    return _on_one_base(parts, chosen.time.rate, made, settings)


def _joint_series(
    found: Channels,
    quantity: str,
    chosen: ImportMap,
    tables: list[Table],
    made: Assembled,
    settings: ImportSettings,
) -> Series:
    series = _series(list(found.columns), chosen, tables, made, settings, found.delay)
    values = series.values * found.factor() * np.array(found.sign)
    if quantity == POSITION:
        values = _unwrapped(values)
    elif UNITS.get(found.unit, ("", 1))[0] == POSITION:
        # Positions where speeds are wanted: their slope, over two steps to either side.
        values = _slope(_unwrapped(values), series.time)
        message = f"from positions: differences of {' and '.join(found.columns[:2])}, ..."
        made.findings.append(Finding("info", message, column=quantity))
    return Series(series.time, values)


def _leave_out_zeros(parts: dict[str, Series], made: Assembled, settings: ImportSettings) -> None:
    """Leaves out efforts that are zero throughout: a driver that measures none fills them in."""
    for quantity in ("effort", "command"):
        if quantity not in parts:
            continue
        largest = np.nanmax(np.abs(parts[quantity].values), initial=0.0)
        if largest <= settings.zero_effort:
            message = "is zero throughout, so it was not measured: left out"
            made.findings.append(Finding("warning", message, column=quantity))
            del parts[quantity]


def _pose_series(
    pose: Pose, chosen: ImportMap, tables: list[Table], made: Assembled, settings: ImportSettings
) -> Series:
    heading = list(pose.quaternion) or [pose.yaw]
    series = _series([pose.x, pose.y, *heading], chosen, tables, made, settings, pose.delay)
    place = series.values[:, :2] * UNITS[pose.unit][1]
    if pose.quaternion:
        x, y, z, w = series.values[:, 2:].T
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    else:
        yaw = series.values[:, 2] * UNITS[pose.yaw_unit][1]
    known = np.isfinite(yaw)
    yaw[known] = np.unwrap(yaw[known])
    values = np.column_stack([place, yaw]) * np.array(pose.sign)
    values[:, 2] += pose.frame_yaw
    c, s = np.cos(values[:, 2]), np.sin(values[:, 2])
    along, aside = pose.lever
    values[:, 0] -= c * along - s * aside
    values[:, 1] -= s * along + c * aside
    far = _outliers(values, settings)
    if far.any():
        message = f"{far.sum()} of {len(far)} poses leap and are left out"
        made.findings.append(Finding("repaired", message, column="pose"))
    keep = ~far
    return Series(series.time[keep], values[keep])


# --- one series ------------------------------------------------------------------------------


def _series(
    columns: list[str],
    chosen: ImportMap,
    tables: list[Table],
    made: Assembled,
    settings: ImportSettings,
    delay: float,
) -> Series:
    """Some columns (n, k) at increasing times, on the stamps of the first one."""
    found = []
    for name in columns:
        place = find(tables, name)
        if place is None:
            known = [column for table in tables for column in table.columns][:12]
            cure = f"the map must name one of {', '.join(known)}, ..."
            raise fault(tables[0].source, f"has no column {name!r}", cure)
        table, column = place
        found.append((clock_of(table, chosen), table, table.columns[column]))
    time, table, _ = found[0]
    if all(other is table for _, other, _ in found):
        values = np.column_stack([column for _, _, column in found])
        return _ordered(time, values, table, made, settings, delay)
    # Each wheel in a topic of its own: the others are brought to the stamps of the first.
    each = [
        _ordered(t, column[:, None], other, made, settings, delay) for t, other, column in found
    ]
    base = each[0].time
    values = np.column_stack([_sampled(one, base, settings) for one in each])
    return Series(base, values)


def clock_of(table: Table, chosen: ImportMap) -> Array:
    """The clock (n,) [s] of a table that a map asks for, or its best one.

    Raises
    ------
    InputError
        If it has none.
    """
    time = chosen.time
    if time.clock == ROW:
        if time.rate is None:
            raise fault(table.source, "rows are counted", "give their rate: [time] rate, in Hz")
        return np.arange(table.rows) / time.rate
    named = clock_named(table, time.clock, time.unit) if time.clock else None
    if named is not None:
        return named
    if table.clocks:
        return next(iter(table.clocks.values()))
    cure = 'name it in the map: [time] clock and unit, or clock = "row" and rate'
    raise fault(table.source, "no column is known as its time", cure)


def _ordered(
    time: Array,
    values: Array,
    table: Table,
    made: Assembled,
    settings: ImportSettings,
    delay: float,
) -> Series:
    """Rows that hold something, in the order of time, each time once."""
    used = np.isfinite(time) & np.isfinite(values).any(axis=1)
    time, values = time[used], values[used]
    if len(time) < 2:
        raise fault(table.source, "has no rows with numbers in these columns", "check the map")
    back = int((np.diff(time) < 0).sum())
    order = np.argsort(time, kind="stable")
    whole, merged, mixed = _merged(time[order], values[order])
    even = spread(time) if mixed > settings.max_repeated_share else None
    if even is not None:
        _note(made, 1, "the clock is coarse: times are spread evenly over the rows between")
        return Series(even - delay, values)
    if back and (mixed > settings.max_repeated_share or not _is_regular(whole, settings)):
        row = int(np.argmax(np.diff(time) < 0)) + 1
        message = f"time runs back from {time[row - 1]:.9g} to {time[row]:.9g} s: two runs in one"
        cure = "`-o FOLDER/` writes a log for each"
        raise fault(table.source, message, cure)
    _note(made, back, f"{back} row(s) out of order: sorted by time")
    twice = round(mixed * len(time))
    _note(made, twice, f"{twice} row(s) repeat a time: the first of each is kept")
    return Series(whole - delay, merged)


def _merged(time: Array, values: Array) -> tuple[Array, Array, float]:
    """Rows (n, k) of one time made one: of each column the first number.

    Returns the times, the rows, and the share of rows that held another number there. Messages of
    one instant may hold a joint each, and a message may have been recorded twice.
    """
    whole, place = np.unique(time, return_inverse=True)
    merged = np.full((len(whole), values.shape[1]), np.nan)
    for k, column in enumerate(values.T):
        known = np.flatnonzero(np.isfinite(column))[::-1]
        # Backwards, so that of several numbers the first one stays.
        merged[place[known], k] = column[known]
    other = np.isfinite(values) & (values != merged[place])
    return whole, merged, float(other.any(axis=1).mean())


def _note(made: Assembled, count: int, message: str) -> None:
    if count and not any(finding.message == message for finding in made.findings):
        made.findings.append(Finding("repaired", message, column="time"))


def _is_regular(time: Array, settings: ImportSettings) -> bool:
    steps = np.diff(time)
    usual = np.median(steps)
    return bool((np.abs(steps - usual) <= usual / 2).mean() >= settings.min_regular_share)


def back_jumps(time: Array, settings: ImportSettings = ImportSettings()) -> list[int]:
    """Rows at which a clock (n,) is set back and another run begins; [] where none does."""
    known = np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[known])
    unique = np.unique(time[known])
    if (steps >= 0).all() or len(unique) < 3:
        return []
    again = 1 - len(unique) / len(known)
    if again <= settings.max_repeated_share and _is_regular(unique, settings):
        return []
    return known[1:][steps < 0].tolist()


def _unwrapped(values: Array) -> Array:
    """Angles (n, k) [rad] of which those that wrap within a turn are made continuous."""
    found = values.copy()
    turn = 2 * np.pi
    for k in range(values.shape[1]):
        known = np.isfinite(values[:, k])
        angle = values[known, k]
        wraps = len(angle) > 1 and np.ptp(angle) <= turn * 1.01
        if wraps and np.abs(np.diff(angle)).max() > turn / 2:
            found[known, k] = np.unwrap(angle)
    return found


def _slope(values: Array, time: Array) -> Array:
    return np.gradient(values, time, axis=0) if len(time) > 1 else values


def _outliers(values: Array, settings: ImportSettings) -> NDArray[np.bool_]:
    """Rows (n,) in which a column leaps away from its neighbours and back."""
    far = np.zeros(len(values), bool)
    if len(values) <= settings.outlier_window:
        return far
    for column in values.T:
        filled = np.where(np.isfinite(column), column, np.nanmedian(column))
        off = np.abs(filled - signal.medfilt(filled, settings.outlier_window))
        # 1.48: what makes a standard deviation of a Gaussian's median deviation. The least one
        # keeps a signal that stands still, all deviations zero, from being all outliers.
        usual = 1.48 * float(np.median(off[off > 0])) if (off > 0).any() else 0.0
        steps = np.abs(np.diff(filled))
        usual = max(usual, float(np.quantile(steps, 0.9)))
        far |= off > settings.outlier_deviations * usual
    # The ends of the median's window hold zeros: they say nothing.
    half = settings.outlier_window // 2
    far[:half] = far[-half:] = False
    return far


# --- one time base ---------------------------------------------------------------------------


def _on_one_base(
    parts: dict[str, Series], rate: float | None, made: Assembled, settings: ImportSettings
) -> Assembled:
    speeds = parts.get("velocity")
    if speeds is None:
        why = next((str(f) for f in made.findings if f.column == "velocity"), "not in the map")
        raise fault("map", f"no speeds of the wheels: {why}", "write it into [velocity]")
    base = speeds.time
    if rate is not None and not _has_rate(base, rate):
        base = base[0] + np.arange(int((base[-1] - base[0]) * rate + 1e-6) + 1) / rate
        made.findings.append(
            Finding("info", f"resampled from {speeds.rate:.4g} Hz to {rate:.4g} Hz", column="time")
        )
    channels = {}
    for name, series in parts.items():
        alike = len(series.time) == len(base) and np.array_equal(series.time, base)
        channels[name] = series.values if alike else _sampled(series, base, settings)
        if not alike and name != "velocity":
            low_pass = _is_faster(series, base, settings)
            how = ", low-passed" if low_pass else ""
            message = f"at {series.rate:.4g} Hz: brought to the rows' times{how}"
            made.findings.append(Finding("info", message, column=name))
    # Where the speeds pause there is no row, so that a gap stays one.
    rows = np.isfinite(channels["velocity"]).any(axis=1)
    if "effort" in channels:
        rows &= _within(base, parts["effort"].time)
    if rows.sum() < 2:
        raise fault("import", "no two rows hold speeds and efforts", "check times and delays")
    channels = {name: block[rows] for name, block in channels.items()}
    for name in [name for name, block in channels.items() if not np.isfinite(block).any()]:
        message = "has no value at the times of the speeds: left out; do the clocks agree?"
        made.findings.append(Finding("warning", message, column=name))
        del channels[name]
    return _trimmed(replace(made, time=base[rows], channels=channels), settings)


def _trimmed(made: Assembled, settings: ImportSettings) -> Assembled:
    """Without the rows at both ends in which a channel has no value yet, or none any more.

    Recorders start and stop one after another. A channel that covers a part of the run only is no
    reason to lose the rest: it stays empty there.
    """
    first, stop, ends = 0, len(made.time), []
    most = settings.max_trimmed_share * len(made.time)
    for name, block in made.channels.items():
        known = np.flatnonzero(np.isfinite(block).all(axis=1))
        if not len(known):
            continue
        before, after = int(known[0]), len(block) - 1 - int(known[-1])
        if before + after == 0:
            continue
        if before + after > most:
            late = made.time[known[0]] - made.time[0]
            early = made.time[-1] - made.time[known[-1]]
            message = (
                f"has no value in the first {late:.3g} s and the last {early:.3g} s of the run: "
                "empty (nan) there"
            )
            made.findings.append(Finding("warning", message, column=name))
            continue
        first, stop = max(first, before), min(stop, len(block) - after)
        ends.append(name)
    if not ends:
        return made
    message = (
        f"{first} row(s) at the start and {len(made.time) - stop} at the end left out: "
        f"{' and '.join(ends)} had no value there"
    )
    made.findings.append(Finding("info", message, column="time"))
    kept = {name: block[first:stop] for name, block in made.channels.items()}
    return replace(made, time=made.time[first:stop], channels=kept)


def _has_rate(time: Array, rate: float) -> bool:
    steps = np.diff(time)
    return bool(np.abs(steps * rate - 1).max(initial=0.0) < 1e-3)


def _within(base: Array, time: Array) -> NDArray[np.bool_]:
    return (base >= time[0]) & (base <= time[-1])


def _is_faster(series: Series, base: Array, settings: ImportSettings) -> bool:
    return series.rate > settings.min_decimation * rate_of(base)


def _sampled(series: Series, base: Array, settings: ImportSettings) -> Array:
    """A series at other times (m,): (m, k), NaN in its gaps and beyond its ends."""
    found = np.full((len(base), series.values.shape[1]), np.nan)
    for k, column in enumerate(series.values.T):
        known = np.isfinite(column)
        if known.sum() < 2:
            continue
        time, values = series.time[known], column[known]
        gap = max(settings.gap_steps / rate_of(time), settings.min_gap)
        for start, stop in runs_of(np.r_[np.diff(time) <= gap]):
            part = slice(start, stop + 1)
            inside = (base >= time[start]) & (base <= time[stop])
            if inside.any():
                one = Series(time[part], values[part, None])
                found[inside, k] = _interpolated(one, base, inside, settings)
        exact = np.isin(base, time) & ~np.isfinite(found[:, k])
        found[exact, k] = values[np.searchsorted(time, base[exact])]
    return found


def _interpolated(
    series: Series, base: Array, inside: NDArray[np.bool_], settings: ImportSettings
) -> Array:
    """One stretch without gaps, at those times of the base that lie inside it."""
    at = base[inside]
    time, values = series.time, series.values[:, 0]
    if _is_faster(series, base, settings) and len(time) > 4 * settings.filter_order:
        # A uniform grid at the series' own rate, for the filter; its stamps may jitter.
        grid = np.linspace(time[0], time[-1], len(time))
        rate = (len(time) - 1) / (time[-1] - time[0])
        cutoff = settings.cutoff_share * rate_of(base) / 2
        low_pass = signal.butter(settings.filter_order, cutoff, fs=rate, output="sos")
        padding = min(3 * settings.filter_order, len(time) - 1)
        smooth = signal.sosfiltfilt(low_pass, np.interp(grid, time, values), padlen=padding)
        return np.interp(at, grid, smooth)
    steps = np.diff(time)
    # The cubic runs wild between samples that are much closer than the others.
    if len(time) >= 4 and steps.min() > np.median(steps) / 3:
        return interpolate_at(at, time, values[:, None])[:, 0]
    return np.interp(at, time, values)
