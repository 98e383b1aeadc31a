"""The time column of a log: its faults, its unit, its gaps, and resampling to a uniform grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.logs.columns import Draft
from identification.logs.findings import percent
from identification.logs.settings import LogSettings
from identification.signals.filters import block_mean


def interpolate_at(
    at: NDArray[np.float64], time: NDArray[np.float64], data: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cubic through the four samples around each instant.

    Parameters
    ----------
    at : (m,) instants within the range of time [s]
    time : (n,) increasing, n >= 4 [s]
    data : (n, k)

    Returns
    -------
    (m, k), NaN wherever one of the four samples is NaN and has a weight.
    """
    # Two samples on each side of the instant; at the ends the first or last four samples.
    first = np.clip(np.searchsorted(time, at, side="right") - 2, 0, len(time) - 4)
    nodes = time[first[:, None] + np.arange(4)]
    result = np.zeros((len(at), data.shape[1]))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod([(at - nodes[:, j]) / (nodes[:, i] - nodes[:, j]) for j in others], axis=0)
        contribution = weight[:, None] * data[first + i]
        # At a sample the three others have weight zero, but 0 * NaN would still be NaN.
        result += np.where(weight[:, None] == 0, 0, contribution)
    return result


def bridge(
    signal: NDArray[np.float64], start: int, stop: int, side: int = LogSettings.bridge_samples
) -> None:
    """Replace signal[start:stop] (n,) in place by a cubic fitted to the samples around it.

    The least-squares fit takes up to ``side`` finite samples a side, which averages their noise and
    leaves no kink; with fewer than four it is a straight line.
    """
    # Three times as far, since samples nearby may be missing too.
    before = np.arange(max(start - 3 * side, 0), start)
    after = np.arange(stop, min(stop + 3 * side, len(signal)))
    before = before[np.isfinite(signal[before])][-side:]
    after = after[np.isfinite(signal[after])][:side]
    around = np.r_[before, after]
    # A cubic fitted on one side only extrapolates, and would grow without bound.
    degree = 3 if min(before.size, after.size) >= 2 else 1 if around.size >= 2 else 0
    # Centred and scaled, since high powers of sample numbers are badly conditioned.
    centre, scale = (start + stop - 1) / 2, float(np.ptp(around)) or 1.0
    powers = np.arange(degree + 1)
    basis = ((around - centre) / scale)[:, None] ** powers
    weights = np.linalg.lstsq(basis, signal[around], rcond=None)[0]
    wanted = (np.arange(start, stop) - centre) / scale
    signal[start:stop] = (wanted[:, None] ** powers) @ weights


