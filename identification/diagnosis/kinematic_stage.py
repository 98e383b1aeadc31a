"""Kinematics first: effects that wheels and pose show, before any force is explained.

A wheel of another radius is seen in what no rigid motion explains of four wheel speeds a hundred
times as clearly as in forces, where a friction can imitate it. So these effects are accepted by
that evidence. Where it cannot tell two of them apart, forces may.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.structures import (
    Candidate,
    FittedStructure,
    LoggedData,
    Ranking,
    Step,
    worse_by,
)
from identification.fitting.gauge import gauge_basis
from identification.fitting.kinematic_evidence import (
    KinematicEvidence,
    KinematicFit,
    SlippingWheels,
    held_by,
    kinematic_effects,
    leaders_of,
    slipping_wheels,
)
from identification.fitting.least_squares import Fit
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import rolled_speeds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WheelEvidence:
    """What wheels and pose say of the candidates' kinematics.

    accepted : of each effect that they show, it and those that explain them as well, best first
    mechanism : the one that was given, with what forces must leave as it is
    names : of the candidates that are left to the search by forces
    slip : what remains that neither noise nor kinematics explains
    """

    evidence: KinematicEvidence
    accepted: tuple[tuple[str, ...], ...]
    mechanism: Mechanism
    names: tuple[str, ...]
    slip: SlippingWheels

    @property
    def settled(self) -> frozenset[str]:
        """Effects whose place no search by forces may contest."""
        return frozenset(name for names in self.accepted for name in names)

    def widened(self, mechanism: Mechanism, final: Fit) -> Fit:
        """A fit of forces with the uncertainty of what wheels and pose have settled."""
        names = [name for name in mechanism.structure.effects if name in self.settled]
        if not names:
            return final
        found = self.evidence.at(mechanism, final.theta, names)
        covariance = final.covariance.copy()
        places = {index: k for k, index in enumerate(final.free.tolist())}
        own = [places[index] for index in found.own.tolist()]
        covariance[np.ix_(own, own)] += found.covariance
        return replace(final, covariance=covariance)


def wheel_evidence(
    data: LoggedData, mechanism: Mechanism, start: Array, names: Sequence[str]
) -> WheelEvidence:
    """Judge those of the candidates that change kinematics by wheels and pose alone."""
    # What the model itself holds of kinematics is taken as it is.
    evidence = KinematicEvidence(mechanism, start, data.samples, data.settings.fit)
    left = [name for name in kinematic_effects(mechanism) if name in names and evidence.logs]
    accepted: list[tuple[str, ...]] = []
    here, theta, tried = mechanism, start, dict[str, KinematicFit]()
    while left:
        tried = {
            name: evidence.fitted(
                here.extended(name), here.extend_theta(theta, name, {}), [*_best(accepted), name]
            )
            for name in left
        }
        leaders = leaders_of(evidence.at(here, theta), tried)
        if not leaders:
            break
        best = tried[leaders[0]]
        if not _stands_beside_creep(evidence, best, leaders[0]):
            break
        accepted.append(leaders)
        here, theta = best.mechanism, best.theta
        left = [name for name in left if name not in leaders]
    settled = [held_by(tried[name], name) for name in left]
    known = mechanism.holding((*mechanism.held, *settled))
    gone = {name for leaders in accepted for name in leaders}
    gone |= {name for name in left if not _is_open(known, name)}
    kept = tuple(name for name in names if name not in gone)
    noise = [level.speed for level in data.noise]
    slip = slipping_wheels(here, theta, data.samples, noise, data.settings.fit)
    return WheelEvidence(evidence, tuple(accepted), known, kept, slip)


def _stands_beside_creep(evidence: KinematicEvidence, fit: KinematicFit, name: str) -> bool:
    """Whether an effect moves the speeds by more than the form of a creep beside it is uncertain.

    Wheels may creep by the force on the floor, which is their torque less their friction, so nearly
    a share of their speed. Wheels seem mis-scaled by that share then, or rollers askew.
    """
    creeps = [other for other in fit.mechanism.structure.creeps if other != name]
    if not creeps:
        return True
    uncertain = evidence.settings.kinematics.max_uncertain_share_of_creep
    return _moved(evidence, fit, [name]) > uncertain * _moved(evidence, fit, creeps)


def _moved(evidence: KinematicEvidence, fit: KinematicFit, names: Sequence[str]) -> float:
    """Root mean square of what effects change in the speeds of the logs, over the axes."""
    mechanism, without, squares = fit.mechanism, fit.theta.copy(), list[Array]()
    for index, label in enumerate(mechanism.labels):
        if label.component in names:
            without[index] = label.parameter.without
    for log in evidence.logs:
        where = (mechanism.structure, mechanism.geometry)
        with_them, alone = (
            rolled_speeds(*where, theta, log, mechanism.settings)[0]
            for theta in (fit.theta, without)
        )
        squares.append(((with_them - alone) * mechanism.speed_scale) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _best(accepted: Sequence[tuple[str, ...]]) -> list[str]:
    return [leaders[0] for leaders in accepted]


def _is_open(mechanism: Mechanism, name: str) -> bool:
    """Whether something of an effect's parameters is left for forces to find out."""
    extended = mechanism.extended(name)
    own = [k for k, label in enumerate(extended.labels) if label.component == name]
    return gauge_basis(extended, np.array(own, dtype=np.intp)).shape[1] > 0


