"""Rows of long logs, made in parts: the same numbers to rounding, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import FitSettings
from identification.mechanisms.samples import AddedNoise, Samples, cut
from identification.signals.filters import Ends, RowFilter, settled
from identification.threads import give_back, side_by_side

Array = NDArray[np.float64]


def reduced_by_parts(
    ends_of: Callable[[Samples], Ends],
    samples: Samples,
    reduce: RowFilter,
    settings: FitSettings,
    *,
    whole: bool,
    added: AddedNoise | None = None,
) -> Array:
    """Rows of what ``ends_of`` makes of samples, in parts of long logs, side by side.

    An hour at 1 kHz would take gigabytes at once. Each part begins so long before its first row
    that the filter forgets its start to rounding, and ends as long after its last row, for what
    looks ahead: slopes, means, a delay.

    Parameters
    ----------
    whole : whether ``ends_of`` must see a log at once, because it integrates
    added : noise on the speeds, put on each part alone
    """

    def of_part(begin: int, end: int) -> Ends:
        part = samples if end - begin == len(samples) else cut(samples, begin, end)
        return ends_of(part if added is None else added.on(part, begin))

    return rows_in_parts(of_part, len(samples), samples.moves, reduce, settings, whole=whole)


def rows_in_parts(
    ends_of: Callable[[int, int], Ends],
    count: int,
    moves: NDArray[np.bool_] | None,
    reduce: RowFilter,
    settings: FitSettings,
    *,
    whole: bool = False,
) -> Array:
    """The same of what ``ends_of`` gives for the samples from one to another of ``count``.

    ``moves`` (N,): whether the mechanism moves; None if it does all the time.
    """

    def of_part(begin: int, end: int, first: int | None = None) -> Array:
        return reduce(ends_of(begin, end), None if moves is None else moves[begin:end], first)

    if whole or count <= settings.max_part_samples:
        return of_part(0, count)
    size = reduce.size
    margin = settled(reduce.rate, reduce.dt, settings.part_margin_time_constants)
    rows = max(1, min(settings.part_samples, settings.max_part_samples) // size)

    def rows_from(start: int) -> Array:
        most = min(rows, (count - start) // size)
        begin, end = max(0, start - margin), min(start + most * size + margin, count)
        return of_part(begin, end, start - begin)[:most]

    first, *starts = range(reduce.first, count - size + 1, rows * size)
    head = rows_from(first)
    # Filled part by part: to join all of them at the end would take their memory twice.
    found = np.empty(((count - first) // size, *head.shape[1:]))
    found[: len(head)] = head

    def fill(start: int) -> None:
        part = rows_from(start)
        at = (start - first) // size
        found[at : at + len(part)] = part

    side_by_side(fill, starts)
    give_back()
    return found


def give_back_after(logs: Sequence[Samples], settings: FitSettings) -> None:
    """Return to the system what work on logs has freed, where one is so long that it matters."""
    if max(map(len, logs)) > settings.max_part_samples:
        give_back()
