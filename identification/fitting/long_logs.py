"""What is done about logs that hold more samples than a fit needs."""

from __future__ import annotations

from collections.abc import Sequence

from identification.logs.findings import names_of
from identification.mechanisms.samples import Samples, averaged_down


def averaged_to_most(
    samples: Sequence[Samples], most: int, least_rate: float, purpose: str
) -> tuple[list[Samples], list[str]]:
    """Samples of all logs that are about as many as ``most`` together, and what was done, in words.

    Faster logs are averaged down, those of one rate alike; none below ``least_rate`` [Hz].

    purpose : what the words say that so many are too much for
    """
    count = sum(map(len, samples))
    if count <= most:
        return list(samples), []
    share = most / count
    found = [averaged_down(item, max(share / item.dt, least_rate)) for item in samples]
    ways = {(round(1.0 / a.dt), round(1.0 / b.dt)) for a, b in zip(samples, found, strict=True)}
    rates = [f"from {fast} Hz to {slow} Hz" for fast, slow in sorted(ways) if fast != slow]
    if not rates:
        return found, []
    names = names_of([a.name for a, b in zip(samples, found, strict=True) if a is not b])
    return found, [
        f"{names}: {count} samples are more than {purpose}; averaged {' and '.join(rates)}, all of "
        "the time"
    ]
