"""Each kind of noise is what its name says: its correlation, spectrum, steps, tails and stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kurtosis

from youbot_scripts.blind_bench import cases, sensors
from youbot_scripts.blind_bench.second_simulator import SPEED_NOISE, TORQUE_NOISE

N, RATE = 24000, 100.0


def true_rows(n: int = N, rate: float = RATE) -> sensors.Rows:
    """Wheels that turn at four steady speeds under steady torques."""
    time = np.arange(1, n + 1) / rate
    speed = np.array([1.0, -2.3, 4.1, 0.7])
    steady = np.ones((n, 4))
    return sensors.Rows(time, steady * speed, steady * 0.5, time[:, None] * speed)


def noise_of(name: str, factor: float = 1.0, **values: float) -> list[np.ndarray]:
    """What a kind adds to speeds and to torques, each (n, 4)."""
    rows = true_rows()
    sensing = sensors.Sensing(name, values)
    _, speed, effort = sensors.sense(rows, sensing, factor, np.random.default_rng(0))
    return [speed - rows.velocity, effort - rows.effort]


def correlation(x: np.ndarray, lag: int) -> float:
    """Of samples ``lag`` apart, the mean over the wheels."""
    return float(np.mean(x[lag:] * x[:-lag]) / np.mean(x * x))


@pytest.mark.parametrize("name", sensors.ALL)
def test_a_kind_draws_what_it_applies_and_changes_no_true_row(name: str):
    for rate in (50.0, 100.0, 250.0, 1000.0):
        for seed in range(5):
            rows = true_rows(400, rate)
            sensing = sensors.draw(name, np.random.default_rng(seed), rate)
            time, *channels = sensors.sense(rows, sensing, 1.0, np.random.default_rng(seed))
            assert (np.diff(time) > 0).all()
            assert all(np.isfinite(channel).all() for channel in channels)
            assert np.array_equal(rows.velocity, true_rows(400, rate).velocity)


@pytest.mark.parametrize("time_constant", [0.005, 0.03, 0.3])
@pytest.mark.parametrize("channel", [0, 1])
def test_coloured_noise_forgets_with_its_time_constant(channel: int, time_constant: float):
    name, key = (("ar1_speeds", "speed"), ("ar1_torques", "torque"))[channel]
    other = ("torque", "speed")[channel]
    noise = noise_of(name, **{f"{key}_time_constant": time_constant, f"{other}_time_constant": 0.0})
    for lag in (1, 5):
        expected = np.exp(-lag / RATE / time_constant)
        assert correlation(noise[channel], lag) == pytest.approx(expected, abs=0.05)
        assert correlation(noise[1 - channel], lag) == pytest.approx(0.0, abs=0.03)
    for x, size in zip(noise, (SPEED_NOISE, TORQUE_NOISE), strict=True):
        assert x.std() == pytest.approx(size, rel=0.1)


def test_coloured_noise_is_stationary_from_the_first_sample():
    rng = np.random.default_rng(0)
    x = sensors.first_order((3, 40000), 0.01, 0.1, rng)
    assert x.std(axis=1) == pytest.approx(np.ones(3), rel=0.03)
    assert np.mean(x[0] * x[1]) == pytest.approx(np.exp(-0.1), rel=0.03)


def test_torques_that_wander_are_slow_and_of_the_size_drawn():
    speed, torque = noise_of("torque_wander", rms=0.02, time_constant=2.0)
    assert torque.std() == pytest.approx(np.hypot(TORQUE_NOISE, 0.02), rel=0.1)
    # White noise has no part in the correlation of samples that lie apart.
    share = 0.02**2 / (0.02**2 + TORQUE_NOISE**2)
    assert correlation(torque, 50) == pytest.approx(share * np.exp(-0.25), abs=0.06)
    assert correlation(speed, 50) == pytest.approx(0.0, abs=0.03)


def test_an_offset_that_wanders_averages_out_over_the_log():
    _, torque = noise_of("offset_wander", factor=0.0, rms=0.02, periods=4.0)
    assert np.abs(torque.mean(axis=0)).max() < 1e-12
    assert torque.std() == pytest.approx(0.02, rel=1e-6)
    spectrum = np.abs(np.fft.rfft(torque, axis=0)) ** 2
    assert spectrum[1:5].sum() / spectrum.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("frequency", "seen"), [(49.97, 49.97), (60.02, 39.98), (48.5, 48.5)])
def test_hum_is_a_line_where_sampling_puts_it(frequency: float, seen: float):
    assert sensors.appears_at(frequency, RATE) == pytest.approx(seen)
    speed, torque = noise_of("hum", frequency=frequency, torque=0.1, speed=0.0)
    spectrum = np.abs(np.fft.rfft(torque[:, 0])) ** 2
    assert np.fft.rfftfreq(N, 1 / RATE)[spectrum.argmax()] == pytest.approx(seen, abs=0.01)
    assert torque.std() == pytest.approx(np.hypot(TORQUE_NOISE, 0.1 / np.sqrt(2)), rel=0.02)
    assert speed.std() == pytest.approx(SPEED_NOISE, rel=0.02)


def test_hum_never_appears_within_the_band_of_the_motions():
    for rate in (50.0, 60.0, 100.0, 250.0):
        for seed in range(30):
            drawn = sensors.draw("hum", np.random.default_rng(seed), rate).values
            assert sensors.appears_at(drawn["frequency"], rate) > sensors.SLOWEST_HUM
            assert (drawn["torque"] > 0) != (drawn["speed"] > 0)


def test_outliers_are_rare_and_wild():
    for x, size in zip(
        noise_of("outliers", share=0.003, size=30.0), (SPEED_NOISE, TORQUE_NOISE), strict=True
    ):
        wild = np.abs(x) > 15 * size
        assert wild.mean() == pytest.approx(0.003, rel=0.2)
        assert x[~wild].std() == pytest.approx(size, rel=0.02)


def test_heavy_tails_are_heavy_and_of_the_usual_variance():
    for x, size in zip(
        noise_of("heavy_tails", freedom=4.0), (SPEED_NOISE, TORQUE_NOISE), strict=True
    ):
        assert x.std() == pytest.approx(size, rel=0.1)
        assert kurtosis(x.ravel()) > 3.0
        assert abs(correlation(x, 1)) < 0.03


def test_quantised_channels_come_in_steps():
    rows = true_rows()
    sensing = sensors.Sensing("quantised", {"speed_step": 0.07, "torque_step": 0.03, "noise": 1.0})
    _, speed, effort = sensors.sense(rows, sensing, 1.0, np.random.default_rng(0))
    for channel, true, step in ((speed, rows.velocity, 0.07), (effort, rows.effort, 0.03)):
        assert channel / step == pytest.approx(np.round(channel / step), abs=1e-9)
        assert 1 < len(np.unique(channel.round(6))) < 60
        assert np.abs(channel - true).max() < step / 2 + 6 * TORQUE_NOISE


def test_jitter_is_of_the_stamps_alone_and_bounded():
    rows = true_rows()
    time, speed, _ = sensors.sense(
        rows, sensors.Sensing("jitter", {"largest": 1e-3}), 1.0, np.random.default_rng(0)
    )
    off = time - rows.time
    assert np.abs(off).max() <= 1e-3 + 1e-6
    assert off.std() == pytest.approx(1e-3 / np.sqrt(3), rel=0.03)
    assert (speed - rows.velocity).std() == pytest.approx(SPEED_NOISE, rel=0.02)


@pytest.mark.parametrize("counts", sensors.COUNTS)
def test_counted_speeds_are_whole_counts_a_row_and_lose_no_angle(counts: float):
    rows = true_rows()
    sensing = sensors.Sensing(sensors.ENCODER, {"counts": counts})
    _, speed, effort = sensors.sense(rows, sensing, 1.0, np.random.default_rng(0))
    step = 2 * np.pi / counts * RATE
    assert speed / step == pytest.approx(np.round(speed / step), abs=1e-6)
    assert np.abs(speed - rows.velocity).max() < step
    assert np.abs(np.cumsum(speed, axis=0) / RATE - rows.angle).max() < 1.001 * step / RATE
    assert (effort - rows.effort).std() == pytest.approx(TORQUE_NOISE, rel=0.02)


# --- the cases that are measured so ----------------------------------------------------------


def test_thirty_cases_of_noise_meet_each_kind_at_each_rate():
    drawn = [cases.draw_case("noise", index, 0) for index in range(30)]
    assert all(not case.planted and case.sensing for case in drawn)
    assert {(case.sensing and case.sensing.name, case.rate) for case in drawn} == {
        (name, rate) for name in sensors.NOISES for rate in cases.RATES["noise"]
    }


def test_six_cases_of_counts_meet_each_encoder_with_coulomb_friction_and_without():
    drawn = [cases.draw_case("counts", index, 0) for index in range(6)]
    found = {
        (case.sensing.values["counts"], tuple(item.name for item in case.planted))
        for case in drawn
        if case.sensing
    }
    planted = ((), ("wheel_coulomb_friction",))
    assert found == {(counts, what) for counts in sensors.COUNTS for what in planted}
    assert all(0.7 < item.factor < 1.5 for case in drawn for item in case.planted)


def test_a_noise_can_be_asked_for_by_name():
    case = cases.draw_case("hum", 3, 0)
    assert case.sensing and case.sensing.name == "hum" and not case.planted


@pytest.mark.slow
def test_a_case_s_truth_is_that_of_its_twin_with_white_noise():
    case = cases.draw_case("counts", 0, 0)
    counted, smooth = (
        cases.log_along(item, "part", np.tile([0.2, 0.05, 0.1], (2000, 1)))
        for item in (case, replace(case, sensing=None))
    )
    step = 2 * np.pi / 500 * case.rate
    assert counted.velocity / step == pytest.approx(np.round(counted.velocity / step), abs=1e-3)
    assert np.abs(counted.velocity - smooth.velocity).max() < 1.1 * step
    assert np.abs(counted.effort - smooth.effort).max() < 8 * TORQUE_NOISE
