"""Channels that take a new value every few samples only, and hold it in between."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import count, finite

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class HeldSettings:
    """When a channel counts as held."""

    min_changes: int = field(
        default=50,
        metadata={"unit": "1", "reason": "fewer changes are no habit of a logger"},
    )
    min_regular_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of the changes",
            "reason": "held values change every so many rows; coarse ones at any row",
        },
    )

    def __post_init__(self) -> None:
        count("changes of a held channel", self.min_changes)
        finite("share of regular changes", self.min_regular_share, positive=True)


def fresh_rows(block: Array, settings: HeldSettings = HeldSettings()) -> tuple[int, Rows] | None:
    """Of channels (n, k) that are held: for how many rows, and the rows (m,) of new values.

    None where they are new at every row, or at rows that follow no rule.
    """
    changed = np.flatnonzero((block[1:] != block[:-1]).any(axis=1)) + 1
    lengths = np.diff(changed)
    if lengths.size < settings.min_changes:
        return None
    usual = int(np.median(lengths))
    if usual < 2 or (lengths % usual == 0).mean() <= settings.min_regular_share:
        return None
    return usual, changed


def between_fresh(block: Array, fresh: Rows) -> Array:
    """Channels (n, k) that go straight from one new value to the next."""
    known = np.concatenate([[0], fresh])
    rows = np.arange(len(block))
    return np.column_stack([np.interp(rows, known, channel[known]) for channel in block.T])


def half_a_row_later(block: Array, fresh: Rows) -> Array:
    """Channels (n, k) that step at the rows of new values, not half a row before them."""
    later = block.copy()
    later[fresh] = 0.5 * (block[fresh] + block[fresh - 1])
    return later


def ripple(signal: Array, rows: int) -> Array:
    """What a signal (n, k) does within holds of ``rows``: slower parts are taken away, twice."""
    width = 2 * rows + 1
    for _ in range(2):
        total = np.cumsum(np.concatenate([np.zeros((1, signal.shape[1])), signal]), axis=0)
        signal = signal[rows : len(signal) - rows] - (total[width:] - total[:-width]) / width
    return signal
