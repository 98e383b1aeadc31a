"""What a diagnosis compares: structures fitted to the same logs, and candidates on top of them.

A structure is a mechanism with given effects. Each is judged by its held-out squares: those of the
force residual on what it was not fitted on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.clocks import (
    first_placed_on_clock,
    has_own_clock,
    placed_on_clock,
)
from identification.fitting.coarse_channels import are_coarse, measured_again
from identification.fitting.cross_validation import (
    CrossValidation,
    Fold,
    block_sums,
    cross_validate,
    make_folds,
)
from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    Traces,
    add_up,
    force_traces,
    velocity_traces,
    white_force_floor,
)
from identification.fitting.gauge import gauge_basis
from identification.fitting.held_channels import logs_to_fit
from identification.fitting.lasting_noise import lasting_noise, torque_noise
from identification.fitting.predictability import (
    NoiseFloor,
    Predictability,
    noise_floor,
    predictability,
)
from identification.fitting.regression import (
    Indices,
    Regression,
    acting_share,
    filtered_residual,
    regression,
    regressions,
)
from identification.fitting.span import Span, stacked
from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import DemandedForce, Samples, cut
from youbot_env.errors import InputError
from youbot_env.physics.effect import effect_of

Array = NDArray[np.float64]


def visible_directions(mechanism: Mechanism, free: Indices) -> Array:
    """(F, Q) directions of the parameters ``free`` that data can see, in their own units."""
    return gauge_basis(mechanism, free) / mechanism.scale[free][:, None]


@dataclass(frozen=True)
class FittedStructure:
    """A structure at fitted parameters theta, with its rows: what candidates are added to.

    free : (F,) indices of the parameters that were fitted; basis : (F, Q) their directions that
        data can see
    """

    mechanism: Mechanism
    theta: Array
    rows: tuple[Regression, ...]
    free: Indices
    basis: Array
    samples: tuple[Samples, ...]
    settings: DiagnosisSettings

    @classmethod
    def at(
        cls,
        mechanism: Mechanism,
        theta: Array,
        samples: Sequence[Samples],
        free: Indices,
        settings: DiagnosisSettings,
    ) -> FittedStructure:
        """Rows of all logs at theta."""
        rows = regressions(mechanism, theta, samples, free, settings.rows)
        basis = visible_directions(mechanism, free)
        return cls(mechanism, theta, tuple(rows), free, basis, tuple(samples), settings)

    @property
    def is_in_parts(self) -> bool:
        """Whether rows of a log are made in parts: all that is known of an hour takes gigabytes."""
        return any(len(item) > self.settings.rows.max_part_samples for item in self.samples)

    @cached_property
    def demands(self) -> tuple[DemandedForce | None, ...]:
        """Demanded force of each log, computed once for all candidates on top of the structure.

        None of logs whose rows are made in parts.
        """
        most = self.settings.rows.max_part_samples
        return tuple(
            self.mechanism.demand(self.theta, item.for_fit) if len(item) <= most else None
            for item in self.samples
        )

    @property
    def residual(self) -> list[Array]:
        """Per log (n, A)."""
        return [row.residual for row in self.rows]

    @property
    def columns(self) -> list[Array]:
        """Per log (n, A, F)."""
        return [row.columns for row in self.rows]

    @property
    def span(self) -> Span:
        """Its columns, stacked: what they explain of others."""
        # Kept for all candidates on top of it, but for an hour's, which take 80 MB.
        return self._made_span() if self.is_in_parts else self._span

    @cached_property
    def _span(self) -> Span:
        return self._made_span()

    def _made_span(self) -> Span:
        return Span(stacked(self.columns), self.settings.min_seen_share)

    @property
    def square(self) -> float:
        """Sum of the squared residuals of all rows."""
        return sum(float((row.residual**2).sum()) for row in self.rows)

    @cached_property
    def acting_share(self) -> float:
        """Squares of the force that its channels let act, over those of the logged one."""
        return acting_share(self.mechanism, self.theta, self.samples)

    @cached_property
    def held_out(self) -> CrossValidation:
        """Cross-validation with the structure's own folds."""
        return self.judged(make_folds(self.rows, self.columns, self.settings.fit))

    def judged(self, folds: Sequence[Fold]) -> CrossValidation:
        """The same with other folds."""
        return cross_validate(self.residual, self.columns, folds, self.basis, self.settings.fit)

    def fold_ratio(self, folds: Sequence[Fold]) -> float:
        """Its held-out squares over those with other folds."""
        own = self.held_out
        return 1.0 if tuple(folds) == own.folds else own.square / self.judged(folds).square

    def noise_square(
        self, noise: Sequence[NoiseLevel], seed: int, with_torques: bool = False
    ) -> float:
        """Squares that noise on the speeds leaves in the residual, by putting it on once more.

        ``with_torques``: noise on the torques too, to compare structures that pass it on
        differently.
        """
        added = self.with_noise(noise, seed, with_torques)
        return sum(float((residual**2).sum()) for _, residual in added)

    def with_noise(
        self, noise: Sequence[NoiseLevel], seed: int, with_torques: bool, lasting: bool = False
    ) -> Iterator[tuple[Samples, Array]]:
        """Per log, its samples with noise put on once more, and what that adds to the residual.

        ``lasting``: noise with the spectrum that the speeds, and the residual, show.
        """
        rng, fit = np.random.default_rng(seed), self.settings.fit
        for item, level, row in zip(self.samples, noise, self.rows, strict=True):
            # Noise on the torques adds the same squares to the residual of every structure, unless
            # a channel takes its share of them: a dead zone lets no noise through.
            torque = level.torque if with_torques else 0.0 * level.torque
            noisy = self.mechanism.noisy(item, level.speed, torque, rng)
            slow = lasting_noise(self.mechanism, item, level, rng, fit) if lasting else None
            if slow is not None:
                noisy = replace(slow.on(item, 0), torque=noisy.torque)
            if lasting and with_torques:
                quiet = replace(noisy, torque=item.torque)
                args = self.mechanism, self.theta, item, quiet, level, rng, fit
                noisy = replace(noisy, torque=item.torque + torque_noise(*args))
            again = filtered_residual(self.mechanism, self.theta, noisy, self.settings.rows)
            yield noisy, again - row.residual


