"""Candidate effects on top of one structure: tried, fitted, ranked, and told from each other."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.restricted import (
    BaseSums,
    Logs,
    LogSums,
    can_differ,
    instance_name,
)
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.significance import (
    Evidence,
    candidate_p_values,
    score_blocks,
)
from identification.diagnosis.structures import (
    Candidate,
    CandidateRows,
    FittedStructure,
    LoggedData,
    Ranking,
    visible_directions,
    worse_by,
)
from identification.fitting.coarse_channels import are_counted
from identification.fitting.cross_validation import cross_validate, make_folds
from identification.fitting.noise_bias import extrapolated_fit, joint_fit
from identification.fitting.observability import log_observability, refuse_blind
from identification.fitting.regression import (
    Indices,
    acting_share,
    acting_slope,
    columns_by_share,
    filtered_residual,
    residual_and_columns,
    rows_by_parts,
)
from identification.fitting.span import Span, stacked
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import DemandedForce, Samples
from identification.residual_map.bootstrap import random_signs
from identification.threads import side_by_side
from youbot_env.physics.effect import (
    ACTUATOR,
    CHANNEL,
    CLOCK,
    INSTANCE,
    SPEED,
    Parameter,
    effect_of,
)

Array = NDArray[np.float64]


def fit_structure(data: LoggedData, mechanism: Mechanism, start: Array) -> FittedStructure:
    """Joint fit on all logs, smooth shape constants included."""
    result = joint_fit(mechanism, data.samples, start, data.settings.fit)
    return FittedStructure.at(mechanism, result.theta, data.samples, result.free, data.settings)


def fit_base(data: LoggedData, mechanism: Mechanism, start: Array) -> FittedStructure:
    """The fit of what the model holds already.

    Raises
    ------
    InputError
        If the logs cannot show its parameters: with the motion that would.
    """
    fitted = fit_structure(data, mechanism, start)
    refuse_blind(mechanism, log_observability(mechanism, fitted.rows))
    return fitted


def at_best_width(data: LoggedData, fitted: FittedStructure) -> FittedStructure | None:
    """A structure with the dry friction of its base model at another width about standstill.

    None if the base model has none, or no other width leaves materially less.
    """
    own, best = fitted.mechanism.structure.effects, fitted
    for place, label in enumerate(fitted.mechanism.labels):
        usual = _usual_width(label.parameter)
        if label.component in own or usual is None:
            continue
        values = [usual * factor for factor in data.settings.other_widths]
        best = _best_of(data, best, place, values)
        for factor in data.settings.finer_widths:
            here = float(best.theta[place])
            best = _best_of(data, best, place, (here / factor, here * factor))
    most = (1 - data.settings.min_extension_gain) * _held_out_square(fitted)
    return best if _held_out_square(best) < most else None


def _usual_width(parameter: Parameter) -> float | None:
    """The usual value of a shape constant that no search tries, as how wide a step of dry friction
    is; None of other parameters."""
    return None if parameter.grid else parameter.default


def _best_of(
    data: LoggedData, known: FittedStructure, place: int, values: Sequence[float]
) -> FittedStructure:
    """The best of a structure and of the same with one parameter at other values."""
    found = [known]
    for value in values:
        start = known.theta.copy()
        start[place] = value
        found.append(fit_structure(data, known.mechanism, start))
    return min(found, key=_held_out_square)


def _held_out_square(fitted: FittedStructure) -> float:
    return fitted.held_out.square


def try_candidate(
    base: FittedStructure,
    sums: BaseSums | None,
    effect: str,
    held: Mapping[str, float] | None = None,
) -> list[Candidate]:
    """The effect with its best shape constants by held-out squares: on the grid, then between.

    Behind it, where that is better, the effect in some of the logs only; this one alone if the
    structure holds the effect already.

    Parameters
    ----------
    sums : of the structure over its logs; None if no effect can differ between them
    held : shape constants that are not searched, but kept at these values
    """
    present = effect in base.mechanism.structure.effects
    name = f"{effect}{INSTANCE}0" if present else effect
    mechanism = base.mechanism.extended(name)
    searched = [p for p in mechanism.catalogue[name].parameters if p.grid]
    grids = {p.name: _grid(p, base) for p in searched}
    grids |= {shape: (value,) for shape, value in (held or {}).items()}
    if sums:
        # In all logs from their start on is what the base model holds; in some it is not.
        declared = mechanism.catalogue[name].parameter
        grids = {
            shape: (max(declared(shape).lower, 0.0), *grid) if declared(shape).instant else grid
            for shape, grid in grids.items()
        }
    best: Candidate | None = None
    part: InPart | None = None
    scores: list[Array] = []
    for values in itertools.product(*grids.values()):
        tried = _linear_candidate(base, mechanism, name, dict(zip(grids, values, strict=True)))
        scores += [_scores(base, tried.columns)] if grids else []
        best = tried if best is None else min(best, tried, key=_square)
        split = _best_in_part(base, sums, tried, present) if sums else None
        if split and (part is None or split.fall > part.fall):
            part = split
    assert best is not None  # without shape constants there is one product of nothing
    if present and part is not None and _is_inexactness(base, effect, part.fall):
        part = None
    found = [] if present else [_refined(base, grids, best)]
    found += [] if part is None else [_refined(base, grids, _in_part(base, effect, part))]
    if found and sums:
        in_part = LogSums(sums, _seen_columns(base, best))
        names = base.mechanism.structure.effects
        scores += in_part.all_scores(effect, but=names).values()
    if found:
        found[0] = replace(found[0], tried=tuple(scores))
    if base.is_in_parts:
        return [_without_rows(base, item) for item in found]
    return found


def _without_rows(base: FittedStructure, item: Candidate) -> Candidate:
    """The candidate without its rows, and with its scores, which each ranking asks for."""
    return replace(item.without_rows(), score=_scores(base, item.columns))


def _is_inexactness(base: FittedStructure, effect: str, fall: float) -> bool:
    """Whether what an effect would take once more, in some logs, is what it leaves by itself.

    Angles and places that are integrated drift with their noise, and the phase of a ripple with
    them: in each log another one does a little better.

    ``fall``: of the fitted squares.
    """
    alone = base.mechanism.with_effects([effect])
    if alone.structure.depends_on_angle and not all(s.angle_measured for s in base.samples):
        return True
    own = np.array([base.mechanism.labels[k].component == effect for k in base.free])
    columns = stacked(base.columns)
    force = columns[:, own] @ base.theta[base.free][own]
    taken = _unexplained(columns[:, ~own], force[:, None], base.settings)
    return fall < base.settings.min_share_of_first_instance * float(taken[0])


class InPart(NamedTuple):
    """An effect that acts in some logs only: these, the candidate that acts in all, and the fall of
    the fitted squares by one linear step."""

    logs: Logs
    whole: Candidate
    fall: float


def _base_sums(base: FittedStructure) -> BaseSums | None:
    """Sums of a structure over its logs; None if no effect can differ between them."""
    if not can_differ([item.name for item in base.samples]):
        return None
    columns = [part @ base.basis for part in base.columns]
    return BaseSums(base.residual, columns, base.rows[0].step, base.settings)


def _seen_columns(base: FittedStructure, item: Candidate) -> list[Array]:
    """Per log (n, A, q) a candidate's own columns, in directions that data can see."""
    own = visible_directions(item.mechanism, item.free[len(base.free) :])
    return [columns @ own for columns in item.columns]


