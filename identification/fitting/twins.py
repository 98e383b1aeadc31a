"""Parameters of one effect that act alike, so that no log tells which of them it is.

The rollers of the two front wheels turn at one speed, and so do those of the back ones: forces show
what two of them drag together. A least-squares fit shares it between them, or leaves it with one,
and its covariance knows nothing of the other ways to share it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.fitting.least_squares import Fit
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]


def doubt_between_twins(
    mechanism: Mechanism, fit: Fit, settings: FitSettings = FitSettings()
) -> Array:
    """(F, F) to add to the covariance of a fit: each twin may have none or all of what they share.

    What they have together stays as sure as it was. The standard deviation of each is half of it:
    that of two wheels of which one drags, if it is not known which.
    """
    doubt = np.zeros((len(fit.free), len(fit.free)))
    for members in _twins(mechanism, fit, settings):
        count, together = len(members), float(np.abs(fit.theta[fit.free[members]]).sum())
        apart = (count * np.eye(count) - 1.0) / (count - 1)
        doubt[np.ix_(members, members)] = (0.5 * together) ** 2 * apart
    return doubt


def _twins(mechanism: Mechanism, fit: Fit, settings: FitSettings) -> list[NDArray[np.intp]]:
    """Groups of places among the free parameters that belong to one effect and act alike.

    Not of effects whose single values wheels and pose have settled.
    """
    owners = np.array([mechanism.labels[k].component for k in fit.free])
    settled = {held.effect for held in mechanism.held}
    found = list[NDArray[np.intp]]()
    for name in mechanism.structure.effects:
        own = np.flatnonzero(owners == name)
        if name in settled or len(own) < 2:
            continue
        columns = np.concatenate([row.columns[..., own].reshape(-1, len(own)) for row in fit.rows])
        size = np.linalg.norm(columns, axis=0)
        left, unit = own[size > 0], columns[:, size > 0] / size[size > 0]
        while len(left) > 1:
            alike = unit.T @ unit[:, 0] > 1.0 - settings.max_difference_of_twins
            if alike.sum() > 1:
                found.append(left[alike])
            left, unit = left[~alike], unit[:, ~alike]
    return found
