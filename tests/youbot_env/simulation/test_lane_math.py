"""Functions that vectorise: as exact as the C library, the same bits alone and side by side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numba import njit

from youbot_env.simulation import lane_math, lane_math_single

RNG = np.random.default_rng(0)

CASES = {
    "sin": (lane_math.sin, np.sin, RNG.uniform(-1e3, 1e3, 999), 5e-16, np.inf),
    "cos": (lane_math.cos, np.cos, RNG.uniform(-1e3, 1e3, 999), 5e-16, np.inf),
    "sine_of_turns": (
        lane_math.sine_of_turns,
        lambda u: np.sin(2 * np.pi * (u - np.rint(u))),
        RNG.uniform(-9, 9, 999),
        1e-14,
        np.inf,
    ),
    "sine_of_little": (
        lane_math.sine_of_little,
        np.sin,
        RNG.uniform(-0.07, 0.07, 999),
        1.2e-16,
        2e-15,
    ),
    "cosine_of_little": (
        lane_math.cosine_of_little,
        np.cos,
        RNG.uniform(-0.07, 0.07, 999),
        3e-16,
        np.inf,
    ),
    "exp": (lane_math.exp, np.exp, RNG.uniform(-700, 700, 999), np.inf, 5e-16),
    "tanh": (
        lane_math.tanh,
        np.tanh,
        np.concatenate([RNG.uniform(-30, 30, 900), 10.0 ** RNG.uniform(-12, 0, 99)]),
        5e-16,
        1e-15,
    ),
    "log": (
        lane_math.log_of_share,
        np.log,
        np.concatenate([RNG.uniform(0, 1, 900), 10.0 ** RNG.uniform(-10, 0, 99)]),
        np.inf,
        1e-14,
    ),
}


def over(function: Callable[..., float]) -> Callable[..., None]:
    @njit(error_model="numpy")
    def loop(x, out):
        for i in range(x.size):
            out[i] = function(x[i])

    return loop


@pytest.mark.parametrize("name", CASES)
def test_agrees_with_the_c_library_and_with_itself(name):
    function, expected, x, absolute, relative = CASES[name]
    loop, out, alone = over(function), np.empty_like(x), np.empty_like(x)
    loop(x, out)
    right = expected(x)
    assert np.abs(out - right).max() <= absolute
    assert np.abs((out - right) / right).max() <= relative
    for i in range(len(x)):
        loop(x[i : i + 1], alone[i : i + 1])
    assert np.array_equal(out, alone)


SINGLE = {
    "sin": (np.sin, RNG.uniform(-1e3, 1e3, 9999), 2e-7, np.inf),
    "cos": (np.cos, RNG.uniform(-1e3, 1e3, 9999), 2e-7, np.inf),
    "sine_of_turns": (lambda u: np.sin(2 * np.pi * u), RNG.uniform(-1, 1, 9999), 4e-7, np.inf),
    "exp": (np.exp, RNG.uniform(-86, 86, 9999), np.inf, 3e-7),
    "tanh": (np.tanh, 10.0 ** RNG.uniform(-9, 1.5, 9999), 2e-7, 4e-7),
    "log_of_share": (np.log, 10.0 ** RNG.uniform(-9, -1e-6, 9999), np.inf, 3e-7),
}


def test_in_single_precision_agrees_to_its_rounding():
    one, two, three, four, five, six = (getattr(lane_math_single, name) for name in SINGLE)

    @njit(error_model="numpy")
    def loop(x, out):
        for i in range(x.shape[1]):
            out[0, i], out[1, i] = one(x[0, i]), two(x[1, i])
            out[2, i], out[3, i] = three(x[2, i]), four(x[3, i])
            out[4, i], out[5, i] = five(x[4, i]), six(x[5, i])

    x = np.array([case[1] for case in SINGLE.values()], np.float32)
    out = np.empty_like(x)
    loop(x, out)
    for name, row, given in zip(SINGLE, out, x.astype(float), strict=True):
        expected, _, absolute, relative = SINGLE[name]
        right = expected(given)
        assert np.abs(row - right).max() <= absolute, name
        assert np.abs((row - right) / right).max() <= relative, name


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "tanh", "sine_of_turns"])
def test_what_is_no_number_stays_none(name):
    function = CASES[name][0]
    assert np.isnan(function(np.nan))


def test_limits():
    assert lane_math.tanh(np.inf) == 1.0 and lane_math.tanh(-1e9) == -1.0
    assert lane_math.tanh(0.0) == 0.0 and lane_math.exp(0.0) == 1.0
    assert lane_math.exp(-1e9) < 1e-300 and np.isfinite(lane_math.exp(1e9))