class CandidateRows(NamedTuple):
    """Rows of a candidate's linear step.

    columns : per log (n, A, F) of its own linear parameters
    left : per fold (n, A) what the step leaves of what was held out
    """

    columns: tuple[Array, ...]
    left: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, at one choice of its shape constants, on top of a fitted structure.

    Attributes
    ----------
    free : indices of its own linear parameters and the structure's
    kept : its rows; None where logs are long: those of all candidates would fill half a gigabyte
    held_out : judged by the linear step from the structure, or by its joint fit
    directions : that data can see of its own linear parameters
    fitted : its joint fit, if it was in the lead
    added_noise : squares that noise on the speeds adds to the residual beyond what it adds to the
        structure's
    fold_ratio : the structure's held-out squares over those with the candidate's folds
    lost_fall : part of the fall in held-out squares that the joint fit, within bounds, does not
        confirm
    acting_share : squares of the force that its channels let act, over those that the structure's
        let act
    tried : score blocks of what was tried beside it: each choice of its shape constants on their
        grid, and the effect in some logs only
    again : makes it once more, with its rows
    score : score blocks of its own columns on top of the structure; None: not made yet
    """

    name: str
    mechanism: Mechanism
    theta: Array
    free: Indices
    kept: CandidateRows | None
    held_out: CrossValidation
    shapes: dict[str, float] = field(default_factory=dict)
    directions: int = 0
    fitted: FittedStructure | None = None
    # An actuator lag differentiates the speeds and amplifies their noise. Its squares are corrected
    # for that, or it would lose against effects that leave noise as it is.
    added_noise: float = 0.0
    # Finer folds hold out less at a time and give smaller errors, which is no merit of a candidate.
    fold_ratio: float = 1.0
    # Held-out linear steps ignore bounds and may use a negative inertia.
    lost_fall: float = 0.0
    # A limit under nearly all torques leaves no force to explain, and so hardly any error: what it
    # leaves counts as a share of the force that acts.
    acting_share: float = 1.0
    tried: tuple[Array, ...] = field(default=(), repr=False)
    again: Callable[[], Candidate] | None = field(default=None, repr=False)
    score: Array | None = field(default=None, repr=False)

    @property
    def rows(self) -> CandidateRows:
        """Its rows, made again where they are not kept."""
        if self.kept is not None:
            return self.kept
        assert self.again is not None  # nothing else lets its rows go
        return self.again().rows

    @property
    def columns(self) -> tuple[Array, ...]:
        """Per log (n, A, F) of its own linear parameters."""
        return self.rows.columns

    @property
    def left(self) -> tuple[Array, ...]:
        """Per fold (n, A) what it leaves of what was held out."""
        return self.held_out.residual if self.fitted else self.rows.left

    def without_rows(self) -> Candidate:
        """The same, whose rows are made again each time that they are asked for."""
        return replace(self, kept=None, held_out=replace(self.held_out, residual=()))

    @property
    def in_part(self) -> bool:
        """Whether the effect acts in some of the logs only."""
        return self.name in self.mechanism.acts_in

    @property
    def square(self) -> float:
        """Sum of squared held-out residuals, at the structure's own noise, folds and force."""
        return self.square_with_noise - self.added_noise / self.acting_share + self.lost_fall

    @property
    def square_with_noise(self) -> float:
        """The same at its own noise, as it was measured."""
        return self.ratio * self.held_out.square

    @property
    def ratio(self) -> float:
        """From its squared held-out residuals to those at the structure's own folds and force."""
        return self.fold_ratio / self.acting_share

    @property
    def parameters(self) -> int:
        """Number of parameters that it adds, shape constants included."""
        return self.directions + len(self.shapes)


