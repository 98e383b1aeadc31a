"""Residuals whose random signs show what chance does: as large as the noise they are left of."""

from __future__ import annotations

import numpy as np
import pytest

from identification.residual_map.held_out_gain import (
    FoldRows,
    NormalMatrices,
    NuisanceRegressors,
    added,
    residuals_after,
    unshrunk_residuals,
)

BLOCK, BLOCKS, AXES = 25, 12, 2
ROWS = BLOCK * BLOCKS
FLEXIBLE = NuisanceRegressors(np.arange(10), 1e-6)


def slow(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """White noise over rows, averaged over a quarter of a block."""
    return np.apply_along_axis(np.convolve, 0, rng.standard_normal(shape), np.ones(6) / 6, "same")


def folds(noise: np.ndarray) -> list[FoldRows]:
    """Two folds with regressors that are as slow as what is looked for."""
    rng = np.random.default_rng(5)
    features, columns = slow(rng, ROWS, 10), slow(rng, ROWS, AXES, 4)
    half = ROWS // 2
    return [
        FoldRows(features[rows], columns[rows], noise[rows], BLOCK)
        for rows in (np.s_[:half], np.s_[half:])
    ]


def unshrunk(parts: list[FoldRows], total: NormalMatrices, nuisance: NuisanceRegressors):
    return unshrunk_residuals(parts, residuals_after(parts, total, nuisance), total, nuisance)


def mean_square_scores(residuals) -> float:
    """Of block sums of residuals times slow functions, over those of the noise itself."""
    directions = slow(np.random.default_rng(6), ROWS, 30)
    given = found = 0.0
    for seed in range(200):
        noise = np.random.default_rng(1000 + seed).standard_normal((ROWS, AXES))
        parts = folds(noise)
        total = added(fold.matrices for fold in parts)
        left = np.concatenate(residuals(parts, total, FLEXIBLE))
        for rows in np.split(np.arange(ROWS), BLOCKS):
            given += ((directions[rows].T @ noise[rows]) ** 2).sum()
            found += ((directions[rows].T @ left[rows]) ** 2).sum()
    return found / given


def test_in_slow_directions_they_are_as_large_as_the_noise():
    assert mean_square_scores(residuals_after) < 0.9
    assert mean_square_scores(unshrunk) == pytest.approx(1.0, abs=0.02)


def test_a_block_that_alone_shows_a_regressor_stays_finite():
    noise = np.random.default_rng(3).standard_normal((ROWS, AXES))
    parts = folds(noise)
    parts[0].features[BLOCK:, 0], parts[1].features[:, 0] = 0.0, 0.0
    parts[0].columns[:, :, 1], parts[1].columns[:, :, 1] = 0.0, 0.0
    left = unshrunk(parts, added(fold.matrices for fold in parts), FLEXIBLE)
    size = np.abs(np.concatenate(left)).max()
    assert np.isfinite(size) and size < 10 * np.abs(noise).max()
