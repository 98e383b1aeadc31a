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


KIND_WORDS = {
    "none": "nothing planted",
    "noise": "nothing planted, noise that is not white",
    "counts": "speeds from encoder counts; Coulomb friction in every other case",
    "one": "one effect of about catalogue size",
    "kinematics": "one effect of kinematics of about catalogue size",
    "quarter": "a quarter of it, twice the noise",
    "double_noise": "one effect of about catalogue size, twice the noise",
    "two": "two effects at once",
    "unknown": "an effect outside the catalogue",
    "differ": "one effect in some of the logs only",
    "regime": "an effect outside the catalogue, in a part of the motion",
    "law": "an effect outside the catalogue, of any kind",
}
"""Kinds of cases in words."""

NEVER = ("refused", "crashed", "identify_failed", "warned")
"""What no case may be."""

WANTED = {
    ("none", "false_alarm"): "< 2 %",
    ("none", "right"): ">= 99 %",
    ("noise", "right"): ">= 95 %",
    ("noise", "wrongly_named"): "<= 1 %",
    ("counts", "right"): "all",
    ("counts", "base_all_within_3"): "all",
    ("one", "right"): ">= 97 %",
    ("two", "right"): ">= 95 %",
    **{(kind, "right"): ">= 85 %" for kind in ("quarter", "double_noise")},
    ("one", "in_set"): "> 95 %",
    ("one", "alone"): "> 80 %",
    ("one", "confidently_wrong"): "< 2 %",
    ("one", "accepted_unplanted"): "< 10 %",
    ("quarter", "in_set"): "> 85 %",
    ("two", "both_found"): "> 85 %",
    ("unknown", "said_unknown"): "> 90 %",
    **{
        (kind, key): ">= 80 %"
        for kind in ("unknown", "law")
        for key in ("law_proposed", "law_right", "law_helps")
    },
    ("none", "law_needless"): "<= 1 %",
    ("noise", "law_needless"): "<= 1 %",
    ("one", "law_needless"): "<= 3 %",
    ("two", "law_needless"): "<= 3 %",
    ("differ", "log_named"): ">= 80 %",
    ("regime", "regime_right"): ">= 80 %",
    **{
        (kind, key): "93 to 97 %"
        for kind in ("none", "noise", "one", "quarter", "double_noise", "two")
        for key in ("sizes_inside", "base_inside")
    },
    **{(kind, key): "none" for kind in KIND_WORDS for key in NEVER},
    **{(kind, "tie_resolved"): "> 80 %" for kind in ("one", "quarter", "two")},
}
"""Targets of the diagnosis."""
