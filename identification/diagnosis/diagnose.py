"""Which physical effect is missing: adequacy, ranking, selection, ambiguity, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.candidates import Candidate, Fitted
from identification.diagnosis.experiment_design import best_experiment
from identification.diagnosis.ranking import Ranking
from identification.diagnosis.search import Search, Step, given_errors
from identification.diagnosis.selection import select
from identification.diagnosis.sentences import describe
from identification.diagnosis.threads import side_by_side
from identification.fitting.least_squares import Fit, fit
from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from identification.residual_map.residual_map import ResidualMap, residual_map
from youbot_env.errors import InputError

Array = NDArray[np.float64]

ABOVE_FLOOR = 1.25
"""Held-out force error over the noise floor above which something is left to explain."""

DOMINANT = 0.5
"""Share of the excess over the floor that an effect must take to be named beside "unknown"."""

CHANGED = 1.5
"""Given model's force error over the refitted one's from which on its parameters have changed."""


@dataclass(frozen=True)
class Diagnosis:
    """Result of :func:`diagnose`; :meth:`to_dict` is its JSON form.

    Attributes
    ----------
    verdict : "adequate", "effect", "ambiguous" or "unknown"
    missing : accepted effects, in order; of an ambiguous set its best member
    ambiguous_with : what the data cannot tell apart from an accepted effect
    partial : accepted effects that explain their share, while something else remains
    steps : held-out errors as they fall; the first is the refitted base
    rankings : all candidates, on top of each step
    fitted_model : the refitted model with the accepted effects; None where its parameters are not
        physical, and ``unphysical`` says why
    maps : what the residual depends on, before and after the accepted effects
    sentences : the verdict in words
    """

    verdict: str
    missing: tuple[str, ...]
    ambiguous_with: dict[str, list[str]]
    partial: tuple[str, ...]
    steps: tuple[Step, ...]
    rankings: tuple[Ranking, ...]
    fitted_model: Any | None
    mechanism: Mechanism
    samples: tuple[Any, ...]
    given_model: dict[str, float]
    noise_floor: dict[str, float]
    maps: tuple[ResidualMap, ...]
    next_experiment: dict[str, Any] | None
    warnings: tuple[str, ...]
    sentences: tuple[str, ...] = ()
    candidates: list[dict[str, Any]] = field(default_factory=list)
    unphysical: str = ""

    @property
    def model(self) -> Any:
        """The refitted model with the accepted effects.

        Raises
        ------
        InputError
            If the logs do not show its parameters: what the fit found is not physical.
        """
        if self.fitted_model is None:
            raise InputError(
                f"no model: these logs do not show the base parameters ({self.unphysical}); "
                "`youbot doctor` names the motions that would"
            )
        return self.fitted_model

    @property
    def where(self) -> list[dict[str, Any]]:
        """Shares of the base model's residual by variable."""
        return self.maps[0].to_list()

    @property
    def remaining(self) -> list[dict[str, Any]]:
        """The same after the last accepted effect."""
        return self.maps[1].to_list() if len(self.maps) > 1 else []

    def to_dict(self) -> dict[str, Any]:
        """JSON form, as the design fixes it."""
        return {
            "verdict": self.verdict,
            "missing": list(self.missing),
            "ambiguous_with": self.ambiguous_with,
            "partial": list(self.partial),
            "steps": [step.to_dict() for step in self.steps],
            "given_model": self.given_model,
            "noise_floor": self.noise_floor,
            "candidates": self.candidates,
            "where": self.where,
            "remaining": self.remaining,
            "next_experiment": self.next_experiment,
            "words": list(self.sentences),
            "warnings": list(self.warnings),
        }


