"""The result of a diagnosis: verdict, errors as they fall, candidates, and sentences on them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from identification.diagnosis.sentences import describe
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import Candidate, Ranking, Step, count_settled
from identification.fitting.changed_parameters import ParameterChanges
from identification.fitting.kinematic_evidence import TellingSlip
from identification.fitting.late_efforts import LateEfforts
from identification.fitting.misfit import stated_estimates
from identification.fitting.predictability import too_short
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import StatedParameters
from identification.mechanisms.samples import Samples
from identification.proposal.proposal import Proposal, sizes_in_words
from identification.residual_map.regime import Regime
from identification.residual_map.shares import ResidualMap
from identification.showing import Shown
from youbot_env.model.model import Model
from youbot_env.physics.effect import Parameter, effect_of


class FaultOfLogs(Protocol):
    """What is wrong with the logs, so that no model holds on them and no law is sought.

    brief : in a headline; words : with what to do
    """

    @property
    def brief(self) -> str: ...

    @property
    def words(self) -> str: ...


def faults_of_logs(late: LateEfforts | None, slip: TellingSlip | None) -> list[FaultOfLogs]:
    """Those that there are, in the order in which they are told."""
    found: tuple[FaultOfLogs | None, ...] = (late, slip)
    return [fault for fault in found if fault is not None]


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Result of :func:`diagnose`; :meth:`to_dict` is its JSON form.

    Attributes
    ----------
    verdict : "adequate", "effect", "ambiguous" or "unknown"
    missing : accepted effects, in order; if several are ambiguous, the best one
    ambiguous_with : what the data cannot tell apart from an accepted effect
    partial : accepted effects, if they explain only a part and something unknown remains
    steps : held-out errors as they fall; the first is the refitted base. Names of effects in
        steps and rankings tell instances apart: floor_tilt@2 acts in the second log alone
    rankings : all candidates, on top of each step
    model : refitted, with the accepted effects, and without a proposed law; see ``told``
    maps : what the residual depends on, before and after the accepted effects
    sentences : the verdict in words
    regime : where what remains lives, of an unknown rest; None if no rule says so
    proposal : a law beyond the catalogue for an unknown rest; None if none was found
    changes : the given model's parameters beside the refitted ones
    slip : of the wheels, where it is worth a word
    late : efforts that come later than the others', where some do
    settings : all numbers that the verdict depends on
    """

    verdict: str
    missing: tuple[str, ...]
    ambiguous_with: dict[str, list[str]]
    partial: tuple[str, ...]
    steps: tuple[Step, ...]
    rankings: tuple[Ranking, ...]
    model: Any
    mechanism: Mechanism
    samples: tuple[Samples, ...]
    given_model: dict[str, float]
    noise_floor: dict[str, float]
    maps: tuple[ResidualMap, ...]
    next_experiment: dict[str, Any] | None
    warnings: tuple[str, ...]
    sentences: tuple[str, ...] = ()
    candidates: list[dict[str, Any]] = field(default_factory=list)
    settings: DiagnosisSettings = field(default_factory=DiagnosisSettings)
    told_first: int = 0
    regime: Regime | None = None
    proposal: Proposal | None = None
    changes: ParameterChanges = field(default_factory=ParameterChanges)
    slip: TellingSlip | None = None
    late: LateEfforts | None = None

    kind: ClassVar[str] = "diagnosis"

    def summary(self) -> str:
        """The verdict in one sentence, with how far the error falls."""
        names = listed([name.replace("_", " ") for name in self.missing]) if self.missing else ""
        line = HEADLINES[self.verdict].format(missing=names)
        fault = next(iter(faults_of_logs(self.late, self.slip)), None)
        if self.verdict == "unknown" and (names or fault):
            rest = fault.brief if fault else "something that no effect of the catalogue explains"
            line = f"The model lacks {names}, and {rest}" if names else _as_a_beginning(rest)
        first, last = self.steps[0].force_error, self.steps[-1].force_error
        noise = f"noise {self.noise_floor['force_error']:.2%}"
        if len(self.steps) == 1:
            return f"{line}: force error {first:.2%}, {noise}"
        small = 1.0 - (last / first) ** 2 < self.settings.min_share_of_residual
        if small and not self.mechanism.structure.changes_kinematics:
            # Where a mechanism stands nothing is judged, but this error is that of all rows.
            before, after = self.steps[0].velocity_error, self.steps[-1].velocity_error
            return (
                f"{line}: the force error is {last:.2%}, after {first:.2%}, and the velocity error "
                f"{after:.2%}, after {before:.2%} ({noise})"
            )
        if small:
            # Effects of kinematics are accepted by what wheels and pose show.
            posed = any(item.pose_measured for item in self.samples)
            shown = "the wheel speeds and the pose show" if posed else "the wheel speeds show"
            return f"{line}: {shown} it; the force error is {last:.2%}, after {first:.2%} ({noise})"
        return f"{line}: the force error falls from {first:.2%} to {last:.2%} ({noise})"

    def rows(self) -> list[dict[str, Any]]:
        """The error as it falls, held out; the last row is that with a proposed law."""
        rows: list[tuple[str, Step | Proposal]] = [
            (effect_of(step.effect) if step.effect else "the model, refitted", step)
            for step in self.steps
        ]
        if self.proposal is not None:
            rows.append((f"{self.proposal.name} (proposed)", self.proposal))
        return [
            {"with": name, "force error": of.force_error, "velocity error": of.velocity_error}
            for name, of in rows
        ]

    @property
    def told(self) -> Model[Any] | StatedParameters:
        """The parameters that are told: of the fit with the proposed law, if there is one; else of
        ``model``. Without the law, those of effects and base hold a part of it."""
        return self.model if self.proposal is None else self.proposal.joint

    @property
    def first_warnings(self) -> tuple[str, ...]:
        """What is wrong with the logs, which makes all that follows doubtful."""
        return self.warnings[: self.told_first]

    @property
    def where(self) -> list[dict[str, Any]]:
        """Shares of the base model's residual by variable."""
        return self.maps[0].to_list()

    @property
    def remaining(self) -> list[dict[str, Any]]:
        """The same after the last accepted effect."""
        return self.maps[1].to_list() if len(self.maps) > 1 else []

    @property
    def explained_share(self) -> float | None:
        """Of what was predictable beyond the base model, held out, the share that effects take.

        None where nothing was predictable.
        """
        return explained_share(self.steps)

    @property
    def _episodes(self) -> list[tuple[int, float, float]]:
        found = self.steps[-1].predictable
        return found.episodes if found.is_episodic else []

    @property
    def logs(self) -> dict[str, list[str]]:
        """Of accepted effects that act in some logs only, the names of these logs."""
        found: dict[str, list[str]] = {}
        for step in self.steps[1:]:
            if step.effect and step.logs:
                named = found.setdefault(effect_of(step.effect), [])
                named += [name for name in step.logs if name not in named]
        return found

    @property
    def explained(self) -> list[dict[str, Any]]:
        """Each accepted effect's own part of that share, in order."""
        whole = _predictable_square(self.steps)
        return [
            {
                "effect": effect_of(after.effect or ""),
                **({"logs": list(after.logs)} if after.logs else {}),
                "share": (before.force_error**2 - after.force_error**2) / whole,
            }
            for before, after in zip(self.steps, self.steps[1:], strict=False)
            if whole > 0
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON form, as the design fixes it."""
        return {
            "verdict": self.verdict,
            "headline": self.summary(),
            "missing": list(self.missing),
            "logs": self.logs,
            "ambiguous_with": self.ambiguous_with,
            "partial": list(self.partial),
            "steps": [step.to_dict() for step in self.steps],
            "explained_share": self.explained_share,
            "explained": self.explained,
            "predictable_share": self.steps[-1].predictable.share_of_motion,
            "episodes": [
                {"log": self.samples[log].name, "from": start, "to": end}
                for log, start, end in self._episodes
            ],
            "given_model": self.given_model,
            "changes": self.changes.to_dict(),
            "noise_floor": self.noise_floor,
            "candidates": self.candidates,
            "where": self.where,
            "remaining": self.remaining,
            "slip": None if self.slip is None else self.slip.share,
            "late": None if self.late is None else self.late.to_dict(),
            "regime": self.regime and self.regime.rule,
            "proposal": self.proposal and self.proposal.to_dict(),
            "next_experiment": self.next_experiment,
            "words": list(self.sentences),
            "warnings": list(self.warnings),
            "settings": self.settings.to_dict(),
        }


def _as_a_beginning(line: str) -> str:
    """With a capital letter, unless a column's name stands first."""
    return line if "_" in line.split()[0] else line[0].upper() + line[1:]


def effects_of(names: Sequence[str]) -> tuple[str, ...]:
    """Names of the effects behind names of instances, each once, in order."""
    return tuple(dict.fromkeys(map(effect_of, names)))


def plain_ties(ties: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Ties between instances, under the names of their effects."""
    found: dict[str, list[str]] = {}
    for name, others in ties.items():
        effect = effect_of(name)
        rivals = [other for other in effects_of(others) if other != effect]
        if rivals:
            found[effect] = [*dict.fromkeys([*found.get(effect, []), *rivals])]
    return found


HEADLINES = {
    "adequate": "Nothing is missing that these logs could show",
    "effect": "The model lacks {missing}",
    "ambiguous": "The model lacks {missing}, or what these logs cannot tell from it",
    "unknown": "Something is missing that no effect of the catalogue explains",
    "in part": "The model lacks {missing}, and something that no effect of the catalogue explains",
}
"""The verdict in words."""


def _predictable_square(steps: Sequence[Step]) -> float:
    """Squared force error of the base model that is no noise: what a model could still explain."""
    last = steps[-1]
    share = last.predictable.systematic_share
    return steps[0].force_error ** 2 - last.force_error**2 * (1.0 - share)


def explained_share(steps: Sequence[Step]) -> float | None:
    """Share of what could be predicted beyond the base model that the accepted effects take."""
    whole = _predictable_square(steps)
    if whole <= 0 or (len(steps) == 1 and steps[0].predictable.is_noise):
        return None
    return (steps[0].force_error ** 2 - steps[-1].force_error ** 2) / whole


def leaves_something(steps: Sequence[Step], settings: DiagnosisSettings) -> bool:
    """Whether more can be predicted of the last step's residual than the inexactness of effects."""
    last, share = steps[-1], explained_share(steps)
    if last.predictable.is_noise:
        # Nothing is predicted of logs that are too short for it, whatever is missing.
        return len(steps) == 1 and last.predictable.is_short
    small = share is not None and 1.0 - share <= settings.max_small_rest
    return not (small and last.predictable.systematic_share <= settings.max_small_rest_share)


def without_imitators(
    steps: tuple[Step, ...], settings: DiagnosisSettings, settled: Collection[str] = ()
) -> tuple[Step, ...]:
    """The steps; the base and what is ``settled`` alone where more is left than effects explain by
    far.

    Then what is missing is something else, and effects of the catalogue imitate it in part. Not
    those that wheels and pose show.
    """
    share = explained_share(steps)
    if not leaves_something(steps, settings) or share is None:
        return steps
    enough = share >= settings.min_explained_share
    return steps if enough else steps[: count_settled(steps, settled)]


def verdict_of(unexplained: bool, tied: bool, accepted: bool) -> str:
    """One word for what was found.

    Parameters
    ----------
    unexplained : whether more is left than noise would leave
    tied : whether the data cannot tell an accepted effect from another
    """
    if unexplained:
        return "unknown"
    if tied:
        return "ambiguous"
    return "effect" if accepted else "adequate"


def sentences_of(
    model: Any,
    steps: Sequence[Step],
    verdict: str,
    ties: Mapping[str, Sequence[str]],
    floor: Mapping[str, float],
    remaining: ResidualMap,
    regime: Regime | None = None,
    proposal: Proposal | None = None,
) -> list[str]:
    """The verdict in words; the effects have the sizes that they have in ``model``, or beside a
    proposed law those that were fitted with it: without it they hold a part of the law.

    ``remaining``: what the last step's residual depends on; ``regime``: where it lives;
    ``proposal``: a law for it.
    """
    found, mechanism = [], steps[-1].fitted.mechanism
    told = model if proposal is None else proposal.joint
    in_part = "in part" if proposal is None else "in part, fitted with the proposed law"
    for step in steps[1:]:
        assert step.effect is not None
        key = mechanism.plain_names[step.effect]
        sentence = describe_in(told, mechanism.catalogue[key])
        if step.logs:
            where = f"{listed(step.logs)} alone" if len(step.logs) == 1 else listed(step.logs)
            sentence = f"{effect_of(key)}, in {where}: {sentence}"
        others = effects_of(ties.get(step.effect, ()))
        if others:
            sentence = f"{sentence.rstrip('.')}; these logs cannot tell it from "
            sentence += " or ".join(others)
        # Beside an unknown rest an effect may only imitate what is missing.
        found.append(f"{in_part}: {sentence}" if verdict == "unknown" else sentence)
        if proposal is not None:
            found.append(_with_and_without_law(key, proposal.joint, model))
    last, level = steps[-1].force_error, floor["force_error"]
    if verdict == "adequate":
        found.append(
            f"the model is adequate: of the {last:.2%} that it leaves, the motion predicts nothing "
            "on stretches that were held out"
        )
    elif verdict == "unknown":
        found += _of_the_unknown(steps, level, remaining, proposal)
        found += [regime.sentence] if regime else []
        found += proposal.sentences if proposal else []
    return found


def _with_and_without_law(effect: str, joint: StatedParameters, written: Model[Any]) -> str:
    """The sizes of an effect in a fit with a proposed law, and in the model that is written."""
    both = []
    for model in (joint, written):
        entries = stated_estimates(model)
        names = {f"{effect}.{name}": name for name in model.effects[effect]}
        both.append(sizes_in_words({name: entries[key] for key, name in names.items()}))
    return (
        f"{effect_of(effect)} with the proposed law: {both[0]}; without it, as in the model that "
        f"`-o` writes: {both[1]}"
    )


def _of_the_unknown(
    steps: Sequence[Step], level: float, remaining: ResidualMap, proposal: Proposal | None = None
) -> list[str]:
    """How much is explained, how much is not, and on what the rest depends."""
    last, share = steps[-1].force_error, explained_share(steps)
    if steps[-1].predictable.is_noise:
        # A law that repeats itself too finely for anything else to see it speaks for itself.
        return [] if proposal else [too_short(steps[-1].predictable)]
    left = (
        f"a force error of {last:.2%} remains where noise would leave {level:.2%}, and the motion "
        f"predicts {max(steps[-1].predictable.share_of_motion, 0.0):.0%} of its squares"
    )
    if len(steps) > 1 and share is not None:
        effects = effects_of([step.effect for step in steps[1:] if step.effect])
        names = listed([name.replace("_", " ") for name in effects])
        verb = "take" if len(steps) > 2 else "takes"
        # Wheels and pose may show an effect that forces hardly know.
        part = f"{share:.0%}" if share >= 0.005 else "nothing"
        found = [
            f"{names} {verb} {part} of what could be explained; something more is missing: {left}"
        ]
    else:
        found = [
            f"something is missing that no effect of the catalogue explains well enough: {left}"
        ]
    if steps[-1].predictable.is_episodic:
        found.append(f"what remains is large at times only: {_episodes(steps[-1])}")
    if remaining.leading:
        shown = [item for item in remaining.shares if item.share > 0][:SHOWN_VARIABLES]
        parts = ", ".join(item.words for item in shown)
        found.append(f"what remains depends on {parts}")
    elif not steps[-1].predictable.is_episodic:
        found.append(f"of what remains: {remaining.words(large=True)}")
    return found


def _episodes(step: Step) -> str:
    """Where in the logs most of the residual is, the largest stretches first."""
    names = [item.name for item in step.fitted.samples]
    found = step.predictable.episodes
    parts = [
        f"{names[log]} at {start:.0f}-{end:.0f} s" for log, start, end in found[:SHOWN_STRETCHES]
    ]
    more = len(found) - len(parts)
    return ", ".join(parts) + (f" and {more} more" if more else "")


SHOWN_STRETCHES = 3
"""Stretches of logs that a sentence names."""


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: a, b and c."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


SHOWN_VARIABLES = 3
"""Variables that a sentence names."""


def describe_in(model: Any, effect: Any) -> str:
    """One sentence on an effect of the catalogue, at the size that it has in a model."""
    values = {name: entry.value for name, entry in model.effects[effect.name].items()}
    known = {name: entry.value for name, entry in model.parameters.items()}
    # Beside them the other effects: two may be one law together.
    for other, entries in model.effects.items():
        known |= {f"{effect_of(other)}.{name}": entry.value for name, entry in entries.items()}
    return describe(effect, values, known)


def warnings_of(
    given: Mapping[str, float],
    refitted: Step,
    out_of_time: bool,
    settings: DiagnosisSettings,
) -> list[str]:
    """What a reader must know to judge the verdict, beside what is wrong with the logs.

    Parameters
    ----------
    given, refitted : errors of the model as it was given, and refitted
    out_of_time : whether the search ended before it had come to its own end
    """
    found: list[str] = []
    if given["force_error"] > settings.min_changed_error_ratio * refitted.force_error:
        found.append(
            f"the given model's own parameters no longer fit (force error "
            f"{given['force_error']:.1%}, refitted {refitted.force_error:.1%}): they have changed"
        )
    if out_of_time:
        found.append(
            f"the search was ended after {settings.max_search_time:.0f} s of computing, with what "
            "it had found: give fewer or shorter logs for all of it"
        )
    return found


def candidate_rows(ranking: Ranking, steps: Sequence[Step], model: Any) -> list[dict[str, Any]]:
    """First-step candidates, best first; an accepted one with its parameters in the final fit.

    ``logs``: of one that acts in some logs only. Errors are converted to the noise and the folds of
    the base, as in the ranking.
    """
    found, base = [], steps[0]
    keys = steps[-1].fitted.mechanism.plain_names
    for item in ranking.candidates:
        acts_in = item.mechanism.acts_in.get(item.name, ())
        logs = [samples.name for samples in base.fitted.samples if samples.name in acts_in]
        ratio = np.sqrt(max(item.square, 0.0) / max(ranking.square, 1e-300))
        found.append(
            {
                "effect": effect_of(item.name),
                **({"logs": logs} if logs else {}),
                "force_error": float(base.force_error * ratio),
                "p_value": ranking.p_values[item.name],
                "parameters": _parameters(item, model, keys.get(item.name)),
            }
        )
    return found


def estimates(entries: Mapping[str, Any]) -> dict[str, Any]:
    """JSON form of an effect's entries in a model: value, unit and standard deviation."""
    return {
        name: {"value": entry.value, "unit": entry.unit, "std": entry.std}
        for name, entry in entries.items()
    }


def _parameters(item: Candidate, model: Any, key: str | None) -> dict[str, Any]:
    """By name; ``key``: that of the effect in the model, if it was accepted."""
    if key in model.effects:
        return estimates(model.effects[key])
    theta = item.theta.copy()
    if item.fitted is None:
        theta[item.free] += item.held_out.step
    effect = item.mechanism.catalogue[item.name]
    # A new effect's parameters are appended, so the candidate's are the last ones.
    own = theta[len(theta) - len(effect.parameter_names) :]
    public = effect.to_public(item.mechanism.geometry, own)
    return {
        name: {"value": _at_bound(declared, value), "unit": declared.unit, "std": None}
        for name, value in zip(effect.public_names, public, strict=True)
        for declared in [effect.public_parameter(name)]
    }


def _at_bound(declared: Parameter, value: float) -> float:
    """A value, or the bound from which rounding alone keeps it: a search inside of bounds ends at
    1e-30, say, where 0 is the least."""
    for bound in (declared.lower, declared.upper):
        if abs(value - bound) < 1e-9 * declared.size:
            return bound
    return value