@dataclass(frozen=True)
class Ranking:
    """All candidates on top of one structure, best first, with those that tie with the best.

    square : held-out squares of the structure itself
    needed : least share of them that an effect must take away to be accepted
    """

    candidates: tuple[Candidate, ...]
    p_values: dict[str, float]
    tied: tuple[str, ...]
    best: Candidate | None
    square: float
    needed: float

    @property
    def is_material(self) -> bool:
        """Whether the best candidate takes away what is needed."""
        return self.fall >= self.needed

    @property
    def fall(self) -> float:
        """Share of the held-out squares that the best candidate takes away."""
        return 0.0 if self.best is None else self.fall_of(self.best)

    def fall_of(self, item: Candidate) -> float:
        """The same for any candidate."""
        return 1.0 - item.square / self.square


@dataclass(frozen=True)
class Step:
    """One structure on the way: the effect accepted last, and held-out errors.

    folds : on which it was judged; fold_thetas : (folds, P) parameters fitted without each
    predict : computes ``predictable``: only the last steps need it
    """

    effect: str | None
    force_error: float
    velocity_error: float
    fitted: FittedStructure
    folds: tuple[Fold, ...]
    fold_thetas: Array
    predict: Callable[[], Predictability] = field(repr=False, compare=False)

    @cached_property
    def predictable(self) -> Predictability:
        """What of its residual the motion can still predict."""
        return self.predict()

    @property
    def logs(self) -> tuple[str, ...]:
        """Names of the logs in which its effect acts; () if it acts in all of them."""
        acts_in = self.fitted.mechanism.acts_in.get(self.effect or "", ())
        return tuple(item.name for item in self.fitted.samples if item.name in acts_in)

    @property
    def errors(self) -> dict[str, float]:
        """Both errors by name."""
        return {"force_error": self.force_error, "velocity_error": self.velocity_error}

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        where = {"logs": list(self.logs)} if self.logs else {}
        return {"effect": self.effect and effect_of(self.effect), **where, **self.errors}


def count_settled(steps: Sequence[Step], settled: Collection[str]) -> int:
    """How many of the first steps are the base, and effects that are settled.

    Those are effects that wheels and pose show: what forces are left says nothing against them.
    """
    return 1 + sum(1 for _ in takewhile(lambda step: step.effect in settled, steps[1:]))


