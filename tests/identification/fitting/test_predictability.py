"""What is left that the motion predicts, and what noise leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.fitting import predictability as trees
from identification.fitting.least_squares import fit
from identification.fitting.predictability import Predictability, predictability, too_short
from identification.fitting.repeated_periods import (
    _all_differences,
    _difference,
    repeated_noise,
)
from identification.fitting.settings import FitSettings, PredictabilitySettings
from identification.logs.log import Log
from identification.mechanisms.registry import mechanism_of
from tests.identification.blind_logs import FEW, blind_logs
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
MECHANISM = mechanism_of(PAPER)


def left_by_the_base_model(*logs: Log, seed: int = 0) -> Predictability:
    samples = [MECHANISM.samples(log) for log in logs]
    fitted = fit(MECHANISM, samples, PAPER.theta)
    return predictability(MECHANISM, fitted.rows, samples, seed)


def coloured(log: Log, memory: float, size: float) -> Log:
    """The log with AR(1) noise on its torques: a memory [s] and a size [N m]."""
    keep = np.exp(-log.dt / memory)
    white = np.random.default_rng(5).standard_normal(log.effort.shape)
    return replace(
        log,
        effort=log.effort
        + size * np.sqrt(1 - keep**2) * lfilter([1.0], [1.0, -keep], white, axis=0),
    )


@pytest.mark.parametrize("memory", [0.015, 0.3])
def test_noise_of_any_colour_is_noise(memory):
    found = left_by_the_base_model(coloured(recording("calibration"), memory, 0.3))
    assert found.is_noise
    assert found.correlation_time == pytest.approx(max(memory, 0.1), rel=0.6)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("wheel_coulomb_friction", {"torque": 0.1}),
        ("floor_tilt", {"tilt_x": 0.005}),
        ("actuator_lag", {"time_constant": 0.05}),
    ],
)
def test_what_is_missing_is_predicted(effect, values):
    found = left_by_the_base_model(recording("calibration", ((effect, tuple(values.items())),)))
    assert found.share > 0.3 and not found.is_noise


def test_an_offset_that_wanders_is_noise_and_a_constant_one_is_not():
    log = recording("calibration")
    phase = 2 * np.pi * (log.time - log.time[0]) / 45.0
    wave = 0.05 * np.sin(phase[:, None] + np.arange(4))
    found = left_by_the_base_model(replace(log, effort=log.effort + wave))
    assert found.share > 0.2 and found.is_noise
    offset = left_by_the_base_model(replace(log, effort=log.effort + [0.05, 0.0, 0.02, 0.0]))
    assert not offset.is_noise


def test_what_each_log_repeats_at_the_same_time_is_no_wander():
    def with_waves(phases: tuple[float, ...]) -> Predictability:
        logs = []
        for seed, phase in enumerate(phases):
            log = recording(seed=seed)
            turn = 2 * np.pi * (log.time - log.time[0]) / 45.0
            wave = 0.05 * np.sin(turn + phase)[:, None] * [1, -1, 1, -1]
            logs.append(replace(log, effort=log.effort + wave))
        return left_by_the_base_model(*logs)

    for own in ((0.4, 2.5, 4.6), (0.4, 2.5)):
        found = with_waves(own)
        assert found.wander > 0.3 and found.is_noise
    for shared in ((0.4, 0.4, 0.4), (0.4, 0.4)):
        found = with_waves(shared)
        assert found.wander == 0.0 and found.share > 0.3 and not found.is_noise


@pytest.mark.parametrize(
    ("kind", "names"),
    [("jet_on_board", FEW[0]), ("jet_on_board", FEW[1]), ("whirl", FEW[0]), ("gust", FEW[0])],
)
def test_a_push_at_one_time_of_two_logs_is_no_wander(kind, names):
    found = left_by_the_base_model(*blind_logs(kind, names))
    assert found.wander == 0.0 and not found.is_noise


@pytest.mark.parametrize(
    ("kind", "names", "only_in"),
    [
        ("payload_change", FEW[0], ("multisine_a",)),
        ("payload_change", FEW[0], ()),
        ("failing_drive", FEW[0], ()),
        ("failing_drive", FEW[1], ()),
    ],
)
def test_a_force_that_follows_the_motion_otherwise_from_a_time_on_is_no_noise(kind, names, only_in):
    logs = blind_logs(kind, names, {"time": 30.0}, factor=0.7, only_in=only_in)
    found = left_by_the_base_model(*logs)
    assert not found.is_noise and found.share > 0.25


@pytest.mark.parametrize(
    ("kind", "names"),
    [("torque_wander", FEW[0]), ("offset_wander", FEW[0]), ("offset_wander", FEW[1])],
)
def test_noise_of_two_logs_is_noise(kind, names):
    found = left_by_the_base_model(*blind_logs(kind, names, seed=6))
    assert found.is_noise


def test_what_happens_at_times_only_is_no_noise_and_is_told_where():
    log = recording("calibration")
    push = np.zeros_like(log.effort)
    struck = (log.time > log.time[0] + 40.0) & (log.time < log.time[0] + 43.0)
    push[struck] = 1.5
    found = left_by_the_base_model(replace(log, effort=log.effort + push))
    assert found.is_episodic and not found.is_noise
    (at, start, end), *_ = found.episodes
    assert at == 0 and start <= 41.0 and end >= 42.0 and end - start < 15.0
    assert found.systematic_share > 0.5
    quiet = left_by_the_base_model(log)
    assert found.noise(0).std() < 3 * quiet.noise(0).std()


def test_outliers_are_noise():
    log = recording("calibration")
    rng = np.random.default_rng(0)
    spikes = 2.0 * rng.standard_normal(log.effort.shape) * (rng.random(log.effort.shape) < 0.003)
    assert left_by_the_base_model(replace(log, effort=log.effort + spikes)).is_noise


def test_the_same_seed_gives_the_same_bits_and_another_hardly_another_share():
    log = recording("calibration", (("wheel_coulomb_friction", (("torque", 0.1),)),))
    first, again, other = (left_by_the_base_model(log, seed=seed) for seed in (0, 0, 1))
    assert all((a == b).all() for a, b in zip(first.predicted, again.predicted, strict=True))
    assert other.share == pytest.approx(first.share, abs=0.05) and other.share != first.share


def test_a_log_of_one_stretch_predicts_nothing():
    log = recording("calibration")
    short = [MECHANISM.samples(log)]
    rows = fit(MECHANISM, short, PAPER.theta).rows
    # Half a second: stretches shrink with the logs, down to 1 s.
    few = [replace(row, time=row.time[:10], residual=row.residual[:10]) for row in rows]
    assert predictability(MECHANISM, few, short).share == 0.0


def test_long_logs_get_fewer_rows_not_more_time():
    log = recording("calibration")
    samples = [MECHANISM.samples(log)]
    rows = fit(MECHANISM, samples, PAPER.theta).rows
    few = FitSettings(predictability=PredictabilitySettings(max_rows=500))
    found = predictability(MECHANISM, rows, samples, settings=few)
    assert len(found.residual[0]) <= 500 < len(rows[0].residual)


class TestRepeatedPeriods:
    TIME = np.arange(0.0, 40.0, 0.01)
    SPEED = np.column_stack([np.sin(2 * np.pi * TIME / 7.0), np.cos(2 * np.pi * TIME / 3.5)])

    def noise(self, residual: np.ndarray, speed: np.ndarray = SPEED) -> tuple[np.ndarray, int]:
        forces = (residual, np.zeros_like(residual))
        known = PredictabilitySettings()
        return repeated_noise(self.TIME, speed, forces, [(0.0, 40.0)], known)

    def test_what_repeats_is_no_noise(self):
        white = 0.1 * np.random.default_rng(0).standard_normal(self.SPEED.shape)
        total, count = self.noise(np.sign(self.SPEED) + white)
        np.testing.assert_allclose(np.sqrt(total / count), 0.1, rtol=0.05)

    def test_a_wait_and_a_ramp_before_the_motion_and_another_end_hide_no_period(self):
        gain = np.clip((self.TIME - 3.0) / 2.0, 0.0, 1.0)
        gain[self.TIME > 37.0] = 0.5
        speed = gain[:, None] * self.SPEED
        rng = np.random.default_rng(3)
        white = 0.1 * rng.standard_normal(speed.shape)
        noisy = speed + 0.005 * rng.standard_normal(speed.shape)
        total, count = self.noise(np.tanh(3.0 * speed) + white, noisy)
        np.testing.assert_allclose(np.sqrt(total / count), 0.1, rtol=0.05)
        assert 20.0 < count * 0.01 < 26.0  # 5 s to 30 s come again 7 s later

    def test_two_stretches_that_resemble_each_other_by_chance_are_no_period(self):
        rng = np.random.default_rng(4)
        chirp = np.sin(0.05 * self.TIME**2)[:, None] * np.ones(2)
        chirp[3000:3300] = chirp[500:800]
        _, count = self.noise(rng.standard_normal(chirp.shape), chirp)
        assert count == 0

    def test_all_lags_at_once_are_those_one_by_one(self):
        rough = self.SPEED + 0.3 * np.random.default_rng(1).standard_normal(self.SPEED.shape)
        found = _all_differences(rough)
        for lag in (1, 10, 350, 700, 1400):
            assert found[lag] == pytest.approx(_difference(rough, lag), abs=1e-12)

    def test_a_motion_that_does_not_repeat_tells_nothing(self):
        chirp = np.sin(0.05 * self.TIME**2)[:, None] * np.ones(2)
        total, count = self.noise(chirp, chirp)
        assert count == 0 and not total.any()


def first(log: Log, duration: float) -> Log:
    """The first seconds of a log."""
    keep = slice(0, round(duration / log.dt))
    return replace(
        log, time=log.time[keep], velocity=log.velocity[keep], effort=log.effort[keep], pose=None
    )


def test_of_a_short_log_shorter_stretches_are_held_out():
    coulomb = (("wheel_coulomb_friction", (("torque", 0.3),)),)
    missing, nothing = (
        left_by_the_base_model(first(recording("calibration", effects), 14.0))
        for effects in (coulomb, ())
    )
    assert not missing.is_noise and missing.share > 0.3
    assert nothing.is_noise and not nothing.is_short


def test_what_is_too_short_to_tell_is_said():
    found = left_by_the_base_model(first(recording("calibration"), 8.0))
    assert found.is_short and found.duration == pytest.approx(7.5, abs=0.3)
    assert "7.5 s, and 12 s are the least" in too_short(found)
    settings = PredictabilitySettings()
    assert settings.stretch_in(600.0) == 6.0 and settings.stretch_in(3.0) == 1.0
    assert settings.stretch_in(36.0) == pytest.approx(3.0)


def test_trees_on_time_are_grown_only_where_a_drift_could_make_noise_of_it(monkeypatch):
    asked = []
    grown = trees._held_out

    def counted(features, *args):
        asked.append(features.shape[1])
        return grown(features, *args)

    monkeypatch.setattr(trees, "_held_out", counted)
    tilt = (("floor_tilt", (("tilt_x", 0.02),)),)
    assert left_by_the_base_model(recording("calibration", tilt)).is_predicted
    # The motion predicts far more than time does: trees on the motion without time are spared.
    assert len(asked) == 2 and asked[1] == trees.TIMES
