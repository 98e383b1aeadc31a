"""Laws over the whole catalogue that take long: some cases in each run, the rest among the slow."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def mostly_slow(cases: Iterable[Any], fast: Iterable[Any]) -> list[Any]:
    """The cases of a parametrised test, of which those that are not ``fast`` are marked slow."""
    kept = list(fast)
    return [case if case in kept else pytest.param(case, marks=pytest.mark.slow) for case in cases]