class LoggedData:
    """The logs of a diagnosis: samples, the noise on them, and errors of structures on them.

    Parameters
    ----------
    seed : of the noise that is put on once more, for noise floors
    progress : called after each piece of work
    """

    def __init__(
        self,
        mechanism: Mechanism,
        logs: Sequence[Log],
        seed: int = 0,
        progress: Callable[[], None] = lambda: None,
        settings: DiagnosisSettings = DiagnosisSettings(),
    ) -> None:
        self.samples, self.notes, self.is_long = logs_to_fit(
            *(mechanism, logs, settings.fit),
            most=settings.max_samples,
            least_rate=settings.min_sample_rate,
            purpose="the search for effects takes in minutes",
        )
        self.noise = [NoiseLevel.of(samples, settings.fit) for samples in self.samples]
        self.seed, self.progress, self.settings = seed, progress, settings
        self._ends = time.process_time() + settings.max_search_time
        self._remainders: dict[int, _Remainder] = {}

    @property
    def out_of_time(self) -> bool:
        """Whether the search for effects has taken the time that it may.

        Time of this process on all cores, so that the result does not depend on what else runs.
        """
        return time.process_time() > self._ends

    def measured_again(self, fitted: FittedStructure) -> LoggedData | None:
        """The fitted model's own free runs, measured like the logs; None where nothing is coarse.

        On these nothing is missing from the model, whatever its residual looks like.
        """
        settings = self.settings.fit.predictability
        if not are_coarse(self.samples, settings):
            return None
        args = (fitted.mechanism, fitted.theta, self.samples, self.seed, settings)
        runs = measured_again(*args)
        if runs is None:
            return None
        return self._of(runs)

    def on_clock_of(self, mechanism: Mechanism, theta: Array, *, first: bool = False) -> LoggedData:
        """The same logs, each begun where in its period what swings is best explained.

        ``first``: whether theta does not know the size of what swings yet
        """
        if not has_own_clock(mechanism):
            return self
        place = first_placed_on_clock if first else placed_on_clock
        return self._of(place(mechanism, theta, self.samples, self.settings.fit))

    def _of(self, samples: Sequence[Samples]) -> LoggedData:
        found = copy(self)
        found.samples, found._remainders = samples, {}
        return found

    def step(
        self, fitted: FittedStructure, effect: str | None, folds: Sequence[Fold] | None = None
    ) -> Step:
        """Held-out force and velocity error of a structure; its own folds by default."""
        judged = fitted.judged(folds) if folds else fitted.held_out
        folds = judged.folds
        thetas = np.tile(fitted.theta, (len(folds), 1))
        thetas[:, fitted.free] += judged.steps
        # Without a fold, a parameter may be poorly determined and leave its bounds, and a free run
        # outside them may diverge.
        thetas = np.clip(thetas, *fitted.mechanism.bounds)
        force, velocity = [], []
        for fold, theta in zip(folds, thetas, strict=True):
            part = self._part(fold)
            force.append(self._force(fitted.mechanism, theta, part)[1])
            velocity.append(SumsOfSquares.of(_free_run(fitted.mechanism, theta, part)))
            self.progress()
        errors = add_up(force).ratio, add_up(velocity).ratio
        predict = partial(self.predictability, fitted)
        return Step(effect, *errors, fitted, tuple(folds), thetas, predict)

    def judged_alike(self, steps: Iterable[Step], folds: Sequence[Fold]) -> list[Step]:
        """The steps with errors on these folds: on others they cannot be compared."""
        return [
            step if step.folds == tuple(folds) else self.step(step.fitted, step.effect, folds)
            for step in steps
        ]

    def predictability(self, fitted: FittedStructure) -> Predictability:
        """What of a structure's residual the motion predicts."""
        return self._remainder(fitted).predictability

    def above_white_floor(self, fitted: FittedStructure) -> float:
        """Force error of the fit on its own logs, over what white noise alone would leave."""
        return self._remainder(fitted).above_white_floor

    def _remainder(self, fitted: FittedStructure) -> _Remainder:
        """What a structure leaves: asked for by the search, the next ranking and the verdict."""
        known = self._remainders.get(id(fitted))
        if known is None:
            known = self._remainders[id(fitted)] = _Remainder(self, fitted)
        return known

    def _part(self, fold: Fold) -> Any:
        """The samples of a fold."""
        samples = self.samples[fold.log]
        if fold.whole:
            return samples
        first, last = np.searchsorted(samples.time, [fold.start, fold.end])
        return cut(samples, int(first), int(last) + 1)

    def _force(
        self, mechanism: Mechanism, theta: Array, samples: Samples
    ) -> tuple[Traces, SumsOfSquares]:
        traces = force_traces(mechanism, theta, samples, self.settings.fit)
        return traces, SumsOfSquares.of(traces)

    def given_errors(self, mechanism: Mechanism, theta: Array) -> dict[str, float]:
        """Errors of a model as it stands, nothing fitted."""
        force = [self._force(mechanism, theta, item)[1] for item in self.samples]
        velocity = [
            SumsOfSquares.of(velocity_traces(mechanism, theta, item)) for item in self.samples
        ]
        return {"force_error": add_up(force).ratio, "velocity_error": add_up(velocity).ratio}

    def floor(self, fitted: FittedStructure) -> NoiseFloor:
        """What noise leaves at the fitted structure."""
        return self._remainder(fitted).floor