def diagnose(
    model: AnyModel,
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
    effects : candidates; the mechanism's whole catalogue by default
    seed : of the bootstrap and of the noise floor
    progress : called after each candidate and each free run

    Raises
    ------
    InputError
        If no log is given, or the logs cannot show the model.
    """
    if not logs:
        raise InputError("no log given: diagnose needs at least one")
    mechanism = mechanism_of(model)
    search = Search(mechanism, logs, seed, progress)
    names = list(effects) if effects is not None else list(mechanism.catalogue.names())
    chosen = select(search, mechanism, model.theta, names, np.random.default_rng(seed))
    steps, rankings = list(chosen.steps), chosen.rankings
    floor = search.floor(steps[-1].fitted)
    unexplained = steps[-1].force_error > ABOVE_FLOOR * floor["force_error"]
    if unexplained:
        steps = _drop_minor(steps, floor["force_error"])
        floor = search.floor(steps[-1].fitted)
    accepted = [step.effect for step in steps if step.effect]
    ties = {
        ranking.best.name: list(ranking.tied)
        for ranking in rankings
        if ranking.best and ranking.tied and ranking.best.name in accepted
    }
    verdict = _verdict(unexplained, bool(ties), bool(accepted))
    shown = [steps[0].fitted, steps[-1].fitted] if accepted else [steps[0].fitted]
    tasks = [
        partial(search.final, steps[-1].fitted),
        *(partial(_map, fitted, search) for fitted in shown),
    ]
    final, *maps = side_by_side(lambda task: task(), tasks, progress)
    given = given_errors(mechanism, model.theta, search.samples)
    try:
        fitted_model = _model(steps[-1].fitted.mechanism, final, model, logs, steps, floor)
        sized, unphysical = fitted_model, ""
    except InputError as error:
        fitted_model, unphysical = None, str(error).removeprefix(f"model {model.name}: ")
        sized = _at_given_base(steps[-1].fitted, model, search) if accepted else model
    return Diagnosis(
        verdict=verdict,
        missing=tuple(accepted),
        ambiguous_with=ties,
        partial=tuple(accepted) if unexplained else (),
        steps=tuple(steps),
        rankings=rankings,
        fitted_model=fitted_model,
        mechanism=steps[-1].fitted.mechanism,
        samples=tuple(search.samples),
        given_model=given,
        noise_floor=floor,
        maps=tuple(maps),
        next_experiment=_next_experiment(search, steps, rankings, ties, seed),
        warnings=tuple(_warnings(logs, given, steps, unphysical)),
        sentences=tuple(_sentences(sized, steps, verdict, ties, floor)),
        candidates=_candidate_list(chosen.first, steps, sized),
        unphysical=unphysical,
    )


def _drop_minor(steps: list[Step], floor: float) -> list[Step]:
    """Where something unknown remains: at most the first effect, if it takes most of the excess."""
    if len(steps) < 2:
        return steps
    before, after = steps[0].force_error ** 2, steps[1].force_error ** 2
    dominant = before - after > DOMINANT * (before - floor**2)
    return steps[:2] if dominant else steps[:1]


def _verdict(unexplained: bool, tied: bool, accepted: bool) -> str:
    if unexplained:
        return "unknown"
    if tied:
        return "ambiguous"
    return "effect" if accepted else "adequate"


def _model(
    mechanism: Mechanism,
    final: Fit,
    model: AnyModel,
    logs: Sequence[Log],
    steps: Sequence[Step],
    floor: dict[str, float],
) -> Any:
    errors = {
        "force_error": steps[-1].force_error,
        "velocity_error": steps[-1].velocity_error,
        "held_out": True,
        "noise_floor": floor,
    }
    return kind_of(model).fitted_model(
        mechanism,
        final,
        name=model.name,
        logs=tuple(log.reference for log in logs),
        errors=errors,
        provenance={"command": "diagnose"},
    )


def _at_given_base(fitted: Fitted, model: AnyModel, search: Search) -> Any:
    """The accepted effects fitted beside the given model's parameters, which stay.

    For their sizes in words, where the logs do not show the parameters that were given.
    """
    known = len(model.theta)
    start = np.concatenate([model.theta, fitted.theta[known:]])
    free = fitted.mechanism.free & (np.arange(len(start)) >= known)
    found = fit(fitted.mechanism, search.samples, start, free=free)
    return kind_of(model).fitted_model(fitted.mechanism, found, name=model.name)


def _map(fitted: Fitted, search: Search) -> ResidualMap:
    return residual_map(fitted.mechanism, fitted.theta, search.samples, seed=search.seed)


def _next_experiment(
    search: Search,
    steps: Sequence[Step],
    rankings: Sequence[Ranking],
    ties: dict[str, list[str]],
    seed: int,
) -> dict[str, Any] | None:
    """The motion that best separates the first tie, if the mechanism knows motions."""
    if not ties:
        return None
    motions = search.mechanism.motions(seed)
    ranking = next(r for r in rankings if r.best and r.best.name in ties)
    tied = [item for item in ranking.candidates if item.name in ranking.tied and item.fitted]
    assert ranking.best is not None and ranking.best.fitted is not None
    if not tied or not motions:
        return None
    noise = float(np.sqrt(np.mean([np.mean(r**2) for r in steps[-1].fitted.residual])))
    return best_experiment(motions, _named(ranking.best), [_named(item) for item in tied], noise)


def _named(item: Candidate) -> tuple[str, Any, Array]:
    assert item.fitted is not None
    return item.name, item.fitted.mechanism, item.fitted.theta


def _warnings(
    logs: Sequence[Log], given: dict[str, float], steps: Sequence[Step], unphysical: str
) -> list[str]:
    found = [line for log in logs for line in log.warnings]
    if given["force_error"] > CHANGED * steps[0].force_error:
        found.append(
            f"the given model's own parameters no longer fit (force error "
            f"{given['force_error']:.1%}, refitted {steps[0].force_error:.1%}): they have changed"
        )
    if unphysical:
        found.append(
            f"these logs do not show the base parameters ({unphysical}): there is no model to "
            "write, and sizes are those beside the given model's parameters"
        )
    return found


def _sentences(
    model: Any,
    steps: Sequence[Step],
    verdict: str,
    ties: dict[str, list[str]],
    floor: dict[str, float],
) -> list[str]:
    found = []
    for step in steps[1:]:
        assert step.effect is not None
        effect = step.fitted.mechanism.catalogue[step.effect]
        values = {name: e.value for name, e in model.effects[step.effect].items()}
        base = {name: e.value for name, e in model.parameters.items()}
        sentence = describe(effect, values, base)
        others = ties.get(step.effect)
        if others:
            sentence += f"; these logs cannot tell it from {' or '.join(others)}"
        found.append(sentence)
    last, level = steps[-1].force_error, floor["force_error"]
    if verdict == "adequate":
        found.append(
            f"the model is adequate: what it leaves ({last:.2%}) is noise (floor {level:.2%})"
        )
    elif verdict == "unknown":
        part = "explains a part, but something" if len(steps) > 1 else "something"
        found.append(
            f"{part} is missing that no effect of the catalogue explains: {last:.2%} remains "
            f"where noise would leave {level:.2%}"
        )
    return found


def _candidate_list(ranking: Ranking, steps: Sequence[Step], model: Any) -> list[dict[str, Any]]:
    """First-step candidates, best first; an accepted one with its parameters in the final fit.

    Their errors are at the base's own noise and folds, by which they are ranked.
    """
    base = steps[0].fitted
    found = []
    for item in ranking.candidates:
        ratio = np.sqrt(max(item.square, 0.0) / max(ranking.square, 1e-300))
        found.append(
            {
                "effect": item.name,
                "force_error": float(steps[0].force_error * ratio),
                "p_value": ranking.p_values[item.name],
                "parameters": _parameters(item, base, model),
            }
        )
    return found


def _parameters(item: Candidate, base: Fitted, model: Any) -> dict[str, Any]:
    if item.name in model.effects:
        entries = model.effects[item.name]
        return {
            name: {"value": e.value, "unit": e.unit, "std": e.std} for name, e in entries.items()
        }
    theta = item.theta.copy()
    if item.fitted is None:
        theta[item.free] += item.result.step
    effect = item.mechanism.catalogue[item.name]
    # The candidate's parameters are the last ones: it was put on top of the fitted structure.
    own = theta[len(theta) - len(effect.parameter_names) :]
    public = effect.to_public(getattr(item.mechanism, "geometry", None), own)
    return {
        name: {"value": value, "unit": effect.public_parameter(name).unit, "std": None}
        for name, value in zip(effect.public_names, public, strict=True)
    }
