"""A law beyond the catalogue, judged as effects are: fitted jointly, held out, in free run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.structures import FittedStructure, LoggedData, Step, count_settled
from identification.fitting.clocks import has_own_clock, words_of_clock
from identification.fitting.least_squares import Fit
from identification.fitting.misfit import misfit_of
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import StatedParameters, stated_parameters
from identification.proposal.law import FoundLaw, Verdict
from identification.proposal.proposal import Proposal
from identification.proposal.propose import Left, find_law, with_law
from youbot_env.errors import NoTorqueError

Array = NDArray[np.float64]


class Fits(NamedTuple):
    """How structures are fitted: structure(data, mechanism, theta) jointly on all logs, final(...)
    with intervals, see `final_fit`; fewer(data, full, names) with some effects of a fitted
    structure, and walk(data, base, names, full) likewise, effect by effect from a step on.

    settled: names of the effects that wheels and pose show, which are no matter of forces."""

    structure: Callable[[LoggedData, Mechanism[Any], Array], FittedStructure]
    final: Callable[..., Fit]
    fewer: Callable[[LoggedData, FittedStructure, tuple[str, ...]], FittedStructure]
    walk: Callable[[LoggedData, Step, Sequence[str], FittedStructure], list[Step]]
    settled: frozenset[str] = frozenset()


def propose(
    data: LoggedData, steps: tuple[Step, ...], unexplained: bool, fits: Fits
) -> tuple[tuple[Step, ...], Proposal | None]:
    """The law that explains what the last step leaves, and the steps that hold beside it.

    It is sought beside the accepted effects and without them: what has no name in the catalogue is
    imitated by what has. Where the law does as well without them, they are no part of the answer.

    ``unexplained``: whether the motion predicts a part of what the last step leaves
    """
    found = _found(data, steps, unexplained, fits)
    if found is None:
        return steps, None
    kept, verdict, fitted, of_law = found
    try:
        step = of_law.step(fitted, verdict.found.law.name)
    except NoTorqueError:  # as fitted without one of the folds
        return steps, None
    kept = tuple(data.judged_alike(kept, step.folds))
    before = kept[-1]
    # One that fits better only where it was fitted is no law, whatever a part of the logs says.
    if not step.force_error < before.force_error or _worsens_free_run(data, before, step):
        return steps, None
    return kept, _proposal(of_law, kept, step, verdict, fits)


def _worsens_free_run(data: LoggedData, before: Step, after: Step) -> bool:
    """Whether the held-out free run is worse with a law than without it: such a law is not what is
    missing. A ripple of the wheels is not judged by it, whose phase a free run loses."""
    assert after.effect is not None
    alone = after.fitted.mechanism.with_effects([after.effect])
    most = data.settings.max_velocity_error_ratio * before.velocity_error
    worse = np.isfinite(before.velocity_error) and not after.velocity_error <= most
    return bool(worse) and not alone.structure.depends_on_angle


class Found(NamedTuple):
    """The steps below a law, the law, the joint fit; and the logs, which of a law on a clock of its
    own are placed on that."""

    kept: tuple[Step, ...]
    verdict: Verdict
    fitted: FittedStructure
    data: LoggedData


def _found(data: LoggedData, steps: Sequence[Step], unexplained: bool, fits: Fits) -> Found | None:
    """The law without the accepted effects, if it makes them needless; else that beside them."""
    least = count_settled(steps, fits.settled)
    counts = [len(steps)] if len(steps) == least or not unexplained else [least, len(steps)]
    for count in counts:
        base = steps[count - 1]
        left = Left(
            base.fitted.mechanism,
            base.fitted.theta,
            base.fitted.free,
            base.predictable.systematic_share if unexplained else 0.0,
            base.predictable.is_episodic,
        )
        settings = data.settings
        verdict = find_law(
            *(left, data.samples, data.seed, settings.proposal, settings.fit, data.progress)
        )
        if verdict is None:
            continue
        verdict = replace(verdict, found=_named_apart(verdict.found, base.fitted))
        try:
            of_law, fitted = _fitted(data, base.fitted, verdict.found, fits)
        except NoTorqueError:  # a loss that grows with the torque, larger than can be
            continue
        if not fitted.square < base.fitted.square:
            continue
        # Effects of the catalogue give way only to a law that leaves much less than they do, or
        # nothing but noise.
        if count < len(steps) and not _is_enough(of_law, steps, fitted):
            continue
        found = Found(tuple(steps[:count]), verdict, fitted, of_law)
        return _without_needless(data, found, fits) if unexplained else found
    return None


def _without_needless(data: LoggedData, found: Found, fits: Fits) -> Found:
    """The law beside those of the accepted effects that are material beside it.

    The others were accepted for want of the law, of which they took a part.
    """
    base, law = found.kept[0], found.verdict.found
    own = base.fitted.mechanism.structure.effects
    names = [step.effect for step in found.kept if step.effect]
    needed, fitted = list(names), found.fitted
    for name in reversed(names):
        if name in fits.settled:
            continue
        others = [other for other in needed if other != name]
        fewer = fits.fewer(found.data, fitted, (*own, *others, law.law.name))
        if fewer.square <= (1.0 + data.settings.min_extension_gain) * fitted.square:
            needed, fitted = others, fewer
    if needed == names:
        return found
    kept = fits.walk(data, base, needed, found.kept[-1].fitted)
    at = {name: fitted.theta[k] for k, name in enumerate(fitted.mechanism.parameter_names)}
    effect = law.effect()
    values = {name: float(at[f"{law.law.name}.{name}"]) for name in effect.parameter_names}
    verdict = replace(found.verdict, found=replace(law, values=values))
    of_law, fitted = _fitted(data, kept[-1].fitted, verdict.found, fits)
    return Found(tuple(kept), verdict, fitted, of_law)


def _fitted(
    data: LoggedData, base: FittedStructure, found: FoundLaw, fits: Fits
) -> tuple[LoggedData, FittedStructure]:
    """The law, fitted jointly; and the logs, on its own clock where it has one.

    Raises
    ------
    NoTorqueError
        If with the law no torque drives the motion of the logs.
    """
    mechanism, start = _with_law(base, found)
    # Once from the law as one log shows it, and once more as all do.
    of_law = data.on_clock_of(mechanism, start)
    fitted = fits.structure(of_law, mechanism, start)
    if of_law is not data:
        of_law = data.on_clock_of(mechanism, fitted.theta)
        fitted = fits.structure(of_law, mechanism, fitted.theta)
    return of_law, fitted


def _is_enough(data: LoggedData, steps: Sequence[Step], fitted: FittedStructure) -> bool:
    """Whether a law without the accepted effects leaves much less than they do; or less, and
    nothing that the motion predicts."""
    before, most = steps[-1].fitted.square, data.settings.proposal.max_rest_share
    if fitted.square < most * before:
        return True
    return fitted.square < before and data.predictability(fitted).is_noise


def _named_apart(found: FoundLaw, base: FittedStructure) -> FoundLaw:
    """The law under a name that no effect has."""
    name, known, number = found.law.name, base.mechanism.kind.catalogue.names(), 2
    while name in known:
        name, number = f"{found.law.name}_{number}", number + 1
    return replace(found, law=replace(found.law, name=name))


def _with_law(base: FittedStructure, found: FoundLaw) -> tuple[Mechanism[Any], Array]:
    """The mechanism with the law beside all that it holds, and theta (P,)."""
    effect = found.effect()
    values = [found.values.get(name, 0.0) for name in effect.parameter_names]
    return with_law(base.mechanism, effect), np.concatenate([base.theta, values])


def _proposal(
    data: LoggedData,
    kept: Sequence[Step],
    step: Step,
    verdict: Verdict,
    fits: Fits,
) -> Proposal:
    fitted, settings = step.fitted, data.settings
    args = (fitted.mechanism, data.samples, data.noise, fitted.theta, data.seed, settings.fit)
    final = fits.final(*args)
    floor, share = data.floor(fitted).to_dict(), None
    errors = {**step.errors, "held_out": True, "noise_floor": floor}
    joint = stated_parameters(fitted.mechanism, final, errors)
    parameters = _parameters(fitted, final, verdict.found, joint, settings.fit)
    values = {name: entry["value"] for name, entry in parameters.items()}
    before = kept[-1]
    systematic = before.predictable.systematic_share
    if systematic > 0:
        # Trees do not learn all that is there: what is beyond the noise floor was missing too.
        noise = min(floor["force_error"] / before.force_error, 1.0)
        systematic = max(systematic, 1.0 - noise**2)
        share = min((1.0 - (step.force_error / before.force_error) ** 2) / systematic, 1.0)
    return Proposal(
        replace(verdict.found, values=values),
        parameters,
        step.force_error,
        step.velocity_error,
        share,
        verdict,
        fitted.mechanism,
        final.theta,
        joint,
        (before.force_error, before.velocity_error),
        tuple(item.effect for item in kept if item.effect),
        tuple(item.name for item in data.samples),
        _starts(data, fitted),
        tuple(words_of_clock(fitted.mechanism, data.samples, data.settings.fit)),
        floor,
    )


def _starts(data: LoggedData, fitted: FittedStructure) -> dict[str, float]:
    """When each log began on the law's own clock [s]; {} where it has none."""
    if not has_own_clock(fitted.mechanism):
        return {}
    return {item.name: item.start for item in data.samples}


def _parameters(
    fitted: FittedStructure,
    final: Fit,
    found: FoundLaw,
    joint: StatedParameters,
    settings: FitSettings,
) -> dict[str, dict[str, Any]]:
    """Value, unit, std and interval of each parameter of the law; None where it was not fitted.

    No interval either where that fit, which is ``joint`` too, does not fit the logs.
    """
    holds, deviations = misfit_of(joint, settings) is None, settings.interval_deviations
    names = fitted.mechanism.parameter_names
    free = {int(k): n for n, k in enumerate(final.free)}
    entries: dict[str, dict[str, Any]] = {}
    for index, label in enumerate(fitted.mechanism.labels):
        if names[index].rpartition(".")[0] != found.law.name:
            continue
        value = float(final.theta[index])
        std = float(final.std[free[index]]) if index in free else None
        interval = None
        if std is not None and holds:
            interval = [value - deviations * std, value + deviations * std]
        entries[label.name] = {
            "value": value,
            "unit": label.parameter.unit,
            "std": std,
            "interval": interval,
        }
    return entries
