"""The paper's filter a_f/(p + a_f) on sampled signals.

Between two samples a signal is taken as a straight line (first-order hold). A zero-order hold
would delay every product by half a sample and bias the wheels' inertia by about 20 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import finite

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilterSettings:
    """The first-order filter that forces pass before they are compared."""

    rate: float = field(
        default=10.0,
        metadata={
            "unit": "rad/s",
            "reason": "a_f of the paper: the force error is defined with it",
        },
    )
    settling_time_constants: float = field(
        default=5.0,
        metadata={
            "unit": "1",
            "reason": "the filter starts from zero; after 5/a_f that is down to exp(-5) = 0.7 %",
        },
    )

    def __post_init__(self) -> None:
        finite("filter rate", self.rate, positive=True)
        finite("settling time of the filter", self.settling_time_constants, positive=True)


def first_order(start: Array, end: Array, rate: float, dt: float) -> Array:
    """Response of ``rate``/(p + ``rate``) to a signal that is linear within each interval.

    Parameters
    ----------
    start, end : (N - 1, ...) the signal at the start and at the end of each interval; they differ
        from each other's neighbours where the signal jumps (an acceleration between samples)
    rate : a_f [rad/s]
    dt : interval [s]

    Returns
    -------
    (N, ...) filtered signal at the samples, starting from zero. Exact for such signals.
    """
    start, end = _contiguous(start), _contiguous(end)
    found = np.empty((len(start) + 1, *start.shape[1:]))
    _compiled(_filtered)(_flat(start), _flat(end), *hold_weights(rate, dt), _flat(found))
    return found


@cache
def _compiled(function: Callable[..., None]) -> Callable[..., None]:
    """A loop over samples as machine code: made when first asked for, as importing numba takes a
    while, which what filters nothing does without."""
    from youbot_env.caching import njit

    return njit(cache=True, nogil=True)(function)


def _filtered(start, end, decay, weight_start, weight_end, out):
    """Fill out (N, W) with the response to signals at both ends of N - 1 intervals."""
    count, width = start.shape
    for c in range(width):
        out[0, c] = 0.0
    for k in range(count):
        for c in range(width):
            new = weight_start * start[k, c] + weight_end * end[k, c]
            out[k + 1, c] = decay * out[k, c] + new


def _filtered_means(start, end, decay, weight_start, weight_end, first, size, out):
    """Fill out (n, W) with means of ``size`` samples of ``_filtered``, from ``first`` on.

    The filtered signal itself, many times as large, is never held.
    """
    width, rows = start.shape[1], out.shape[0]
    now, total = np.zeros(width), np.zeros(width)
    share, row, held = 1.0 / size, 0, 0
    for sample in range(first + rows * size if rows else 0):
        if sample:
            for c in range(width):
                new = weight_start * start[sample - 1, c] + weight_end * end[sample - 1, c]
                now[c] = decay * now[c] + new
        if sample >= first:
            for c in range(width):
                total[c] += now[c]
            held += 1
            if held == size:
                for c in range(width):
                    out[row, c] = share * total[c]
                    total[c] = 0.0
                row, held = row + 1, 0


def _contiguous(signal: Array) -> Array:
    return np.ascontiguousarray(signal, float)


def _flat(signal: Array) -> Array:
    """(N, W): all axes behind the first as one, for the recursion is the same for each of them."""
    return signal.reshape(len(signal), int(np.prod(signal.shape[1:])))


def hold_weights(rate: float, dt: float) -> tuple[float, float, float]:
    """Factor on the filtered value, and weights of the signal at an interval's start and end.

    Exact for a signal that is linear within the interval.
    """
    decay = float(np.exp(-rate * dt))
    # Integral of rate exp(-rate (dt - t)) t/dt from 0 to dt. The start's weight is the rest, so
    # that a constant signal passes with gain 1.
    weight_end = 1.0 - (1.0 - decay) / (rate * dt)
    return decay, (1.0 - decay) - weight_end, weight_end


def accumulate(steps: Array, decay: float) -> Array:
    """y (N, W) of y[k + 1] = decay y[k] + steps[k], y[0] = 0, for steps (N - 1, W)."""
    steps = _contiguous(steps)
    total = np.empty((len(steps) + 1, steps.shape[1]))
    _compiled(_filtered)(steps, steps, decay, 1.0, 0.0, total)
    return total


def filter_samples(signal: Array, rate: float, dt: float) -> Array:
    """`first_order` of a signal (N, ...) that is continuous at its samples; returns (N, ...)."""
    return first_order(signal[:-1], signal[1:], rate, dt)


Ends = Array | tuple[Array, Array]
"""A signal at the start and the end of each interval: (2, N - 1, ...), or two of (N - 1, ...)."""


def at_both_ends(signal: Array) -> tuple[Array, Array]:
    """A signal (N, ...) that is continuous at its samples, without a copy."""
    return signal[:-1], signal[1:]


def settled(
    rate: float, dt: float, time_constants: float = FilterSettings.settling_time_constants
) -> int:
    """Number of samples after which the effect of the filter's initial value is negligible."""
    # Less 1e-9: rounding of an exact whole number must not add a sample.
    return int(np.ceil(time_constants / rate / dt - 1e-9))


