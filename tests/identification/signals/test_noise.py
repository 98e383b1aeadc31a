"""Noise of sampled channels: its size and its colour."""

from __future__ import annotations

import numpy as np
import pytest

from identification.signals.noise import differenced_noise

DT = 0.01


def motion(n: int = 6000) -> np.ndarray:
    t = DT * np.arange(n)
    return np.column_stack([5 * np.sin(1.3 * t), 3 * np.cos(2.9 * t) + np.sin(0.7 * t)])


@pytest.mark.parametrize("counts", [500, 2000, 16384])
def test_differences_of_counted_angles_are_recognised_with_their_size(counts):
    step = 2 * np.pi / counts
    angle = step * np.floor(np.cumsum(motion(), axis=0) * DT / step)
    found = differenced_noise(np.diff(angle, axis=0) / DT, DT)
    assert found is not None
    assert found == pytest.approx(step / np.sqrt(12), rel=0.25)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_white_and_slow_noise_is_not_taken_for_differences(memory):
    rng = np.random.default_rng(1)
    noise = np.zeros((6000, 2))
    for k in range(1, len(noise)):
        noise[k] = memory * noise[k - 1] + 0.02 * rng.standard_normal(2)
    assert differenced_noise(motion() + noise, DT) is None


def test_rounded_speeds_and_speeds_without_noise_are_not():
    assert differenced_noise(motion().round(1), DT) is None
    assert differenced_noise(np.zeros((6000, 2)), DT) is None
    assert differenced_noise(motion(), DT) is None


def test_speeds_at_rest_say_nothing():
    angle = np.floor(np.cumsum(motion(), axis=0) * DT / 0.01) * 0.01
    speed = np.column_stack([np.diff(angle, axis=0) / DT, np.zeros(5999)])
    found = differenced_noise(speed, DT)
    assert found is not None and found[2] == 0.0


def test_a_hum_near_half_the_sampling_rate_is_not():
    t = DT * np.arange(6000)
    white = 0.01 * np.random.default_rng(2).standard_normal((6000, 2))
    hum = 0.02 * np.sin(2 * np.pi * 49.95 * t)[:, None]
    assert differenced_noise(motion() + white + hum, DT) is None
