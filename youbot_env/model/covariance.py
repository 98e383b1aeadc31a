"""Covariances of estimated parameters: the checks that every model and every file shares."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError

Array = NDArray[np.float64]

ROUNDING = 1e-6
"""Error of a correlation that counts as rounding, where a covariance is checked for symmetry and
positive eigenvalues. Fits are within 1e-9; files with six digits a number are within 1e-6."""


def check_covariance(
    covariance: Array | None, names: tuple[str, ...], known: Collection[str], where: str
) -> None:
    """Refuse what cannot be the covariance (k, k) of the parameters ``names``, each in ``known``.

    Raises
    ------
    InputError
        If a name is unknown or given twice, or the matrix is not k x k, symmetric and positive
        semidefinite up to rounding; ``where`` begins the message.
    """
    if covariance is None:
        return
    if len(set(names)) < len(names) or not set(names) <= set(known):
        raise InputError(f"{where}: names {', '.join(names)} must be parameters, each once")
    if covariance.shape != (len(names), len(names)):
        raise InputError(f"{where} must be {len(names)} x {len(names)}, one row a name")
    # Correlations, so that one tolerance fits parameters of all sizes. A variance of 0 must not
    # divide by 0.
    scale = np.sqrt(np.abs(np.diag(covariance)))
    with np.errstate(over="ignore", invalid="ignore"):
        unit = covariance / np.outer(scale, scale).clip(min=1e-300)
    if not np.isfinite(unit).all():
        raise InputError(f"{where} holds numbers that are too far apart for variances")
    if not np.allclose(unit, unit.T, atol=ROUNDING) or np.diag(covariance).min(initial=0) < 0:
        raise InputError(f"{where} must be symmetric with variances on its diagonal")
    # Rounding of k x k entries moves an eigenvalue by up to k times as much.
    if len(names) and np.linalg.eigvalsh(unit).min() < -ROUNDING * len(names):
        raise InputError(f"{where} is not positive semidefinite")


def covariance_of(entry: Mapping[str, Any] | None) -> tuple[tuple[str, ...], Array | None]:
    """Names and matrix of a file's ``covariance``; (), None where there is none.

    Raises
    ------
    InputError
        If the matrix is not one of numbers, with a row for each name.
    """
    if entry is None:
        return (), None
    names = tuple(str(name) for name in entry["names"])
    try:
        matrix = np.array(entry["matrix"])
    except ValueError:  # rows of different lengths
        matrix = np.empty(0)
    is_numeric = matrix.dtype.kind in "if" and np.isfinite(matrix).all()
    if not names or matrix.shape != (len(names), len(names)) or not is_numeric:
        raise InputError(
            f"covariance.matrix must be {len(names)} x {len(names)} numbers, one row for "
            "each of covariance.names"
        )
    return names, matrix.astype(float)
