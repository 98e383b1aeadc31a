"""Is a residual periodic in a place, a wheel's angle or time? A scan over periods, held out.

Joints of a floor, ribs, teeth of a gear, a deck that sways: a force that repeats every few
centimetres, some times a turn, or every few seconds. Neither trees nor smooth functions of a
coordinate see it, since they would have to know each period by itself. Here one wave (a period,
with its sizes and phases) is chosen by most of the stretches of time and predicts the others, fold
by fold, so that chance has nothing to gain by the many periods that were tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from identification.fitting.parts import rows_in_parts
from identification.fitting.settings import FitSettings, HarmonicScanSettings
from identification.mechanisms.mechanism import Mechanism, Variables
from identification.mechanisms.samples import Samples, cut
from identification.signals.filters import Ends, at_both_ends, settled
from identification.threads import side_by_side

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Harmonic:
    """One wave over one variable, and what it predicts on stretches that were held out.

    Attributes
    ----------
    variable : position_x, wheel_angle_fl, time, ...
    period : in its unit [m, rad or s]; of most folds
    predicted : per log (n, A), each stretch from the others
    share : of the residual's squares that this takes away; below zero of noise
    p_value : chance of such a share, over all variables that were scanned
    """

    variable: str
    period: float
    predicted: tuple[Array, ...]
    share: float
    p_value: float

    def is_seen(self, settings: HarmonicScanSettings) -> bool:
        """Whether it is more than chance."""
        return self.p_value <= settings.max_p_value and self.share > settings.min_share


@dataclass(frozen=True)
class _Scanned:
    """A variable to scan: per log values (N,); wave numbers (K,).

    A force along each of the axes may follow it, of the body, or of the world where ``headings``
    (N,) are known.
    """

    name: str
    values: list[Array]
    headings: list[Array] | None
    wave_numbers: Array


def harmonic_scan(
    mechanism: Mechanism,
    residual: Sequence[Array],
    samples: Sequence[Samples],
    settings: FitSettings = FitSettings(),
    *,
    angles: bool = True,
) -> list[Harmonic]:
    """The best wave over each coordinate of the place and each wheel's angle, the largest first.

    Over a place, and in time, the force acts along the world's axes and as a moment; over an angle
    along the body's. In time each log has a wave of its own: none knows when another began. Empty
    where the logs hold too few stretches, or nothing to scan.

    Parameters
    ----------
    residual : per log (n, A) rows of a fit on these samples, made with these settings
    angles : whether wheel angles are scanned too, or places alone
    """
    chosen = settings.harmonic_scan
    steps = [settings.rows_of(mechanism.filter_rate, item.dt).step for item in samples]
    stretches = _stretches(residual, steps, chosen)
    if _too_few(stretches, chosen):
        return []
    by_variable = [
        _best_wave(mechanism, one, residual, stretches, samples, settings)
        for one in _scanned(mechanism, steps[0], samples, settings, angles)
    ]
    by_variable.append(_best_in_time(mechanism, residual, steps, samples, settings))
    count = len(by_variable)
    waves = [
        Harmonic(name, period, predicted, share, min(1.0, count * p_value))
        for name, period, predicted, share, p_value in by_variable
    ]
    return sorted(waves, key=lambda wave: -wave.share)


def _stretches(
    residual: Sequence[Array], steps: Sequence[float], settings: HarmonicScanSettings
) -> list[Indices]:
    """Per log (n,) the stretch of time that each row is in, counted over all logs."""
    found, first = list[Indices](), 0
    for rows, step in zip(residual, steps, strict=True):
        lasted = step * np.arange(len(rows))
        found.append(first + (lasted // settings.stretch_duration).astype(np.intp))
        first = int(found[-1].max(initial=first - 1)) + 1
    return found


def _too_few(stretches: Sequence[Indices], settings: HarmonicScanSettings) -> bool:
    return int(stretches[-1].max(initial=-1)) + 1 < settings.min_stretches


def _scanned(
    mechanism: Mechanism,
    step: float,
    samples: Sequence[Samples],
    settings: FitSettings,
    with_angles: bool,
) -> Iterator[_Scanned]:
    """What is scanned, one after another: coordinates of the place, and angles of the joints.

    ``step``: from one row to the next [s].
    """
    chosen, read = settings.harmonic_scan, partial(all_of, mechanism, samples, settings)
    first = mechanism.variables(cut(samples[0], 0, 2))
    headings = read(lambda one: one.heading)
    for k, place in enumerate(first.places):
        values = read(lambda one, k=k: one.position[:, k])
        assert values is not None
        numbers = _wave_numbers(values, step, samples, chosen)
        if len(numbers):
            name = f"position_{place}" if place else "position"
            yield _Scanned(name, values, headings, numbers)
    for k, joint in enumerate(first.joints if with_angles else ()):
        values = read(lambda one, k=k: None if one.angle is None else one.angle[:, k])
        if values is None:
            continue
        name = f"wheel_angle_{joint}" if joint else "wheel_angle"
        orders = np.arange(1.0, chosen.max_wheel_order + 1)
        yield _Scanned(name, values, None, orders)


def all_of(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    settings: FitSettings,
    choose: Callable[[Variables], Array | None],
) -> list[Array] | None:
    """Per log (N,) one of what the residual may depend on; None where some log lacks it.

    Of long logs part by part: all variables take more memory than the log.
    """
    found = []
    for item in samples:
        size = settings.max_part_samples
        parts = [
            choose(mechanism.variables(cut(item, begin, begin + size)))
            for begin in range(0, len(item), size)
        ]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        found.append(known[0] if len(known) == 1 else np.concatenate(known))
    return found


def _wave_numbers(
    values: Sequence[Array],
    step: float,
    samples: Sequence[Samples],
    settings: HarmonicScanSettings,
) -> Array:
    """(K,) [rad per unit] from some periods in the usual range up to what the rows can follow."""
    joined = np.concatenate(values)
    low, high = np.quantile(joined, settings.usual_range)
    rates = [np.gradient(v, item.dt) for v, item in zip(values, samples, strict=True)]
    usual = float(np.sqrt(np.mean(np.concatenate(rates) ** 2)))
    if high - low <= 0 or usual <= 0:
        return np.zeros(0)
    # A wave that passes faster than half the rate of the rows is not seen in them.
    most = settings.max_share_of_nyquist * (0.5 / step) / usual * (high - low)
    periods = np.arange(settings.min_periods, most, 1.0 / settings.oversampling)
    return 2 * np.pi * periods[: settings.max_waves] / (high - low)


Wave = tuple[str, float, tuple[Array, ...], float, float]
"""Variable, period, predicted rows, share and p-value of this variable alone."""


def _best_wave(
    mechanism: Mechanism,
    one: _Scanned,
    residual: Sequence[Array],
    stretches: Sequence[Indices],
    samples: Sequence[Samples],
    settings: FitSettings,
) -> Wave:
    """What the best wave of each fold's other stretches predicts of the fold."""
    chosen = settings.harmonic_scan
    residual = _without_constants(mechanism, one, residual, samples, settings)
    power = _scores(mechanism, one, residual, stretches, samples, settings)
    leaders = np.unique(np.argsort(-power, axis=1)[:, : chosen.exact_waves])
    joined, stretch = np.concatenate(residual), np.concatenate(stretches)
    waves = {
        int(k): _columns(mechanism, one, float(one.wave_numbers[k]), samples, residual, settings)
        for k in leaders
    }
    predicted, numbers = np.zeros_like(joined), []
    for fold in range(chosen.folds):
        held = stretch % chosen.folds == fold
        fits = {k: _fitted(columns[~held], joined[~held]) for k, columns in waves.items()}
        best = max(fits, key=lambda k: fits[k][1])
        predicted[held] = waves[best][held] @ fits[best][0]
        numbers.append(float(one.wave_numbers[best]))
    gain = (joined**2 - (joined - predicted) ** 2).sum(axis=1)
    by_stretch = np.bincount(stretch, gain)
    spread = float(by_stretch.std(ddof=1)) * np.sqrt(len(by_stretch))
    p_value = float(ndtr(-float(gain.sum()) / max(spread, 1e-300)))
    share = float(gain.sum() / max(float((joined**2).sum()), 1e-300))
    edges = np.cumsum([len(part) for part in residual])[:-1]
    period = 2 * np.pi / float(np.median(numbers))
    return one.name, period, tuple(np.split(predicted, edges)), share, p_value


