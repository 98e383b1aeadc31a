"""Candidate effects on top of one structure: tried, fitted, ranked, and told from each other."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.significance import (
    candidate_p_values,
    remainder,
    score_blocks,
    stacked,
)
from identification.diagnosis.structures import (
    Candidate,
    FittedStructure,
    LoggedData,
    Ranking,
    visible_directions,
)
from identification.fitting.cross_validation import block_sums, cross_validate, make_folds
from identification.fitting.noise_bias import extrapolated_fit, joint_fit
from identification.fitting.observability import log_observability, refuse_blind
from identification.fitting.regression import (
    Indices,
    filtered_residual,
    filtered_rows,
    residual_ends,
)
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import DemandedForce, Samples
from identification.threads import side_by_side
from youbot_env.physics.effect import Parameter

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


def try_candidate(base: FittedStructure, name: str) -> Candidate:
    """The effect with its best shape constants by held-out squares: on the grid, then between."""
    mechanism, settings = base.mechanism.extended(name), base.settings
    longest = max(float(item.time[-1]) for item in base.samples)
    grids = {p.name: _grid(p, longest) for p in mechanism.catalogue[name].parameters if p.grid}

    def judge(values: tuple[float, ...]) -> Candidate:
        return _linear_candidate(base, mechanism, name, dict(zip(grids, values, strict=True)))

    best = min(map(judge, itertools.product(*grids.values())), key=_square)
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


def _square(item: Candidate) -> float:
    return item.square


def _grid(parameter: Parameter, longest: float) -> tuple[float, ...]:
    """Values to try; instants of a log up to the end of the longest one [s]."""
    grid = parameter.grid
    if not parameter.instant:
        return grid
    step = grid[-1] - grid[-2]
    more = np.arange(grid[-1] + step, longest, step)
    return tuple(value for value in (*grid, *more.tolist()) if value < longest)


def _between(grid: Sequence[float], here: float, halving: int, parameter: Parameter) -> list[float]:
    """Values half, a quarter, ... of the grid's local step to both sides of ``here``."""
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
    demands = [
        mechanism.demand(theta, item.for_fit, known)
        for item, known in zip(base.samples, base.demands, strict=True)
    ]
    columns = tuple(
        _columns(base, mechanism, demand, item, new)
        for item, demand in zip(base.samples, demands, strict=True)
    )
    declared = mechanism.catalogue[name].parameters
    starts = {p.name for p in declared if p.grid and not p.is_shape}
    residual = base.residual
    if starts:
        residual = [
            filtered_rows(
                residual_ends(mechanism, demand, item.for_fit), mechanism, item, base.settings.rows
            )
            for item, demand in zip(base.samples, demands, strict=True)
        ]
    joined = [np.concatenate([a, b], axis=-1) for a, b in zip(base.columns, columns, strict=True)]
    free = np.concatenate([base.free, new])
    basis = visible_directions(mechanism, free)
    folds = make_folds(base.rows, joined, base.settings.fit)
    judged = cross_validate(residual, joined, folds, basis, base.settings.fit)
    shapes = {key: value for key, value in shapes.items() if key not in starts}
    found = Candidate(
        *(name, mechanism, theta, free, columns, judged, shapes),
        directions=basis.shape[1] - base.basis.shape[1],
        fold_ratio=base.fold_ratio(folds),
    )
    if _takes_too_much(demands, base.settings):
        return replace(found, lost_fall=max(base.held_out.square - found.square, 0.0))
    lost = _lost_at_bounds(base, found, new, theta[new] + judged.step[len(base.free) :])
    # Another shape may do as well with a sign that can be; where none does, the effect explains
    # nothing.
    return replace(found, lost_fall=min(lost, max(base.held_out.square - found.square, 0.0)))


def _takes_too_much(demands: Sequence[DemandedForce], settings: DiagnosisSettings) -> bool:
    """Whether channels leave so little of the logged torques that any model would fit the rest."""
    taken, logged = map(sum, zip(*(demand.taken for demand in demands), strict=True))
    return bool(taken > settings.max_taken_share * logged)


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
    return float(_unexplained(stacked(base.columns), back, base.settings)[0])


def _columns(
    base: FittedStructure,
    mechanism: Mechanism,
    demand: DemandedForce,
    samples: Samples,
    new: Indices,
) -> Array:
    ends = np.moveaxis(demand.columns(new), 0, -1)
    return filtered_rows(ends, mechanism, samples, base.settings.rows)


def rank(
    data: LoggedData,
    base: FittedStructure,
    names: Sequence[str],
    rng: np.random.Generator,
) -> Ranking:
    """Try each candidate on top of a structure."""
    needed = _needed(data, base)
    names = [name for name in names if base.mechanism.structure.can_hold(name)]
    if not names:
        return Ranking((), {}, (), None, base.held_out.square, needed)
    _ = base.demands  # a cached property: computed here once, or each thread would compute it
    found = side_by_side(partial(try_candidate, base), names, data.progress)
    found = _with_joint_fits(data, base, sorted(found, key=_square), needed)
    step = base.rows[0].step
    scores = {
        item.name: score_blocks(base.residual, base.columns, item.columns, step, data.settings)
        for item in found
    }
    p_values = candidate_p_values(scores, rng, data.settings)
    return ranking_of(data, base, found, p_values, needed)


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
        fold_ratio=base.fold_ratio(joint.held_out.folds),
    )
    # Fall of the fitted squares, scaled to held-out squares. Noise that the effect itself amplifies
    # is no loss.
    kept = (base.square - joint.square + added) * square / base.square
    if _takes_too_much(joint.demands, data.settings):
        return replace(new, lost_fall=max(square - new.square, 0.0))
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
    best = found[0]
    for item in near:
        # The simpler of two nested effects is preferred unless the larger one is materially better.
        if contains(best, item, base) and _gives_way(data, best, item):
            best = item
    # An effect that contains the best one does as well by construction. That is no tie.
    tied = [
        item.name
        for item in near
        if item is not best
        and _worse_by(item, best, base) < settings.max_tied_deviations
        and not contains(item, best, base)
    ]
    return best, tuple(tied)


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
    left = _unexplained(stacked(smaller.columns), stacked(beyond), settings)
    return bool(left[0] < settings.min_extension_gain * square)


def _worse_by(item: Candidate, leader: Candidate, base: FittedStructure) -> float:
    """By how many standard errors a candidate's held-out squares exceed the leader's."""
    if item is leader:
        return 0.0
    # Their folds may differ, but the rows have the same order and can be compared one by one.
    mine, others = (
        one.fold_ratio * (np.concatenate(one.held_out.residual) ** 2).sum(axis=1)
        for one in (item, leader)
    )
    length = base.settings.residual_map.bootstrap_block_time
    difference = block_sums(mine - others, base.rows[0].step, length)
    # Standard error of a sum of blocks that are taken as independent.
    spread = np.sqrt(len(difference)) * difference.std()
    worse = difference.sum() - (item.added_noise - leader.added_noise)
    return float(worse / max(spread, 1e-300))


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
    return (remainder(target, columns, settings.min_seen_share) ** 2).sum(axis=0)
