"""Is there anything left that can be predicted? The test of what a model leaves, and its noise.

A model is adequate if what it leaves is noise: if nothing that was logged predicts it. This holds
for noise of any colour, where a comparison with a level of white noise does not. Extremely
randomised trees (Geurts, Ernst and Wehenkel, Machine Learning 63, 2006) predict the filtered
residual on stretches of time that they have not seen, from speeds, their signs, accelerations,
heading, place, wheel angles, time and log. Measured torques are left out: the residual holds their
noise, so they would predict it always. What trees cannot learn, a force that repeats over a place
or a wheel's angle, a scan over periods sees: :mod:`identification.fitting.harmonic_scan`.

What nothing predicts is the noise floor: the error that no model of the motion can go below. The
same noise, acting as a force, and white noise on the measured speeds make the free run's.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from identification.fitting.changing_laws import Rows, changing_law
from identification.fitting.coarse_channels import are_coarse, measured_again
from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    Traces,
    add_up,
    squares_of,
    velocity_traces,
)
from identification.fitting.harmonic_scan import all_of, harmonic_scan, turned_axes
from identification.fitting.regression import Regression, regression, rows_by_parts
from identification.fitting.repeated_periods import repeated_noise
from identification.fitting.settings import (
    ChangingLawSettings,
    FitSettings,
    PredictabilitySettings,
)
from identification.fitting.shared_times import likeness
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, cut
from identification.mechanisms.standstill import held_rows
from identification.signals.filters import Ends, at_both_ends
from identification.signals.resampling import smoothed
from identification.threads import side_by_side

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Predictability:
    """What of a residual can be predicted from the motion, on stretches that were held out.

    Attributes
    ----------
    residual, predicted : per log (n, A), rows of the filtered force residual
    time : per log (n,), end of each row [s], from the log's start
    step : per log, from one row to the next [s]
    wander : share that a drift in time alone predicts, whatever the motion; 0 where it is so small
        beside ``share`` that it makes no difference
    measuring : share that coarse channels alone may make predictable, were the model true
    held : per log (n,) rows in which a joint stands, or has stood within the filter's memory: dry
        friction holds it by a force that nothing tells. Empty where that is not known
    settings : of these the share up to which a residual counts as noise
    """

    residual: tuple[Array, ...]
    predicted: tuple[Array, ...]
    time: tuple[Array, ...]
    step: tuple[float, ...]
    wander: float
    settings: PredictabilitySettings
    measuring: float = 0.0
    held: tuple[NDArray[np.bool_], ...] = ()

    @property
    def share(self) -> float:
        """Share of the residual's squares that is predicted; of noise it is below zero."""
        total = sum(float((r**2).sum()) for r in self.residual)
        left = sum(float((e**2).sum()) for e in self.unpredicted)
        return 1.0 - left / total if total > 0 else 0.0

    @property
    def duration(self) -> float:
        """What the rows last together [s]."""
        parts = zip(self.residual, self.step, strict=True)
        return sum(len(rows) * step for rows, step in parts)

    @property
    def is_short(self) -> bool:
        """Whether the rows are too few to tell whether anything is left."""
        return self.duration < self.settings.shortest

    @property
    def share_of_motion(self) -> float:
        """The share without what coarse channels alone make predictable."""
        return self.share - self.measuring

    @property
    def is_noise(self) -> bool:
        """Whether nothing is left that the motion predicts, and nothing happens at times only."""
        return not self.is_predicted and not self.is_episodic

    @property
    def is_predicted(self) -> bool:
        """Whether the motion predicts more than noise would let it."""
        # A sensor's offset that wanders is noise: its neighbours in time tell it, no motion does.
        # So is what counts and other steps hide.
        return self.share_of_motion - self.wander > self.settings.max_noise_share

    @property
    def is_episodic(self) -> bool:
        """Whether the residual is large at times and small at most others: a bump, a contact.

        Such a thing happens too seldom to be learnt elsewhere, but noise is not like that.
        """
        return self.mean_over_median > self.settings.max_mean_over_median

    @property
    def systematic_share(self) -> float:
        """Share of the residual's squares that is no noise."""
        if self.is_noise:
            return 0.0
        episodes = 1.0 - 1.0 / self.mean_over_median if self.is_episodic else 0.0
        return max(self.share_of_motion, episodes)

    @property
    def episodes(self) -> list[tuple[int, float, float]]:
        """Log, start and end [s] of stretches of an episodic residual, the largest first."""
        found: list[tuple[float, int, float, float]] = []
        for log, (time, square) in enumerate(zip(self.time, self._blocks, strict=True)):
            block, loud = self._block_of(log), np.flatnonzero(self._is_loud(log))
            # Neighbouring blocks are one stretch.
            for part in np.split(loud, np.flatnonzero(np.diff(loud) > 1) + 1):
                if part.size:
                    inside = time[(block >= part[0]) & (block <= part[-1])]
                    start = float(inside[0]) - self.step[log]
                    found.append((float(square[part].sum()), log, start, float(inside[-1])))
        return [(log, start, end) for _, log, start, end in sorted(found, reverse=True)]

    def _block_of(self, log: int) -> Indices:
        """(n,) block that each row is in; the last one takes what fills no other."""
        size = _rows_in(self.settings.episode_duration, self.step[log])
        rows = len(self.residual[log])
        return np.minimum(np.arange(rows) // size, max(rows // size - 1, 0))

    @cached_property
    def _blocks(self) -> list[Array]:
        """Per log, the mean square in blocks of time, all axes together; zero where all rests."""
        found = []
        for log, residual in enumerate(self.residual):
            block, square = self._block_of(log), (residual**2).sum(axis=1)
            if self.held:
                square = square * ~self.held[log]
            # Rows in which the mechanism rests are zero and tell nothing of the noise.
            rows = np.bincount(block, square > 0)
            found.append(np.bincount(block, square) / np.maximum(rows, 1))
        return found

    def _is_loud(self, log: int) -> NDArray[np.bool_]:
        return self._blocks[log] > self.settings.max_mean_over_median * self._median

    @cached_property
    def _median(self) -> float:
        return float(np.median(self._moving_blocks))

    @cached_property
    def _moving_blocks(self) -> Array:
        blocks = np.concatenate(self._blocks)
        return blocks[blocks > 0] if (blocks > 0).any() else blocks

    @property
    def mean_over_median(self) -> float:
        """Of the residual's mean square in blocks of time: 1 of even noise, large of an episode."""
        mean = float(np.mean(self._moving_blocks))
        return mean / max(self._median, 1e-300) if mean > 0 else 1.0

    @property
    def unpredicted(self) -> list[Array]:
        """Per log (n, A): residual less its prediction."""
        return [r - p for r, p in zip(self.residual, self.predicted, strict=True)]

    def predicted_square(self, log: int) -> Array:
        """(A,) mean square of what is no noise in one log; zero where all is noise."""
        residual, noise = self.residual[log], self.noise(log)
        return np.maximum((residual**2).mean(axis=0) - (noise**2).mean(axis=0), 0.0)

    def noise(self, log: int) -> Array:
        """(n, A) rows of one log that count as noise."""
        rows = self.unpredicted[log] if self.is_predicted else self.residual[log]
        if not self.is_episodic:
            return rows
        return rows * ~self._is_loud(log)[self._block_of(log), None]

    @property
    def correlation_time(self) -> float:
        """How long the unpredicted part remembers itself [s]: its integral time scale."""
        times = [step * _integral_scale(self.noise(log)) for log, step in enumerate(self.step)]
        return float(np.mean(times))

    @property
    def noise_std(self) -> float:
        """Relative standard error of the noise's rms, from its spread over blocks of all logs."""
        blocks = []
        for log, step in enumerate(self.step):
            square = (self.noise(log) ** 2).sum(axis=1)
            size = _rows_in(self.settings.noise_block_duration, step)
            blocks += [part.mean() for part in np.array_split(square, max(1, len(square) // size))]
        mean = float(np.mean(blocks))
        if len(blocks) < 2 or mean <= 0:
            return 0.0
        # Half: the relative error of a root is half that of its square.
        return 0.5 * float(np.std(blocks, ddof=1)) / mean / np.sqrt(len(blocks))


def too_short(found: Predictability) -> str:
    """What to say of logs that are too short to tell whether anything is missing."""
    return (
        f"too short to tell whether anything is missing: the logs hold {found.duration:.2g} s, and "
        f"{found.settings.shortest:.2g} s are the least; a minute is better"
    )


def predictability(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    seed: int = 0,
    settings: FitSettings = FitSettings(),
    theta: Array | None = None,
) -> Predictability:
    """Predict the residual rows of a fit from the motion, each stretch from all others.

    Parameters
    ----------
    rows : per log, of the fit on these samples with these settings
    seed : of the trees, and of which stretches are held out together
    theta : (P,) of the fit; with it, what coarse channels alone make predictable is told
    """
    found = _predictability(mechanism, rows, samples, seed, settings)
    chosen = settings.predictability
    if theta is None or found.is_noise or not are_coarse(samples, chosen):
        return found
    again = measured_again(mechanism, theta, samples, seed, chosen)
    if again is None:
        return found
    free = np.flatnonzero(mechanism.free)
    null = [regression(mechanism, theta, item, free, settings) for item in again]
    alone = _predictability(mechanism, null, again, seed, settings)
    square = [sum(float((r**2).sum()) for r in part.residual) for part in (alone, found)]
    measuring = chosen.measuring_margin * max(alone.share, 0.0)
    return replace(found, measuring=measuring * square[0] / square[1])


def _predictability(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    seed: int,
    settings: FitSettings,
) -> Predictability:
    chosen = settings.predictability
    thin = max(1, -(-sum(len(row.residual) for row in rows) // chosen.max_rows))
    residual = [row.residual[::thin] for row in rows]
    features = list(_all_features(mechanism, rows, samples, thin, settings))
    whole = sum(len(row.residual) * row.step for row in rows)
    stretch_of = _stretches(rows, thin, chosen.stretch_in(whole))
    fold_of = _dealt(stretch_of, seed, chosen.folds)
    joined = np.concatenate(residual)
    all_features = np.concatenate(features)
    predicted = _held_out(all_features, joined, fold_of, seed, settings)
    edges = np.cumsum([len(part) for part in residual])[:-1]
    found = Predictability(
        tuple(residual),
        tuple(np.split(predicted, edges)),
        tuple(row.time[::thin] for row in rows),
        tuple(thin * row.step for row in rows),
        0.0,
        chosen,
        held=_held(mechanism, rows, samples, thin, settings),
    )
    if found.share > chosen.max_noise_share:
        # Of coarse channels each part matters: they may account for the rest of it.
        ignored = 0.0 if are_coarse(samples, chosen) else found.share - chosen.max_noise_share
        is_shared = partial(_are_alike, mechanism, found, samples, settings)
        wander = _wander(all_features, joined, fold_of, seed, settings, ignored, is_shared)
        found = replace(found, wander=wander)
    known = Rows(
        *(joined, np.concatenate([row.columns[::thin] for row in rows])),
        *(_speeds_and_accelerations(all_features, joined.shape[1]), np.concatenate(found.time)),
        *(all_features[:, -1].astype(np.intp), stretch_of, fold_of),
    )
    found = _with_law(found, known, edges, settings.changing_law)
    if found.is_predicted and found.share >= chosen.max_share_with_waves:
        return found
    waves = harmonic_scan(mechanism, [row.residual for row in rows], samples, settings)
    if not waves or not waves[0].is_seen(settings.harmonic_scan):
        return found
    predicted = tuple(part[::thin] for part in waves[0].predicted)
    periodic = replace(found, predicted=predicted, wander=0.0)
    return periodic if periodic.is_predicted and periodic.share > found.share else found


def _held(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    thin: int,
    settings: FitSettings,
) -> tuple[NDArray[np.bool_], ...]:
    """Per log (n,) rows in which a joint stands; none, where that is most of them."""
    memory, found = settings.filter.settling_time_constants / mechanism.filter_rate, []
    for row, item in zip(rows, samples, strict=True):
        stands = held_rows(item.wheel_speed, item.dt, mechanism.settings)
        count = np.concatenate([[0], np.cumsum(stands)])
        time = row.time[::thin]
        first, last = (
            np.searchsorted(item.time, at) for at in (time - thin * row.step - memory, time)
        )
        found.append(count[last] > count[first])
    # In a motion in which two wheels stand all the time they tell what there is to tell.
    total = sum(map(len, found))
    most = sum(int(part.sum()) for part in found) > settings.predictability.max_held_share * total
    return () if most else tuple(found)


def _with_law(
    found: Predictability, rows: Rows, edges: Indices, settings: ChangingLawSettings
) -> Predictability:
    """What is found, if a linear law that may change at an instant predicts no part of the rows.

    With it, what predicts the most of them, and no wander: an offset follows no motion.
    """
    law = changing_law(rows, settings)
    if law.p_value > settings.max_p_value or law.share <= settings.min_share:
        return found
    of_law = replace(found, predicted=tuple(np.split(law.predicted, edges)), wander=0.0)
    if not of_law.is_predicted:
        return found
    return max(replace(found, wander=0.0), of_law, key=lambda one: one.share)


def _are_alike(
    mechanism: Mechanism, found: Predictability, samples: Sequence[Samples], settings: FitSettings
) -> bool:
    """Whether the same is left at the same time of each log, on board or along the world."""
    forces, chosen = [list(found.residual)], settings.predictability
    headings = all_of(mechanism, samples, settings, lambda one: one.heading)
    if headings is not None:
        turned = []
        for row, time, item, heading in zip(
            *(found.residual, found.time, samples, headings), strict=True
        ):
            then = np.interp(time, item.time, np.unwrap(heading))
            turned.append(np.einsum("na,nab->nb", row, turned_axes(then, *row.shape)))
        forces.append(turned)
    return any(likeness(force, found.time, chosen).is_shared(chosen) for force in forces)


def _wander(
    features: Array,
    residual: Array,
    fold_of: Indices,
    seed: int,
    settings: FitSettings,
    ignored: float,
    is_shared: Callable[[], bool],
) -> float:
    """Share that time alone predicts beyond a constant of each log, and better than the motion.

    What a slow motion explains, time explains too: that is no wander. 0 too where time predicts no
    more than ``ignored``, a share that makes no difference: trees on the motion take long.

    ``is_shared``: whether the logs do the same at the same times, as no wander does
    """

    def share(chosen: Array) -> float:
        predicted = _held_out(chosen, residual, fold_of, seed, settings)
        return 1.0 - float(((residual - predicted) ** 2).sum() / (residual**2).sum())

    by_time = share(features[:, -TIMES:])
    if by_time < ignored or by_time <= 0 or share(features[:, :-TIMES]) >= by_time:
        return 0.0
    # A constant of each log is no drift: a slope, say, or an offset.
    drift = max(by_time - max(share(features[:, -1:]), 0.0), 0.0)
    return 0.0 if drift > 0 and is_shared() else drift


def _speeds_and_accelerations(features: Array, axes: int) -> Array:
    """(n, 2 A) of the features: the first ones, and the last ones that are of the motion."""
    return np.concatenate([features[:, :axes], features[:, -TIMES - axes : -TIMES]], axis=1)


TIMES = 3
"""Features at the end of each row that are no motion: time, time over all logs, and the log."""


def _stretches(rows: Sequence[Regression], thin: int, duration: float) -> Indices:
    """(all rows,) the stretch of time that each is in, counted over all logs."""
    stretches, first = [np.zeros(0, np.intp)], 0
    for row in rows:
        count = len(row.residual[::thin])
        of_log = (np.arange(count) * thin * row.step // duration).astype(np.intp)
        stretches.append(first + of_log)
        first += int(of_log[-1]) + 1 if count else 0
    return np.concatenate(stretches)


def _dealt(stretch_of: Indices, seed: int, folds: int) -> Indices:
    """(all rows,) which rows are held out together: whole stretches, dealt at random."""
    count = int(stretch_of.max(initial=-1)) + 1
    return (np.random.default_rng(seed).permutation(count) % folds)[stretch_of]


def _held_out(
    features: Array, residual: Array, fold_of: Indices, seed: int, settings: FitSettings
) -> Array:
    """(rows, A) the residual of each fold, predicted by trees grown on the others."""
    # All axes weigh alike; an axis without a residual stays at zero.
    scale = np.maximum(residual.std(axis=0), 1e-300)
    work = partial(_predict_fold, features, residual / scale, fold_of, seed, settings)
    predicted = np.zeros_like(residual)
    folds = [k for k in range(settings.predictability.folds) if 0 < (fold_of == k).sum()]
    if len(folds) < 2:  # less than two stretches: nothing can be held out
        return predicted
    for k, part in zip(folds, side_by_side(work, folds), strict=True):
        predicted[fold_of == k] = part * scale
    return predicted


def _predict_fold(
    features: Array,
    residual: Array,
    fold_of: Indices,
    seed: int,
    settings: FitSettings,
    fold: int,
) -> Array:
    # Imported here: it takes half a second, and a fit does without.
    from sklearn import config_context
    from sklearn.tree import ExtraTreeRegressor

    chosen, held = settings.predictability, fold_of == fold
    known, given = residual[~held], features[~held].astype(np.float32)
    asked = features[held].astype(np.float32)
    draws = np.random.RandomState(seed)
    found = np.zeros((len(asked), residual.shape[1]))
    # A thousand trees have the same settings: to check those each time takes a tenth of the time.
    with config_context(skip_parameter_validation=True):
        # One tree after another: scikit-learn's forest passes the filters of warnings to each tree,
        # and these are shared by all threads, so that folds side by side disturb each other.
        for _ in range(chosen.trees):
            tree = ExtraTreeRegressor(
                min_samples_leaf=chosen.min_rows_of_leaf,
                max_features=chosen.share_of_features,
                random_state=draws.randint(np.iinfo(np.int32).max),
            )
            # Of one axis a vector: scikit-learn warns of a matrix with one column. That all is
            # finite and of the type of trees is known: to look again takes an eighth of the time.
            tree.fit(given, known[:, 0] if known.shape[1] == 1 else known, check_input=False)
            found += tree.predict(asked, check_input=False).reshape(found.shape)
    return found / chosen.trees


def _all_features(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    samples: Sequence[Samples],
    thin: int,
    settings: FitSettings,
) -> Iterator[Array]:
    """Per log (n, Q): what may predict its rows, with the log's number and a time for all logs."""
    typical = _typical_rates(mechanism, samples, settings)
    start = 0.0
    for number, (row, item) in enumerate(zip(rows, samples, strict=True)):
        known = _motion_features(mechanism, item, typical, settings)[::thin]
        time = row.time[::thin]
        log = np.full(len(time), float(number))
        yield np.column_stack([known[: len(time)], time, start + time, log])
        start += float(item.time[-1])


def _typical_rates(
    mechanism: Mechanism, samples: Sequence[Samples], settings: FitSettings
) -> Array:
    """(K,) rms of the rates at which surfaces slide, over all logs."""
    squares = np.zeros(1)
    for item in samples:
        # Some at a time: there are more rates than channels in a log.
        for begin in range(0, len(item), settings.max_part_samples):
            part = cut(item, begin, begin + settings.max_part_samples)
            squares = squares + (mechanism.variables(part).rates ** 2).sum(axis=0)
    return np.maximum(np.sqrt(squares / sum(map(len, samples))), 1e-300)


def _motion_features(
    mechanism: Mechanism, samples: Samples, typical: Array, settings: FitSettings
) -> Array:
    """(n, Q) of one log, with the filter and the means of the residual's rows."""

    def ends_of(part: Samples) -> Ends:
        return at_both_ends(_motion_signals(mechanism, part, typical, settings))

    return rows_by_parts(ends_of, mechanism, samples, settings)


def _motion_signals(
    mechanism: Mechanism, samples: Samples, typical: Array, settings: FitSettings
) -> Array:
    """(N, Q) of samples."""
    chosen, known = settings.predictability, mechanism.variables(samples)
    signals = [known.twist, known.rates, known.position]
    signals.append(np.tanh(known.rates / (chosen.sign_width * typical)))
    if known.speed is not None:
        signals.append(known.speed)
    if known.heading is not None:
        signals.append(np.column_stack([known.heading, np.sin(known.heading)]))
        signals.append(np.cos(known.heading)[:, None])
    if known.angle is not None:
        signals += [np.sin(known.angle), np.cos(known.angle)]
    joined = np.column_stack(signals)
    # The mean over some rows: noise of the speeds is in the residual too, through the
    # acceleration, and would predict it; its difference has next to no mean.
    sigma = chosen.acceleration_smoothing_time / samples.dt
    acceleration = np.asarray(np.gradient(known.twist, samples.dt, axis=0))
    slopes = [smoothed(acceleration[:, k], sigma) for k in range(acceleration.shape[1])]
    return np.column_stack([joined, *slopes])


def _rows_in(duration: float, step: float) -> int:
    """Rows, ``step`` [s] apart, in a duration [s]; at least one."""
    return max(1, round(duration / step))


def _integral_scale(signal: Array) -> float:
    """Integral of the autocorrelation of (n, A) up to its first zero, in rows."""
    centred = signal - signal.mean(axis=0)
    size = 2 * len(centred)
    power = (np.abs(np.fft.rfft(centred, size, axis=0)) ** 2).sum(axis=1)
    correlation = np.fft.irfft(power, size)[: len(centred)]
    if correlation[0] <= 0:
        return 0.0
    correlation = correlation / correlation[0]
    zeros = np.flatnonzero(correlation <= 0)
    end = zeros[0] if zeros.size else len(correlation)
    return float(0.5 + correlation[1:end].sum())


@dataclass(frozen=True)
class NoiseFloor:
    """Sums of squares, per log, that noise leaves.

    Attributes
    ----------
    force, velocity : of the force residual and of the free run's; velocity may be empty
    relative_std : standard error of the force floor, as a share of it
    correlation_time : how long the noise on the filtered forces remembers itself [s]
    """

    force: tuple[SumsOfSquares, ...]
    velocity: tuple[SumsOfSquares, ...]
    relative_std: float
    correlation_time: float

    def to_dict(self) -> dict[str, float]:
        """JSON form: both errors over all logs, the first with its uncertainty and colour."""
        force = add_up(self.force).ratio
        found = {"force_error": force}
        if self.velocity:
            found["velocity_error"] = add_up(self.velocity).ratio
        return found | {
            "force_error_std": force * self.relative_std,
            "correlation_time": self.correlation_time,
        }


def noise_floor(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    rows: Sequence[Regression],
    found: Predictability,
    traces: Sequence[Traces],
    runs: Sequence[Traces] = (),
    noise: Sequence[NoiseLevel] = (),
    seed: int = 0,
    settings: FitSettings = FitSettings(),
    elsewhere: Sequence[Array] = (),
) -> NoiseFloor:
    """Noise floor of a fit on the logs that it was made on.

    Parameters
    ----------
    theta, rows : of the fit
    found : what of the rows' residual can be predicted
    traces : force residuals of a model on the same logs (of the fit or another), per log
    runs, noise : of each log its free run and the white noise on its speeds; none for forces alone
    elsewhere : per log (A,) mean square of the noise on its forces as other logs of the robot show
        it; limits, where no motion repeats, what the trees leave of a large residual
    """
    forces = noise_of_forces(mechanism, samples, found, traces, settings, elsewhere)
    velocity = velocity_floors(mechanism, theta, samples, rows, forces, runs, noise, seed)
    return NoiseFloor(forces.squares, velocity, found.noise_std, found.correlation_time)


@dataclass(frozen=True)
class NoiseOfForces:
    """What of the force residual of some logs is noise.

    squares : per log, the sums of squares that it leaves
    rows : per log (n, A), what counts as noise of its rows
    """

    squares: tuple[SumsOfSquares, ...]
    rows: tuple[Array, ...]


def noise_of_forces(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    found: Predictability,
    traces: Sequence[Traces],
    settings: FitSettings,
    elsewhere: Sequence[Array] = (),
) -> NoiseOfForces:
    """The part of :func:`noise_floor` that needs the traces of the forces."""
    repeated = _repeated_square(mechanism, samples, traces, settings.predictability)
    if elsewhere and not np.isfinite(repeated).all():
        limits = list(elsewhere)
    else:
        limits = [repeated] * len(traces)
    squares, noise = list[SumsOfSquares](), list[Array]()
    for k, most in enumerate(limits):
        residual, predicted = found.residual[k], found.predicted_square(k)
        squares.append(force_floor(traces[k], residual, predicted, most))
        # Of what the trees leave, no more is noise in the free run than in the forces.
        left = force_floor(traces[k], residual, predicted, np.full(len(most), np.inf)).residual
        share = np.sqrt(squares[k].residual / np.maximum(left, 1e-300))
        noise.append(share * found.noise(k))
    return NoiseOfForces(tuple(squares), tuple(noise))


def velocity_floors(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    rows: Sequence[Regression],
    forces: NoiseOfForces,
    runs: Sequence[Traces],
    noise: Sequence[NoiseLevel],
    seed: int,
) -> tuple[SumsOfSquares, ...]:
    """The part of :func:`noise_floor` that needs the free runs: none where these are missing."""
    found = list[SumsOfSquares]()
    for item, row, part, run, level in zip(samples, rows, forces.rows, runs, noise, strict=False):
        if not np.isfinite(run.predicted).all():
            # A run that diverges has no floor.
            found.append(SumsOfSquares.of(run))
            continue
        disturbed = disturbed_torque(mechanism, item, row, part)
        found.append(velocity_floor(mechanism, theta, item, disturbed, run, level, seed))
    return tuple(found)


def _repeated_square(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    traces: Sequence[Traces],
    settings: PredictabilitySettings,
) -> Array:
    """(A,) mean square of what does not repeat, over all logs; infinite where nothing repeats."""
    total, count = np.zeros(len(mechanism.axes)), 0
    for item, trace in zip(samples, traces, strict=True):
        speed = mechanism.measured_speed(item)[-len(trace.time) :]
        parts = [(part.start, part.end) for part in mechanism.parts(item)]
        forces = (trace.measured, trace.predicted)
        square, found = repeated_noise(trace.time, speed, forces, parts, settings)
        total, count = total + square, count + found
    return total / count if count else np.full(len(total), np.inf)


def force_floor(
    traces: Traces, residual: Array, predicted_square: Array, repeated_square: Array
) -> SumsOfSquares:
    """Squares of a fit's force residual that are noise: neither predicted nor repeated.

    Parameters
    ----------
    traces : of the fit, at every sample
    residual : (n, A) rows of its regression
    predicted_square : (A,) mean square of what is predicted of the rows; zero if all is noise
    repeated_square : (A,) mean square of what does not repeat
    """
    squares = SumsOfSquares.of(traces)
    # Means over a row take noise away and hardly any of what the motion makes; a faster filter
    # than that of the traces lets more of both through. The larger of the two is the measure.
    of_rows = np.maximum((residual**2).mean(axis=0), 1e-300)
    of_traces = squares.residual / len(traces.time)
    share = np.minimum(predicted_square / np.maximum(of_rows, of_traces), 1.0)
    noise = of_traces * (1.0 - share)
    if predicted_square.any():
        # Of a large residual the trees leave some that is no noise: periods tell how much.
        noise = np.minimum(noise, repeated_square)
    return SumsOfSquares(noise * len(traces.time), squares.measured)


def disturbed_torque(
    mechanism: Mechanism, samples: Samples, row: Regression, noise: Array
) -> Callable[[slice], Array]:
    """The torques (n, J) of some samples with noise of the filtered forces put on once more.

    The noise (n, A) stands at rows of the regression, or at each j-th of them.
    """
    thin = max(1, round(len(row.time) / len(noise)))
    time = row.time[::thin][: len(noise)] - 0.5 * row.step
    # The filter undone: f = f_f + f_f' / a_f. What is faster than a row is lost; it would hardly
    # move a speed, which integrates forces.
    force = noise + np.gradient(noise, thin * row.step, axis=0) / mechanism.filter_rate

    def torque(some: slice) -> Array:
        at = samples.time[some]
        added = [np.interp(at, time, axis, left=0.0, right=0.0) for axis in force.T]
        return samples.torque[some] + mechanism.joint_torque(np.column_stack(added))

    return torque


def velocity_floor(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    disturbed: Callable[[slice], Array],
    clean: Traces,
    noise: NoiseLevel,
    seed: int,
) -> SumsOfSquares:
    """What noise leaves in the free run's velocity residual: by putting it on once more.

    Parameters
    ----------
    disturbed : torques that carry the noise on the forces twice, see `disturbed_torque`
    clean : the free run of the samples as they were logged
    noise : white noise, of which that on the speeds is put on here
    """
    square = np.zeros(len(mechanism.axes))
    for rows, left in _noisy_run(mechanism, theta, samples, noise, disturbed, seed):
        square = square + squares_of(left - (clean.measured[rows] - clean.predicted[rows]))
    return SumsOfSquares(square, squares_of(clean.measured))


def _noisy_run(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    noise: NoiseLevel,
    torque: Callable[[slice], Array],
    seed: int,
) -> Iterator[tuple[slice, Array]]:
    """Rows of samples with noise, and how far the free run is from the speeds there (n, A)."""
    rng = np.random.default_rng(seed)

    def noisy(rows: slice) -> Samples:
        part = cut(samples, *rows.indices(len(samples))[:2])
        return mechanism.speed_noise(part, noise.speed, rng).on(part, 0)

    if mechanism.structure.changes_kinematics:
        # What the logged speeds tell of the motion depends on the whole log.
        again = replace(noisy(slice(None)), torque=torque(slice(None)))
        yield slice(None), velocity_traces(mechanism, theta, again).residual
        return
    first, *others = mechanism.rows_of_free_run(theta, samples)
    start = noisy(first)
    parts = itertools.chain([start], map(noisy, others))
    run = mechanism.pieces_of_free_run(theta, samples, torque, start)
    for (rows, twist), part in zip(run, parts, strict=True):
        yield rows, mechanism.measured_speed(part) - twist * mechanism.speed_scale
