"""Laws over the whole catalogue that take long: some cases in each run, the rest among the slow."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def mostly_slow(cases: Iterable[Any], fast: Iterable[Any], several: bool = False) -> list[Any]:
    """The cases of a parametrised test, of which those that are not ``fast`` are marked slow.

    ``several``: each case is a tuple of several arguments.
    """
    kept, slow = list(fast), pytest.mark.slow
    return [
        case if case in kept else pytest.param(*(case if several else [case]), marks=slow)
        for case in cases
    ]