FitForces = Callable[[LoggedData, Mechanism, Array], FittedStructure]
"""Fits a structure to forces, from theta (P,) on: that of the search by forces."""


def accepted_kinematics(
    data: LoggedData, base: Step, wheels: WheelEvidence, fit_forces: FitForces
) -> tuple[list[Step], list[Ranking]]:
    """Steps from the base on, with the effects that wheels and pose show, and their rankings."""
    steps, rankings = [base], list[Ranking]()
    for leaders in wheels.accepted:
        ranking = _ranking(data, steps[-1], leaders, wheels, fit_forces)
        assert ranking.best is not None and ranking.best.fitted is not None
        steps.append(data.step(ranking.best.fitted, ranking.best.name))
        rankings.append(ranking)
    return steps, rankings


def _ranking(
    data: LoggedData,
    before: Step,
    leaders: Sequence[str],
    wheels: WheelEvidence,
    fit_forces: FitForces,
) -> Ranking:
    """Effects that explain the wheels alike, ranked by what they leave of the forces."""
    found, p_values = list[Candidate](), dict[str, float]()
    for name in leaders:
        item, p_values[name] = _candidate(data, before, name, wheels, fit_forces)
        found.append(item)
    found.sort(key=lambda item: item.square)
    best = found[0]
    most = data.settings.max_tied_deviations
    tied = [item.name for item in found[1:] if worse_by(item, best, before.fitted) < most]
    square = before.fitted.held_out.square
    return Ranking(tuple(found), p_values, tuple(tied), best, square, 0.0)


def _candidate(
    data: LoggedData, before: Step, name: str, wheels: WheelEvidence, fit_forces: FitForces
) -> tuple[Candidate, float]:
    """An effect as wheels and pose show it, with all else fitted to forces; and its p-value."""
    base = before.fitted
    mechanism = base.mechanism.extended(name)
    start = mechanism.extend_theta(base.theta, name, {})
    known = [other for other in mechanism.structure.effects if other in wheels.settled]
    seen = wheels.evidence.fitted(mechanism, start, known)
    mechanism = mechanism.holding((*mechanism.held, held_by(seen, name)))
    fitted = fit_forces(data, mechanism, seen.theta)
    noise = (one.noise_square(data.noise, data.seed) for one in (fitted, base))
    found = Candidate(
        *(name, mechanism, fitted.theta, fitted.free, None, fitted.held_out),
        fitted=fitted,
        added_noise=next(noise) - next(noise),
        fold_ratio=base.fold_ratio(fitted.held_out.folds),
    )
    return found, seen.p_value