def block_mean(signal: Array, size: int) -> Array:
    """Mean (N // size, ...) of successive blocks; samples that fill no block are left out.

    Averaged filtered signals obey the same linear equation, and white noise on the speeds, which
    would attenuate masses, shrinks with the size of a block.
    """
    if size == 1:
        return signal
    count = len(signal) // size
    return signal[: count * size].reshape(count, size, *signal.shape[1:]).mean(axis=1)


def slope_ends(signal: Array, dt: float) -> Array:
    """Slope (2, N - 1, ...) of a sampled signal (N, ...) at the start and end of each interval.

    Its mean over an interval is the difference there. Held constant, it would lag within a step
    and bias the frictions by (omega dt)^2: a quarter of a standard deviation at 50 Hz.
    """
    slope = np.diff(signal, axis=0) / dt
    # Half the change of slope over an interval, from its two neighbours. The first and the last
    # interval have only one neighbour, and their slope is held constant.
    bend = np.zeros_like(slope)
    bend[1:-1] = 0.25 * (slope[2:] - slope[:-2])
    return np.stack([slope - bend, slope + bend])


def integral_of(rate: Array, dt: float) -> Array:
    """Integral (N, ...) of a sampled rate (N, ...) from the first sample on, by trapezoids.

    The same numbers as scipy.integrate.cumulative_trapezoid, whose import takes 0.3 s.
    """
    total = np.zeros_like(rate)
    for part in pieces(len(rate) - 1):
        after = slice(part.start + 1, part.stop + 1)
        add_up_from(total, part.start, 0.5 * dt * (rate[after] + rate[part]))
    return total


def pieces(count: int, size: int | None = None) -> Iterator[slice]:
    """The first ``count`` samples, ``size`` at a time: what is made of them takes little memory.

    None: as many as make megabytes of a few channels.
    """
    size = size or 1 << 17
    for begin in range(0, count, size):
        yield slice(begin, min(begin + size, count))


def add_up_from(total: Array, at: int, steps: Array) -> None:
    """Fill ``total`` (N, ...) from sample ``at`` on by steps (n, ...): the same as all in one sum.

    ``steps`` are changed.
    """
    if at:
        steps[:1] += total[at]
    np.cumsum(steps, axis=0, out=total[at + 1 : at + 1 + len(steps)])


def vertex(before: float, at: float, after: float) -> float:
    """Where the parabola through three values turns, in steps from the middle one; 0 if straight.

    Finds a peak or a trough between samples, if the middle value is the largest or the least.
    """
    bend = before - 2 * at + after
    return 0.5 * (before - after) / bend if bend else 0.0


@dataclass(frozen=True)
class RowFilter:
    """From a log's samples to rows: the filter, then means over a row's samples.

    rate : of the filter [rad/s]; settling : its time constants until its start is forgotten
    dt : of the samples [s]; size : samples in a row
    """

    rate: float
    settling: float
    dt: float
    size: int

    @property
    def first(self) -> int:
        """Number of the first row's first sample: there the filter has settled."""
        return settled(self.rate, self.dt, self.settling)

    @property
    def step(self) -> float:
        """From one row to the next [s]."""
        return self.size * self.dt

    def __call__(
        self, ends: Ends, moves: NDArray[np.bool_] | None = None, first: int | None = None
    ) -> Array:
        """Rows (n, ...) of a signal that is given at the ends of intervals.

        Rows in which the mechanism rests are zero: they neither ask nor tell anything.

        ``moves`` (N,): whether it moves; None if it does all the time. ``first``: number of the
        first row's first sample, if it is not that of a whole log.
        """
        first = self.first if first is None else first
        rows = self._means(ends[0], ends[1], first)
        if moves is None:
            return rows
        # The filter remembers what was held at rest, and so does a row soon after it.
        rests = (~moves).astype(float)
        moved = self._means(rests[:-1], rests[1:], first) < np.exp(-self.settling)
        return rows * moved.reshape(-1, *[1] * (rows.ndim - 1))

    def _means(self, start: Array, end: Array, first: int) -> Array:
        """Rows (n, ...): means of what is filtered, from sample ``first`` on."""
        start, end = _contiguous(start), _contiguous(end)
        rows = max(0, len(start) + 1 - first) // self.size
        found = np.empty((rows, *start.shape[1:]))
        weights = hold_weights(self.rate, self.dt)
        _compiled(_filtered_means)(
            _flat(start), _flat(end), *weights, first, self.size, _flat(found)
        )
        return found

    def of_samples(self, signal: Array) -> Array:
        """Rows (n, ...) of a signal (N, ...) that is continuous at its samples."""
        return self(at_both_ends(signal))

    def adjoint(
        self,
        rows: Array,
        count: int,
        part: tuple[int, int],
        margin: int,
    ) -> Array:
        """(N, ...) such that its product with N = ``count`` samples is that of ``rows`` (n, ...)
        with the rows of these samples.

        ``part``: from which sample to which they are asked for; ``margin``: samples after it from
        which on the filter, which runs backwards, has forgotten its start.
        """
        begin, end = part
        until = min(end + margin, count)
        spread = np.zeros((until - begin, *rows.shape[1:]))
        held = slice(max(begin, self.first), min(until, self.first + len(rows) * self.size))
        if held.start < held.stop:
            of_row = (np.arange(held.start, held.stop) - self.first) // self.size
            spread[held.start - begin : held.stop - begin] = (rows / self.size)[of_row]
        filtered = filter_samples(spread[::-1], self.rate, self.dt)[::-1]
        return filtered[: end - begin]
