"""The evidence for candidate effects: scores of their columns, beside chance and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.significance import (
    Evidence,
    candidate_p_values,
    remainder,
    score_blocks,
    stacked,
)
from identification.diagnosis.structures import Candidate, FittedStructure, LoggedData
from identification.fitting.regression import Indices, filtered_residual, filtered_rows
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import DemandedForce, Samples
from identification.residual_map.bootstrap import random_signs
from youbot_env.physics.effect import ACTUATOR, CHANNEL, SPEED

Array = NDArray[np.float64]


def p_values_of(
    data: LoggedData, base: FittedStructure, found: Sequence[Candidate], rng: np.random.Generator
) -> dict[str, float]:
    """Family-wise p-value of each candidate."""
    settings = data.settings
    scores = {item.name: evidence_of(base, item) for item in found}
    # What was tried and is no candidate counts too: chance has had that many chances.
    tried = [score for item in found for score in item.tried]
    signs = random_signs(rng, settings.bootstrap_draws, len(scores[found[0].name].observed))
    p_values = candidate_p_values(scores, signs, settings, tried)
    by_noise = [
        item
        for item in found
        if item.mechanism.catalogue[item.name].acts_at in NOISY_SITES
        and item.fitted is None
        and p_values[item.name] <= settings.max_p_value_of_noise
    ]
    if by_noise:
        noise = NoiseOnce.on(data, base)
        for item in by_noise:
            scores[item.name] = _beyond_noise(base, item, scores[item.name], noise)
        p_values = candidate_p_values(scores, signs, settings, tried)
    # What would help with a sign that cannot be explains nothing, however surely.
    absurd = [
        item.name for item in found if item.lost_fall > 0 and item.square >= base.held_out.square
    ]
    return {**p_values, **dict.fromkeys(absurd, 1.0)}


def scores_of(base: FittedStructure, columns: Sequence[Array]) -> Array:
    """Score blocks (blocks, F) of columns on top of a structure."""
    step = base.rows[0].step
    return score_blocks(base.residual, base.columns, columns, step, base.settings)


def evidence_of(base: FittedStructure, item: Candidate) -> Evidence:
    """Scores of a candidate, and those that chance is judged by.

    What an effect does in a few moments, as a limit of the torque does, makes a few blocks large,
    and random signs of these blocks would make scores as large. So chance is judged by what the
    effect leaves of the rows that its fit has not seen: if the effect does nothing these are the
    same.
    """
    joint = item.fitted
    if joint is None or item.lost_fall > 0:
        return Evidence(scores_of(base, item.columns))
    own = np.isin(joint.free, base.free, invert=True)
    columns = [part[..., own] for part in joint.columns]
    ends = np.cumsum([len(part) for part in base.residual])[:-1]
    left = np.split(np.concatenate(item.held_out.residual), ends)
    step = base.rows[0].step
    chance = score_blocks(left, base.columns, columns, step, base.settings)
    return Evidence(scores_of(base, columns), chance)


NOISY_SITES = (CHANNEL, ACTUATOR, SPEED)
"""Where an effect's column is made of logged torques: their noise is in the residual too."""


@dataclass(frozen=True)
class NoiseOnce:
    """Noise put on the logs once more: the samples, and what it adds to the residual (n, A)."""

    samples: tuple[Samples, ...]
    residual: tuple[Array, ...]

    @classmethod
    def on(cls, data: LoggedData, base: FittedStructure) -> NoiseOnce:
        """White noise as large as the logs' own."""
        rng, rows = np.random.default_rng(data.seed), base.settings.rows
        samples, added = [], []
        for item, level, row in zip(base.samples, data.noise, base.rows, strict=True):
            noisy = base.mechanism.noisy(item, level.speed, level.torque, rng)
            again = filtered_residual(base.mechanism, base.theta, noisy, rows)
            samples.append(noisy)
            added.append(again - row.residual)
        return cls(tuple(samples), tuple(added))


def _beyond_noise(
    base: FittedStructure, item: Candidate, evidence: Evidence, noise: NoiseOnce
) -> Evidence:
    """The evidence less what noise alone makes of it, which is in the column and the residual.

    A drive's resonance bends the torque, and so its noise: the two are correlated.
    """
    own = item.free[len(base.free) :]
    added = []
    for samples, columns in zip(noise.samples, item.columns, strict=True):
        demand = item.mechanism.demand(item.theta, samples.for_fit)
        added.append(own_columns(base, item.mechanism, demand, samples, own) - columns)
    cleared = remainder(stacked(added), stacked(base.columns), base.settings.min_seen_share)
    score = cleared.T @ np.concatenate([part.ravel() for part in noise.residual])
    observed = evidence.observed - score / len(evidence.observed)
    return replace(evidence, observed=observed)


def own_columns(
    base: FittedStructure,
    mechanism: Mechanism,
    demand: DemandedForce,
    samples: Samples,
    new: Indices,
) -> Array:
    """Rows (n, A, F) of the parameters ``new`` of a structure that extends another."""
    ends = np.moveaxis(demand.columns(new), 0, -1)
    return filtered_rows(ends, mechanism, samples, base.settings.rows)
