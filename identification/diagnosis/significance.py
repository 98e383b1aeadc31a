"""Does anything in the residual answer to a candidate? Family-wise, by a wild block bootstrap.

Plain F and BIC tests take autocorrelated residuals for evidence. Here the score of each candidate
is summed over blocks of time that are long against the correlation; under the null the signs of
blocks are random, so flipping them at random gives the null distribution of the largest statistic
over all candidates (Liu, Annals of Statistics 16(4), 1988; Romano and Wolf, JASA 100, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.cross_validation import block_sums

Array = NDArray[np.float64]

DRAWS = 999
"""Bootstrap draws: the smallest p-value is 1/1000."""


def score_blocks(
    residual: Sequence[Array], base: Sequence[Array], columns: Sequence[Array], step: float
) -> Array:
    """Block sums (blocks, F) of a candidate's score, its columns cleared of the base model's.

    residual (n, A), base (n, A, B) and columns (n, A, F) per log.
    """
    flat = np.concatenate([c.reshape(-1, c.shape[-1]) for c in columns])
    nuisance = np.concatenate([b.reshape(-1, b.shape[-1]) for b in base])
    norm = np.sqrt((nuisance**2).sum(axis=0))
    nuisance = nuisance / np.where(norm > 0, norm, 1.0)
    gram = nuisance.T @ nuisance
    flat = flat - nuisance @ (np.linalg.pinv(gram, rcond=1e-10) @ (nuisance.T @ flat))
    sums, start = [], 0
    for log in residual:
        stop = start + log.size
        cleared = flat[start:stop].reshape(*log.shape, -1)
        sums.append(block_sums(np.einsum("na,naf->nf", log, cleared), step))
        start = stop
    return np.concatenate(sums)


def family_p_values(
    scores: Mapping[str, Array], rng: np.random.Generator, draws: int = DRAWS
) -> dict[str, float]:
    """Family-wise p-value of each candidate from its score blocks (blocks, F).

    All candidates share the draws of signs, so their dependence is kept.
    """
    blocks = len(next(iter(scores.values())))
    signs = rng.choice([-1.0, 1.0], size=(draws, blocks))
    observed, null = {}, np.full(draws, -np.inf)
    for name, blocks_of in scores.items():
        whiten = _whitening(blocks_of)
        observed[name] = _normal_score(blocks_of.sum(axis=0) @ whiten)
        null = np.maximum(null, _normal_score((signs @ blocks_of) @ whiten))
    return {
        name: float((1 + (null >= value).sum()) / (draws + 1)) for name, value in observed.items()
    }


def _whitening(blocks: Array) -> Array:
    values, vectors = np.linalg.eigh(blocks.T @ blocks)
    keep = values > 1e-12 * max(values.max(), 1e-300)
    return vectors[:, keep] / np.sqrt(values[keep])


def _normal_score(whitened: Array) -> Array:
    """Wilson and Hilferty's normal score of a chi-square statistic, comparable across sizes."""
    size = whitened.shape[-1]
    if size == 0:  # columns without any length: a motion that never touches the effect
        return np.full(whitened.shape[:-1], -np.inf)
    statistic = (whitened**2).sum(axis=-1)
    spread = 2.0 / (9.0 * size)
    return ((statistic / size) ** (1 / 3) - (1 - spread)) / np.sqrt(spread)