def _best_in_time(
    mechanism: Mechanism,
    residual: Sequence[Array],
    steps: Sequence[float],
    samples: Sequence[Samples],
    settings: FitSettings,
) -> Wave:
    """The same of waves in time: in each log the best one, where it is more than chance.

    Noise has tones too, but hum of a grid is faster than what is scanned. ``steps``: from row to
    row [s].
    """
    chosen = settings.harmonic_scan
    headings = all_of(mechanism, samples, settings, lambda one: one.heading)
    predicted, p_values = [np.zeros_like(part) for part in residual], list[float]()
    longest, period = 0.0, np.inf
    for log, item in enumerate(samples):
        duration = float(item.time[-1] - item.time[0])
        most = min(duration * chosen.fastest_in_time, chosen.max_periods_in_time)
        periods = np.arange(chosen.min_periods_in_time, most, 1.0 / chosen.oversampling)
        stretches = _stretches([residual[log]], [steps[log]], chosen)
        if not len(periods) or _too_few(stretches, chosen):
            continue
        turned = [headings[log]] if headings else None
        one = _Scanned("time", [item.time], turned, 2 * np.pi * periods / duration)
        _, own_period, (known,), share, p_value = _best_wave(
            mechanism, one, [residual[log]], stretches, [item], settings
        )
        if p_value > chosen.max_p_value or share <= chosen.min_share_in_time:
            continue
        predicted[log] = known
        p_values.append(p_value)
        if duration > longest:  # it tells the period best
            longest, period = duration, own_period
    if not p_values:
        return "time", period, tuple(predicted), 0.0, 1.0
    square = sum(float((part**2).sum()) for part in residual)
    gain = sum(
        float((known * (2 * part - known)).sum())
        for part, known in zip(residual, predicted, strict=True)
    )
    p_value = min(1.0, len(samples) * min(p_values))
    return "time", period, tuple(predicted), gain / max(square, 1e-300), p_value


