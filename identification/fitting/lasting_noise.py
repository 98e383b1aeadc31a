"""Noise that is not white, with the spectrum that logs show.

Of the speeds: more joints than axes, and what their speeds hold beside those of a rigid motion is
noise alone. Of four mecanum wheels it is phi_1' + phi_2' - phi_3' - phi_4'. Of the torques: what a
model's residual holds beside that of the speeds' noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.errors import NoiseLevel
from identification.fitting.regression import filtered_residual
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import AddedNoise, Samples
from identification.signals.noise import white_noise

Array = NDArray[np.float64]


def lasting_noise(
    mechanism: Mechanism,
    samples: Samples,
    level: NoiseLevel,
    rng: np.random.Generator,
    settings: FitSettings = FitSettings(),
) -> AddedNoise | None:
    """Noise on a log's speeds with random phases; None where it is white, or nothing shows it.

    ``level``: the white noise, which says how the joints share it.
    """
    if samples.angle_noise is not None:
        return None
    left = _beside_motion(mechanism, samples)
    white = float(np.sqrt(np.mean(level.speed**2)))
    if left is None:
        return None
    size, ratio = float(np.sqrt(np.mean(left**2))), settings.min_lasting_noise_ratio
    # A hum near half the sampling rate makes the white noise seem too large: here too, or the
    # speeds were made of a twist, and hold nothing beside it.
    own = float(white_noise(left[:, None], settings=settings.noise)[0])
    if size < ratio * white and own < ratio * size:
        return None
    spectrum = np.abs(np.fft.rfft(left))[:, None]
    phases = rng.uniform(0.0, 2 * np.pi, (len(spectrum), len(level.speed)))
    spectrum = spectrum * np.exp(1j * phases)
    extra = np.fft.irfft(spectrum, len(left), axis=0) * level.speed / max(white, 1e-300)
    return mechanism.added_noise(samples, extra)


def torque_noise(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    noisy: Samples,
    level: NoiseLevel,
    rng: np.random.Generator,
    settings: FitSettings = FitSettings(),
) -> Array:
    """Noise (N, J) for a log's torques [N m], with the spectrum that a model's residual shows.

    Its phases are random. In each band of frequencies it is as large as the residual asks for
    beside the speeds' noise, and no larger than the logged torques. Where the speeds' noise hides
    that of the torques, it is white. What a model lacks is in its residual, and so in this noise.

    Parameters
    ----------
    theta : (P,) of the model; samples : of the log; noisy : the same with noise on the speeds
    level : the white noise, which says how the joints share it
    """
    count, torque = len(samples), samples.torque
    # Of the same size at each frequency: then chance has no part in the power of a band.
    phases = rng.uniform(0.0, 2 * np.pi, (count // 2 + 1, len(level.torque)))
    spectrum = np.sqrt(count) * np.exp(1j * phases) * level.torque
    white = np.fft.irfft(spectrum, count, axis=0)
    if not white.any():
        return white
    # Each sample is a row: the usual rows hold no frequency above half their rate.
    rows = replace(settings, row_rate=1.0 / samples.dt)
    left, with_speeds, with_torques = (
        filtered_residual(mechanism, theta, item, rows)
        for item in (samples, noisy, replace(samples, torque=torque + white))
    )
    bands = _Bands.of(len(left) * samples.dt, 0.5 / samples.dt, settings)
    total, by_speeds, by_torques = (
        bands.power(one, samples.dt) for one in (left, with_speeds - left, with_torques - left)
    )
    # A band of rounding errors alone asks for nothing.
    by_torques = np.maximum(by_torques, settings.min_held_out_share * by_torques.max())
    ratio = np.maximum(total - by_speeds, 0.0) / by_torques
    # The power at one frequency, on one axis, has a standard deviation as large as its mean.
    known = bands.frequencies(len(left), samples.dt) * left.shape[1]
    deviation = np.hypot(total, by_speeds) / by_torques / np.sqrt(known)
    sure = abs(ratio - 1.0) > settings.noise_band_deviations * deviation
    most = bands.power(torque, samples.dt) / bands.power(white, samples.dt)
    size = np.sqrt(np.where(sure, np.minimum(ratio, most), 1.0))
    return np.fft.irfft(spectrum * size[bands.places(count, samples.dt), None], count, axis=0)


@dataclass(frozen=True)
class _Bands:
    """Bands of frequencies; ``edges``: between one and the next [Hz]."""

    edges: Array

    @classmethod
    def of(cls, seconds: float, highest: float, settings: FitSettings) -> _Bands:
        """Bands up to the highest frequency [Hz] of logs that last some seconds."""
        least, edges = settings.noise_band_frequencies / seconds, list[float]()
        end = least
        while end + least < highest:
            edges.append(end)
            width = min(settings.noise_band_share * end, settings.noise_band_width)
            end += max(width, least)
        return cls(np.array(edges))

    def places(self, count: int, dt: float) -> NDArray[np.intp]:
        """(n,) number of the band of each frequency of ``count`` samples, ``dt`` [s] apart."""
        return np.searchsorted(self.edges, np.fft.rfftfreq(count, dt), side="right")

    def frequencies(self, count: int, dt: float) -> NDArray[np.intp]:
        """(bands,) how many frequencies there are in each of them."""
        return np.bincount(self.places(count, dt), minlength=len(self.edges) + 1)

    def power(self, signal: Array, dt: float) -> Array:
        """(bands,) power of signals (n, k), ``dt`` [s] apart, without their means."""
        power = (np.abs(np.fft.rfft(signal, axis=0)) ** 2).sum(axis=1)
        power[0] = 0.0
        places = self.places(len(signal), dt)
        return np.asarray(np.bincount(places, power, len(self.edges) + 1), float)


def _beside_motion(mechanism: Mechanism, samples: Samples) -> Array | None:
    """(N,) what the speeds hold beside those of a rigid motion, of the noise's size."""
    if not mechanism.internal:
        return None
    internal = np.array(mechanism.internal) / np.linalg.norm(mechanism.internal)
    left, speed = samples.wheel_speed @ internal, mechanism.measured_speed(samples)
    # Joints that roll or are measured unevenly: motion, not noise.
    ways = np.sign(mechanism.joint_speed(speed))
    motion = np.column_stack([np.ones(len(left)), speed, ways])
    return left - motion @ np.linalg.lstsq(motion, left, rcond=None)[0]
