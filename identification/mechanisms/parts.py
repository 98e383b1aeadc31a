"""Stretches of a log, of any mechanism, that are judged apart."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Part:
    """A stretch of a log: its kind (I, II, III, IV or "free"; "run" of an axis) and its samples."""

    kind: str
    samples: Any

    @property
    def start(self) -> float:
        """Seconds from the log's start."""
        return float(self.samples.time[0])

    @property
    def end(self) -> float:
        """Seconds from the log's start."""
        return float(self.samples.time[-1])


def cut(samples: Any, start: int, stop: int) -> Any:
    """Rows ``start`` to ``stop`` of any mechanism's samples, under the same name and time."""
    arrays = {field.name: getattr(samples, field.name) for field in fields(samples)}
    return replace(
        samples, **{k: v[start:stop] for k, v in arrays.items() if isinstance(v, np.ndarray)}
    )
