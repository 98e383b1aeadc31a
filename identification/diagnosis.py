"""Which physical effect is missing: adequacy, ranking, selection, ambiguity, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.candidates import Candidate, Fitted, contains, try_candidate
from identification.errors import (
    NoiseLevel,
    Squares,
    add_up,
    force_floor,
    force_traces,
    velocity_floor,
    velocity_traces,
)
from identification.folds import Fold, block_sums, make_folds
from identification.logs import Log
from identification.mecanum import Mecanum
from identification.noise import white_noise
from identification.regression import Fit, fit
from identification.segments import cut
from identification.significance import family_p_values, score_blocks
from youbot_env.errors import InputError
from youbot_env.model import Model

Array = NDArray[np.float64]

SIGNIFICANT = 0.01
"""Family-wise p-value below which an effect may be accepted."""

MATERIAL = 0.02
"""Least share of the held-out squared residual that an accepted effect must take away."""

MOST = 4
"""Effects accepted at most."""

TIED = 2.0
"""Standard errors within which two candidates cannot be told apart."""

KEPT = 0.5
"""Share of the best candidate's fall that a candidate must reach to count as tied."""

ABOVE_FLOOR = 1.25
"""Held-out force error over the noise floor above which something is left to explain."""

DOMINANT = 0.5
"""Share of the excess that a partial explanation must take to be named at all."""


@dataclass(frozen=True)
class Step:
    """One structure on the way: the effect accepted last, and held-out errors."""

    effect: str | None
    force_error: float
    velocity_error: float
    fitted: Fitted
    fold_thetas: Array

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.effect,
            "force_error": self.force_error,
            "velocity_error": self.velocity_error,
        }


@dataclass(frozen=True)
class Ranking:
    """All candidates on top of one structure, best first, with those that tie with the best."""

    candidates: tuple[Candidate, ...]
    p_values: dict[str, float]
    tied: tuple[str, ...]
    fall: float
    best: Candidate | None


@dataclass
class Diagnosis:
    """Result of :func:`diagnose`; :meth:`to_dict` is the JSON that the design fixes."""

    verdict: str
    missing: list[str]
    ambiguous_with: dict[str, list[str]]
    steps: list[Step]
    given_model: dict[str, float]
    noise_floor: dict[str, float]
    ranking: Ranking
    rankings: list[Ranking]
    fit: Fit
    mechanism: Any
    samples: list[Any]
    where: list[dict[str, Any]] = field(default_factory=list)
    remaining: list[dict[str, Any]] = field(default_factory=list)
    next_experiment: dict[str, Any] | None = None
    warnings: list[str] = field(default_factory=list)
    partial: list[str] = field(default_factory=list)
    seed: int = 0


class _Search:
    """The search for missing effects on one set of logs: fits, rankings, held-out errors."""

    def __init__(self, mechanism: Any, logs: Sequence[Log], seed: int, tick: Callable[[], None]):
        self.samples = [mechanism.samples(log) for log in logs]
        self.noise = [
            NoiseLevel(white_noise(log.velocity), white_noise(log.effort)) for log in logs
        ]
        self.seed, self.tick = seed, tick
        self.folds: list[Fold] = []

    def fit(self, mechanism: Any, start: Array) -> Fitted:
        """Joint fit on all logs."""
        result = fit(mechanism, self.samples, start)
        fitted = Fitted.at(mechanism, result.theta, self.samples)
        self.folds = self.folds or make_folds(fitted.rows)
        return fitted

    def step(self, fitted: Fitted, effect: str | None) -> Step:
        """Held-out force and velocity error of a structure."""
        steps = fitted.held_out(self.folds).steps
        thetas = np.tile(fitted.theta, (len(self.folds), 1))
        thetas[:, fitted.free] += steps
        force, velocity = [], []
        for fold, theta in zip(self.folds, thetas, strict=True):
            part = self.stretch(fold)
            force.append(Squares.of(force_traces(fitted.mechanism, theta, part)))
            velocity.append(Squares.of(velocity_traces(fitted.mechanism, theta, part)))
            self.tick()
        return Step(effect, add_up(force).ratio, add_up(velocity).ratio, fitted, thetas)

    def stretch(self, fold: Fold) -> Any:
        """The samples of a fold."""
        samples = self.samples[fold.log]
        if len(self.folds) == len(self.samples):
            return samples
        first, last = np.searchsorted(samples.time, [fold.start, fold.end])
        return cut(samples, int(first), int(last) + 1)

    def floor(self, fitted: Fitted) -> dict[str, float]:
        """What measurement noise alone would leave, at the fitted structure."""
        force, velocity = [], []
        for samples, noise in zip(self.samples, self.noise, strict=True):
            args = (fitted.mechanism, fitted.theta, samples)
            force.append(force_floor(*args, force_traces(*args), noise, self.seed))
            velocity.append(velocity_floor(*args, velocity_traces(*args), noise, self.seed))
        return {"force_error": add_up(force).ratio, "velocity_error": add_up(velocity).ratio}

    def rank(self, fitted: Fitted, names: Sequence[str], rng: np.random.Generator) -> Ranking:
        """Try each candidate on top of a structure."""
        base = fitted.held_out(self.folds)
        found = []
        for name in names:
            found.append(try_candidate(fitted, self.samples, self.folds, name))
            self.tick()
        found.sort(key=lambda item: item.result.square)
        step = fitted.rows[0].step
        scores = {
            item.name: score_blocks(fitted.residual, fitted.columns, item.columns, step)
            for item in found
        }
        p_values = family_p_values(scores, rng)
        best, tied = _choose(found, base.square, fitted, step)
        fall = 0.0 if best is None else 1.0 - best.result.square / base.square
        return Ranking(tuple(found), p_values, tied, fall, best)


