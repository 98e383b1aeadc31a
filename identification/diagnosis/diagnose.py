"""Which physical effect is missing: forward selection, revision of earlier choices, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.candidates import (
    at_best_width,
    fit_base,
    fit_structure,
    gain_by_measuring,
    promised_falls,
    rank,
    ranking_of,
    with_joint_fit,
)
from identification.diagnosis.experiment_design import best_experiment
from identification.diagnosis.kinematic_sentences import contradiction_warning
from identification.diagnosis.kinematic_stage import (
    WheelEvidence,
    accepted_kinematics,
    wheel_evidence,
)
from identification.diagnosis.proposed_law import Fits, propose
from identification.diagnosis.regimes import regime_left
from identification.diagnosis.report import (
    Diagnosis,
    candidate_rows,
    effects_of,
    explained_share,
    faults_of_logs,
    leaves_something,
    plain_ties,
    sentences_of,
    verdict_of,
    warnings_of,
    without_imitators,
)
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.slip import refuted, telling_slip
from identification.diagnosis.structures import (
    Candidate,
    FittedStructure,
    LoggedData,
    Ranking,
    Step,
)
from identification.fitting.changed_parameters import changed_parameters
from identification.fitting.final_fit import coarse_speed_warnings, final_fit
from identification.fitting.kinematic_evidence import kinematic_effects
from identification.fitting.late_efforts import LateEfforts, late_efforts
from identification.fitting.least_squares import Fit
from identification.fitting.regression import acting_share
from identification.logs.log import Log, in_order_of_time, shared_clock, warnings_of_logs
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import public_values
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from identification.mechanisms.residual_maps import refuse_unseen_logs
from identification.mechanisms.samples import Samples
from identification.proposal.proposal import Proposal
from identification.residual_map.regime import Regime
from identification.residual_map.residual_map import residual_map
from identification.residual_map.shares import ResidualMap
from identification.threads import give_back, in_one_blas_thread, side_by_side
from youbot_env.errors import InputError
from youbot_env.physics.effect import effect_of

Array = NDArray[np.float64]


@in_one_blas_thread
def diagnose(
    model: AnyModel,
    logs: Sequence[Log],
    *,
    effects: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
    settings: DiagnosisSettings = DiagnosisSettings(),
) -> Diagnosis:
    """Say which effects of the catalogue a model lacks on some logs.

    Parameters
    ----------
    model : its structure is where the search starts; its parameters are fitted again
    effects : candidates; the mechanism's whole catalogue by default
    seed : of the bootstrap and of the noise floor
    progress : called after each candidate and each free run
    settings : all numbers that the verdict depends on

    Raises
    ------
    InputError
        If no log is given, or the logs cannot show the model.
    """
    if not logs:
        raise InputError("no log given: diagnose needs at least one")
    logs = in_order_of_time(logs)
    mechanism = mechanism_of(model, settings=settings.fit.mechanism)
    data = LoggedData(mechanism, logs, seed, progress, settings)
    refuse_unseen_logs(mechanism, model.theta, data.samples)
    data = data.on_clock_of(mechanism, model.theta)
    names = list(effects) if effects is not None else list(mechanism.catalogue.names())
    chosen = select(data, mechanism, model.theta, names, np.random.default_rng(seed))
    steps = without_imitators(chosen.steps, settings, chosen.wheels.settled)
    unexplained = leaves_something(steps, settings)
    steps, regime = (
        regime_left(data, steps, explained_share(steps)) if unexplained else (steps, None)
    )
    slip, proposal = telling_slip(steps[-1].fitted, chosen.wheels.slip, chosen.refused), None
    late = late_efforts_of(data, steps)
    faults = faults_of_logs(late, slip)
    fits = FITS._replace(final=partial(_final_fit, chosen.wheels), settled=chosen.wheels.settled)
    if not faults:
        # Also where trees find nothing: a ripple of the floor is too fine for them. Of wheels that
        # slide, or efforts that come late, no law is sought: one of wheels would imitate them.
        steps, proposal = propose(data, steps, unexplained, fits)
    unexplained = unexplained or proposal is not None
    # What the last step leaves holds the law as well, and trees do not learn all of it.
    floor = proposal.noise_floor if proposal else data.floor(steps[-1].fitted).to_dict()
    accepted = _names(steps)
    ties = _ties(chosen.rankings, accepted)
    verdict = verdict_of(unexplained, bool(ties), bool(accepted))
    final, maps = _final_fit_and_maps(data, steps, fits)
    maps = [item.led_by(_told_of(regime, proposal)) for item in maps]
    given = data.given_errors(mechanism, model.theta)
    fitted_model = _model(steps[-1], final, model, logs, floor)
    of_logs = warnings_of_logs(logs) + [*data.notes, *coarse_speed_warnings(data.samples, final)]
    words = sentences_of(fitted_model, steps, verdict, ties, floor, maps[-1], regime, proposal)
    words += _words_of_widths(mechanism, model.theta, steps[0].fitted)
    if chosen.contradicted:
        of_logs.append(contradiction_warning(chosen.contradicted))
    told = [fault.words for fault in faults]
    of_logs += told
    words = [*told, *words] if unexplained else words
    return Diagnosis(
        verdict=verdict,
        missing=effects_of(accepted),
        ambiguous_with=plain_ties(ties),
        partial=effects_of(accepted) if unexplained else (),
        steps=steps,
        rankings=chosen.rankings,
        model=fitted_model,
        mechanism=steps[-1].fitted.mechanism,
        samples=tuple(data.samples),
        given_model=given,
        noise_floor=floor,
        maps=tuple(maps),
        next_experiment=_next_experiment(mechanism, steps, chosen.rankings, ties, seed),
        warnings=(
            *of_logs,
            *warnings_of(given, steps[0], chosen.out_of_time, settings),
        ),
        told_first=len(of_logs),
        sentences=tuple(words),
        candidates=candidate_rows(chosen.first, steps, fitted_model),
        settings=settings,
        regime=regime,
        proposal=proposal,
        changes=changed_parameters(
            *(model, fitted_model, mechanism, settings.fit),
            public_values(steps[0].fitted.mechanism, steps[0].fitted.theta),
        ),
        slip=slip,
        late=late,
    )


def _words_of_widths(given: Mechanism, theta: Array, base: FittedStructure) -> list[str]:
    """What is to be said where dry friction of the base model is of another width than given."""
    own = given.structure.effects
    return [
        f"dry friction turns about standstill within {base.theta[k]:.2g} {label.parameter.unit}, "
        f"not {theta[k]:.2g} as in the given model: these logs show it, and the model has it now"
        for k, label in enumerate(given.labels)
        if label.component not in own and label.parameter.is_shape and base.theta[k] != theta[k]
    ]


def late_efforts_of(data: LoggedData, steps: Sequence[Step]) -> LateEfforts | None:
    """Efforts that come later than the others', beside what the last step holds or the first.

    What is missing from the first may hide them; what the last holds may imitate them.
    """
    for step in dict.fromkeys((len(steps) - 1, 0)):
        fitted, share = steps[step].fitted, steps[step].predictable.systematic_share
        where = fitted.mechanism, fitted.theta, fitted.samples
        found = late_efforts(*where, data.settings.fit, data.seed, share)
        if found is not None:
            return found
    return None


def _told_of(regime: Regime | None, proposal: Proposal | None) -> tuple[str, ...]:
    """Variables that a law depends on, or a rule cuts."""
    of_law = () if proposal is None else proposal.law.law.variables
    return (*of_law, *(() if regime is None else regime.variables))


@dataclass(frozen=True)
class Selection:
    """What was accepted, and why.

    steps : held-out errors as they fall; the first is the base
    rankings : the ranking that each accepted effect won; the last one may have no winner
    first : all candidates on top of the base
    out_of_time : whether the search was ended before it had come to its own end
    wheels : what the wheels and a pose say of kinematics
    refused : effects that act as slipping wheels do, and hold only where they slip
    contradicted : effects that wheels and pose show, and with which forces fit worse
    """

    steps: tuple[Step, ...]
    rankings: tuple[Ranking, ...]
    first: Ranking
    out_of_time: bool
    wheels: WheelEvidence
    refused: tuple[str, ...] = ()
    contradicted: tuple[str, ...] = ()


def select(
    data: LoggedData,
    mechanism: Mechanism,
    start: Array,
    names: Sequence[str],
    rng: np.random.Generator,
) -> Selection:
    """Accept effects one after another while the held-out error falls materially.

    After each acceptance the earlier ones are tried again: dropped if they add nothing, replaced
    if a rival does better now that others are present.

    Parameters
    ----------
    mechanism, start : the base structure, and its theta (P,) to start from
    names : of the candidates
    rng : of the bootstrap's signs
    """
    found = _searched(data, mechanism, start, names, rng)
    contradicted = _contradicted(data, found.steps, found.wheels)
    if not contradicted or data.out_of_time:
        return found
    # Wheels do something of that kind, and not by the law that the catalogue has: what else the
    # catalogue has of kinematics would only imitate it.
    forces = [name for name in names if name not in kinematic_effects(mechanism)]
    found = _searched(data, mechanism, start, forces, rng)
    return replace(found, contradicted=contradicted)


def _contradicted(
    data: LoggedData, steps: Sequence[Step], wheels: WheelEvidence
) -> tuple[str, ...]:
    """Accepted effects of kinematics without which, all others kept, forces fit clearly better."""
    shown = [name for name in _names(steps) if name in wheels.settled]
    if not shown:
        return ()
    base, full = steps[0].fitted, steps[-1].fitted
    others = [name for name in _names(steps) if name not in shown]
    without = _refitted(data, full, (*base.mechanism.structure.effects, *others))
    most = 1.0 - data.settings.min_share_of_residual
    better = _held_out_square(base, without) < most * _held_out_square(base, full)
    return tuple(shown) if better else ()


def _searched(
    data: LoggedData,
    mechanism: Mechanism,
    start: Array,
    names: Sequence[str],
    rng: np.random.Generator,
    widths_known: bool = False,
) -> Selection:
    """One search: kinematics first, then forces; anew, once, where nothing is missing but that dry
    friction of the base model has another width about standstill."""
    asked, settings = names, data.settings
    wheels = wheel_evidence(data, mechanism, start, asked)
    names = wheels.names
    base = data.step(fit_base(data, wheels.mechanism, start), None)
    steps, rankings = accepted_kinematics(data, base, wheels, fit_structure)
    seen = rankings[0] if rankings else None
    first: Ranking | None = None
    visited: dict[frozenset[str], tuple[list[Step], list[Ranking]]] = {}
    while len(steps) <= settings.max_effects:
        if len(steps) > 1 and _nothing_left(data, steps[-1]):
            break
        present = steps[-1].fitted.mechanism.structure.effects
        left = [name for name in names if _can_be_added(mechanism, name, present)]
        ranking = rank(data, steps[-1].fitted, left, rng)
        # Without any effect too: the report lists the candidates on top of the base in any case.
        first = first or _with_seen(ranking, seen)
        more = _accepted(data, steps[-1], ranking)
        more = more or _accepted_pair(data, steps[-1], ranking, rng)
        if not widths_known and (more or not steps[-1].predictable.is_noise):
            other = at_best_width(data, steps[-1].fitted)
            if other is not None and _does_as_well(other, more, settings):
                begin = other.theta[: len(start)]
                return _searched(data, mechanism, begin, asked, rng, widths_known=True)
        if not more:
            rankings.append(ranking)
            break
        steps = [*steps, *(step for step, _ in more)]
        rankings = [*rankings, *(won for _, won in more)]
        if data.out_of_time or _contradicted(data, steps, wheels):
            break
        # With one accepted effect there is nothing to revise: it has just won.
        if len(steps) > 2:
            steps, rankings = _revised(data, steps, rankings, rng, wheels.settled)
        key = frozenset(_names(steps))
        if key in visited:
            # The search goes round in a circle: of what it has been through, the best is taken.
            steps, rankings = min(
                visited.values(),
                key=lambda way: _held_out_square(way[0][0].fitted, way[0][-1].fitted),
            )
            break
        visited[key] = steps, rankings
    first = first or seen
    # max_effects is at least 1, so the loop has made one ranking if kinematics has made none.
    assert first is not None
    kept, refused = _without_slip(data, _with_sound_free_runs(data, steps), wheels)
    return Selection(tuple(kept), tuple(rankings), first, data.out_of_time, wheels, refused)


def _does_as_well(
    other: FittedStructure, more: Sequence[Accepted], settings: DiagnosisSettings
) -> bool:
    """Whether a structure at another width leaves no more than with effects at its own."""
    if not more:
        return True
    last = more[-1][0].fitted
    least = last.held_out.square / last.acting_share * other.acting_share
    return (1 - settings.min_extension_gain) * other.held_out.square <= least


def _with_seen(ranking: Ranking, seen: Ranking | None) -> Ranking:
    """The ranking on top of the base with the effects that wheels and pose show, if any."""
    if seen is None:
        return ranking
    # What is tried after them leaves less: in shares of what it was tried on, it stays comparable.
    return replace(
        ranking,
        candidates=(*seen.candidates, *ranking.candidates),
        p_values={**ranking.p_values, **seen.p_values},
        square=seen.square,
    )


def _can_be_added(mechanism: Mechanism, name: str, present: Sequence[str]) -> bool:
    """Whether a structure can hold an effect beside those present: once more in some logs, too."""
    # Two lags or two delays in a row are one.
    once = mechanism.catalogue[name].acts_at.kind in ("actuator", "shift")
    return name not in (map(effect_of, present) if once else ())


def _ties(rankings: Sequence[Ranking], accepted: Sequence[str]) -> dict[str, list[str]]:
    """Of each accepted effect, what tied with it; what is accepted beside it is no rival of it."""
    rivals = {
        ranking.best.name: [name for name in ranking.tied if name not in accepted]
        for ranking in rankings
        if ranking.best and ranking.best.name in accepted
    }
    return {name: others for name, others in rivals.items() if others}


def _names(steps: Sequence[Step]) -> list[str]:
    """The accepted effects, in order."""
    return [step.effect for step in steps if step.effect]


def _held_out_square(first: FittedStructure, last: FittedStructure) -> float:
    """Held-out squares of the last structure, judged with the folds of the first."""
    judged = last.held_out
    return first.fold_ratio(judged.folds) * judged.square / last.acting_share


def _with_sound_free_runs(data: LoggedData, steps: Sequence[Step]) -> list[Step]:
    """The steps, without effects that make the free run worse."""
    steps = data.judged_alike(steps, steps[-1].fitted.held_out.folds)
    for index, (before, after) in enumerate(zip(steps, steps[1:], strict=False)):
        if not _free_run_holds(data, before, after):
            names = [name for k, name in enumerate(_names(steps)) if k != index]
            return _with_sound_free_runs(data, _walk(data, steps[0], names, steps[-1].fitted))
    return steps


def _without_slip(
    data: LoggedData, steps: Sequence[Step], wheels: WheelEvidence
) -> tuple[list[Step], tuple[str, ...]]:
    """The steps without effects that only imitate slipping wheels, and the names of these."""
    refused = refuted(data, steps[-1].fitted, wheels.slip)
    own = steps[0].fitted.mechanism.structure.effects
    refused = [name for name in refused if name not in own]
    if not refused:
        return list(steps), ()
    names = [name for name in _names(steps) if name not in refused]
    return _walk(data, steps[0], names, steps[-1].fitted), tuple(refused)


def _nothing_left(data: LoggedData, step: Step) -> bool:
    """Whether white noise is all that a structure leaves, so that no other ranking is worth it."""
    settings = data.settings
    if not step.predictable.is_noise:
        return False
    above = data.above_white_floor(step.fitted)
    return settings.min_error_over_floor <= above <= settings.max_final_error_over_floor


Accepted = tuple[Step, Ranking]
"""A step, and the ranking that its effect won."""


def _accepted(data: LoggedData, before: Step, ranking: Ranking) -> list[Accepted]:
    """The best candidate that is significant, material, and of use in each log and free run.

    Empty if there is none.
    """
    excluded: list[str] = []
    # In long logs even tiny effects are significant, so the fall must be material as well.
    while ranking.best is not None and ranking.is_material:
        best = ranking.best
        if best.fitted is None:
            if excluded or not data.out_of_time:
                break
            # The time ran out in the midst of the ranking: what it found is not thrown away.
            best = with_joint_fit(data, before.fitted, best)
            ranking = replace(ranking, best=best)
            if not ranking.is_material:
                break
        assert best.fitted is not None  # as is every result of a joint fit
        significant = ranking.p_values[best.name] <= data.settings.max_p_value
        helps = significant and _helps_in_each_log(before.fitted, best, data.settings)
        helps = helps and _helps_outside_episodes(before, best.fitted)
        if helps and _survives_measuring(data, before.fitted, ranking):
            step = data.step(best.fitted, best.name)
            if _free_run_holds(data, before, step):
                return [(step, ranking)]
        excluded.append(best.name)
        ranking = ranking_of(
            *(data, before.fitted, ranking.candidates, ranking.p_values, ranking.needed),
            excluded,
        )
    return []


def _survives_measuring(data: LoggedData, base: FittedStructure, ranking: Ranking) -> bool:
    """Whether the best candidate takes away more than what coarse channels alone would yield."""
    assert ranking.best is not None and ranking.best.fitted is not None
    if ranking.fall > data.settings.max_noise_gain:
        return True
    alone = gain_by_measuring(data, base, ranking.best.fitted) / ranking.square
    return ranking.fall - alone >= ranking.needed


def _helps_in_each_log(base: FittedStructure, item: Candidate, settings: DiagnosisSettings) -> bool:
    """Whether the held-out squares fall in each log, or rise by little beside the falls."""
    own = base.judged(item.held_out.folds)
    shares = [_share_in(item, base, log) for log in base.samples]
    gains: dict[int, float] = {}
    for fold, before, after in zip(own.folds, own.residual, item.held_out.residual, strict=True):
        gain = float((before**2).sum() - (after**2).sum() / shares[fold.log])
        gains[fold.log] = gains.get(fold.log, 0.0) + gain
    lost = -sum(min(gain, 0.0) for gain in gains.values())
    won = sum(max(gain, 0.0) for gain in gains.values())
    return lost <= settings.max_lost_share * won


def _helps_outside_episodes(before: Step, fitted: FittedStructure) -> bool:
    """Whether an effect leaves no more where the residual was small than was there before.

    A force that acts for a while is met halfway by a constant one: the squares fall where it acts,
    and rise wherever it does not. What acts always does no such thing.
    """
    known = before.predictable
    if not known.is_episodic:
        return True
    quiet = [np.ones(len(row.time), bool) for row in fitted.rows]
    for log, start, end in known.episodes:
        time = fitted.rows[log].time
        quiet[log] &= (time <= start) | (time > end)
    own, without = (
        sum(float((r.residual[q] ** 2).sum()) for r, q in zip(one.rows, quiet, strict=True))
        for one in (fitted, before.fitted)
    )
    return own <= fitted.settings.max_quiet_rise * without


def _share_in(item: Candidate, base: FittedStructure, log: Samples) -> float:
    """Squares of the force that a candidate lets act in a log, over those with the structure."""
    theta = item.fitted.theta if item.fitted else item.theta
    own = acting_share(item.mechanism, theta, [log])
    return own / acting_share(base.mechanism, base.theta, [log])


def _free_run_holds(data: LoggedData, before: Step, after: Step) -> bool:
    """Whether the held-out free run is no worse with an effect than without it."""
    (before,) = data.judged_alike([before], after.folds)
    most = data.settings.max_velocity_error_ratio * before.velocity_error
    # A free run that diverges without the effect says nothing against it.
    if after.velocity_error <= most or not np.isfinite(before.velocity_error):
        return True
    # Nor does one that noise alone throws off: an arm's, which falls as a pendulum does.
    if _by_noise(data, after) > data.settings.max_free_run_noise:
        return True
    # A force that repeats along the way is met out of step after some seconds of free run, and the
    # true one worst of all: what noise makes of the free run is no fault of the effect. So much is
    # in the free run without it too.
    beyond, beyond_before = (_beyond_noise(data, step) for step in (after, before))
    bearable = data.settings.max_noisy_velocity_error_ratio * before.velocity_error
    most = data.settings.max_velocity_error_ratio * beyond_before
    return bool(beyond <= most and after.velocity_error <= bearable)


def _beyond_noise(data: LoggedData, step: Step) -> float:
    """A step's velocity error, held out, less what noise alone makes of it, were the model true."""
    return float(np.sqrt(max(step.velocity_error**2 - _by_noise(data, step) ** 2, 0.0)))


