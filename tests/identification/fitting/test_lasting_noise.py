from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.fitting.errors import NoiseLevel
from identification.fitting.lasting_noise import lasting_noise
from identification.mechanisms.registry import mechanism_of
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
SIZE = 0.02
"""Standard deviation [rad/s] of a noise that lasts."""


def noise_of(uneven: float = 0.0):
    """Noise of logs whose speeds have noise that lasts; ``uneven``: a wheel's speed too large."""
    mechanism, rng = mechanism_of(PAPER), np.random.default_rng(3)
    log = recording("III", noise=0.0)
    white = rng.standard_normal((len(log), 4))
    slow = SIZE * np.sqrt(1 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white, axis=0)
    speed = log.velocity * (1.0 + uneven * np.array([1.0, 0.0, 0.0, 0.0]))
    samples = mechanism.samples(replace(log, velocity=speed + slow))
    return lasting_noise(mechanism, samples, NoiseLevel.of(samples), rng)


@pytest.mark.parametrize("uneven", [0.0, 0.02])
def test_noise_has_the_spectrum_of_what_the_speeds_hold_beside_motion(uneven):
    found = noise_of(uneven)
    assert found is not None
    assert found.speed.std(axis=0) == pytest.approx(SIZE, rel=0.2)
    after = [np.corrcoef(one[:-1], one[1:])[0, 1] for one in found.speed.T]
    assert after == pytest.approx([0.9] * 4, abs=0.03)
    # Of each joint its own.
    assert np.abs(np.corrcoef(found.speed.T) - np.eye(4)).max() < 0.2


def test_white_noise_and_a_single_joint_have_none():
    rng = np.random.default_rng(0)
    mechanism, log = mechanism_of(PAPER), recording("III")
    samples = mechanism.samples(log)
    assert lasting_noise(mechanism, samples, NoiseLevel.of(samples), rng) is None
    axis, _ = planted(STAGE)
    alone = axis.samples(log_of(*planted(STAGE), 10.0))
    assert lasting_noise(axis, alone, NoiseLevel.of(alone), rng) is None
