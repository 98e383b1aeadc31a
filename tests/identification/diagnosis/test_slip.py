"""Slip in bursts is told where forces fail with the speeds, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.slip import telling_slip
from identification.diagnosis.structures import FittedStructure
from identification.fitting.errors import NoiseLevel
from identification.fitting.kinematic_evidence import (
    SlippingWheels,
    TellingSlip,
    slipping_wheels,
)
from identification.fitting.regression import Regression
from identification.fitting.swinging_speeds import late_speeds
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.samples import Samples
from identification.signals.filters import block_mean
from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.geometry import Geometry

PAPER = load_model("paper")
BASE = Mecanum(Geometry())
SETTINGS = DiagnosisSettings()


def driven(burst: float) -> Samples:
    """Two minutes of wheels, one of which turns too fast [rad/s] for half a second in twenty."""
    time, rng = np.arange(0, 120, 0.02), np.random.default_rng(1)
    waves = np.sin(np.outer(time, [1.1, 0.7, 0.9]) + [0.0, 1.0, 2.0]) * [0.3, 0.3, 0.8]
    rates = dynamics.joint_rates(np, BASE.structure, BASE.geometry, PAPER.theta, tuple(waves.T))
    speed = np.stack(rates, axis=1) + 0.01 * rng.standard_normal((len(time), 4))
    speed[:, 1] += burst * (time % 20 < 0.5)
    return BASE.samples(Log("two minutes", BASE.joints, time, speed, 0.0 * speed))


def slip_of(samples: Samples) -> SlippingWheels:
    return slipping_wheels(BASE, PAPER.theta, [samples], [NoiseLevel.of(samples).speed])


def left(samples: Samples, factor: float) -> FittedStructure:
    """A structure whose residual is larger by a factor in the bursts and for 0.3 s behind them."""
    time, rng = np.arange(0.5, 119.5, 0.05), np.random.default_rng(2)
    residual = rng.standard_normal((len(time), 3)) * (1 + (factor - 1) * (time % 20 < 0.8))[:, None]
    row = Regression(time, 0.05, residual, np.zeros((len(time), 3, 0)))
    none = np.arange(0)
    return FittedStructure(BASE, PAPER.theta, (row,), none, np.zeros((0, 0)), (samples,), SETTINGS)


def test_bursts_in_which_forces_fail_are_slip():
    samples = driven(1.0)
    slip = slip_of(samples)
    assert slip.share > 0.0
    brief = SlippingWheels(0.005, slip.slips, slip.bursts)
    found = telling_slip(left(samples, 3.0), brief)
    assert found is not None and found.bursts == 6
    assert 5.0 < found.square_ratio < 13.0
    assert "now and then (6 times)" in found.brief and "6 times their speeds" in found.words
    with_scrub = telling_slip(left(samples, 3.0), brief, ["yaw_scrub"])
    assert with_scrub is not None and "yaw scrub would act like it" in with_scrub.words
    assert "would act like it" not in found.words


def test_one_bump_is_no_slip():
    samples = driven(1.0)
    slip = slip_of(samples)
    once = tuple(mask & (samples.time < 10.0) for mask in slip.bursts)
    found = telling_slip(left(samples, 10.0), SlippingWheels(0.005, slip.slips, once))
    assert found is None


@pytest.mark.parametrize(("burst", "factor"), [(1.0, 1.0), (0.0, 3.0), (0.1, 3.0)])
def test_ripple_without_lost_force_and_lost_force_without_slip_are_none(burst, factor):
    samples = driven(burst)
    slip = slip_of(samples)
    rare = SlippingWheels(0.005, slip.slips, slip.bursts)
    assert telling_slip(left(samples, factor), rare) is None


def test_slip_that_lasts_is_told_by_its_share_alone():
    samples = driven(0.0)
    slip = slip_of(samples)
    lasting = SlippingWheels(0.036, slip.slips, slip.bursts)
    found = telling_slip(left(samples, 1.0), lasting)
    assert found is not None and found == TellingSlip(0.036)
    assert found.brief == "the wheels slip (3.6% of their speeds is no rigid motion)"


@pytest.mark.parametrize("phases", [(0.0, 0.0), (0.4, 2.9)])
def test_a_speed_that_swings_with_its_wheel_is_no_slip(phases):
    logs = []
    for phase in phases:
        samples = driven(0.0)
        speed = samples.wheel_speed.copy()
        # As an encoder reads that is out of centre; each log counts angles from its own start.
        speed[:, 1] *= 1 + 0.03 * np.cos(samples.wheel_angle[:, 1] + phase)
        logs.append(BASE.samples(Log("two minutes", BASE.joints, samples.time, speed, 0.0 * speed)))
    noise = [NoiseLevel.of(item).speed for item in logs]
    slip = slipping_wheels(BASE, PAPER.theta, logs, noise)
    assert list(slip.swings) == ["fr"] and slip.swings["fr"] == pytest.approx(0.03, rel=0.05)
    found = telling_slip(left(logs[0], 1.0), slip)
    assert found is not None and "front right by 3.0%" in found.brief
    assert "encoder" in found.words and "slip" not in found.words


@pytest.mark.parametrize("delay", [0.04, -0.08])
def test_a_speed_that_comes_late_is_no_slip(delay):
    samples = driven(0.0)
    speed = samples.wheel_speed.copy()
    speed[:, 2] = np.interp(samples.time - delay, samples.time, speed[:, 2])
    late = BASE.samples(Log("two minutes", BASE.joints, samples.time, speed, 0.0 * speed))
    slip = slip_of(late)
    assert list(slip.late) == ["bl"] and slip.late["bl"] == pytest.approx(delay, rel=0.1)
    found = telling_slip(left(samples, 1.0), slip)
    assert found is not None and "velocity_bl comes" in found.brief
    assert f"ms {'after' if delay > 0 else 'before'} the other wheels' speeds" in found.brief
    assert "the wheels slip" not in found.words


@pytest.mark.parametrize("dt", [0.02, 0.045, 0.055])
def test_the_delay_of_a_speed_does_not_depend_on_the_rate_of_the_log(dt):
    """Rows last 0.2 s where the rate divides that, and else as many samples as come nearest."""
    time, pace = np.arange(0, 120, dt), np.array([0.3, 0.23, 0.37, 0.29])
    speed, rate = np.sin(np.outer(time, pace)), pace * np.cos(np.outer(time, pace))
    internal, delay = np.array([1.0, 1.0, -1.0, -1.0]), 0.05
    size = round(0.2 / dt)
    slip = block_mean(-internal[2] * delay * rate[:, 2], size)
    log = BASE.samples(Log("slow", BASE.joints, time, speed, 0.0 * speed))
    found = late_speeds([log], [slip], internal, BASE.joints, SETTINGS.fit.kinematics)
    assert list(found) == ["bl"] and found["bl"] == pytest.approx(delay, rel=0.04)


def test_a_log_of_one_row_beside_a_long_one_has_no_delay():
    logs = [driven(0.0)]
    rows = slice(0, 12)
    time, speed = logs[0].time[rows], logs[0].wheel_speed[rows]
    logs.append(BASE.samples(Log("short", BASE.joints, time, speed, 0.0 * speed)))
    slips = [0.1 * np.random.default_rng(0).standard_normal(len(log) // 10) for log in logs]
    assert not late_speeds(logs, slips, np.ones(4), BASE.joints, SETTINGS.fit.kinematics)


def test_wheels_that_slide_do_not_swing():
    samples = driven(3.0)
    slip = slip_of(samples)
    assert slip.share > SETTINGS.fit.kinematics.min_slip_share and not slip.swings
    assert not slip.late
