"""What a stated probability promises, beside what it delivered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NULLS = ("none", "noise")
"""Kinds of the cheap fits, in turn: white noise, and noise of other kinds."""


@dataclass(frozen=True)
class Row:
    """What was promised of something stated, and what came.

    hits, of : per replicate, how often it held and how often it was stated; those of one replicate
        are not independent, so the standard error is that of a ratio over replicates
    least, most : of the share that is promised
    """

    what: str
    promised: str
    hits: tuple[int, ...]
    of: tuple[int, ...]
    least: float = 0.0
    most: float = 1.0

    @property
    def share(self) -> float:
        """Of all that was stated, what held."""
        return sum(self.hits) / sum(self.of)

    @property
    def replicates(self) -> int:
        """That stated it."""
        return sum(count > 0 for count in self.of)

    @property
    def std(self) -> float:
        """Standard error of the share, by the spread of the replicates (ratio estimator).

        Where all replicates agree that spread is zero: then one more, which does not, is added.
        """
        hits, of = np.array(self.hits, float), np.array(self.of, float)
        if self.share in (0.0, 1.0):
            usual = of.sum() / max(self.replicates, 1)
            hits, of = np.append(hits, (1.0 - self.share) * usual), np.append(of, usual)
        left = hits - hits.sum() / of.sum() * of
        count = len(left)
        return float(np.sqrt((left**2).sum() * count / max(count - 1, 1)) / of.sum())

    @property
    def falls_short(self) -> bool:
        """Whether the share is outside the promise by more than two standard errors."""
        return self.share + 2 * self.std < self.least or self.share - 2 * self.std > self.most