def _best_in_part(
    base: FittedStructure, of_base: BaseSums, whole: Candidate, present: bool
) -> InPart | None:
    """The logs in which an effect acts, if that is better than in all of them.

    ``present``: whether the structure holds the effect in all logs already.
    """
    sums, new = LogSums(of_base, _seen_columns(base, whole)), whole.free[len(base.free) :]
    own, names = visible_directions(whole.mechanism, new), base.mechanism.structure.effects

    def can_be(logs: Logs, strength: Array) -> bool:
        if instance_name(whole.name, logs) in names:
            return False
        return _within_bounds(whole.mechanism, new, whole.theta[new] + own @ strength)

    everywhere = 0.0 if present else sums.step(range(len(sums)))[0]
    found = sums.best_choice(base.square, everywhere, can_be)
    return None if found is None else InPart(found[0], whole, found[1])


def _in_part(base: FittedStructure, effect: str, part: InPart) -> Candidate:
    """The candidate that acts in some logs, at the shapes at which it was found."""
    name = instance_name(effect, part.logs)
    mechanism = base.mechanism.extended(name, [base.samples[k].name for k in part.logs])
    return _linear_candidate(base, mechanism, name, part.whole.shapes)


def _refined(
    base: FittedStructure, grids: Mapping[str, Sequence[float]], best: Candidate
) -> Candidate:
    """A candidate with shape constants between those of the grids."""
    mechanism, name, settings = best.mechanism, best.name, base.settings

    def judge(values: tuple[float, ...]) -> Candidate:
        return _linear_candidate(base, mechanism, name, dict(zip(grids, values, strict=True)))

    # Most candidates explain nothing; a finer search would only cost time.
    if best.square > settings.max_refined_share * base.held_out.square:
        return best
    # Coordinate search: one shape constant after the other, each from the best values so far.
    for shape, grid in grids.items():
        parameter = mechanism.catalogue[name].parameter(shape)
        if parameter.whole or not parameter.is_shape:
            continue
        for halving in range(1, settings.grid_halvings + 1):
            here = best.shapes[shape]
            for value in _between(grid, here, halving, parameter):
                values = tuple((best.shapes | {shape: value})[key] for key in grids)
                best = min(best, judge(values), key=_square)
    return best