def runs_of(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges (start, stop) in which a mask (n,) holds."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def ordinal(number: int) -> str:
    """A positive number as "1st", "2nd", "3rd", "11th"."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10)
    return f"{number}{ending or 'th'}"


_UNITS = {
    "milliseconds": (1e3, "0.001"),
    "microseconds": (1e6, "1e-6"),
    "nanoseconds": (1e9, "1e-9"),
}


def gap_limit(step: float, settings: LogSettings) -> int:
    """Number of consecutive samples [-] that may be bridged at a time step [s]."""
    usual = max(settings.max_gap_samples, settings.max_gap_time / step)
    return int(min(usual, settings.longest_gap_time / step))


def nominal_step(time: NDArray[np.float64]) -> float:
    """Time step [s] of increasing instants (n,), gaps and repetitions aside.

    The mean, not the median: time stamps at 400 Hz, rounded to milliseconds, step by 2 and 3 ms.
    """
    steps = np.diff(time)
    # The median tells a usual step even if there are gaps; steps far from it are gaps or
    # repetitions.
    usual = np.median(steps)
    return float(steps[(steps >= 0.5 * usual) & (steps <= 1.5 * usual)].mean())


def check_time(draft: Draft) -> bool:
    """Repair the time column of a draft, or refuse it; return whether the steps are irregular.

    Rows written twice are dropped, and so are a few that repeat a time. In a regular log, missing
    rows are inserted as NaN. An irregular log stays irregular here: `resample` follows after its
    channels are repaired. Each repair is reported.

    Raises
    ------
    InputError
        If time repeats, runs backwards, is not in seconds, is outside 20 Hz to 1 kHz or has a gap
        too long to bridge.
    """
    _fill_time(draft)
    _sort_exchanged_rows(draft)
    _drop_repeated_rows(draft)
    _drop_rows_of_one_time(draft)
    if len(draft.time) < draft.settings.min_rows:
        cure = f"record at least {draft.settings.min_rows} rows of motion"
        raise draft.fault(f"has only {len(draft.time)} row(s)", cure)
    _check_order(draft)
    if (even := even_step(draft.time, draft.settings)) is not None:
        _check_step(draft, even)
        if not _is_irregular(draft.time, even, draft.settings):
            return False
        _check_bursts(draft)
        return not _evened(draft, even)
    _check_bursts(draft)
    step = nominal_step(draft.time)
    _check_step(draft, step)
    _check_gaps(draft, step)
    irregular = _is_irregular(draft.time, step, draft.settings)
    if not irregular:
        _insert_missing_rows(draft, step)
    return irregular


def _fill_time(draft: Draft) -> None:
    """Interpolate missing times of single rows, if the rows around them allow it."""
    missing = ~np.isfinite(draft.time)
    if not missing.any():
        return
    first = int(np.argmax(missing))
    known = np.flatnonzero(~missing)
    runs = np.diff(known) - 1
    # Times can be interpolated, but not extrapolated beyond the first and last known one.
    inside = known.size >= 3 and known[0] == 0 and known[-1] == len(missing) - 1
    if (
        not inside
        or runs.max() > draft.settings.max_gap_samples
        or missing.mean() > draft.settings.max_untimed_share
    ):
        cure = "write the time of every row, in seconds"
        raise draft.fault(f"{missing.sum()} rows have no time", cure, first, "time")
    # The usual step, from neighbouring rows that both have a time.
    step = np.median(np.diff(draft.time[known])[runs == 0])
    spans = np.diff(draft.time[known])[runs > 0] / (runs[runs > 0] + 1)
    if np.abs(spans / step - 1).max() > draft.settings.max_step_offset:
        cure = "write the time of every row, in seconds"
        raise draft.fault("the row has no time and the rows around it do not tell it", cure, first)
    draft.time[missing] = np.interp(np.flatnonzero(missing), known, draft.time[known])
    message = f"{missing.sum()} row(s) without a time: interpolated"
    draft.report("repaired", message, "check the logger", first, "time")


def _drop_repeated_rows(draft: Draft) -> None:
    same_time = np.diff(draft.time) == 0
    # NaN equals nothing, itself included; a missing value is no sign of a new row.
    same_data = ((draft.data[1:] == draft.data[:-1]) | np.isnan(draft.data[1:])).all(axis=1)
    repeated = np.r_[False, same_time & same_data]
    if not repeated.any():
        return
    message = f"{repeated.sum()} row(s) written twice: dropped"
    draft.report("repaired", message, "check the logger", int(np.argmax(repeated)))
    draft.keep(~repeated)


def _sort_exchanged_rows(draft: Draft) -> None:
    """Sort rows that stand in another order than their times, if their times are regular then."""
    order = np.argsort(draft.time, kind="stable")
    moved = order != np.arange(len(order))
    settings = draft.settings
    if not moved.any() or np.abs(order - np.arange(len(order))).max() > settings.max_moved_rows:
        return
    steps = np.diff(draft.time[order])
    usual = float(np.median(steps))
    regular = (steps > 0.5 * usual) & (steps < 1.5 * usual)
    if usual <= 0 or regular.mean() < settings.min_sorted_share:
        return
    at = int(np.argmax(moved))
    message = f"{int(moved.sum())} rows stand in another order than their times: sorted"
    draft.report("repaired", message, "check the logger", at, "time")
    draft.time, draft.data = draft.time[order], draft.data[order]
    draft.lines, draft.valid = draft.lines[order], draft.valid[order]


def _drop_rows_of_one_time(draft: Draft) -> None:
    """Of a few rows that share a time with the row before, keep the first."""
    same = np.r_[False, np.diff(draft.time) == 0]
    if not 0 < same.sum() <= max(1, draft.settings.max_same_time_share * len(same)):
        return
    at = int(np.argmax(same))
    message = f"{same.sum()} row(s) have the time of the row before: the later row is dropped"
    draft.report("repaired", message, "check the logger's clock", at, "time")
    draft.keep(~same)


def _check_order(draft: Draft) -> None:
    steps = np.diff(draft.time)
    if (steps > 0).all():
        return
    _check_rounded(draft, steps)
    at = int(np.argmax(steps <= 0)) + 1
    now, before = draft.time[at], draft.time[at - 1]
    # Mostly backwards, or no step at all: the whole column is wrong, not a single row.
    if (steps < 0).mean() > 0.5 or not steps.any():
        cure = "sort the rows by time, and write it in seconds"
        raise draft.fault("time does not increase", cure, at, "time")
    if now == before:
        cure = "remove the row, or write time with more decimals"
        raise draft.fault(f"time {now:.12g} s repeats", cure, at, "time")
    times = int((steps < 0).sum())
    if times > draft.settings.max_clock_settings:
        message = f"time runs back {times} times, first from {before:.12g} to {now:.12g} s"
        cure = (
            "seconds and nanoseconds glued without leading zeros, or rows of several topics? "
            "import it with both columns, or sort the rows"
        )
        raise draft.fault(message, cure, at, "time")
    cure = "remove the row, or split the log there if the clock was set"
    raise draft.fault(f"time runs back from {before:.12g} to {now:.12g} s", cure, at, "time")


def _check_rounded(draft: Draft, steps: NDArray[np.float64]) -> None:
    """Refuse times that many rows share: their last digits are lost."""
    same = float((steps == 0).mean())
    if same < draft.settings.min_rounded_share or (steps < 0).any():
        return
    at = int(np.argmax(steps == 0)) + 1
    rising = steps[steps > 0]
    every = f" in steps of {float(np.median(rising)):.4g} s" if rising.size else ""
    message = f"{percent(same)} of the rows have the time of the row before{every}"
    # The times of these years, in seconds, have ten digits; a float32 holds seven.
    epoch = abs(float(draft.time[0])) > draft.settings.least_epoch
    why = "an epoch in float32, or rounded by a spreadsheet" if epoch else "rounded"
    cure = (
        "write time with all its digits (float64), less its start; or the row's number times the "
    )
    cure += "sample time"
    raise draft.fault(f"time is {why}: {message}", cure, at, "time")


def _check_step(draft: Draft, step: float) -> None:
    settings, margin = draft.settings, draft.settings.max_step_deviation
    least, most = settings.min_step * (1 - margin), settings.max_step * (1 + margin)
    if step < least:
        # Less 1e-6: rounding of an exact ratio must not advise one row more.
        rows = int(np.ceil(settings.min_step / step - 1e-6))
        cure = f"keep every {ordinal(rows)} row, after a low-pass"
        fastest = f"{1e-3 / settings.min_step:g} kHz"
        raise draft.fault(f"{1 / step:.6g} Hz is above {fastest}", cure, 1, "time")
    if step <= most:
        return
    for unit, (scale, factor) in _UNITS.items():
        if least <= step / scale <= most:
            cure = f"multiply it by {factor} (a sample counter: by the sample time)"
            message = f"time steps by {step:.6g}, which looks like {unit}"
            raise draft.fault(message, cure, 1, "time")
    cure = "record faster; time is in seconds"
    raise draft.fault(f"{1 / step:.4g} Hz is below {1 / settings.max_step:g} Hz", cure, 1, "time")


def even_step(time: NDArray[np.float64], settings: LogSettings) -> float | None:
    """Time step [s] of rows of which none is lost, however their times jitter; None of others.

    Jitter goes back and forth about a straight line over the row's number. Lost rows bend it.
    """
    # Times that hardly move but for one may be apart by more than a number holds of them.
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(time) / np.median(np.diff(time))
        whole = np.abs(steps - np.round(steps)) < 0.1
    lost = np.round(steps).max() > 1 and np.round(steps).min() >= 1
    if lost and whole.mean() > settings.min_lattice_share:
        return None
    number = np.arange(len(time))
    slope, start = np.polyfit(number, time - time[0], 1)
    left = time - time[0] - start - slope * number
    if slope <= 0 or np.abs(left).max() > max(settings.max_lateness, 1.5 * slope):
        return None
    size = max(round(settings.lateness_time / slope), 2)
    means = block_mean(left, size)
    if len(means) > 2 and float(means.std()) > settings.max_slow_share * float(left.std()):
        return None
    return float(slope)


def _evened(draft: Draft, step: float) -> bool:
    """Take rows for evenly sampled where their values say so, and their times jitter; report it.

    Values that were taken at the stamps lie nearer to a line between their neighbours by the
    stamps; those that were taken evenly and stamped late, by the rows' numbers.
    """
    time = draft.time
    part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    values = draft.data[:, [draft.names.index(name) for name in draft.required]]
    values = values[:, : max(values.shape[1] // 2, 1)]  # speeds: smoother than efforts
    first, middle, last = values[:-2], values[1:-1], values[2:]
    by_stamp = np.nansum((middle - first - part * (last - first)) ** 2)
    by_number = np.nansum((middle - 0.5 * (first + last)) ** 2)
    if by_stamp < draft.settings.max_stamped_share * by_number:
        return False
    line = time.mean() + step * (np.arange(len(time)) - (len(time) - 1) / 2)
    late = time - line
    at = int(np.argmax(np.abs(late)))
    message = (
        f"times jitter by {1e3 * float(late.std()):.2g} ms (rms) about {1 / step:.6g} Hz, the "
        "values do not: taken as evenly sampled"
    )
    draft.report("repaired", message, "use the message's own stamp (header.stamp)", at, "time")
    draft.time = line
    return True


def _check_bursts(draft: Draft) -> None:
    """Refuse times of arrival: rows in bursts, between which nothing comes."""
    steps, settings = np.diff(draft.time), draft.settings
    # Jitter makes few steps as short as those within a burst.
    if float((steps < settings.max_burst_step * steps.mean()).mean()) < settings.min_burst_steps:
        return
    short = float(np.quantile(steps, settings.burst_quantile))
    pauses = steps > settings.min_burst_pause * short
    share = float(pauses.mean())
    if not settings.min_burst_share < share <= settings.max_burst_share:
        return
    rows, period = 1 / share, float(np.mean(steps)) / share
    message = (
        f"times of arrival, in bursts of some {rows:.2g} rows every {period:.3g} s, not of "
        "measurement"
    )
    cure = "use the message's own stamp (header.stamp), or the sample time times the row's number"
    raise draft.fault(message, cure, int(np.argmax(pauses)) + 1, "time")


def _check_gaps(draft: Draft, step: float) -> None:
    """Refuse a gap too long to bridge, and too many short ones."""
    steps = np.diff(draft.time)
    at = int(np.argmax(steps))
    # A gap of n missing rows is a step of n + 1; the half allows for jitter.
    if steps[at] > (gap_limit(step, draft.settings) + 1.5) * step:
        message = f"time jumps by {steps[at]:.6g} s"
        raise draft.fault(message, "split the log there into two", at + 1, "time")
    missing = float(np.maximum(np.round(steps / step) - 1, 0).sum())
    if missing > draft.settings.max_missing_row_share * len(steps):
        at = int(np.argmax(steps > 1.5 * step))
        message = f"{missing:.0f} rows are missing"
        raise draft.fault(message, "record again, the logger loses samples", at + 1, "time")


def _is_irregular(time: NDArray[np.float64], step: float, settings: LogSettings) -> bool:
    steps = np.diff(time)
    samples = np.maximum(np.round(steps / step), 1)
    offset = np.abs(steps - samples * step)
    jitter = np.sqrt(np.mean(offset**2)) / step
    if jitter <= settings.max_jitter and offset.max() <= settings.max_step_offset * step:
        return False
    # Times rounded to few decimals (400 Hz in milliseconds) look irregular but are not: each is at
    # most half a unit of the last decimal from a straight line. 0.75 leaves room for the line's
    # own error.
    index = np.r_[0, np.cumsum(samples)]
    slope, start = np.polyfit(index, time - time[0], 1)
    rounding = _resolution(time)
    return bool(np.abs(time - time[0] - start - slope * index).max() > 0.75 * rounding)


def _resolution(time: NDArray[np.float64]) -> float:
    """Unit of the last decimal of a time column [s]; 0 beyond microseconds."""
    for decimals in range(1, 7):
        unit = 10.0**-decimals
        # The second term is the rounding of a float: times since 1970 are near 1e9 s.
        if np.abs(time - np.round(time, decimals)).max() < 1e-3 * unit + 1e-15 * abs(time[-1]):
            return unit
    return 0.0


def _insert_missing_rows(draft: Draft, step: float) -> None:
    steps = np.round(np.diff(draft.time) / step).astype(int)
    if steps.max(initial=1) <= 1:
        return
    at = int(np.argmax(steps > 1))
    gaps, missing = int((steps > 1).sum()), int((steps[steps > 1] - 1).sum())
    message = f"{missing} missing row(s) in {gaps} gap(s): interpolated"
    draft.report("repaired", message, "check the logger", at + 1, "time")
    # A step below half of the usual one is rounded to 0, but still leads to another row.
    place = np.r_[0, np.cumsum(np.maximum(steps, 1))]
    index = np.arange(place[-1] + 1)
    source = np.searchsorted(place, index, side="right") - 1
    inserted = place[source] != index
    draft.time = np.interp(index, place, draft.time)
    draft.data, draft.lines = draft.data[source], draft.lines[source]
    draft.valid = draft.valid[source] & ~inserted
    draft.data[inserted] = np.nan


def resample(draft: Draft) -> None:
    """Interpolate a draft, whose channels are finite, to a uniform grid, and report it."""
    old = draft.time
    steps = np.diff(old)
    # Mean step with missing rows counted, so that the grid ends at the last sample.
    even = even_step(old, draft.settings)
    counted = (
        np.maximum(np.round(steps / nominal_step(old)), 1).sum() if even is None else steps.size
    )
    step = float((old[-1] - old[0]) / counted)
    grid = old[0] + step * np.arange(int((old[-1] - old[0]) / step + 1e-6) + 1)
    after = np.clip(np.searchsorted(old, grid, side="right"), 1, len(old) - 1)
    jitter = np.sqrt(np.mean((steps - step) ** 2)) / step
    message = f"time steps vary by {percent(jitter)} (rms): interpolated to {1 / step:.6g} Hz"
    at = int(np.argmax(np.abs(steps - step))) + 1
    draft.report("repaired", message, "log at a constant rate", at, "time")
    if steps.min() > draft.settings.min_cubic_step * step:
        draft.data = interpolate_at(grid, old, draft.data)
    else:  # A cubic through two samples that are close together would leap
        draft.data = np.column_stack([np.interp(grid, old, channel) for channel in draft.data.T])
    # A value interpolated across a gap is not a measurement.
    near = steps[after - 1] < 2.5 * step
    draft.valid = draft.valid[after - 1] & draft.valid[after] & near
    draft.time, draft.lines = grid, draft.lines[after - 1]
