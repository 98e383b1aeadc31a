"""What logs do at the same time is told from slow wander that each has on its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.fitting.settings import PredictabilitySettings
from identification.fitting.shared_times import Likeness, likeness

SETTINGS = PredictabilitySettings()
STEP = 0.1
Rng = np.random.Generator


def rows(duration: float) -> np.ndarray:
    """Times (n,) of a log's rows [s]."""
    return STEP * np.arange(1, round(duration / STEP) + 1)


def measured(make: Callable[[np.ndarray, Rng], np.ndarray], rng: Rng, *durations: float):
    """Likeness of logs that are made one by one, under white noise of half their size."""
    time = [rows(duration) for duration in durations]
    residual = []
    for at in time:
        slow = make(at, rng)
        residual.append(slow + 0.5 * slow.std() * rng.standard_normal(slow.shape))
    return likeness(residual, time, SETTINGS)


def wave(period: float):
    def made(time: np.ndarray, rng: Rng) -> np.ndarray:
        phases = rng.uniform(0.0, 2 * np.pi, 3)
        return np.sin(2 * np.pi * time[:, None] / period + phases)

    return made


def walk(time: np.ndarray, rng: Rng) -> np.ndarray:
    return np.cumsum(rng.standard_normal((len(time), 3)), axis=0)


def lasting(time: np.ndarray, rng: Rng) -> np.ndarray:
    keep = np.exp(-STEP / 8.0)
    return np.asarray(lfilter([1.0], [1.0, -keep], rng.standard_normal((len(time), 3)), axis=0))


def drift(time: np.ndarray, rng: Rng) -> np.ndarray:
    return np.outer(time, rng.standard_normal(3))


def step_at_any_time(time: np.ndarray, rng: Rng) -> np.ndarray:
    instant = rng.uniform(0.1, 0.9) * time[-1]
    return np.outer(time > instant, rng.standard_normal(3))


@pytest.mark.parametrize("make", [wave(60.0), wave(25.0), walk, lasting, drift, step_at_any_time])
@pytest.mark.parametrize("durations", [(60.0, 60.0), (140.0, 60.0), (60.0, 60.0, 60.0)])
def test_logs_that_wander_on_their_own_share_nothing(make, durations):
    rng = np.random.default_rng(7)
    tries = 60
    shared = sum(measured(make, rng, *durations).is_shared(SETTINGS) for _ in range(tries))
    assert shared <= 0.05 * tries


def push(time: np.ndarray, rng: Rng) -> np.ndarray:
    return np.outer(time > 23.0, [1.0, -0.5, 0.2])


def push_for_a_while(time: np.ndarray, rng: Rng) -> np.ndarray:
    return np.outer(np.exp(-(((time - 30.0) / 8.0) ** 2)), [0.2, 0.0, 1.0])


@pytest.mark.parametrize("make", [push, push_for_a_while])
@pytest.mark.parametrize("durations", [(60.0, 60.0), (140.0, 60.0), (60.0, 45.0, 140.0)])
def test_a_push_at_one_time_is_shared_from_two_logs_on(make, durations):
    rng = np.random.default_rng(8)
    found = [measured(make, rng, *durations) for _ in range(5)]
    assert all(one.is_shared(SETTINGS) for one in found)


def test_pushes_at_other_times_or_the_other_way_are_not_shared():
    rng = np.random.default_rng(9)
    time = [rows(60.0), rows(60.0)]
    first = push(time[0], rng)
    for second in (-first, push(time[1] + 12.0, rng)):
        found = likeness([first, second], time, SETTINGS)
        assert not found.is_shared(SETTINGS)


def test_a_single_log_shares_nothing():
    time = rows(60.0)
    found = likeness([push(time, np.random.default_rng(0))], [time], SETTINGS)
    assert found == Likeness(0.0, 1.0) and not found.is_shared(SETTINGS)
