"""Estimates over time: the recursive estimator, run through a fit's rows one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.fitting.recursive import RecursiveLeastSquares
from identification.fitting.regression import Regression
from identification.fitting.settings import FitSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EstimateHistory:
    """Estimates over time.

    time (n,): [s] since the first log's start, logs one after another; theta, std (n, F): the
    free parameters and their standard deviations, which end at those of the batch covariance.
    """

    time: Array
    theta: Array
    std: Array


def recursive_course(
    rows: Sequence[Regression],
    theta: Array,
    scale: Array,
    std: Array,
    settings: FitSettings = FitSettings(),
) -> EstimateHistory:
    """Run the recursive estimator through a fit's rows; effects are linearised at the fit.

    The estimator assumes independent rows, but filtered rows are correlated, so its covariance P is
    too small. Each standard deviation is therefore scaled by a constant factor, so that the last
    one equals the batch estimate's.

    Parameters
    ----------
    rows : per log, residual and columns at the fit
    theta, std : (F,) fitted parameters and their standard deviations
    scale : (F,) factors from the parameters to numbers of one size
    """
    estimator = RecursiveLeastSquares(
        len(theta),
        variance=settings.recursive_prior_variance,
        forgetting=settings.recursive_forgetting,
    )
    course, spread = [], []
    for log in rows:
        # The rows hold the residual at theta. Adding the prediction gives back the measured force.
        measured = log.residual + log.columns @ theta
        for columns, z in zip(log.columns / scale, measured, strict=True):
            course.append(estimator.update(columns, z) / scale)
            spread.append(np.sqrt(np.diag(estimator.covariance)) / scale)
    ends = np.cumsum([0.0, *(log.time[-1] for log in rows)])
    time = np.concatenate([end + log.time for end, log in zip(ends, rows, strict=False)])
    shape = np.array(spread)
    return EstimateHistory(time, np.array(course), shape * (std / shape[-1]))
