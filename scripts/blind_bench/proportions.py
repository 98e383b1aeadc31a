"""Shares of cases, with exact intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from scipy.stats import beta, norm


@dataclass(frozen=True)
class Proportion:
    """``count`` of ``total`` cases."""

    count: int
    total: int

    @classmethod
    def of(cls, answers: Iterable[bool | None]) -> Proportion:
        """Of the answers that there are: None is no answer."""
        known = [answer for answer in answers if answer is not None]
        return cls(sum(known), len(known))

    @property
    def value(self) -> float:
        """count / total; NaN of nothing."""
        return self.count / self.total if self.total else float("nan")

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Exact two-sided interval of a binomial share (Clopper and Pearson 1934)."""
        k, n, tail = self.count, self.total, (1.0 - confidence) / 2
        low = float(beta.ppf(tail, k, n - k + 1)) if k else 0.0
        high = float(beta.ppf(1.0 - tail, k + 1, n - k)) if k < n else 1.0
        return low, high

    def wilson(self, confidence: float = 0.95) -> tuple[float, float]:
        """Two-sided score interval of a binomial share (Wilson 1927); of nothing: 0 to 1.

        Its mean coverage is what it says; the exact interval's is more.
        """
        if not self.total:
            return 0.0, 1.0
        z, n, share = float(norm.ppf(0.5 + confidence / 2)), self.total, self.value
        centre = (share + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * (share * (1 - share) / n + z * z / (4 * n * n)) ** 0.5
        return max(0.0, centre - half), min(1.0, centre + half)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "share": self.value,
            "count": self.count,
            "total": self.total,
            "interval": list(self.interval()),
        }
