"""Noise of the speeds that lasts, with the spectrum that the joints show beside any motion.

More joints than axes: what their speeds hold beside those of a rigid motion is noise alone. Of four
mecanum wheels it is phi_1' + phi_2' - phi_3' - phi_4'.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.fitting.errors import NoiseLevel
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import AddedNoise, Samples

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
    if left is None or np.sqrt(np.mean(left**2)) < settings.min_lasting_noise_ratio * white:
        return None
    size = np.abs(np.fft.rfft(left))
    phases = rng.uniform(0.0, 2 * np.pi, (len(size), len(level.speed)))
    spectrum = size[:, None] * np.exp(1j * phases)
    extra = np.fft.irfft(spectrum, len(left), axis=0) * level.speed / max(white, 1e-300)
    return mechanism.added_noise(samples, extra)


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
