"""What combinations of columns explain of others, by linear least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def stacked(columns: Sequence[Array]) -> Array:
    """Columns (n, A, F) of all logs, in one (N, F)."""
    return np.concatenate([part.reshape(-1, part.shape[-1]) for part in columns])


class Span:
    """Combinations of columns (N, F): what they explain of one target after the other.

    ``min_seen_share``: of the largest eigenvalue, under which a direction of columns is not seen.
    """

    def __init__(self, columns: Array, min_seen_share: float) -> None:
        # Unit columns, so that the cut-off does not depend on units; a column of zeros stays zero.
        norm = np.sqrt((columns**2).sum(axis=0))
        self._norm = np.where(norm > 0, norm, 1.0)
        self.columns, self._unit = columns, columns / self._norm
        self._inverse = np.linalg.pinv(self._unit.T @ self._unit, rcond=min_seen_share)

    def coefficients(self, target: Array) -> Array:
        """(F, T) of the combinations of columns that explain most of targets (N, T)."""
        return self._inverse @ (self._unit.T @ target) / self._norm[:, None]

    def remainder(self, target: Array) -> Array:
        """(N, T) what no combination explains of targets (N, T)."""
        return target - self.columns @ self.coefficients(target)

    def unexplained(self, target: Array) -> Array:
        """(T,) its squares."""
        return (self.remainder(target) ** 2).sum(axis=0)
