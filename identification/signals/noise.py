"""White measurement noise of a log's channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import count, finite

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseSettings:
    """How the white noise of a sampled channel is measured."""

    difference_order: int = field(
        default=6,
        metadata={
            "unit": "1",
            "reason": "passes a motion of 3 Hz sampled at 50 Hz with a gain below 1e-4",
        },
    )
    max_deviations: float = field(
        default=4.0,
        metadata={
            "unit": "standard deviations",
            "reason": "larger differences are steps, spikes or contacts, not white noise",
        },
    )
    max_differenced_slope: float = field(
        default=0.6,
        metadata={
            "unit": "1",
            "reason": "power at an eighth to a quarter of the sampling rate over that above three "
            "eighths: white noise has 1.0 (0.9 to 1.2 in 40 logs), differences of angles 0.34 "
            "(0.25 to 0.5, from 500 to 16384 counts a turn), coloured noise more than 2",
        },
    )
    max_samples: int = field(
        default=20_000,
        metadata={
            "unit": "samples",
            "reason": "settle a statistic to better than 2 %; a longer log is thinned",
        },
    )

    def __post_init__(self) -> None:
        count("order of the differences", self.difference_order)
        finite("deviations of a difference", self.max_deviations, positive=True)
        finite("slope of a differenced noise", self.max_differenced_slope, positive=True)
        count("samples of a noise level", self.max_samples)


def white_noise(
    signal: Array,
    valid: NDArray[np.bool_] | None = None,
    settings: NoiseSettings = NoiseSettings(),
) -> Array:
    """Standard deviation (k,) of white noise in the channels (n, k), from high-order differences.

    Parameters
    ----------
    signal : (n, k) uniformly sampled, n > the differences' order
    valid : (n,) samples to take; differences that touch another are left out

    Notes
    -----
    A difference of order p of white noise has the variance C(2p, p) sigma^2, and a smooth signal
    hardly enters it. The largest differences are left out, so steps, spikes and contacts do not
    count. Slow errors are not counted as noise. What a sensor adds at high frequency (the ripple of
    rollers, the error of an encoder) is counted as noise.
    """
    order = settings.difference_order
    starts = thinned(np.arange(len(signal) - order), settings.max_samples)
    if valid is not None and not valid.all():
        # Counts up to each sample: equal counts at both ends mean no repaired sample in between.
        touched = np.r_[0, np.cumsum(~valid)]
        whole = starts[touched[starts + order + 1] == touched[starts]]
        # If nearly every difference touches a repaired sample, a rough level is better than none.
        starts = whole if whole.size > 10 * order else starts
    differences = np.zeros((len(starts), signal.shape[1]))
    for i in range(order + 1):
        differences += (-1) ** i * comb(order, i) * signal[starts + i]
    # 1.4826: from the median of absolute normal deviates to their standard deviation.
    scale = 1.4826 * np.median(np.abs(differences), axis=0)
    # A coarse channel may have a median of zero: then all differences are kept.
    usual = (np.abs(differences) <= settings.max_deviations * scale) | (scale == 0)
    mean_square = (differences**2).sum(axis=0, where=usual) / usual.sum(axis=0)
    return np.sqrt(mean_square / comb(2 * order, order))


def differenced_noise(
    rate: Array, dt: float, settings: NoiseSettings = NoiseSettings()
) -> Array | None:
    """Standard deviation (k,) of white noise on a position whose differences are the channels.

    Speeds from an encoder are differences of counted angles. An angle's error (half a count, and
    the jitter of its instant) is white, and its difference has the power |1 - exp(-i w dt)|^2:
    little where the motion is, most at half the sampling rate. None if the channels (n, k), ``dt``
    [s] apart, do not show that shape.
    """
    n = len(rate)
    # Hann's window: the ends of the log must not leak into high frequencies. 3/8: its mean square.
    windowed = (rate - rate.mean(axis=0)) * np.hanning(n)[:, None]
    power = np.abs(np.fft.rfft(windowed, axis=0)) ** 2 / (0.375 * n)
    share = np.arange(len(power)) / n
    # Medians: a hum is a line, and a line near half the sampling rate is no such shape. ln 2: from
    # the median of a noise's power, which is distributed exponentially, to its mean.
    low = np.median(power[(share > 0.125) & (share < 0.25)], axis=0) / np.log(2.0)
    high = np.median(power[share > 0.375], axis=0) / np.log(2.0)
    moving = high > 0
    if not moving.any() or (low / np.where(moving, high, np.inf)).sum() > (
        settings.max_differenced_slope * moving.sum()
    ):
        return None
    # Mean of |1 - exp(-i w dt)|^2 = 2 - 2 cos(w dt) above three eighths of the sampling rate.
    gain = 2.0 + 2.0 * np.sin(0.75 * np.pi) / (0.25 * np.pi)
    return dt * np.sqrt(high / gain)


def thinned(samples: NDArray, most: int = NoiseSettings.max_samples) -> NDArray:
    """Every j-th of the samples (n,), j so that about ``most`` (or up to twice as many) remain."""
    return samples[:: max(len(samples) // most, 1)]