def _p_values(
    data: LoggedData,
    base: FittedStructure,
    found: Sequence[Candidate],
    beside: Sequence[Candidate],
    rng: np.random.Generator,
) -> dict[str, float]:
    """Family-wise p-value of each candidate; ``beside``: others that chance has had."""
    settings = data.settings
    scores = {item.name: _evidence(base, item) for item in found}
    # What was tried and is no candidate counts too: chance has had that many chances.
    tried = [score for item in (*found, *beside) for score in item.tried]
    tried += [_scores(base, item.columns) for item in beside]
    signs = random_signs(rng, settings.bootstrap_draws, len(scores[found[0].name].observed))
    p_values = candidate_p_values(scores, signs, settings, tried)
    by_noise = [
        item
        for item in found
        if item.mechanism.catalogue[item.name].acts_at in NOISY_SITES
        and (item.fitted is None or item.lost_fall <= 0)
        and p_values[item.name] <= settings.max_p_value_of_noise
    ]
    if by_noise:
        noise = _Noise.on(data, base)
        for item in by_noise:
            scores[item.name] = noise.taken_off(item, scores[item.name])
        p_values = candidate_p_values(scores, signs, settings, tried)
    # What would help with a sign that cannot be explains nothing, however surely.
    absurd = [
        item.name for item in found if item.lost_fall > 0 and item.square >= base.held_out.square
    ]
    return {**p_values, **dict.fromkeys(absurd, 1.0)}


def _scores(base: FittedStructure, columns: Sequence[Array]) -> Array:
    """Score blocks (blocks, F) of columns on top of a structure."""
    step = base.rows[0].step
    return score_blocks(base.residual, base.span, columns, step, base.settings)


def _evidence(base: FittedStructure, item: Candidate) -> Evidence:
    """Scores of a candidate, and those that chance is judged by.

    What an effect does in a few moments, as a limit of the torque does, makes a few blocks large,
    and random signs of these blocks would make scores as large. So chance is judged by what the
    effect leaves of the rows that its fit has not seen: if the effect does nothing these are the
    same.
    """
    joint = item.fitted
    if joint is None or item.lost_fall > 0:
        return Evidence(_scores(base, item.columns) if item.score is None else item.score)
    own = np.isin(joint.free, base.free, invert=True)
    columns = [part[..., own] for part in joint.columns]
    ends = np.cumsum([len(part) for part in base.residual])[:-1]
    left = np.split(np.concatenate(item.held_out.residual), ends)
    step = base.rows[0].step
    chance = score_blocks(left, base.span, columns, step, base.settings)
    return Evidence(_scores(base, columns), chance)


NOISY_SITES = (CHANNEL, ACTUATOR, CLOCK, SPEED)
"""Where an effect's column is made of logged torques: their noise is in the residual too."""


class _Noise(NamedTuple):
    """Noise put on the logs of a structure once more, and what it makes of the structure's rows.

    samples : per log, with the noise
    residual : (N,) and columns (N, F) of the structure's parameters, what the noise adds to them
    """

    base: FittedStructure
    samples: tuple[Samples, ...]
    residual: Array
    columns: Array

    @classmethod
    def on(cls, data: LoggedData, base: FittedStructure, lasting: bool = True) -> _Noise:
        """The logs' own noise; ``lasting``: with the spectrum that speeds and residual show."""
        added = list(base.with_noise(data.noise, data.seed, True, lasting))
        samples, residual = zip(*added, strict=True)
        joined = np.concatenate([part.ravel() for part in residual])
        args = base, base.mechanism, base.theta
        clean, noisy = (_columns_of(*args, logs, base.free) for logs in (base.samples, samples))
        return cls(base, samples, joined, noisy - clean)

    def taken_off(self, item: Candidate, evidence: Evidence) -> Evidence:
        """The evidence less what noise alone makes of it, in the column and in the residual.

        A drive's resonance bends the torque, and so its noise: the two are correlated. And noise
        in the structure's own columns makes its parameters too small; what these columns explain
        of the effect's then shows the error that they leave.
        """
        base, known = self.base, self.base.span
        free = item.fitted.free if item.fitted else item.free
        own = free[np.isin(free, base.free, invert=True)]
        args = base, item.mechanism, item.theta
        clean, noisy = (_columns_of(*args, logs, own) for logs in (base.samples, self.samples))
        added = noisy - clean - self.columns @ known.coefficients(clean)
        score = known.remainder(added).T @ self.residual
        observed = evidence.observed - score / len(evidence.observed)
        return replace(evidence, observed=observed)