def _by_noise(data: LoggedData, step: Step) -> float:
    """The velocity error that noise alone makes of a step, were the model true."""
    return float(data.floor(step.fitted).to_dict()["velocity_error"])


def _accepted_pair(
    data: LoggedData, before: Step, ranking: Ranking, rng: np.random.Generator
) -> list[Accepted]:
    """Two effects that are material together though neither is alone; empty if there are none.

    A delay, for instance, hides behind a friction that is missing too. Only where something is
    left that can be predicted: noise needs no pairs.
    """
    settings, base = data.settings, before.fitted
    if before.predictable.is_noise:
        return []
    pairs: list[tuple[float, Candidate, Ranking]] = []
    names = [item.name for item in ranking.candidates]
    for item in ranking.candidates[: settings.paired_candidates]:
        if data.out_of_time:
            break
        item = item if item.fitted else with_joint_fit(data, base, item)
        assert item.fitted is not None
        promised = promised_falls(base, item.fitted, ranking.candidates, _others(names, item.name))
        least = settings.min_promised_share_of_pair * 2 * ranking.needed - ranking.fall_of(item)
        hopeful = [name for name, fall in promised.items() if fall >= least]
        if not hopeful:
            continue
        unlikely = [one for one in ranking.candidates if promised.get(one.name, least) < least]
        second = rank(data, item.fitted, hopeful, rng, unlikely)
        if second.best is not None and second.best.fitted is not None:
            pairs.append((second.best.square / item.acting_share, item, second))
    for square, item, second in sorted(pairs, key=lambda pair: pair[0]):
        fall = 1.0 - square / ranking.square
        if fall < 2 * ranking.needed or not second.is_material:
            continue
        assert item.fitted is not None
        step = data.step(item.fitted, item.name)
        more = _accepted(data, step, second)
        if more and _free_run_holds(data, before, more[0][0]):
            return [(step, replace(ranking, best=item, tied=())), *more]
    return []


