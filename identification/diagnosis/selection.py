"""Forward selection of effects, and second thoughts: what was accepted is tried against again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.candidates import Fitted
from identification.diagnosis.ranking import KEPT, Ranking, rank
from identification.diagnosis.search import Search, Step
from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]

SIGNIFICANT = 0.01
"""Family-wise p-value below which an effect may be accepted."""

MOST = 4
"""Effects accepted at most."""

AT_FLOOR = (0.97, 1.02)
"""Force error of the fit over the noise floor between which nothing material can be left: a fall by
MATERIAL of the squares would end below the floor. A ratio below the first means that the floor
itself is in doubt."""

ROUNDS = 3
"""Times that all accepted effects are tried against their rivals again, at most."""


@dataclass(frozen=True)
class Selection:
    """What was accepted, and why.

    steps : held-out errors as they fall; the first is the base
    rankings : the ranking that each accepted effect won; the last one may have no winner
    first : all candidates on top of the base
    """

    steps: tuple[Step, ...]
    rankings: tuple[Ranking, ...]
    first: Ranking


def select(
    search: Search,
    mechanism: Mechanism,
    start: Array,
    names: Sequence[str],
    rng: np.random.Generator,
) -> Selection:
    """Accept effects one after another while the held-out error falls materially.

    After each acceptance the earlier ones are tried again: dropped if idle, replaced if a rival
    does better now that others are present.

    Parameters
    ----------
    mechanism, start : the base structure, and its theta (P,) to start from
    names : of the candidates
    """
    steps = [search.step(search.base(mechanism, start), None)]
    rankings: list[Ranking] = []
    first: Ranking | None = None
    while len(steps) <= MOST:
        fitted = steps[-1].fitted
        above = search.above_floor(fitted)
        if len(steps) > 1 and AT_FLOOR[0] <= above <= AT_FLOOR[1]:
            break
        present = fitted.mechanism.structure.effects
        left = [name for name in names if name not in present]
        ranking = rank(search, fitted, left, rng, above)
        first = first or ranking
        rankings.append(ranking)
        best = ranking.best
        if best is None or best.fitted is None:
            break
        if ranking.p_values[best.name] > SIGNIFICANT or not ranking.is_material:
            break
        steps.append(search.step(best.fitted, best.name))
        if len(steps) > 2:
            steps, rankings = _reconsidered(search, steps, rankings, rng)
    assert first is not None
    return Selection(tuple(_judged_alike(search, steps)), tuple(rankings), first)


def _judged_alike(search: Search, steps: Sequence[Step]) -> list[Step]:
    """The steps with the last one's folds, so that their errors can be compared."""
    folds = steps[-1].fitted.held_out.folds
    return [
        step
        if step.fitted.held_out.folds == folds
        else search.step(step.fitted, step.effect, folds)
        for step in steps
    ]


def _reconsidered(
    search: Search, steps: list[Step], rankings: list[Ranking], rng: np.random.Generator
) -> tuple[list[Step], list[Ranking]]:
    """The accepted effects, each tried against its rivals with all others present."""
    given = steps[0].fitted.mechanism.structure.effects
    names = [step.effect for step in steps[1:] if step.effect]
    full = steps[-1].fitted
    won = list(rankings[: len(names)])
    for _ in range(ROUNDS):
        before = list(names)
        # The last first: it was chosen last, with the most known.
        for index in range(len(names) - 1, -1, -1):
            others = [*names[:index], *names[index + 1 :]]
            rivals = _rivals(won[index], others)
            if index == len(names) - 1 and names == before and full is steps[-1].fitted:
                continue  # its ranking is the one that it has just won
            mechanism = full.mechanism.with_effects((*given, *others))
            base = search.fit(mechanism, _shared(full, mechanism))
            again = rank(search, base, rivals, rng)
            if again.best is None or again.best.fitted is None or not again.is_material:
                del names[index], won[index]
                full = base
                break
            won[index] = again
            names[index] = again.best.name
            full = again.best.fitted
        if names == before:
            break
    if names == [step.effect for step in steps[1:]]:
        return steps, won
    return _walk(search, steps[0], names, full), won


def _rivals(ranking: Ranking, others: Sequence[str]) -> list[str]:
    """Candidates that took a good part of what the winner of a ranking took."""
    assert ranking.best is not None
    least = KEPT * ranking.fall
    found = [item.name for item in ranking.candidates if ranking.fall_of(item) > least]
    return [name for name in found if name not in others]


def _shared(fitted: Fitted, mechanism: Mechanism) -> Array:
    """Parameters of another structure, where this one left them."""
    known = dict(zip(fitted.mechanism.parameter_names, fitted.theta, strict=True))
    return np.array([known[name] for name in mechanism.parameter_names])


def _walk(search: Search, base: Step, names: Sequence[str], full: Fitted) -> list[Step]:
    """The steps to a set of effects, one after another."""
    given = base.fitted.mechanism.structure.effects
    steps = [base]
    for count, name in enumerate(names, start=1):
        mechanism = full.mechanism.with_effects((*given, *names[:count]))
        steps.append(search.step(search.fit(mechanism, _shared(full, mechanism)), name))
    return steps