def worse_by(item: Candidate, leader: Candidate, base: FittedStructure) -> float:
    """By how many standard errors a candidate's held-out squares exceed the leader's."""
    if item is leader:
        return 0.0
    # Their folds may differ, but the rows have the same order and can be compared one by one.
    mine, others = (
        one.ratio * (np.concatenate(one.left) ** 2).sum(axis=1) for one in (item, leader)
    )
    length = base.settings.residual_map.bootstrap_block_time
    difference = block_sums(mine - others, base.rows[0].step, length)
    # Standard error of a sum of blocks that are taken as independent.
    spread = np.sqrt(len(difference)) * difference.std()
    noise = item.added_noise / item.acting_share - leader.added_noise / leader.acting_share
    worse = difference.sum() - noise
    return float(worse / max(spread, 1e-300))


@dataclass(frozen=True)
class _Remainder:
    """What a structure leaves of the logs; each part is computed once, when it is asked for."""

    data: LoggedData
    fitted: FittedStructure

    @cached_property
    def rows(self) -> list[Regression]:
        """Its residual at the rate of a fit, which is lower than that of the choice of effects."""
        fitted, settings = self.fitted, self.data.settings.fit
        return [
            regression(fitted.mechanism, fitted.theta, item, fitted.free, settings)
            for item in self.data.samples
        ]

    @cached_property
    def traces(self) -> list[Traces]:
        """Force traces of each log."""
        fitted, settings = self.fitted, self.data.settings.fit
        return [
            force_traces(fitted.mechanism, fitted.theta, item, settings)
            for item in self.data.samples
        ]

    @cached_property
    def predictability(self) -> Predictability:
        """What of it the motion predicts."""
        data = self.data
        args = (self.fitted.mechanism, self.rows, data.samples, data.seed, data.settings.fit)
        found = predictability(*args, self.fitted.theta)
        data.progress()
        return found

    @cached_property
    def floor(self) -> NoiseFloor:
        """What noise leaves of it."""
        data, fitted = self.data, self.fitted
        # A diverging free run has no floor: its squares are NaN, and so is the ratio.
        runs = [_free_run(fitted.mechanism, fitted.theta, item) for item in data.samples]
        return noise_floor(
            *(fitted.mechanism, fitted.theta, data.samples),
            *(self.rows, self.predictability, self.traces),
            *(runs, data.noise, data.seed, data.settings.fit),
        )

    @cached_property
    def above_white_floor(self) -> float:
        """Force error over what white noise alone would leave."""
        data, fitted = self.data, self.fitted
        floor = [
            white_force_floor(
                *(fitted.mechanism, fitted.theta, samples, traces, noise),
                *(data.seed, data.settings.fit),
            )
            for samples, traces, noise in zip(data.samples, self.traces, data.noise, strict=True)
        ]
        return add_up(map(SumsOfSquares.of, self.traces)).ratio / add_up(floor).ratio


def _free_run(mechanism: Mechanism, theta: Array, samples: Samples) -> Traces:
    """Velocity traces, with NaN predicted where the parameters are too stiff to simulate."""
    try:
        return velocity_traces(mechanism, theta, samples)
    except InputError:
        measured = mechanism.measured_speed(samples)
        return Traces(samples.time, measured, np.full_like(measured, np.nan))