def _others(names: Sequence[str], name: str) -> list[str]:
    return [other for other in names if effect_of(other) != effect_of(name)]


def _revised(
    data: LoggedData,
    steps: list[Step],
    rankings: list[Ranking],
    rng: np.random.Generator,
    settled: frozenset[str],
) -> tuple[list[Step], list[Ranking]]:
    """The accepted effects, each tried against its rivals with all others present.

    ``settled``: those that are accepted by other evidence than forces, and stay.
    """
    given = steps[0].fitted.mechanism.structure.effects
    names = _names(steps)
    full = steps[-1].fitted
    won = list(rankings[: len(names)])
    for _ in range(data.settings.max_revision_rounds):
        before = list(names)
        # The last one first: it was chosen with the most other effects present.
        for index in range(len(names) - 1, -1, -1):
            others = [*names[:index], *names[index + 1 :]]
            if index == len(names) - 1 and names == before and full is steps[-1].fitted:
                continue  # its ranking was computed with the same other effects just before
            if names[index] in settled:
                continue
            if data.out_of_time:
                break
            base = _refitted(data, full, (*given, *others))
            again = rank(data, base, _rivals(won[index], others, data.settings), rng)
            if data.out_of_time and not (again.best and again.best.fitted):
                # The ranking was cut before its joint fits: it says nothing against the effect.
                break
            if again.best is None or again.best.fitted is None or not again.is_material:
                # The other effects were chosen beside the one that is dropped: try them again.
                del names[index], won[index]
                full = base
                break
            won[index] = again
            names[index] = again.best.name
            full = again.best.fitted
        if names == before:
            break
    if names == _names(steps):
        return steps, won
    return _walk(data, steps[0], names, full), won


