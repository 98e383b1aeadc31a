import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from identification.signals.filters import (
    RowFilter,
    accumulate,
    block_mean,
    filter_samples,
    first_order,
    integral_of,
    settled,
)


def naive(start, end, rate, dt):
    """The same recursion, one step at a time, from the exact response to a ramp."""
    decay = np.exp(-rate * dt)
    out = [np.zeros_like(start[0])]
    for a, b in zip(start, end, strict=True):
        slope = (b - a) / dt
        # Particular solution of y' = rate (u - y) for u = a + slope t: u - slope / rate.
        constant = out[-1] - (a - slope / rate)
        out.append(constant * decay + b - slope / rate)
    return np.array(out)


@pytest.mark.parametrize("count", [2, 63, 64, 65, 129, 1000])
def test_the_response_is_exact_for_straight_lines(count):
    rng = np.random.default_rng(0)
    start, end = rng.standard_normal((2, count, 3))
    expected = naive(start, end, 10.0, 0.01)
    np.testing.assert_allclose(first_order(start, end, 10.0, 0.01), expected, atol=1e-12)


@pytest.mark.parametrize("decay", [0.0, 0.5, 0.97, np.exp(-0.01)])
@pytest.mark.parametrize("count", [1, 64, 3000])
def test_the_recursion_is_scipys(count, decay):
    steps = np.random.default_rng(3).standard_normal((count, 2))
    expected = lfilter([1.0], [1.0, -decay], steps, axis=0)
    np.testing.assert_allclose(accumulate(steps, decay)[1:], expected, atol=1e-13)


@pytest.mark.parametrize("shape", [(), (3,), (2, 4)])
@pytest.mark.parametrize(
    "count, first, size", [(300, 50, 7), (300, 0, 1), (60, 50, 20), (9, 50, 5)]
)
def test_rows_are_means_of_the_filtered_signal(shape, count, first, size):
    ends = np.random.default_rng(5).standard_normal((2, count, *shape))
    rows = RowFilter(10.0, 5.0, 0.01, size)(ends, None, first)
    expected = block_mean(first_order(ends[0], ends[1], 10.0, 0.01)[first:], size)
    assert rows.shape == expected.shape == (max(0, count + 1 - first) // size, *shape)
    np.testing.assert_allclose(rows, expected, atol=1e-14)


def test_filtered_derivative_is_the_papers_exactly():
    """a_f p/(p + a_f) s = a_f (s - s_f) for a signal that is linear between samples."""
    rng = np.random.default_rng(1)
    signal = np.cumsum(rng.standard_normal((400, 3)), axis=0)
    signal -= signal[0]
    slope = np.diff(signal, axis=0) / 0.02
    filtered = first_order(slope, slope, 10.0, 0.02)
    paper = 10.0 * (signal - filter_samples(signal, 10.0, 0.02))
    np.testing.assert_allclose(filtered, paper, atol=1e-10)


def test_response_to_a_slow_sine_is_that_of_the_continuous_filter():
    dt, rate, omega = 0.01, 10.0, 2.0
    time = np.arange(0, 20, dt)
    filtered = filter_samples(np.sin(omega * time)[:, None], rate, dt)[:, 0]
    gain, phase = rate / np.hypot(rate, omega), np.arctan2(omega, rate)
    late = settled(rate, dt) * 3
    expected = gain * np.sin(omega * time - phase)
    # First-order hold of a sine loses (omega dt)^2 / 12 of its size.
    np.testing.assert_allclose(filtered[late:], expected[late:], atol=5e-5)


def test_start_is_forgotten_after_the_settling_time():
    dt, rate = 0.01, 10.0
    filtered = filter_samples(np.ones((200, 1)), rate, dt)[:, 0]
    assert abs(filtered[settled(rate, dt)] - 1.0) < 0.007


def test_block_mean_leaves_incomplete_blocks_out():
    np.testing.assert_allclose(block_mean(np.arange(11.0)[:, None], 4)[:, 0], [1.5, 5.5])


@pytest.mark.parametrize("shape", [(1,), (300,), (300, 4)])
def test_the_integral_is_scipys(shape):
    rate = np.random.default_rng(4).standard_normal(shape)
    expected = cumulative_trapezoid(rate, dx=0.01, axis=0, initial=0)
    np.testing.assert_allclose(integral_of(rate, 0.01), expected, atol=1e-14)
