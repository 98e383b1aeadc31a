"""Add one named effect to a model, fit everything again, and say whether it was worth it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from identification.diagnosis.addition import Addition
from identification.diagnosis.candidates import (
    fit_base,
    fit_structure,
    rank,
)
from identification.diagnosis.kinematic_stage import accepted_kinematics, wheel_evidence
from identification.diagnosis.report import describe_in
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import FittedStructure, LoggedData, Step
from identification.fitting.final_fit import final_fit
from identification.logs.log import Log, shared_clock
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from identification.mechanisms.residual_maps import (
    refuse_unseen_logs,
    sentence_of_map,
    with_map_over,
)
from identification.mechanisms.samples import Samples
from identification.threads import in_one_blas_thread
from youbot_env.errors import InputError
from youbot_env.physics.residual_maps import is_map


@in_one_blas_thread
def add_effect(
    model: AnyModel,
    effect: str,
    logs: Sequence[Log],
    *,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
    settings: DiagnosisSettings = DiagnosisSettings(),
) -> Addition:
    """Fit a model with one effect more, jointly, and judge it on held-out data.

    Parameters
    ----------
    model : its structure is the start; its parameters are fitted again
    effect : a name of the mechanism's catalogue
    seed : of the bootstrap and of the noise floor
    settings : all numbers that the judgement depends on

    Raises
    ------
    InputError
        If the effect is unknown or in the model already, or no log is given.
    """
    if not logs:
        raise InputError("no log given: add needs at least one")
    added = (_Map if is_map(effect) else _Named)(effect)
    _ = mechanism_of(model).catalogue[effect]  # it knows the effect, or says which it knows
    model, settings = added.start(model), added.settings(settings)
    mechanism = mechanism_of(model, settings=settings.fit.mechanism)
    data = LoggedData(mechanism, logs, seed, progress, settings)
    mechanism = added.over(mechanism, data.samples)
    refuse_unseen_logs(mechanism, model.theta, data.samples)
    wheels = wheel_evidence(data, mechanism, model.theta, [effect])
    base = fit_base(data, mechanism, model.theta)
    placed = added.on_clock(data, base)
    if placed is not data:  # the base model is beside it on the same logs
        data, base = placed, fit_base(placed, mechanism, model.theta)
    if wheels.accepted:
        # Wheels and pose show it: its size comes from there, as in a diagnosis.
        _, (ranking,) = accepted_kinematics(data, data.step(base, None), wheels, fit_structure)
    else:
        ranking = rank(data, base, [effect], np.random.default_rng(seed))
    candidate = ranking.candidates[0]
    fitted = candidate.fitted or fit_structure(data, candidate.mechanism, candidate.theta)
    after = data.step(fitted, effect)
    # With the folds of the larger structure: errors can be compared only on the same folds.
    before = data.step(base, None, fitted.held_out.folds)
    args = (fitted.mechanism, data.samples, data.noise, fitted.theta, seed, settings.fit)
    result = wheels.widened(fitted.mechanism, final_fit(*args))
    new = kind_of(model).fitted_model(
        fitted.mechanism,
        result,
        name=model.name,
        logs=tuple(log.reference for log in logs),
        errors={**after.errors, "held_out": True},
        provenance={"command": "add", "effect": effect, "clock": shared_clock(logs)},
    )
    p_value = ranking.p_values[effect]
    reasons = [
        *_errors_that_doubt(before, after, p_value, settings),
        *_parameters_that_doubt(
            effect,
            added.judged_one_by_one(new),
            [fitted.mechanism.labels[result.free[k]].component for k in result.bounded],
            settings.fit.interval_deviations,
            new,
        ),
    ]
    return Addition(
        effect=effect,
        model=new,
        before=before,
        after=after,
        noise_floor=data.floor(fitted).to_dict(),
        p_value=p_value,
        worthwhile=not reasons,
        reasons=tuple(reasons),
        sentence=added.sentence(new, settings),
        samples=tuple(data.samples),
        settings=settings,
    )


@dataclass(frozen=True)
class _Named:
    """An effect of the catalogue that is added."""

    name: str

    def start(self, model: AnyModel) -> AnyModel:
        """The model that it is added to."""
        if self.name in model.effects:
            raise InputError(f"the model holds {self.name} already; identify fits it again")
        return model

    def settings(self, given: DiagnosisSettings) -> DiagnosisSettings:
        """The settings under which it is judged."""
        return given

    def over(self, mechanism: Mechanism[Any], samples: Sequence[Samples]) -> Mechanism[Any]:
        """The mechanism, whose catalogue has it as the logs want it."""
        return mechanism

    def on_clock(self, data: LoggedData, base: FittedStructure) -> LoggedData:
        """The logs, each begun where in its period it is best explained, if it swings in time."""
        more = base.mechanism.extended(self.name)
        defaults = list(more.catalogue[self.name].defaults.values())
        return data.on_clock_of(more, np.concatenate([base.theta, defaults]), first=True)

    def judged_one_by_one(self, fitted: AnyModel) -> Mapping[str, Any]:
        """Its parameters of which one that is sure speaks for it."""
        return fitted.effects[self.name]

    def sentence(self, fitted: AnyModel, settings: DiagnosisSettings) -> str:
        """What it is, with its size."""
        return describe_in(fitted, mechanism_of(fitted).catalogue[self.name])


class _Map(_Named):
    """A map of the residual that is added."""

    def start(self, model: AnyModel) -> AnyModel:
        """The model without it: it is drawn anew, over the range of these logs."""
        if self.name not in model.effects:
            return model
        left = {name: values for name, values in model.effects.items() if name != self.name}
        return replace(model, effects=left, covariance=None, covariance_names=())

    def settings(self, given: DiagnosisSettings) -> DiagnosisSettings:
        """Blocks of every log are held out in turn."""
        blocks = {"blocks_of_single_log": given.proposal.map_blocks, "min_lone_share": NO_SHARE}
        return replace(given, fit=replace(given.fit, **blocks))

    def over(self, mechanism: Mechanism[Any], samples: Sequence[Samples]) -> Mechanism[Any]:
        """Over the range that the logs pass."""
        return with_map_over(mechanism, self.name, samples)

    def judged_one_by_one(self, fitted: AnyModel) -> Mapping[str, Any]:
        """None: its humps overlap, and none may be sure alone though their sum is."""
        return {}

    def sentence(self, fitted: AnyModel, settings: DiagnosisSettings) -> str:
        """What it is, how large, and where it holds."""
        return sentence_of_map(fitted, self.name, settings.proposal.map_points)


NO_SHARE = float(np.finfo(float).tiny)
"""Any log shows some column alone, by this."""


def _errors_that_doubt(
    before: Step, after: Step, p_value: float, settings: DiagnosisSettings
) -> list[str]:
    """Why the fall of the held-out error does not speak for the effect."""
    found = []
    fall = 1.0 - (after.force_error / before.force_error) ** 2
    if fall < 0:
        found.append(f"the held-out squared force error rises by {-fall:.1%}")
    elif fall < settings.min_share_of_residual:
        found.append(
            f"the held-out squared force error falls by {fall:.1%} only, "
            f"less than {settings.min_share_of_residual:.0%}"
        )
    if p_value > settings.max_p_value:
        found.append(f"chance alone does as much in {p_value:.1%} of cases")
    return found


def _parameters_that_doubt(
    owner: str,
    entries: Mapping[str, Any],
    bounded: Sequence[str],
    deviations: float,
    fitted: AnyModel,
) -> list[str]:
    """Why the effect's parameters do not speak for it.

    Parameters
    ----------
    owner, entries : the effect, and its parameters in the fitted model
    bounded : components with a parameter that stopped at its bound. One of the base model says
        nothing against the effect: more may be missing
    deviations : standard deviations either side of a value that hold the truth in 95 % of cases
    fitted : the whole model, with what the parameters' errors have to do with each other
    """
    found = []
    if owner in bounded:
        found.append("a parameter stopped at its physical bound: sign or size are implausible")
    unsure = [
        name
        for name, entry in entries.items()
        if entry.std is not None and abs(entry.value) < deviations * entry.std
    ]
    strong = [name for name, entry in entries.items() if entry.std and name not in unsure]
    # One sure parameter is enough: the place of a payload may be unsure while its mass is not. So
    # is one sure sum of them: what two wheels drag together, where nothing tells which of them.
    if unsure and not strong and not _are_sure_together(owner, unsure, fitted, deviations):
        found.append(f"the 95 % interval of {' and '.join(unsure)} holds zero")
    return found


def _are_sure_together(
    owner: str, names: Sequence[str], fitted: AnyModel, deviations: float
) -> bool:
    """Whether the sum of sizes of an effect's parameters is surely not zero."""
    known = list(fitted.covariance_names)
    places = [known.index(key) for name in names if (key := f"{owner}.{name}") in known]
    if fitted.covariance is None or len(places) < 2:
        return False
    values = np.array([fitted.values[known[k]] for k in places])
    sign = np.sign(values)
    variance = float(sign @ fitted.covariance[np.ix_(places, places)] @ sign)
    return bool(np.abs(values).sum() > deviations * np.sqrt(max(variance, 0.0)))