def _walk(data: LoggedData, base: Step, names: Sequence[str], full: FittedStructure) -> list[Step]:
    """The steps from the base on, effect by effect, each fitted from its parameters in ``full``."""
    given = base.fitted.mechanism.structure.effects
    walked = [base]
    for count, name in enumerate(names, start=1):
        walked.append(data.step(_refitted(data, full, (*given, *names[:count])), name))
    return walked


def _rivals(ranking: Ranking, others: Sequence[str], settings: DiagnosisSettings) -> list[str]:
    """Candidates that took a good part of what the winner of a ranking took."""
    least = settings.min_share_of_best_fall * ranking.fall
    found = [item.name for item in ranking.candidates if ranking.fall_of(item) > least]
    return [name for name in found if name not in others]


def _refitted(data: LoggedData, full: FittedStructure, effects: tuple[str, ...]) -> FittedStructure:
    """A structure with fewer effects, fitted from the parameters that they have in ``full``."""
    mechanism = full.mechanism.with_effects(effects)
    known = dict(zip(full.mechanism.parameter_names, full.theta, strict=True))
    start = np.array([known[name] for name in mechanism.parameter_names])
    return fit_structure(data, mechanism, start)


FITS = Fits(fit_structure, final_fit, _refitted, _walk)
"""How a diagnosis fits what is missing from the catalogue."""


