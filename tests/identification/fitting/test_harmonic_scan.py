"""What repeats over a place or a wheel's angle is seen, and noise is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.harmonic_scan import Harmonic, harmonic_scan
from identification.fitting.least_squares import fit
from identification.fitting.predictability import predictability
from identification.fitting.settings import FitSettings
from identification.logs.log import Log
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
MECHANISM = mechanism_of(PAPER)


def scanned(log: Log, angles: bool = True) -> list[Harmonic]:
    samples = [MECHANISM.samples(log)]
    rows = fit(MECHANISM, samples, PAPER.theta).rows
    return harmonic_scan(MECHANISM, [row.residual for row in rows], samples, angles=angles)


def on_a_floor_with_joints(log: Log, period: float, force: float, direction: float = 0.0) -> Log:
    """The log, with what a force along one direction of the world asks of the wheels beside it."""
    samples = MECHANISM.samples(log)
    x, y, yaw = samples.pose.T
    size = force * np.sin(2 * np.pi * (np.cos(direction) * x + np.sin(direction) * y) / period)
    L = PAPER.geometry.L
    asked = np.column_stack(
        [L * size * np.cos(direction - yaw), L * size * np.sin(direction - yaw), 0 * yaw]
    )
    return replace(log, effort=log.effort + MECHANISM.joint_torque(asked))


@pytest.mark.parametrize(
    ("direction", "variable", "period"),
    [(0.0, "position_x", 0.1), (np.pi / 2, "position_y", 0.08)],
)
def test_joints_of_a_floor_are_seen_where_they_are(direction, variable, period):
    first, *others = scanned(on_a_floor_with_joints(recording(), period, 6.0, direction))
    assert first.variable == variable and first.share > 0.5
    assert first.period == pytest.approx(period, rel=0.02)
    assert first.is_seen(FitSettings().harmonic_scan)
    assert all(wave.share < 0.2 for wave in others)


def test_joints_of_a_floor_are_no_noise():
    log = on_a_floor_with_joints(recording(), 0.1, 3.0)
    samples = [MECHANISM.samples(log)]
    rows = fit(MECHANISM, samples, PAPER.theta).rows
    assert not predictability(MECHANISM, rows, samples).is_noise
    assert predictability(MECHANISM, rows, samples).share_of_motion > 0.3


def test_a_ripple_is_seen_over_the_angle_of_its_wheel():
    log = recording()
    angle = MECHANISM.samples(log).wheel_angle
    effort = log.effort.copy()
    effort[:, 2] += 0.15 * np.sin(7 * angle[:, 2] + 1.0)
    first, *_ = scanned(replace(log, effort=effort))
    assert first.variable == "wheel_angle_bl" and first.share > 0.3
    assert 2 * np.pi / first.period == pytest.approx(7.0)
    others = {wave.variable for wave in scanned(log, angles=False)}
    assert others == {"position_x", "position_y", "time"}


def pushed(log: Log, force: np.ndarray) -> Log:
    """The log, with what a force (N, 2) along the world asks of the wheels beside it."""
    yaw = MECHANISM.samples(log).pose[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    along = np.column_stack([c * force[:, 0] + s * force[:, 1], c * force[:, 1] - s * force[:, 0]])
    asked = PAPER.geometry.L * np.column_stack([along, 0 * yaw])
    return replace(log, effort=log.effort + MECHANISM.joint_torque(asked))


@pytest.mark.parametrize("period", [0.9, 3.7, 12.0])
def test_a_force_that_swings_in_time_is_seen_with_its_period(period):
    log = recording()
    swing = 5.0 * np.sin(2 * np.pi * log.time / period + 0.4)
    first, *_ = scanned(pushed(log, np.column_stack([swing, -0.5 * swing])))
    assert first.variable == "time" and first.share > 0.5
    assert first.period == pytest.approx(period, rel=0.03)
    assert first.is_seen(FitSettings().harmonic_scan)


@pytest.mark.parametrize("frequency", [2.5, 10.0])
def test_hum_of_the_torques_is_noise(frequency):
    log = recording()
    hum = 0.15 * np.sin(2 * np.pi * frequency * log.time[:, None] + np.arange(4))
    assert not any(
        wave.is_seen(FitSettings().harmonic_scan)
        for wave in scanned(replace(log, effort=log.effort + hum), angles=False)
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_a_force_that_wanders_swings_in_no_time(seed):
    log, rng = recording(), np.random.default_rng(seed)
    steps = rng.standard_normal((len(log), 2)) * np.sqrt(log.dt)
    waves = scanned(pushed(log, 1.5 * np.cumsum(steps, axis=0)), angles=False)
    (wave,) = [wave for wave in waves if wave.variable == "time"]
    assert not wave.is_seen(FitSettings().harmonic_scan)


@pytest.mark.parametrize("memory", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("seed", [0, 1])
def test_noise_of_any_colour_repeats_nowhere(memory, seed):
    from scipy.signal import lfilter

    log = recording()
    keep = np.exp(-log.dt / memory) if memory else 0.0
    white = np.random.default_rng(seed).standard_normal(log.effort.shape)
    noise = 0.2 * np.sqrt(1 - keep**2) * lfilter([1.0], [1.0, -keep], white, axis=0)
    found = scanned(replace(log, effort=log.effort + noise))
    assert max(wave.share for wave in found) < 0.02
    assert not any(wave.is_seen(FitSettings().harmonic_scan) for wave in found)


def test_a_log_of_few_stretches_says_nothing():
    log = recording()
    samples = [MECHANISM.samples(log)]
    rows = fit(MECHANISM, samples, PAPER.theta).rows
    assert harmonic_scan(MECHANISM, [row.residual[:500] for row in rows], samples) == []


def test_where_trees_tell_little_a_wave_tells_more():
    """Dry friction, of which trees see a part, beside a moment that swings in time."""
    log = recording()
    moment = np.sin(2 * np.pi * log.time / 2.3 + 0.4)
    asked = np.column_stack([0 * moment, 0 * moment, moment])
    dry = 0.025 * np.tanh(log.velocity / 0.03)
    effort = log.effort + MECHANISM.joint_torque(asked) + dry
    samples = [MECHANISM.samples(replace(log, effort=effort))]
    rows, known = fit(MECHANISM, samples, PAPER.theta).rows, FitSettings()
    trees = replace(known.predictability, max_share_with_waves=1e-9)
    alone = predictability(MECHANISM, rows, samples, settings=replace(known, predictability=trees))
    both = predictability(MECHANISM, rows, samples)
    assert alone.is_predicted and alone.share < 0.3
    assert both.share > 0.5
