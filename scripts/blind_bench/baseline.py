"""A baseline beside the diagnosis: stepwise selection as in the literature.

Forward selection by F-tests on a split sample, with the false discovery rate of Benjamini and
Hochberg (Journal of the Royal Statistical Society B 57(1), 1995): one half of the rows chooses the
next effect, the other half, which has not chosen, tests all candidates. Rows are three of the
filter's time constants apart, so that white noise leaves them independent. A significant effect
counts as missing, whatever its size: what the diagnosis does beyond this (blocks of time for noise
of any colour, materiality, held-out logs, free runs, sets, "unknown") is the difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from identification.diagnosis.candidates import fit_base, fit_structure, try_candidate
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import Candidate, FittedStructure, LoggedData
from identification.fitting.span import Span, stacked
from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, mechanism_of

Array = NDArray[np.float64]

FALSE_DISCOVERIES = 0.05
"""Share of false ones among the effects that a step finds: the usual rate."""

BLOCK = 10.0
"""[s] of the stretches that go to the two halves in turn, so that both hold each motion."""

SPACING = 3.0
"""Time constants of the filter between the rows of a test: their correlation is then 0.05."""

MOST_EFFECTS = 6
"""That are accepted, as many as a diagnosis takes."""


@dataclass(frozen=True)
class Baseline:
    """What the baseline names.

    missing : accepted effects, in order
    p_values : of each step's accepted effect, on the half that has not chosen it
    fitted : the model with them
    """

    missing: tuple[str, ...]
    p_values: tuple[float, ...] = ()
    sets: dict[str, list[str]] = field(default_factory=dict)
    fitted: FittedStructure | None = field(default=None, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """JSON form, with the keys of a diagnosis that a score reads."""
        return {
            "verdict": "effect" if self.missing else "adequate",
            "missing": list(self.missing),
            "p_values": list(self.p_values),
            "ambiguous_with": self.sets,
        }


def stepwise(model: AnyModel, logs: Sequence[Log], *, seed: int = 0) -> Baseline:
    """Effects of the catalogue that a model lacks on some logs, by F-tests on a split sample.

    Raises
    ------
    InputError
        If the logs cannot show the model.
    """
    settings = DiagnosisSettings()
    mechanism = mechanism_of(model, settings=settings.fit.mechanism)
    data = LoggedData(mechanism, logs, seed, settings=settings)
    fitted = fit_base(data, mechanism, model.theta)
    names = list(mechanism.catalogue.names())
    missing: list[str] = []
    p_values: list[float] = []
    shapes: dict[str, dict[str, float]] = {}
    while len(missing) < MOST_EFFECTS:
        left = [name for name in names if name not in missing and _fits(mechanism, name, missing)]
        # Shape constants are searched once, and again in the joint fit of what is accepted: the
        # search in each step anew would take three quarters of the time.
        tried = [try_candidate(fitted, None, name, shapes.get(name))[0] for name in left]
        shapes |= {item.name: dict(item.shapes) for item in tried}
        first, second = (_tests(fitted, tried, half) for half in (0, 1))
        found = discoveries([p for _, p in second], FALSE_DISCOVERIES)
        if not found:
            break
        # Of the effects that the second half confirms, the one that the first half likes best.
        best = max(found, key=lambda k: first[k][0])
        missing.append(tried[best].name)
        p_values.append(second[best][1])
        fitted = fit_structure(data, tried[best].mechanism, tried[best].theta)
    return Baseline(tuple(missing), tuple(p_values), fitted=fitted)


def _fits(mechanism: Mechanism[Any], name: str, present: Sequence[str]) -> bool:
    """Whether a structure can hold an effect beside others: one lag of the drives, one delay."""
    place = mechanism.catalogue[name].acts_at
    once = place.kind in ("actuator", "shift")
    return not once or all(mechanism.catalogue[other].acts_at is not place for other in present)


def discoveries(p_values: Sequence[float], rate: float) -> list[int]:
    """Indices of the hypotheses that Benjamini and Hochberg's procedure rejects at a rate."""
    order = np.argsort(p_values)
    ranked = np.asarray(p_values, float)[order]
    under = np.flatnonzero(ranked <= rate * np.arange(1, len(ranked) + 1) / len(ranked))
    return [int(k) for k in order[: under[-1] + 1]] if under.size else []


def _tests(
    base: FittedStructure, tried: Sequence[Candidate], half: int
) -> list[tuple[float, float]]:
    """Statistic and p-value of each candidate's F-test on one half of the rows."""
    keep = np.concatenate([_in_half(base, log, half) for log in range(len(base.rows))])
    residual = np.concatenate([row.residual.ravel() for row in base.rows])[keep, None]
    nuisance = stacked(base.columns)[keep]
    least = base.settings.min_seen_share
    before = float(Span(nuisance, least).unexplained(residual).sum())
    found = []
    for item in tried:
        columns = np.concatenate([nuisance, stacked(item.columns)[keep]], axis=1)
        after = float(Span(columns, least).unexplained(residual).sum())
        more, left = item.parameters, len(residual) - columns.shape[1]
        statistic = (before - after) / max(more, 1) / (after / left)
        found.append((statistic, float(stats.f.sf(statistic, max(more, 1), left))))
    return found


def _in_half(base: FittedStructure, log: int, half: int) -> NDArray[np.bool_]:
    """(n A,) which residuals of a log, axis by axis of each row, a half tests."""
    row = base.rows[log]
    thin = max(1, round(SPACING / base.mechanism.filter_rate / row.step))
    chosen = (np.arange(len(row.time)) % thin == 0) & (row.time // BLOCK % 2 == half)
    return np.repeat(chosen, row.residual.shape[1])