def _final_fit(wheels: WheelEvidence, mechanism: Mechanism, *args: Any) -> Fit:
    """A final fit, with the uncertainty of what wheels and pose have settled."""
    return wheels.widened(mechanism, final_fit(mechanism, *args))


def _final_fit_and_maps(
    data: LoggedData, steps: Sequence[Step], fits: Fits
) -> tuple[Fit, list[ResidualMap]]:
    """The last structure's fit; maps of the base's residual and, with effects, of the last one's.

    Side by side, in threads; of long logs one after another, for each of them takes memory.
    """
    last, settings = steps[-1].fitted, data.settings

    def mapped(fitted: FittedStructure) -> ResidualMap:
        return residual_map(
            *(fitted.mechanism, fitted.theta, data.samples),
            seed=data.seed,
            settings=settings.residual_map,
            fit=settings.fit,
        )

    shown = [steps[0].fitted] if len(steps) == 1 else [steps[0].fitted, last]
    args = (last.mechanism, data.samples, data.noise, last.theta, data.seed, settings.fit)
    tasks = [partial(fits.final, *args), *(partial(mapped, f) for f in shown)]
    if not data.is_long:
        final, *maps = side_by_side(lambda task: task(), tasks, data.progress)
        return final, maps
    final = fits.final(*args)
    give_back()
    return final, [mapped(fitted) for fitted in shown]


