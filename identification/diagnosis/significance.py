"""Significance of candidates in the residual: family-wise p-values by a wild block bootstrap.

F tests and BIC assume independent residuals and are too optimistic for autocorrelated ones. Here
the score of each candidate is summed over blocks of time that are long against the correlation, and
compared with the same scores under random signs: see
:mod:`identification.residual_map.bootstrap`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.cross_validation import block_sums
from identification.fitting.span import Span, stacked
from identification.residual_map.bootstrap import family_wise_p_values

Array = NDArray[np.float64]


def score_blocks(
    residual: Sequence[Array],
    base: Span,
    columns: Sequence[Array],
    step: float,
    settings: DiagnosisSettings = DiagnosisSettings(),
) -> Array:
    """Block sums (blocks, F) of a candidate's score, its columns cleared of the base model's.

    Parameters
    ----------
    residual : per log (n, A); base : of its columns; columns : per log (n, A, F)
    step : from one row to the next [s]
    """
    # Frisch, Waugh and Lovell: what the base model's parameters can absorb is no evidence.
    cleared = base.remainder(stacked(columns))
    sums, start = [], 0
    for log in residual:
        stop = start + log.size
        of_log = cleared[start:stop].reshape(*log.shape, -1)
        scores = np.einsum("na,naf->nf", log, of_log)
        sums.append(block_sums(scores, step, settings.residual_map.bootstrap_block_time))
        start = stop
    return np.concatenate(sums)


@dataclass(frozen=True)
class Evidence:
    """Score blocks (blocks, F) of a candidate, and those under random signs.

    chance : the blocks whose random signs show what chance does; by default the same ones
    """

    observed: Array
    chance: Array | None = None


def candidate_p_values(
    scores: Mapping[str, Evidence],
    signs: Array,
    settings: DiagnosisSettings = DiagnosisSettings(),
    tried: Sequence[Array] = (),
) -> dict[str, float]:
    """Family-wise p-value of each candidate from its score blocks.

    All candidates share the random signs (draws, blocks), so their dependence is kept. ``tried``:
    scores at all shape constants that were tried for them. The best of many has a large score by
    chance too, so they belong to the family.
    """
    observed, null = [], []
    for score in scores.values():
        chance = score.observed if score.chance is None else score.chance
        # Signs do not change the sum of squares, so one whitening holds for all draws.
        whiten = _whitening(chance, settings.min_score_share)
        observed.append(_normal_score(score.observed.sum(axis=0) @ whiten))
        null.append(_normal_score((signs @ chance) @ whiten))
    for score in tried:
        null.append(_normal_score((signs @ score) @ _whitening(score, settings.min_score_share)))
    p_values = family_wise_p_values(np.array(observed), np.stack(null))
    return dict(zip(scores, p_values.tolist(), strict=True))


def _whitening(blocks: Array, least: float) -> Array:
    """(F, Q) that makes the block sums' scores uncorrelated, of unit variance each."""
    values, vectors = np.linalg.eigh(blocks.T @ blocks)
    keep = values > least * max(values.max(), 1e-300)
    return vectors[:, keep] / np.sqrt(values[keep])


def _normal_score(whitened: Array) -> Array:
    """Wilson and Hilferty's normal score of a chi-square statistic, comparable across sizes."""
    size = whitened.shape[-1]
    if size == 0:  # all columns are zero: the motion does not excite the effect
        return np.full(whitened.shape[:-1], -np.inf)
    statistic = (whitened**2).sum(axis=-1)
    spread = 2.0 / (9.0 * size)
    return ((statistic / size) ** (1 / 3) - (1 - spread)) / np.sqrt(spread)
