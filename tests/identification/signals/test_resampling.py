"""Signals moved in time and smoothed: exact where they can be, without phase, without edges."""

import numpy as np
import pytest

from identification.signals.resampling import low_passed, moved, smoothed


@pytest.mark.parametrize("shift", [0.0, 0.3, 1.0, 2.75, -1.4])
def test_a_parabola_is_moved_exactly(shift):
    """Keys' cubic reproduces polynomials of degree two."""
    t = np.arange(40.0)
    signal = 3.0 + 0.2 * t - 0.05 * t**2
    ends = np.stack([signal[:-1], signal[1:]])[..., None]
    later = t + shift
    expected = 3.0 + 0.2 * later - 0.05 * later**2
    found = moved(ends, shift)[..., 0]
    inside = slice(4, 32)
    np.testing.assert_allclose(found[0, inside], expected[:-1][inside], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found[1, inside], expected[1:][inside], rtol=0, atol=1e-11)


def test_whole_intervals_are_moved_as_they_are_and_the_ends_held():
    ends = np.random.default_rng(0).normal(size=(2, 20, 3))
    np.testing.assert_array_equal(moved(ends, 0.0), ends)
    np.testing.assert_array_equal(moved(ends, 3.0)[:, :17], ends[:, 3:])
    np.testing.assert_array_equal(moved(ends, 3.0)[:, 17:], ends[:, [19, 19, 19]])
    np.testing.assert_array_equal(moved(ends, -2.0)[:, 2:], ends[:, :18])
    assert np.isfinite(moved(ends, 1000.0)).all()


def test_moving_is_smooth_in_the_shift():
    """Also where it crosses whole samples, or a search would hang there."""
    ends = np.random.default_rng(1).normal(size=(2, 50, 1))
    step = 1e-6
    for shift in (1.0, 2.5):
        ahead = (moved(ends, shift + step) - moved(ends, shift)) / step
        behind = (moved(ends, shift) - moved(ends, shift - step)) / step
        np.testing.assert_allclose(ahead, behind, rtol=0, atol=1e-4)


def test_moving_back_a_sine_leaves_it_within_a_third_order_error():
    errors = []
    for dt in (0.04, 0.02):
        t = dt * np.arange(round(4 / dt))
        ends = np.stack([np.sin(3 * t[:-1]), np.sin(3 * t[1:])])[..., None]
        found = moved(ends, 0.5)[0, 5:-5, 0]
        errors.append(np.abs(found - np.sin(3 * (t[:-1] + 0.5 * dt))[5:-5]).max())
    assert errors[1] < errors[0] / 6 and errors[0] < 1e-3


@pytest.mark.parametrize("sigma", [0.3, 2.0, 15.0])
def test_smoothing_keeps_lines_to_their_ends_and_has_no_phase(sigma):
    t = np.arange(200.0)
    np.testing.assert_allclose(smoothed(2.0 - 0.3 * t, sigma), 2.0 - 0.3 * t, atol=1e-9)
    pulse = np.zeros(201)
    pulse[100] = 1.0
    found = smoothed(pulse, sigma)
    np.testing.assert_allclose(found, found[::-1], atol=1e-15)
    assert found.sum() == pytest.approx(1.0)


def test_smoothing_takes_the_noise_of_a_rate():
    noise = np.random.default_rng(2).normal(size=20_000)
    rough, smooth = np.diff(noise).std(), np.diff(smoothed(noise, 2.0)).std()
    # Of white noise: sqrt(2) before, (2 sqrt(pi))^-1/2 / (sqrt(2) sigma^1.5) after.
    assert rough == pytest.approx(np.sqrt(2), rel=0.03)
    assert smooth == pytest.approx(0.5311 / np.sqrt(2) / 2.0**1.5, rel=0.05)


def test_short_signals_are_smoothed_too():
    assert smoothed(np.array([1.0, 3.0]), 5.0).shape == (2,)


def test_a_low_pass_keeps_a_line_and_what_is_slow_and_takes_what_is_fast():
    t = 0.01 * np.arange(3000)
    line, slow, fast = 2 + 0.3 * t, np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 20 * t)
    kept = low_passed(np.array([line, slow], np.float64).T, 5.0, 0.01)
    assert np.abs(kept[:, 0] - line).max() < 1e-3
    assert np.abs(kept[:, 1] - slow).max() < 1e-3
    assert np.abs(low_passed(fast, 5.0, 0.01)[200:-200]).max() < 1e-3


def test_a_low_pass_has_no_phase_and_is_linear():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal(1001), rng.standard_normal(1001)
    both = low_passed(a + 2 * b, 3.0, 0.01)
    assert both == pytest.approx(low_passed(a, 3.0, 0.01) + 2 * low_passed(b, 3.0, 0.01))
    backwards = np.array(a[::-1], np.float64)
    assert low_passed(backwards, 3.0, 0.01)[::-1] == pytest.approx(
        low_passed(a, 3.0, 0.01), abs=0.1
    )