def _columns_of(
    base: FittedStructure,
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    new: Indices,
) -> Array:
    """(N, F) columns of the parameters ``new``, of all logs."""
    return stacked([_own_columns(base, mechanism, theta, item.for_fit, new) for item in logs])


def _own_columns(
    base: FittedStructure,
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    new: Indices,
    known: DemandedForce | None = None,
    with_residual: bool = False,
) -> Array:
    """Rows (n, A, F) of the parameters ``new`` of a structure that extends another.

    Parameters
    ----------
    known : what the other demands of these samples, which are those of a fit
    with_residual : (n, A, 1 + F), with what the structure leaves before them
    """

    def ends_of(part: Samples) -> Array:
        # Of a part of a long log nothing is known.
        demand = mechanism.demand(theta, part, known if part is samples else None)
        if with_residual:
            return residual_and_columns(mechanism, demand, part, new)
        return np.moveaxis(demand.columns(new), 0, -1)

    return rows_by_parts(ends_of, mechanism, samples, base.settings.rows)


def _square(item: Candidate) -> float:
    return item.square


def _grid(parameter: Parameter, base: FittedStructure) -> tuple[float, ...]:
    """Values to try: instants of a log up to the end of the longest one [s], shares of the largest
    torque in the logs [N m], or what the grid holds."""
    grid = parameter.grid
    if parameter.of_peak:
        # Not the largest value itself, which may be an outlier.
        torques = np.concatenate([np.abs(item.torque).ravel() for item in base.samples])
        peak = float(np.quantile(torques, base.settings.peak_quantile))
        return tuple(value * peak for value in grid)
    if not parameter.instant:
        return grid
    longest = max(float(item.time[-1]) for item in base.samples)
    return _instants(grid, longest, base.settings.max_instants)


