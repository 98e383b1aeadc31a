"""Identify a mecanum platform's dynamics from logs, and compare models with measurements.

The names below are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification.comparison import Comparison, compare
    from identification.diagnosis.add_effect import Addition, add_effect
    from identification.diagnosis.diagnose import Diagnosis, diagnose
    from identification.fitting.identify import Identification, identify
    from identification.fitting.observability import Observability, motion_observability
    from identification.fitting.recursive import RecursiveLeastSquares
    from identification.logs.log import Log
    from identification.logs.reading import read_log, read_logs, write_log

_HOMES = {
    "Addition": "adding",
    "add_effect": "adding",
    "Diagnosis": "diagnosis",
    "diagnose": "diagnosis",
    "Comparison": "comparison",
    "compare": "comparison",
    "Identification": "fitting",
    "identify": "fitting",
    "Log": "log",
    "read_log": "logs",
    "read_logs": "logs",
    "write_log": "logs",
    "Observability": "observability",
    "motion_observability": "observability",
    "RecursiveLeastSquares": "recursive",
}

__all__ = [
    "Addition",
    "Comparison",
    "Diagnosis",
    "Identification",
    "Log",
    "Observability",
    "RecursiveLeastSquares",
    "add_effect",
    "compare",
    "diagnose",
    "identify",
    "motion_observability",
    "read_log",
    "read_logs",
    "write_log",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"identification.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'identification' has no attribute {name!r}")
