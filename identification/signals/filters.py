"""The paper's filter a_f/(p + a_f) on sampled signals, without the bias of a held sample.

Between two samples a signal is taken as a straight line (first-order hold). A hold of order zero
would delay every product by half a sample and bias the wheels' inertia by some 20 %.
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
    decay, weight_start, weight_end = hold_weights(rate, dt)
    steps = weight_start * np.asarray(start, float) + weight_end * np.asarray(end, float)
    return accumulate(steps.reshape(len(steps), -1), decay).reshape(-1, *steps.shape[1:])


def hold_weights(rate: float, dt: float) -> tuple[float, float, float]:
    """Of one step: what stays of the filtered value, and the weights of the signal at the start and
    at the end of an interval over which it is linear."""
    decay = float(np.exp(-rate * dt))
    weight_end = 1.0 - (1.0 - decay) / (rate * dt)
    return decay, (1.0 - decay) - weight_end, weight_end


def accumulate(steps: Array, decay: float) -> Array:
    """y (N, W) of y[k+1] = decay y[k] + steps[k], y[0] = 0, for steps (N - 1, W), 0 <= decay < 1.

    By doubling (Hillis and Steele, Comm. ACM 29(12), 1986): the sum over the last 2^j steps is that
    over the last 2^(j-1) and the decayed one before. It equals scipy.signal.lfilter to 5e-15.
    """
    total = np.concatenate([np.zeros((1, steps.shape[1])), steps])
    reach = 1
    # What has decayed to less than rounding changes no sum any more.
    while reach < len(total) and decay > np.finfo(float).eps / 100:
        # The product is made before it is added, so that nothing is read twice.
        total[reach:] += decay * total[:-reach]
        reach, decay = 2 * reach, decay * decay
    return total


def filter_samples(signal: Array, rate: float, dt: float) -> Array:
    """The same for a continuous signal (N, ...) given at its samples."""
    return first_order(signal[:-1], signal[1:], rate, dt)


def settled(
    rate: float, dt: float, time_constants: float = FilterSettings.settling_time_constants
) -> int:
    """Number of samples after which the filter's start is forgotten."""
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
    bend = np.zeros_like(slope)
    bend[1:-1] = 0.25 * (slope[2:] - slope[:-2])
    return np.stack([slope - bend, slope + bend])


def integral_of(rate: Array, dt: float) -> Array:
    """Integral (N, ...) of a sampled rate (N, ...) from the first sample on, by trapezoids.

    The same numbers as scipy.integrate.cumulative_trapezoid, whose import takes 0.3 s.
    """
    total = np.zeros_like(rate)
    np.cumsum(0.5 * dt * (rate[1:] + rate[:-1]), axis=0, out=total[1:])
    return total