def _without_constants(
    mechanism: Mechanism,
    one: _Scanned,
    residual: Sequence[Array],
    samples: Sequence[Samples],
    settings: FitSettings,
) -> list[Array]:
    """The residual (n, A) of each log without a constant force in each pattern.

    A slope is one: on a way through a room a wave may imitate it.
    """
    columns = _columns(mechanism, one, 0.0, samples, residual, settings)
    joined = np.concatenate(residual)
    weights, _ = _fitted(columns, joined)
    edges = np.cumsum([len(part) for part in residual])[:-1]
    return np.split(joined - columns @ weights, edges)


def _scores(
    mechanism: Mechanism,
    one: _Scanned,
    residual: Sequence[Array],
    stretches: Sequence[Indices],
    samples: Sequence[Samples],
    settings: FitSettings,
) -> Array:
    """(folds, K) squares that each wave explains of the stretches outside of a fold, nearly.

    The filter is put on the residual, backwards in time, in the place of each of the many waves:
    sums of products are the same. The size of a filtered wave follows from its rate.
    """
    chosen, numbers = settings.harmonic_scan, one.wave_numbers
    score = np.zeros((chosen.folds * len(mechanism.axes), len(numbers)), complex)
    size = np.zeros(len(numbers))
    pieces = np.array_split(numbers, -(-len(numbers) // chosen.waves_at_once))
    for log, (values, item) in enumerate(zip(one.values, samples, strict=True)):
        thin = max(1, round(1.0 / (chosen.sample_rate * item.dt)))
        of_part = partial(
            _scores_of_part, mechanism, one, residual[log], stretches[log], log, thin, settings
        )
        for part in side_by_side(partial(of_part, item), _parts(len(item), thin, settings)):
            score += part
        # Of the size, a mean over the motion, a part of the samples is enough.
        sparse = thin * chosen.samples_for_size
        rate = np.gradient(values, item.dt)[::sparse] / mechanism.filter_rate
        size += np.concatenate(
            [sparse * (1.0 / (1.0 + np.outer(rate, piece) ** 2)).sum(axis=0) for piece in pieces]
        )
    by_fold = score.reshape(chosen.folds, len(mechanism.axes), -1)
    others = by_fold.sum(axis=0) - by_fold
    return (np.abs(others) ** 2).sum(axis=1) / np.maximum(size, 1e-300)


def _parts(count: int, thin: int, settings: FitSettings) -> list[tuple[int, int]]:
    """First and last sample of the parts of a log, which begin at samples that stay if thinned."""
    size = max(1, settings.max_part_samples // thin) * thin
    return [(begin, min(begin + size, count)) for begin in range(0, count, size)]


def _scores_of_part(
    mechanism: Mechanism,
    one: _Scanned,
    residual: Array,
    stretch: Indices,
    log: int,
    thin: int,
    settings: FitSettings,
    item: Samples,
    part: tuple[int, int],
) -> Array:
    """(folds A, K) what a part of a log adds to the products of its residual with each wave."""
    chosen, numbers = settings.harmonic_scan, one.wave_numbers
    inside = (stretch % chosen.folds)[:, None] == np.arange(chosen.folds)
    rows = np.where(inside[..., None], residual[:, None, :], 0.0)
    reduce = settings.rows_of(mechanism.filter_rate, item.dt)
    margin = settled(reduce.rate, item.dt, settings.part_margin_time_constants)
    back = reduce.adjoint(rows, len(item), part, margin)[::thin]
    values = one.values[log][slice(*part)][::thin]
    heading = one.headings[log][slice(*part)][::thin] if one.headings else None
    weights = np.einsum("nfa,nag->fgn", back, turned_axes(heading, *back.shape[::2]))
    weights = weights.reshape(-1, len(values)).astype(np.float32)
    score = np.zeros((len(weights), len(numbers)), complex)
    pieces = -(-len(numbers) // chosen.waves_at_once)
    for chunk in np.array_split(np.arange(len(numbers)), pieces):
        turns = np.outer(values, numbers[chunk] / (2 * np.pi))
        # Whole turns are taken off: they would cost digits in single precision, which is enough
        # for the choice of a wave and ten times as fast.
        phase = (2 * np.pi * (turns - np.rint(turns))).astype(np.float32)
        score[:, chunk] = thin * (weights @ np.cos(phase) + 1j * (weights @ np.sin(phase)))
    return score


def turned_axes(heading: Array | None, count: int, axes: int) -> Array:
    """(N, A, A) forces along the axes of the body, or with headings (N,) along those of the world.

    The first two axes of these turn.
    """
    found = np.array(np.broadcast_to(np.eye(axes), (count, axes, axes)))
    if heading is not None:
        c, s = np.cos(heading), np.sin(heading)
        found[:, 0, 0], found[:, 1, 0] = c, -s
        found[:, 0, 1], found[:, 1, 1] = s, c
    return found


def _columns(
    mechanism: Mechanism,
    one: _Scanned,
    number: float,
    samples: Sequence[Samples],
    residual: Sequence[Array],
    settings: FitSettings,
) -> Array:
    """(all rows, A, 2 A) cosine and sine of a wave along each axis, as filtered rows.

    Only what differs is filtered: the same wave acts along all axes of the body.
    """

    def ends_of(log: int, begin: int, end: int) -> Ends:
        phase = number * one.values[log][begin:end]
        waves = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        if one.headings:
            heading = one.headings[log][begin:end, None]
            waves = np.concatenate([waves, np.cos(heading) * waves, np.sin(heading) * waves], 1)
        return at_both_ends(waves)

    found, axes = [], len(mechanism.axes)
    for log, item in enumerate(samples):
        reduce = settings.rows_of(mechanism.filter_rate, item.dt)
        rows = rows_in_parts(partial(ends_of, log), len(item), item.moves, reduce, settings)
        rows = rows[: len(residual[log])].reshape(-1, rows.shape[1] // 2, 2)
        columns = np.zeros((len(rows), axes, axes, 2))
        for axis in range(axes):
            columns[:, axis, axis] = rows[:, 0]
        if one.headings:
            columns[:, 0, 0], columns[:, 1, 0] = rows[:, 1], -rows[:, 2]
            columns[:, 0, 1], columns[:, 1, 1] = rows[:, 2], rows[:, 1]
        found.append(columns.reshape(len(rows), axes, 2 * axes))
    return np.concatenate(found)


def _fitted(columns: Array, residual: Array) -> tuple[Array, float]:
    """Least squares (C,) of rows (n, A) by columns (n, A, C), and the squares they explain."""
    flat = columns.reshape(-1, columns.shape[-1])
    gram, side = flat.T @ flat, flat.T @ residual.ravel()
    weights = np.linalg.pinv(gram, rcond=1e-8, hermitian=True) @ side
    return weights, float(side @ weights)
