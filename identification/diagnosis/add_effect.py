"""Add one named effect to a model, fit everything again, and say whether it was worth it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from identification.diagnosis.ranking import MATERIAL, rank
from identification.diagnosis.search import Search, Step
from identification.diagnosis.selection import SIGNIFICANT
from identification.diagnosis.sentences import describe
from identification.logs.log import Log
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from youbot_env.errors import InputError


@dataclass(frozen=True)
class Addition:
    """Result of :func:`add_effect`.

    Attributes
    ----------
    before, after : held-out errors of the refitted model without and with the effect
    noise_floor : what measurement noise alone would leave, with the effect
    p_value : of the effect, by wild block bootstrap
    worthwhile : whether the fall is material and significant and the size plausible
    reasons : why it was not worth it, in words
    """

    effect: str
    model: Any
    before: Step
    after: Step
    noise_floor: dict[str, float]
    p_value: float
    worthwhile: bool
    reasons: tuple[str, ...]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        entries = self.model.effects[self.effect]
        return {
            "effect": self.effect,
            "before": _errors(self.before),
            "after": _errors(self.after),
            "noise_floor": self.noise_floor,
            "p_value": self.p_value,
            "worthwhile": self.worthwhile,
            "reasons": list(self.reasons),
            "words": self.sentence,
            "parameters": {
                name: {"value": e.value, "unit": e.unit, "std": e.std}
                for name, e in entries.items()
            },
        }


def _errors(step: Step) -> dict[str, float]:
    return {"force_error": step.force_error, "velocity_error": step.velocity_error}


def add_effect(
    model: AnyModel,
    effect: str,
    logs: Sequence[Log],
    *,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
) -> Addition:
    """Fit a model with one effect more, jointly, and judge it on held-out data.

    Parameters
    ----------
    model : its structure is the start; its parameters are fitted again
    effect : a name of the mechanism's catalogue
    seed : of the bootstrap and of the noise floor

    Raises
    ------
    InputError
        If the effect is unknown or in the model already, or no log is given.
    """
    if not logs:
        raise InputError("no log given: add needs at least one")
    mechanism = mechanism_of(model)
    item = mechanism.catalogue[effect]
    if effect in mechanism.structure.effects:
        raise InputError(f"the model holds {effect} already; identify fits it again")
    search = Search(mechanism, logs, seed, progress)
    base = search.base(mechanism, model.theta)
    ranking = rank(search, base, [effect], np.random.default_rng(seed))
    candidate = ranking.candidates[0]
    fitted = candidate.fitted or search.fit(candidate.mechanism, candidate.theta)
    after = search.step(fitted, effect)
    before = search.step(base, None, fitted.held_out.folds)
    result = search.final(fitted)
    new = kind_of(model).fitted_model(
        fitted.mechanism,
        result,
        name=model.name,
        logs=tuple(log.reference for log in logs),
        errors=_errors(after) | {"held_out": True},
        provenance={"command": "add", "effect": effect},
    )
    reasons = _doubts(before, after, ranking.p_values[effect], new.effects[effect], result, item)
    values = {name: e.value for name, e in new.effects[effect].items()}
    words = describe(item, values, {name: e.value for name, e in new.parameters.items()})
    return Addition(
        effect=effect,
        model=new,
        before=before,
        after=after,
        noise_floor=search.floor(fitted),
        p_value=ranking.p_values[effect],
        worthwhile=not reasons,
        reasons=tuple(reasons),
        sentence=words,
    )


def _doubts(
    before: Step, after: Step, p_value: float, entries: Any, result: Any, item: Any
) -> list[str]:
    found = []
    fall = 1.0 - (after.force_error / before.force_error) ** 2
    if fall < MATERIAL:
        found.append(
            f"the held-out squared force error falls by {max(fall, 0.0):.1%} only, "
            f"less than {MATERIAL:.0%}"
        )
    if p_value > SIGNIFICANT:
        found.append(f"chance alone does as much in {p_value:.1%} of cases")
    if result.bounded:
        found.append("a parameter stopped at its physical bound: sign or size are implausible")
    unsure = [
        name
        for name, entry in entries.items()
        if entry.std is not None and abs(entry.value) < 1.96 * entry.std
    ]
    strong = [name for name, entry in entries.items() if entry.std and name not in unsure]
    if unsure and not strong:
        found.append(f"the 95 % interval of {' and '.join(unsure)} holds zero")
    return found
