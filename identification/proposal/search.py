"""The search for the law that is missing: laws tried, sought closely, compared, and confirmed.

The search sees a part of the stretches of all logs. Laws are ranked there by the squares that they
leave of stretches which their strengths were not fitted on, with a penalty for length; chance is
judged family-wise over everything that was tried. Then the one law that won is judged on the
stretches that the search has not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.proposal.evidence import Evidence, Sums, Trial
from identification.proposal.law import Constant, FoundLaw, Law, Shapes, Verdict
from identification.proposal.settings import ProposalSettings
from identification.residual_map.bootstrap import family_wise_p_values, random_signs
from identification.threads import side_by_side

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tried:
    """A law at its best shape constants so far.

    Attributes
    ----------
    square : held-out squares of the stretches that the search sees
    score : (blocks,) of the best choice, as a strength of its own direction
    scores : per choice (blocks, q), for the family that chance has had
    refined : whether its shape constants have been sought
    """

    trial: Trial
    shapes: Shapes
    square: float
    sums: Sums | None = field(repr=False)
    scores: tuple[Array, ...] = field(default=(), repr=False)
    refined: bool = False

    @property
    def law(self) -> Law:
        """Which law."""
        return self.trial.law

    def law_at_best(self) -> Law:
        """The law, tried at its best shape constants alone."""
        best = dict(zip((c.name for c in self.law.shapes), self.shapes, strict=True))
        constants = tuple(
            replace(c, values=(best[c.name],)) if c.is_shape else c for c in self.law.constants
        )
        return replace(self.law, constants=constants)


Choices = Iterable[Shapes]


class Search:
    """One search on top of one structure.

    Parameters
    ----------
    predictable : share of the structure's squares that the motion predicts
    """

    def __init__(
        self,
        evidence: Evidence,
        predictable: float,
        seed: int,
        settings: ProposalSettings,
        progress: Callable[[], None] = lambda: None,
    ) -> None:
        self.evidence, self.predictable = evidence, predictable
        self.seed, self.settings, self.progress = seed, settings, progress
        self.known: list[Tried] = []

    def add(self, laws: Sequence[tuple[Law, Choices]]) -> None:
        """Try laws at their choices."""
        self.known += side_by_side(lambda pair: self._best(*pair), laws, self.progress)

    def _best(self, law: Law, values: Choices) -> Tried:
        trial = Trial(law)
        best = Tried(trial, (), np.inf, None)
        scores = []
        for shapes in values:
            tried = self._at(trial, shapes)
            assert tried.sums is not None
            score = self.evidence.scores(tried.sums, self.evidence.seen)
            if not np.isfinite(score).all():  # a law that overflows on this motion
                continue
            scores.append(score)
            if tried.square < best.square or best.sums is None:
                best = tried
        return replace(best, scores=tuple(scores))

    def _at(self, trial: Trial, shapes: Shapes) -> Tried:
        sums = self.evidence.sums(self.evidence.columns(trial, shapes))
        return Tried(trial, shapes, self.evidence.held_out(sums, trial), sums)

    # Ranking ------------------------------------------------------------------------------------

    def penalised(self, item: Tried) -> float:
        """Held-out squares with the penalty for length."""
        length = item.law.length + self.evidence.logs_apart(item.law)
        return item.square * (1.0 + self.settings.length_penalty * length)

    @property
    def leaders(self) -> list[Tried]:
        """All laws, best first."""
        found = [item for item in self.known if np.isfinite(item.square)]
        return sorted(found, key=lambda item: (self.penalised(item), item.law.name))

    def fall(self, item: Tried) -> float:
        """Share of the held-out squares that a law takes away."""
        return 1.0 - item.square / self.evidence.own_held_out

    def refine(self) -> None:
        """Seek the shape constants of the laws in the lead, of each once."""
        leaders = [
            item
            for item in self.leaders[: self.settings.refined]
            if self.fall(item) > 0 and not item.refined
        ]
        better = side_by_side(self._refined, leaders, self.progress)
        moved = {id(old): new for old, new in zip(leaders, better, strict=True)}
        self.known = [moved.get(id(item), item) for item in self.known]

    def _refined(self, item: Tried) -> Tried:
        own = self.evidence.own_held_out
        shapes = self._minimum(item, lambda tried: tried.square / own)
        best = self._at(item.trial, shapes)
        better = best if best.square < item.square else item
        return replace(better, scores=item.scores, refined=True)

    def _minimum(self, item: Tried, cost: Callable[[Tried], float]) -> Shapes:
        """Shape constants near those of a law at which a cost is least: a simplex search."""
        from scipy.optimize import minimize

        shapes = item.law.shapes
        free = [k for k, c in enumerate(shapes) if c.fitted and not c.whole]
        if not free:
            return item.shapes
        start = np.array([item.shapes[k] for k in free])
        steps = np.array([_step(shapes[k], item.shapes[k]) for k in free])
        low = np.array([shapes[k].lower for k in free])
        high = np.array([shapes[k].upper for k in free])

        def at(x: Array) -> Shapes:
            values = list(item.shapes)
            for k, value in zip(free, start + steps * x, strict=True):
                values[k] = float(value)
            return tuple(values)

        def bounded(x: Array) -> float:
            inside = start + steps * x
            if (inside < low).any() or (inside > high).any():
                return np.inf
            return cost(self._at(item.trial, at(x)))

        simplex = np.vstack([np.zeros(len(free)), 0.5 * np.eye(len(free))])
        options = {
            "initial_simplex": simplex,
            "maxfev": self.settings.refinement_steps * len(free),
            "xatol": 1e-3,
            "fatol": 1e-5,
        }
        with np.errstate(invalid="ignore"):  # differences of infinite costs
            return at(minimize(bounded, simplex[0], method="Nelder-Mead", options=options).x)

    # Judgement ----------------------------------------------------------------------------------

    def verdict(self) -> Verdict | None:
        """The best law and what speaks for it; None where none explains anything."""
        leaders = self.leaders
        if not leaders or self.fall(leaders[0]) <= 0:
            return None
        best, evidence = leaders[0], self.evidence
        assert best.sums is not None
        before, after = evidence.unseen_squares(best.sums)
        tried = len(self.known), sum(len(item.scores) for item in self.known)
        return Verdict(
            self._found(best),
            self.fall(best),
            1.0 - after / before,
            self._p_value(best),
            self._unseen_p_value(best.sums),
            tried,
            tuple(self._pareto(leaders)),
            tuple(self._alternatives(leaders)),
        )

    def settled(self, verdict: Verdict) -> Verdict:
        """The law that is confirmed, with shape constants from all stretches."""
        item, evidence = self.leaders[0], self.evidence
        whole = float(evidence.square.sum())

        def cost(tried: Tried) -> float:
            assert tried.sums is not None
            return evidence.fitted(tried.sums) / whole if np.isfinite(tried.square) else np.inf

        return replace(verdict, found=self._found(self._at(item.trial, self._minimum(item, cost))))

    def _found(self, item: Tried) -> FoundLaw:
        assert item.sums is not None
        everything = np.ones(len(self.evidence.unseen), bool)
        strengths = self.evidence.strengths(item.sums, everything)
        return self.evidence.values_of(item.trial, item.shapes, strengths)

    def _pareto(self, leaders: Sequence[Tried]) -> Iterator[tuple[FoundLaw, float]]:
        """Of each length the best law, as long as longer ones are better."""
        by_length = sorted(leaders, key=lambda item: (item.law.length, item.square))
        least = np.inf
        for item in by_length:
            if item.square < least * (1.0 - self.settings.length_penalty) and self.fall(item) > 0:
                least = item.square
                yield self._found(item), item.square / self.evidence.own_held_out

    def _alternatives(self, leaders: Sequence[Tried]) -> Iterator[tuple[FoundLaw, float]]:
        """Laws that unseen stretches cannot tell from the best one, best first: what they leave
        more there is no more than chance makes it."""
        best, *others = leaders[: self.settings.compared]
        assert best.sums is not None
        left, told = self.evidence.unseen_left(best.sums), {best.law.name}
        for item in others:
            assert item.sums is not None
            if item.law.name in told:
                continue  # the same law near another period
            more = self.evidence.unseen_left(item.sums) - left
            size = float(np.sqrt((more**2).sum()))
            if self.fall(item) > 0 and more.sum() <= self.settings.alike_deviations * size:
                told.add(item.law.name)
                yield self._found(item), item.square / self.evidence.own_held_out

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    def _p_value(self, best: Tried) -> float:
        """Family-wise, over all laws and shape constants that were tried."""
        assert best.sums is not None
        mine = self.evidence.scores(best.sums, self.evidence.seen)
        family = [score for item in self.known for score in item.scores]
        signs = random_signs(self._rng, self.settings.bootstrap_draws, len(mine))
        null = np.full(len(signs), -np.inf)
        for score in [mine, *family]:
            null = np.maximum(null, _statistic(signs @ (score @ _whitening(score))))
        observed = _statistic(mine.sum(axis=0) @ _whitening(mine))
        return float(family_wise_p_values(np.array([observed]), null[None])[0])

    def _unseen_p_value(self, sums: Sums) -> float:
        """Of the law as the seen stretches have it, on the others: one law, one direction."""
        score = self.evidence.unseen_scores(sums)
        signs = random_signs(self._rng, self.settings.bootstrap_draws, len(score))
        return float((1 + (signs @ score >= score.sum()).sum()) / (1 + len(signs)))


def _step(constant: Constant, here: float) -> float:
    """How far a search for a shape constant begins: the way to the next value that was tried."""
    if constant.step:
        return constant.step
    others = [abs(value - here) for value in constant.values if abs(value - here) > 1e-9]
    return min(others) if others else 0.3 * abs(here) or 1.0


def _whitening(blocks: Array) -> Array:
    """(q, Q) that makes the block sums' scores uncorrelated, of unit variance each."""
    values, vectors = np.linalg.eigh(blocks.T @ blocks)
    keep = values > 1e-10 * max(float(values.max()), 1e-300)
    return vectors[:, keep] / np.sqrt(values[keep])


def _statistic(whitened: Array) -> Array:
    """Wilson and Hilferty's normal score of a chi-square statistic, comparable across sizes."""
    size = whitened.shape[-1]
    if size == 0:
        return np.full(whitened.shape[:-1], -np.inf)
    spread = 2.0 / (9.0 * size)
    statistic = (whitened**2).sum(axis=-1)
    return ((statistic / size) ** (1 / 3) - (1 - spread)) / np.sqrt(spread)
