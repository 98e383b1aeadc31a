"""The paper's recursive least squares: a Kalman filter for constant parameters, usable online."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification.fitting.settings import FitSettings

Array = NDArray[np.float64]


class RecursiveLeastSquares:
    """x^' = P H^T (z - H x^), P' = -P H^T H P for rows that come one sample after another.

    Each update solves the sampled form of the paper's continuous equations exactly. After any
    number of rows the estimate is therefore the batch estimate with a prior of ``variance``.

    Parameters
    ----------
    size : number F of parameters
    start : (F,) first estimate, zero by default
    variance : of the start, (F,) or one number; that of FitSettings by default
    forgetting : 1 keeps all; below 1 the weight of old rows falls by this factor each row
    """

    def __init__(
        self,
        size: int,
        start: ArrayLike | None = None,
        variance: ArrayLike = FitSettings.recursive_prior_variance,
        forgetting: float = FitSettings.recursive_forgetting,
    ) -> None:
        self.estimate = np.zeros(size) if start is None else np.array(start, float)
        self.covariance = np.diag(np.broadcast_to(np.asarray(variance, float), (size,)).copy())
        self.forgetting = forgetting

    def update(self, columns: Array, measured: Array) -> Array:
        """Take one sample: ``columns`` (A, F), ``measured`` (A,). Returns the estimate (F,).

        The error's covariance is taken as unity: ``covariance`` scales with the noise's.
        """
        # One axis after another: exact for independent errors, and no linear system must be solved.
        spread, estimate = self.covariance / self.forgetting, self.estimate
        for row, value in zip(columns, measured, strict=True):
            seen = spread @ row
            size = 1.0 + row @ seen
            estimate = estimate + seen * ((value - row @ estimate) / size)
            spread = spread - seen[:, None] * seen / size
        self.covariance, self.estimate = spread, estimate
        return self.estimate
