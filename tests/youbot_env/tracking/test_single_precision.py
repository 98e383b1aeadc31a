"""Rows in single precision: close to those in double, and the same bits however many they are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sparing import mostly_slow
from tests.youbot_env.structures import BASE_ONLY, CASES, model
from tests.youbot_env.tracking.test_vector_env import NOISY, batch_actions, vector
from youbot_env import InputError
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import Batch, keys_of
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_env.tracking.options import tracking_setup

COPIES = 8
SETTLED = {"delay": 1, "wheel_speed_noise": 0.01, "randomise": {"m0": ("80%", "120%")}}


def pair(options) -> tuple[Batch, Batch]:
    """The same episodes in double and in single precision."""
    double, single = (
        Batch(tracking_setup(**options, dtype=dtype), COPIES) for dtype in ("float64", "float32")
    )
    for batch in (double, single):
        batch.begin(keys=keys_of(range(COPIES)))
    return double, single


@pytest.mark.parametrize("case", mostly_slow(CASES, [BASE_ONLY]))
def test_stays_with_double_precision_over_an_episode(case):
    """1000 steps under random torques: what docs/environment.md states, over every effect."""
    double, single = pair({"model": model(case), **SETTLED})
    rng, worst = np.random.default_rng(1), np.zeros(lanes.REPORT_COLUMNS)
    for _ in range(999):
        action = rng.uniform(-0.6, 0.6, (COPIES, 4)).astype(np.float32)
        one, other = double.step(action), single.step(action)
        assert np.array_equal(one.over, other.over)
        worst = np.maximum(worst, np.abs(one.report - other.report).max(axis=0))
    part = {name: worst[place] for name, place in PARTS.items()}
    slack = max(STEEP.get(name, 1.0) for name in [*model(case).effects, BASE_ONLY])
    assert part["twist"].max() < 2e-5 * slack and part["pose"].max() < 5e-5 * slack
    assert part["wheel_angle"].max() < 1e-3 * slack and part["reward"].max() < 5e-5 * slack
    if case == BASE_ONLY:
        assert part["twist"].max() < 5e-7 and part["pose"].max() < 1e-6
        assert part["reference"].max() < 1e-6 and part["reward"].max() < 2e-6
    # Counters, what is seen and past actions are of one size in both: most with a delay, 0.78.
    assert single.bytes_a_row < 0.8 * double.bytes_a_row


STEEP = {"torque_ripple": 100.0, "yaw_scrub": 10.0, "speed_dependent_gain": 2.0}
"""Effects by how much more courses may part. Ripple: a wheel that nearly stops falls to either side
of a crest. Scrub and gain: they change their sign or slope where the platform hardly turns, or a
wheel; 1.2e-4 and 2.3e-5 rad/s were the most."""

PARTS = {
    "twist": slice(lanes.TWIST, lanes.TWIST + 3),
    "pose": slice(lanes.POSE, lanes.POSE + 3),
    "wheel_angle": slice(lanes.ANGLE, lanes.ANGLE + 4),
    "reference": slice(lanes.WANTED, lanes.WANTED_RATE + 3),
    "reward": slice(lanes.REWARD_AT, lanes.REWARD_AT + 1),
}


@pytest.mark.parametrize("threads", [1, 2])
def test_neither_copies_nor_threads_nor_being_alone_change_a_bit(threads):
    count, row = 4200, 4150
    options = {**NOISY, "dtype": "float32"}
    many, few, alone = (
        vector(count, threads=threads, **options),
        vector(2, **options),
        YouBotTrackingEnv(**options),
    )
    many.reset(seed=100)
    few.reset(seed=100 + row)
    alone.reset(seed=100 + row + 1)
    over = False
    for step in range(45):
        action = np.zeros((count, 4), np.float32)
        action[row : row + 2] = own = batch_actions(row, 2, step)
        seen, reward, *_ = many.step(action)
        near, gain, *_ = few.step(own)
        assert np.array_equal(seen[row : row + 2], near)
        assert np.array_equal(reward[row : row + 2], gain)
        if over:
            single, _ = alone.reset()
            over = False
        else:
            single, earned, terminated, truncated, _ = alone.step(own[1])
            assert earned == gain[1]
            over = terminated or truncated
        assert np.array_equal(single, near[1])


def test_what_single_precision_cannot_hold_is_one_clear_line():
    known = {"dtype": "float32", "encoder_ticks": 103_352}
    tracking_setup(**known)
    with pytest.raises(InputError, match="float64, a shorter episode or fewer ticks"):
        tracking_setup(**known, episode_length=600.0)
    with pytest.raises(InputError, match="contact"):
        tracking_setup(dtype="float32", plant="contact")
    for wrong in ("float16", "single precision", 3):
        with pytest.raises(InputError, match="neither 'float64' nor 'float32'"):
            tracking_setup(dtype=wrong)  # pyright: ignore[reportArgumentType]