def _instants(grid: Sequence[float], longest: float, most: int) -> tuple[float, ...]:
    """At most so many instants [s], spread over the longest log as those of a grid are."""
    step = grid[-1] - grid[-2]
    more = np.arange(grid[-1] + step, longest, step)
    found = tuple(value for value in (*grid, *more.tolist()) if value < longest)
    apart = -(-len(found) // most) or 1
    return found[apart - 1 :: apart]


def _between(grid: Sequence[float], here: float, halving: int, parameter: Parameter) -> list[float]:
    """Values half, a quarter, ... of the grid's local step to both sides of ``here``."""
    if len(grid) < 2:
        return []
    points = np.asarray(grid)
    near = int(np.argmin(np.abs(points - here)))
    left = points[near] - points[near - 1] if near > 0 else 0.0
    right = points[near + 1] - points[near] if near + 1 < len(points) else left
    # At the lower end of the grid there is no step to the left; the right one is used instead.
    steps = (-(left or right) / 2**halving, right / 2**halving)
    tried = (float(here + step) for step in steps)
    return [value for value in tried if parameter.lower <= value <= parameter.upper]


def _linear_candidate(
    base: FittedStructure, mechanism: Mechanism, name: str, shapes: dict[str, float]
) -> Candidate:
    """The effect at given shapes, by one linear step from the structure without it."""
    theta = mechanism.extend_theta(base.theta, name, shapes)
    own = np.arange(len(base.theta), len(theta), dtype=np.intp)
    new = own[mechanism.free[own]]
    # At zero strength the effect changes no force, so the structure's known demand can be reused.
    declared = mechanism.catalogue[name].parameters
    starts = {p.name for p in declared if p.grid and not p.is_shape}
    columns = tuple(
        _own_columns(base, mechanism, theta, item.for_fit, new, known, bool(starts))
        for item, known in zip(base.samples, base.demands, strict=True)
    )
    residual = base.residual
    if starts:
        residual = [part[..., 0] for part in columns]
        columns = tuple(part[..., 1:] for part in columns)
        slope = acting_slope(mechanism, theta, base.samples, new)
        columns = tuple(
            columns_by_share(part, left, slope)
            for part, left in zip(columns, residual, strict=True)
        )
    joined = [np.concatenate([a, b], axis=-1) for a, b in zip(base.columns, columns, strict=True)]
    free = np.concatenate([base.free, new])
    basis = visible_directions(mechanism, free)
    folds = make_folds(base.rows, joined, base.settings.fit)
    judged = cross_validate(residual, joined, folds, basis, base.settings.fit)
    found = Candidate(
        *(name, mechanism, theta, free, CandidateRows(columns, judged.residual), judged),
        shapes={key: value for key, value in shapes.items() if key not in starts},
        directions=basis.shape[1] - base.basis.shape[1],
        fold_ratio=base.fold_ratio(folds),
        again=partial(_linear_candidate, base, mechanism, name, shapes),
    )
    found = replace(found, acting_share=_acting_share(mechanism, theta, base))
    lost = _lost_at_bounds(base, found, new, theta[new] + judged.step[len(base.free) :])
    # Another shape may do as well with a sign that can be; where none does, the effect explains
    # nothing.
    return replace(found, lost_fall=min(lost, max(base.held_out.square - found.square, 0.0)))


def _within_bounds(mechanism: Mechanism, which: Indices, values: Array) -> bool:
    """Whether parameters have values within their bounds, but for rounding."""
    lower, upper = (bound[which] for bound in mechanism.bounds)
    rounding = 1e-9 / mechanism.scale[which]
    return bool(((lower - rounding <= values) & (values <= upper + rounding)).all())


def _acting_share(mechanism: Mechanism, theta: Array, base: FittedStructure) -> float:
    """Squares of the force that channels let act, over those that the structure lets act."""
    return acting_share(mechanism, theta, base.samples) / base.acting_share


def _lost_at_bounds(base: FittedStructure, item: Candidate, which: Indices, values: Array) -> float:
    """Squares that come back where values beyond their bounds are moved to them.

    A little noise takes the friction of a free wheel below zero, which costs nothing; an effect
    that helps with the wrong sign alone loses all.
    """
    lower, upper = (bound[which] for bound in item.mechanism.bounds)
    beyond = np.clip(values, lower, upper) - values
    if not beyond.any():
        return 0.0
    back = (stacked(item.columns) @ beyond)[:, None]
    return float(base.span.unexplained(back)[0])


def rank(
    data: LoggedData,
    base: FittedStructure,
    names: Sequence[str],
    rng: np.random.Generator,
    beside: Sequence[Candidate] = (),
) -> Ranking:
    """Try each candidate on top of a structure.

    ``beside``: candidates that are not tried again, but have had their chance too: they belong to
    the family of the p-values.
    """
    needed = _needed(data, base)
    names = [name for name in names if base.mechanism.structure.can_hold(name)]
    if not names:
        return Ranking((), {}, (), None, base.held_out.square, needed)
    _ = base.demands, base.span  # kept: worked out here once, or each thread would do it
    effects = list(dict.fromkeys(effect_of(name) for name in names))
    of_each = side_by_side(partial(try_candidate, base, _base_sums(base)), effects, data.progress)
    found = sorted(itertools.chain(*of_each), key=_square)
    if not found:
        return Ranking((), {}, (), None, base.held_out.square, needed)
    found = _with_joint_fits(data, base, found, needed)
    p_values = _p_values(data, base, found, beside, rng)
    return _with_pair(data, base, ranking_of(data, base, found, p_values, needed))


def promised_falls(
    base: FittedStructure,
    first: FittedStructure,
    candidates: Sequence[Candidate],
    names: Sequence[str],
) -> dict[str, float]:
    """By name, the share of a structure's squares that candidates promise to take after a first.

    By one linear step from the first one's fit, at the shapes that are best without it, neither
    held out nor within bounds. Of an effect in all logs and in some the larger one.

    Parameters
    ----------
    first : the structure with the first effect, fitted; candidates : tried without it
    """
    residual, own = stacked([part[..., None] for part in first.residual]), stacked(first.columns)
    best: dict[str, float] = {}
    share = first.acting_share / base.acting_share
    for item in candidates:
        columns = np.concatenate([own, stacked(item.columns)], axis=1)
        left = float(_unexplained(columns, residual, base.settings)[0])
        effect, fall = effect_of(item.name), (first.square - left) / (share * base.square)
        best[effect] = max(fall, best.get(effect, fall))
    return {name: best[effect_of(name)] for name in names}


DRIVES = ("actuator_lag", "torque_delay", "drive_resonance")
"""Effects of a drive that answers late; the first two together are the third, nearly: a lag and a
delay, and a resonance that does not swing, have the same first two terms in their exponents."""

FIRST_GUESS = {"speed_filter": DRIVES}
"""Of an effect, twins that are named before it: without a pose nothing tells speeds that are
filtered from a drive that lags, and each drive lags a little."""


def _with_pair(data: LoggedData, base: FittedStructure, ranking: Ranking) -> Ranking:
    """The ranking; a resonance is in a set with lag and delay where these two do as well."""
    *names, whole = DRIVES
    best, known = ranking.best, {item.name: item for item in ranking.candidates}
    if best is None or best.fitted is None or best.name != whole or data.out_of_time:
        return ranking
    if not all(name in known for name in names):
        return ranking
    first, second = (known[name] for name in names)
    first = first if first.fitted else with_joint_fit(data, base, first)
    if not first.mechanism.structure.can_hold(second.name):
        return ranking
    both = first.mechanism.extended(second.name)
    start = both.extend_theta(first.theta, second.name, {})
    pair = with_joint_fit(data, base, replace(first, mechanism=both, theta=start))
    if worse_by(pair, best, base) >= data.settings.max_tied_deviations:
        return ranking
    # These three are the set: one of speeds that are filtered is the lag's twin, and not named too.
    return replace(ranking, tied=tuple(names))


def ranking_of(
    data: LoggedData,
    base: FittedStructure,
    found: Sequence[Candidate],
    p_values: dict[str, float],
    needed: float,
    excluded: Collection[str] = (),
) -> Ranking:
    """The ranking of candidates that have been tried.

    Parameters
    ----------
    found : best first
    excluded : names of candidates that cannot be the best, nor tie with it
    """
    square = base.held_out.square
    rivals = [item for item in found if item.name not in excluded]
    best, tied = _best_and_tied(data, base, rivals)
    while best and extends(best, base) and _adds_nothing(data, best, base, square):
        # The best candidate extends an effect that the structure holds, and its gain is small or
        # due to noise: the next one is taken.
        rivals.remove(best)
        best, tied = _best_and_tied(data, base, rivals)
    return Ranking(tuple(found), p_values, tied, best, square, needed)


def _needed(data: LoggedData, base: FittedStructure) -> float:
    """Share of a structure's squares that an effect must take away to be accepted."""
    found, settings = data.predictability(base), data.settings
    if not found.is_noise:
        return needed_share(found.systematic_share, settings)
    # Noise beyond the white may be a force that acts: the loop that drives answers it, and what
    # was measured is then correlated with it, which imitates a small delay or lag.
    coloured = 1.0 - 1.0 / max(data.above_white_floor(base), 1.0) ** 2
    return max(settings.min_share_of_residual, settings.min_share_of_coloured_noise * coloured)


def needed_share(predictable: float, settings: DiagnosisSettings) -> float:
    """Share of a structure's squares that an effect must take away to be accepted.

    ``predictable``: share of them that the motion predicts.
    """
    return max(settings.min_share_of_residual, settings.min_share_of_predictable * predictable)


def _with_joint_fits(
    data: LoggedData, base: FittedStructure, found: list[Candidate], needed: float
) -> list[Candidate]:
    """The candidates, best first; the best ones are fitted jointly with the structure.

    The linear step is not enough: some effects are linear only near zero strength.

    Parameters
    ----------
    found : by one linear step, best first
    """
    settings, square = data.settings, base.held_out.square
    fall = square - found[0].square
    if fall < settings.min_share_of_needed_fall * needed * square or data.out_of_time:
        return found
    leaders = [
        item
        for item in found[: settings.max_joint_fits]
        if square - item.square > fall * _share_in_lead(item, settings)
    ]
    noise = base.noise_square(data.noise, data.seed)
    fitted = side_by_side(partial(_joint_fit, data, base, noise), leaders, data.progress)
    rest = [item for item in found if item not in leaders]
    return sorted([*fitted, *rest], key=_square)


def _share_in_lead(item: Candidate, settings: DiagnosisSettings) -> float:
    """Share of the best candidate's fall from which on a candidate is fitted jointly."""
    if item.name in item.mechanism.structure.nonlinear:
        return settings.min_share_of_best_fall_nonlinear
    return settings.min_share_of_best_fall


def with_joint_fit(data: LoggedData, base: FittedStructure, item: Candidate) -> Candidate:
    """The candidate fitted jointly with the structure, within bounds."""
    return _joint_fit(data, base, base.noise_square(data.noise, data.seed), item)


def _joint_fit(
    data: LoggedData, base: FittedStructure, base_noise: float, item: Candidate
) -> Candidate:
    """The candidate fitted jointly; ``base_noise``: squares that noise leaves in the structure."""
    square = base.held_out.square
    joint = fit_structure(data, item.mechanism, item.theta)
    if joint.mechanism.structure.has_nonlinear_channel:
        both = (joint, base)
        with_effect, without = (f.noise_square(data.noise, data.seed, True) for f in both)
        added = with_effect - without
    else:
        added = joint.noise_square(data.noise, data.seed) - base_noise
    new = replace(
        item,
        theta=joint.theta,
        fitted=joint,
        held_out=joint.held_out,
        added_noise=added,
        lost_fall=0.0,  # the fit is within bounds
        acting_share=_acting_share(item.mechanism, joint.theta, base),
        fold_ratio=base.fold_ratio(joint.held_out.folds),
    )
    # Fall of the fitted squares, scaled to held-out squares. Noise that the effect itself amplifies
    # is no loss.
    left = (joint.square - added) / new.acting_share
    kept = (base.square - left) * square / base.square
    if kept < data.settings.min_kept_share_of_fall * (square - new.square):
        return replace(new, lost_fall=square - kept - new.square)
    return new


def _best_and_tied(
    data: LoggedData, base: FittedStructure, found: Sequence[Candidate]
) -> tuple[Candidate | None, tuple[str, ...]]:
    """The best candidate (or a simpler one that does as well), and those that tie with it."""
    settings, square = data.settings, base.held_out.square
    if not found or found[0].square >= square:
        return None, ()
    fall = square - found[0].square
    near = [item for item in found if square - item.square > settings.min_share_of_best_fall * fall]
    best = _whole_if_as_good(found[0], near, base)
    # An effect in some logs only has had more chances: it is no rival of one that acts in all.
    near = [item for item in near if best.in_part or not item.in_part]
    for item in near:
        # The simpler of two nested effects is preferred unless the larger one is materially better.
        if contains(best, item, base):
            best = _simpler_if_as_good(data, base, best, item)
    # It may give way to one that a third, no larger, surpasses.
    surely = settings.max_tied_deviations
    for item in near:
        if item.parameters <= best.parameters and worse_by(best, item, base) > surely:
            best = item
            break
    # An effect that contains the best one does as well by construction. That is no tie.
    tied = [
        item.name
        for item in near
        if item is not best
        and worse_by(item, best, base) < settings.max_tied_deviations
        and not contains(item, best, base)
    ]
    return _of_drives(best, tied, near, base)


def _of_drives(
    best: Candidate, tied: list[str], near: Sequence[Candidate], base: FittedStructure
) -> tuple[Candidate, tuple[str, ...]]:
    """The best effect and its twins; of drives that answer late the three that do best.

    A resonance does better than lag or delay if it is true, but where little of it is seen not by
    what is material: it is in the set if it does better than a delay, which is none of its limits,
    or better than a lag, which is one, by what is no chance.
    """
    if effect_of(best.name) not in (*DRIVES, *FIRST_GUESS):
        return best, tuple(tied)
    first = FIRST_GUESS.get(effect_of(best.name), ())
    drive = next((item for item in near if item.name in tied and item.name in first), None)
    if drive is not None:
        tied = [best.name, *(name for name in tied if name != drive.name)]
        best = drive
    # How a drive holds its commands is not known to a sample: what that makes of two that are
    # nearly the same is sure, but tells neither from the other.
    inexact = base.settings.max_inexact_share_of_drives * (base.held_out.square - best.square)
    tied += [
        item.name
        for item in near
        if item is not best
        and item.name in DRIVES
        and item.name not in tied
        and item.square - best.square < inexact
    ]
    for item in near:
        if item.name != DRIVES[-1] or item is best or item.name in tied:
            continue
        by_chance = base.settings.max_tied_deviations if contains(item, best, base) else 0.0
        if worse_by(best, item, base) > by_chance:
            tied = [item.name, *tied]
    return best, tuple(sorted(tied, key=lambda name: name not in DRIVES)[: len(DRIVES) - 1])


def _whole_if_as_good(
    best: Candidate, near: Sequence[Candidate], base: FittedStructure
) -> Candidate:
    """The best effect that acts in all logs, unless one in some logs only is better by far."""
    if not best.in_part:
        return best
    settings = base.settings
    for item in near:
        material = item.square - best.square >= settings.min_extension_gain * item.square
        sure = material and worse_by(item, best, base) >= settings.max_tied_deviations
        if not item.in_part and not sure:
            return item
    return best


def _simpler_if_as_good(
    data: LoggedData, base: FittedStructure, larger: Candidate, smaller: Candidate
) -> Candidate:
    """The smaller of two nested effects if it does as well, if need be at another width.

    How steep dry friction is about standstill is a constant that no search tries. Where it is not
    that of the robot, a breakaway peak as narrow as the step makes up for it. So the simpler
    effect is tried at other widths before the larger one takes its place.
    """
    if _gives_way(data, larger, smaller):
        return smaller
    if data.out_of_time or smaller.fitted is None:
        return larger
    best: Candidate | None = None
    for name, usual in _widths(smaller).items():
        if name in _widths(larger):
            found = _at_best_width(base, smaller, name, usual)
            best = found if best is None else min(best, found, key=_square)
    if best is None or best.square >= larger.square / (1 - data.settings.max_noise_gain):
        return larger
    best = with_joint_fit(data, base, best)
    return best if _gives_way(data, larger, best) else larger


def _at_best_width(base: FittedStructure, item: Candidate, name: str, usual: float) -> Candidate:
    """The candidate at the best value of one width, first by large factors, then by small ones."""
    settings, declared = base.settings, item.mechanism.catalogue[item.name].parameter(name)

    def tried(values: Sequence[float]) -> list[Candidate]:
        return [
            _linear_candidate(base, item.mechanism, item.name, item.shapes | {name: value})
            for value in values
            if declared.lower <= value <= declared.upper
        ]

    best = min(tried([usual * factor for factor in settings.other_widths]), key=_square)
    for factor in settings.finer_widths:
        here = best.shapes[name]
        best = min([best, *tried([here / factor, here * factor])], key=_square)
    return best


def _widths(item: Candidate) -> dict[str, float]:
    """Shape constants of an effect that no search tries, by name, at their usual values."""
    declared = item.mechanism.catalogue[item.name].parameters
    usual = {p.name: _usual_width(p) for p in declared}
    return {name: width for name, width in usual.items() if width is not None}


def _gives_way(data: LoggedData, larger: Candidate, smaller: Candidate) -> bool:
    square = smaller.square_with_noise
    if smaller.fitted:
        return _adds_nothing(data, larger, smaller.fitted, square)
    return square - larger.square_with_noise < data.settings.min_extension_gain * square


def _adds_nothing(
    data: LoggedData, larger: Candidate, smaller: FittedStructure, square: float
) -> bool:
    """Whether an effect gains little over its simpler form, or only because of noise.

    Noise on the speeds smooths the step of a dry friction, and a breakaway peak can imitate
    that. So the larger effect is fitted with the noise bias removed. What it then predicts beyond
    the best fit of the smaller one must still be material.

    Parameters
    ----------
    smaller : the structure with the simpler form; square : its held-out squares
    """
    settings = data.settings
    gain = square - larger.square_with_noise
    if gain < settings.min_extension_gain * square:
        return True
    if larger.fitted and are_counted(data.samples):
        # There the bias does not shrink with the noise, so it cannot be extrapolated away.
        by_steps = gain_by_measuring(data, smaller, larger.fitted)
        return gain - by_steps < settings.min_extension_gain * square
    if gain > settings.max_noise_gain * square or not larger.fitted:
        return False
    there = larger.fitted
    found = joint_fit(there.mechanism, data.samples, there.theta, settings.fit)
    args = (there.mechanism, data.samples, data.noise, found, data.seed, settings.fit)
    undone = extrapolated_fit(*args).theta
    beyond = [
        (row.residual - filtered_residual(larger.mechanism, undone, samples, settings.rows))[
            ..., None
        ]
        for row, samples in zip(smaller.rows, data.samples, strict=True)
    ]
    left = smaller.span.unexplained(stacked(beyond))
    return bool(left[0] < settings.min_extension_gain * square)


def gain_by_measuring(data: LoggedData, smaller: FittedStructure, larger: FittedStructure) -> float:
    """Held-out squares that a structure may gain over another by coarse channels alone.

    Both are fitted to the free runs of the smaller one, measured like the logs. 0 where no channel
    is coarse.
    """
    null = data.measured_again(smaller)
    if null is None:
        return 0.0
    before = fit_structure(null, smaller.mechanism, smaller.theta)
    after = fit_structure(null, larger.mechanism, larger.theta).held_out
    gain = max(before.judged(after.folds).square - after.square, 0.0)
    return data.settings.fit.predictability.measuring_margin * gain


def contains(larger: Candidate, smaller: Candidate, base: FittedStructure) -> bool:
    """Whether the larger candidate's columns can imitate the smaller one's (a nested effect)."""
    if larger.parameters <= smaller.parameters:
        return False
    target, nuisance = stacked(smaller.columns), stacked(base.columns)
    return _imitates(stacked(larger.columns), target, nuisance, base.settings)


def extends(item: Candidate, base: FittedStructure) -> bool:
    """Whether a candidate's columns can imitate those of an effect that the structure holds."""
    own, columns = stacked(item.columns), stacked(base.columns)
    for effect in base.mechanism.structure.effects:
        its = np.array([base.mechanism.labels[k].component == effect for k in base.free])
        fewer = its.any() and its.sum() < item.parameters
        if fewer and _imitates(own, columns[:, its], columns[:, ~its], base.settings):
            return True
    return False


def _imitates(columns: Array, target: Array, nuisance: Array, settings: DiagnosisSettings) -> bool:
    """Whether columns explain nearly all of what the nuisance leaves of each target."""
    # Only what the structure does not explain already can distinguish one effect from another.
    left_base = _unexplained(nuisance, target, settings)
    left_both = _unexplained(np.concatenate([nuisance, columns], axis=1), target, settings)
    return bool((left_both < (1 - settings.min_imitated_share) * left_base).all())


def _unexplained(columns: Array, target: Array, settings: DiagnosisSettings) -> Array:
    """Squares (T,) of targets (N, T) that no combination of columns (N, F) explains."""
    return Span(columns, settings.min_seen_share).unexplained(target)