def _choose(
    found: Sequence[Candidate], square: float, base: Fitted, step: float
) -> tuple[Candidate | None, tuple[str, ...]]:
    """The best candidate, a simpler one in its place if it does as well, and those that tie."""
    if not found or found[0].result.square >= square:
        return None, ()
    leader = found[0]
    fall = square - leader.result.square
    close = [
        item
        for item in found
        if square - item.result.square > KEPT * fall and _worse_by(item, leader, step) < TIED
    ]
    simplest = min(item.parameters for item in close)
    best = next(item for item in close if item.parameters == simplest)
    tied = [item.name for item in close if item is not best and not contains(item, best, base)]
    return best, tuple(tied)


def _worse_by(item: Candidate, leader: Candidate, step: float) -> float:
    """By how many standard errors of blocks a candidate's held-out residual is the larger one."""
    if item is leader:
        return 0.0
    difference = np.concatenate(
        [
            block_sums((a**2 - b**2).sum(axis=1), step)
            for a, b in zip(item.result.residual, leader.result.residual, strict=True)
        ]
    )
    spread = np.sqrt(len(difference)) * difference.std()
    return float(difference.sum() / max(spread, 1e-300))


def diagnose(
    model: Model,
    logs: Sequence[Log],
    *,
    effects: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
) -> Diagnosis:
    """Say which effects of the catalogue a model lacks on some logs.

    Parameters
    ----------
    model : its structure is where the search starts; its parameters are fitted again
    effects : candidates; the whole catalogue by default
    seed : of the bootstrap and of the noise floor
    progress : called after each candidate and each free run

    Raises
    ------
    InputError
        If no log is given, or the logs cannot show the model.
    """
    if not logs:
        raise InputError("no log given: diagnose needs at least one")
    mechanism = Mecanum(model.geometry, model.structure)
    search = _Search(mechanism, logs, seed, progress)
    rng = np.random.default_rng(seed)
    steps = [search.step(search.fit(mechanism, model.theta), None)]
    rankings: list[Ranking] = []
    accepted: list[str] = []
    ties: dict[str, list[str]] = {}
    names = list(effects) if effects is not None else list(mechanism.catalogue.names())
    while len(accepted) < MOST:
        fitted = steps[-1].fitted
        present = (*model.effects, *accepted)
        ranking = search.rank(fitted, [name for name in names if name not in present], rng)
        rankings.append(ranking)
        best = ranking.best
        if best is None or ranking.p_values[best.name] > SIGNIFICANT or ranking.fall < MATERIAL:
            break
        joint = search.fit(best.mechanism, best.theta)
        steps.append(search.step(joint, best.name))
        accepted.append(best.name)
        ties[best.name] = list(ranking.tied)
    last = steps[-1].fitted
    floor = search.floor(last)
    given = _given_errors(mechanism, model, search)
    result = Diagnosis(
        verdict="adequate",
        missing=accepted,
        ambiguous_with={name: tied for name, tied in ties.items() if tied},
        steps=steps,
        given_model=given,
        noise_floor=floor,
        ranking=rankings[0],
        rankings=rankings,
        fit=fit(last.mechanism, search.samples, last.theta),
        mechanism=last.mechanism,
        samples=search.samples,
        seed=seed,
    )
    return _verdict(result)


def _verdict(found: Diagnosis) -> Diagnosis:
    errors = [step.force_error for step in found.steps]
    left = errors[-1] > ABOVE_FLOOR * found.noise_floor["force_error"]
    if left:
        found.verdict = "unknown"
    elif found.ambiguous_with:
        found.verdict = "ambiguous"
    elif found.missing:
        found.verdict = "effect"
    return found


def _given_errors(mechanism: Any, model: Model, search: _Search) -> dict[str, float]:
    force = [Squares.of(force_traces(mechanism, model.theta, s)) for s in search.samples]
    velocity = [Squares.of(velocity_traces(mechanism, model.theta, s)) for s in search.samples]
    return {"force_error": add_up(force).ratio, "velocity_error": add_up(velocity).ratio}
