"""Checks of a user's numbers, made once on construction."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from youbot_env.errors import InputError


def finite(what: str, value: Any, *, positive: bool = False, least: float | None = None) -> float:
    """``value`` as a float.

    Raises
    ------
    InputError
        If it is not a finite (and, on request, positive or large enough) real number; names
        ``what``.
    """
    real = isinstance(value, Real) and not isinstance(value, bool)
    try:
        number = float(value) if real else np.nan
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        raise InputError(f"{what}: {value!r} is not a finite number")
    if positive and number <= 0.0:
        raise InputError(f"{what}: {value!r} must be positive")
    if least is not None and number < least:
        raise InputError(f"{what}: {number:g} must be at least {least:g}")
    return number


def count(what: str, value: Any) -> int:
    """``value`` as a whole number of at least 1, or InputError that names ``what``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise InputError(f"{what}: {value!r} is not a whole number of at least 1")
    return int(value)