def _model(
    step: Step, final: Fit, model: AnyModel, logs: Sequence[Log], floor: dict[str, float]
) -> Any:
    """The model of the last step's final fit."""
    return kind_of(model).fitted_model(
        step.fitted.mechanism,
        final,
        name=model.name,
        logs=tuple(log.reference for log in logs),
        errors={**step.errors, "held_out": True, "noise_floor": floor},
        provenance={"command": "diagnose", "clock": shared_clock(logs)},
    )


def _next_experiment(
    mechanism: Mechanism,
    steps: Sequence[Step],
    rankings: Sequence[Ranking],
    ties: dict[str, list[str]],
    seed: int,
) -> dict[str, Any] | None:
    """The motion that best separates the first tie, if the mechanism knows motions."""
    if not ties:
        return None
    motions = mechanism.motions(seed)
    ranking = next(r for r in rankings if r.best and r.best.name in ties)
    tied = [item for item in ranking.candidates if item.name in ranking.tied and item.fitted]
    assert ranking.best is not None and ranking.best.fitted is not None
    if not tied or not motions:
        return None
    noise = float(np.sqrt(np.mean([np.mean(r**2) for r in steps[-1].fitted.residual])))
    return best_experiment(motions, _named(ranking.best), [_named(item) for item in tied], noise)


def _named(item: Candidate) -> tuple[str, Mechanism, Array]:
    assert item.fitted is not None
    # A motion that is proposed has no log yet: it is to be driven where the effect acts.
    return effect_of(item.name), item.fitted.mechanism.everywhere(), item.fitted.theta
