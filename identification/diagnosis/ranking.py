"""Candidates on top of one structure: ranked by held-out squares, nested and tied ones apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.candidates import (
    SELECTION,
    Candidate,
    Fitted,
    contains,
    extends,
    try_candidate,
    unexplained,
)
from identification.diagnosis.search import Search
from identification.diagnosis.significance import family_p_values, score_blocks
from identification.diagnosis.threads import side_by_side
from identification.fitting.cross_validation import block_sums
from identification.fitting.regression_rows import residual_of

Array = NDArray[np.float64]

MATERIAL = 0.05
"""Least share of the held-out squared residual that an effect must take away to be accepted."""

CRUMB = 0.2
"""The same of the squares' excess over the noise floor: an effect that takes less of it away is a
crumb of something else, and nothing true is found by collecting them."""

NESTED = 0.05
"""Share of a simpler effect's squares by which its extension must be better to take its place."""

BY_NOISE = 0.5
"""The same above which no noise alone can have made the extension better."""

LEADERS = 5
"""Candidates that are fitted jointly before they are compared."""

TIED = 2.0
"""Standard errors within which two candidates cannot be told apart."""

KEPT = 0.5
"""Share of the best candidate's fall that a candidate must reach to count as tied."""

BENT = 0.2
"""The same before its joint fit for a candidate in whose parameters the force is not linear: at no
strength a delay's column is the torque's noisy rate, and shows less than half of what it can do."""


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
    needed: float = MATERIAL

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


def least_share(above_floor: float) -> float:
    """Share of a structure's squares that an effect must take away to be accepted.

    ``above_floor``: see :meth:`Search.above_floor`.
    """
    return max(MATERIAL, CRUMB * (1.0 - 1.0 / above_floor**2))


def rank(
    search: Search,
    fitted: Fitted,
    names: Sequence[str],
    rng: np.random.Generator,
    above_floor: float | None = None,
) -> Ranking:
    """Try each candidate on top of a structure; ``above_floor`` of it, where it is known."""
    base = fitted.held_out
    needed = least_share(above_floor or search.above_floor(fitted))
    if not names:
        return Ranking((), {}, (), None, base.square, needed)
    _ = fitted.demands  # found once, not in each thread
    found = side_by_side(partial(try_candidate, fitted), names, search.tick)
    found.sort(key=lambda item: item.square)
    found = _refit(search, fitted, found, base.square, needed)
    step = fitted.rows[0].step
    scores = {
        item.name: score_blocks(fitted.residual, fitted.columns, item.columns, step)
        for item in found
    }
    p_values = family_p_values(scores, rng)
    rivals = list(found)
    best, tied = _choose(rivals, base.square, fitted, step, partial(_idle, search))
    while best and extends(best, fitted) and _idle(search, best, fitted, base.square):
        # More of what is there already, by nothing or by noise: no finding.
        rivals.remove(best)
        best, tied = _choose(rivals, base.square, fitted, step, partial(_idle, search))
    return Ranking(tuple(found), p_values, tied, best, base.square, needed)


def _refit(
    search: Search, base: Fitted, found: list[Candidate], square: float, needed: float
) -> list[Candidate]:
    """Joint fits of the candidates in the lead: some are linear only near zero strength."""
    fall = square - found[0].square if found else 0.0
    if fall < 0.5 * needed * square:
        return found
    noise = base.noise_square(search.noise, search.seed)
    leaders = [item for item in found[:LEADERS] if square - item.square > fall * _enough(item)]

    def refitted(item: Candidate) -> Candidate:
        joint = search.fit(item.mechanism, item.theta)
        more = joint.noise_square(search.noise, search.seed) - noise
        result = joint.held_out
        new = replace(
            item,
            theta=joint.theta,
            fitted=joint,
            result=result,
            extra_noise=more,
            folding=base.compared(result.folds),
        )
        fall = (base.square - joint.square + more) * square / base.square
        broken = fall < KEPT * (square - new.square)
        return replace(new, unkept=square - fall - new.square) if broken else new

    done = side_by_side(refitted, leaders, search.tick)
    rest = [item for item in found if item not in leaders]
    return sorted([*done, *rest], key=lambda item: item.square)


def _idle(search: Search, larger: Candidate, smaller: Fitted, square: float) -> bool:
    """Whether what a nested effect has beyond its simpler form is nothing, or made by noise.

    Noise on the speeds rounds the kink of a dry friction, and a breakaway peak can imitate
    that. The larger is fitted with the noise undone: what it predicts beyond the smaller's
    best must still matter.

    Parameters
    ----------
    smaller : the structure with the simpler form; square : its held-out squares
    """
    dearer = square - larger.noisy_square
    if dearer < NESTED * square:
        return True
    if dearer > BY_NOISE * square or not larger.fitted:
        return False
    undone = search.final(larger.fitted).theta
    beyond = [
        row.residual - residual_of(larger.mechanism, undone, samples, SELECTION)
        for row, samples in zip(smaller.rows, search.samples, strict=True)
    ]
    columns = [row.columns.reshape(-1, row.columns.shape[-1]) for row in smaller.rows]
    target = np.concatenate([part.reshape(-1, 1) for part in beyond])
    left = unexplained(np.concatenate(columns), target)
    return bool(left[0] < NESTED * square)


def _enough(item: Candidate) -> float:
    """Share of the best candidate's fall from which on a candidate is fitted jointly."""
    return BENT if item.name in item.mechanism.structure.nonlinear else KEPT


def _choose(
    found: Sequence[Candidate],
    square: float,
    base: Fitted,
    step: float,
    idle: Callable[[Candidate, Fitted, float], bool],
) -> tuple[Candidate | None, tuple[str, ...]]:
    """The best candidate, a simpler one in its place if it does as well, and those that tie."""
    if not found or found[0].square >= square:
        return None, ()
    leader = found[0]
    fall = square - leader.square
    near = [item for item in found if square - item.square > KEPT * fall]
    best = leader
    for item in near:
        # A nested effect gives way to its simpler form unless it is materially better.
        if contains(best, item, base) and _gives_way(best, item, idle):
            best = item
    tied = [
        item.name
        for item in near
        if item is not best
        and _worse_by(item, best, step) < TIED
        and not contains(item, best, base)
    ]
    return best, tuple(tied)


def _gives_way(
    larger: Candidate, smaller: Candidate, idle: Callable[[Candidate, Fitted, float], bool]
) -> bool:
    if smaller.fitted:
        return idle(larger, smaller.fitted, smaller.noisy_square)
    return smaller.noisy_square - larger.noisy_square < NESTED * smaller.noisy_square


def _worse_by(item: Candidate, leader: Candidate, step: float) -> float:
    """By how many standard errors of blocks a candidate's held-out residual is the larger one."""
    if item is leader:
        return 0.0
    # Their folds may differ, but not the order of what was held out.
    mine, others = (
        one.folding * (np.concatenate(one.result.residual) ** 2).sum(axis=1)
        for one in (item, leader)
    )
    difference = block_sums(mine - others, step)
    spread = np.sqrt(len(difference)) * difference.std()
    worse = difference.sum() - (item.extra_noise - leader.extra_noise)
    return float(worse / max(spread, 1e-300))
