"""Wild block bootstrap: random signs, and the largest of many statistics under chance alone.

Under the null hypothesis a block of residuals, long against their correlation, is as likely as its
negative. The same statistics computed with random signs therefore show what chance does (Liu,
Annals of Statistics 16(4), 1988); the largest of all statistics in each draw controls the
family-wise error (Romano and Wolf, JASA 100, 2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def random_signs(rng: np.random.Generator, draws: int, blocks: int) -> Array:
    """(draws, blocks) of -1 and 1."""
    return rng.choice([-1.0, 1.0], size=(draws, blocks))


def family_wise_p_values(observed: Array, null: Array) -> Array:
    """P-value (G,) of each of G statistics against the largest of all in each draw.

    Parameters
    ----------
    observed : (G,), comparable across statistics
    null : (G, draws), the same with random signs
    """
    largest = null.max(axis=0)
    above = (largest[None, :] >= observed[:, None]).sum(axis=1)
    # The observed signs count as one draw, so that no p-value is zero.
    return (1 + above) / (1 + null.shape[1])
