from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.fitting.errors import NoiseLevel
from identification.fitting.lasting_noise import lasting_noise, torque_noise
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


def test_a_hum_near_half_the_sampling_rate_is_no_white_noise():
    """White noise is measured by differences, in which such a hum is 40 times as large."""
    mechanism, rng = mechanism_of(PAPER), np.random.default_rng(6)
    log = recording(noise=0.0)
    # In these phases as much of it is in the four wheels' difference as in each wheel.
    hum = 0.03 * np.sin(np.pi * (96.0 * log.time[:, None] + np.array([0.0, 0.5, 0.5, 1.0])))
    white = 0.01 * rng.standard_normal((len(log), 4))
    samples = mechanism.samples(replace(log, velocity=log.velocity + hum + white))
    level = NoiseLevel.of(samples)
    assert level.speed.min() > 0.04
    found = lasting_noise(mechanism, samples, level, rng)
    assert found is not None
    assert found.speed.std(axis=0) == pytest.approx([np.hypot(0.01, 0.03 / 2**0.5)] * 4, rel=0.1)
    assert slow_part(found.speed, samples.dt, 40.0) == pytest.approx([0.01 * 0.8**0.5] * 4, rel=0.2)


def test_speeds_that_were_made_of_a_twist_tell_nothing_of_their_noise():
    mechanism, rng = mechanism_of(PAPER), np.random.default_rng(7)
    log = recording("III")
    samples = mechanism.samples(log)
    made = mechanism.joint_speed(samples.twist).round(4)
    samples = replace(samples, wheel_speed=made)
    assert lasting_noise(mechanism, samples, NoiseLevel.of(samples), rng) is None


def test_white_noise_and_a_single_joint_have_none():
    rng = np.random.default_rng(0)
    mechanism, log = mechanism_of(PAPER), recording("III")
    samples = mechanism.samples(log)
    assert lasting_noise(mechanism, samples, NoiseLevel.of(samples), rng) is None
    axis, _ = planted(STAGE)
    alone = axis.samples(log_of(*planted(STAGE), 10.0))
    assert lasting_noise(axis, alone, NoiseLevel.of(alone), rng) is None


def torque_noise_of(added, hum=0.0):
    """Noise for torques of a log to whose torques and speeds noise was added.

    ``hum``: amplitude [rad/s] of a tone of 30 Hz on the speeds.
    """
    mechanism, rng = mechanism_of(PAPER), np.random.default_rng(5)
    log = recording("III", noise=0.0)
    tone = np.sin(2 * np.pi * 30.0 * log.time[:, None] + np.arange(4))
    speed = log.velocity + 0.01 * rng.standard_normal((len(log), 4)) + hum * tone
    samples = mechanism.samples(replace(log, velocity=speed, effort=log.effort + added(rng, log)))
    level = NoiseLevel.of(samples)
    # As if nothing were known of the tone.
    noisy = mechanism.noisy(samples, np.full(4, 0.01), 0.0 * level.torque, rng)
    return torque_noise(mechanism, PAPER.theta, samples, noisy, level, rng), samples.dt


def slow_part(noise, dt, highest=1.0):
    """(J,) standard deviations of what noise holds up to ``highest`` [Hz]."""
    spectrum = np.fft.rfft(noise, axis=0)
    spectrum[np.fft.rfftfreq(len(noise), dt) > highest] = 0.0
    return np.fft.irfft(spectrum, len(noise), axis=0).std(axis=0)


def first_order(size, time_constant):
    def added(rng, log):
        keep = np.exp(-log.dt / time_constant)
        white = rng.standard_normal((len(log), 4))
        return size * np.sqrt(1 - keep**2) * lfilter([1.0], [1.0, -keep], white, axis=0)

    return added


def white(rng, log):
    return 0.03 * rng.standard_normal((len(log), 4))


def test_noise_of_the_torques_has_the_spectrum_of_what_the_residual_holds():
    found, dt = torque_noise_of(first_order(0.05, 0.25))
    assert found.std(axis=0) == pytest.approx([0.05] * 4, rel=0.25)
    after = [np.corrcoef(one[:-25], one[25:])[0, 1] for one in found.T]
    assert after == pytest.approx([np.exp(-25 * dt / 0.25)] * 4, abs=0.15)
    assert np.abs(np.corrcoef(found.T) - np.eye(4)).max() < 0.3


def test_noise_of_the_torques_that_is_white_stays_white():
    found, dt = torque_noise_of(white)
    assert found.std(axis=0) == pytest.approx([0.03] * 4, rel=0.1)
    assert slow_part(found, dt) == pytest.approx([0.03 * np.sqrt(2 * dt)] * 4, rel=0.15)


def test_a_tone_that_the_torques_do_not_hold_is_no_noise_of_theirs():
    """The residual holds it, because the speeds do."""
    found, _ = torque_noise_of(white, hum=0.05)
    assert found.std(axis=0) == pytest.approx([0.03] * 4, rel=0.1)


def test_a_log_without_noise_on_its_torques_has_none():
    samples = mechanism_of(PAPER).samples(recording("III", noise=0.0))
    level = NoiseLevel(np.full(4, 0.01), np.zeros(4))
    args = mechanism_of(PAPER), PAPER.theta, samples, samples, level
    assert not torque_noise(*args, np.random.default_rng(0)).any()
