"""Long logs are fitted in parts: the same rows, to rounding, in bounded memory."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.errors import force_traces
from identification.fitting.predictability import predictability
from identification.fitting.regression import filtered_residual, regression
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import pass_over
from identification.mechanisms.registry import mechanism_of
from identification.mechanisms.samples import Samples
from tests.identification.healthy import healthy_log
from youbot_env.model.model_file import load_model

WHOLE = FitSettings()
PARTS = replace(WHOLE, max_part_samples=500)

EFFECTS = (
    (),
    ("torque_delay",),
    ("friction_warmup", "torque_ripple"),
    ("load_dependent_friction",),
    ("actuator_lag",),
    ("floor_tilt", "torque_saturation"),
    ("wheel_radius_error",),
)


@pytest.fixture(scope="module")
def samples() -> Samples:
    mechanism = mechanism_of(load_model("paper"))
    return mechanism.samples(healthy_log(rate=100.0, duration=60.0, extras=True))


@pytest.mark.parametrize("effects", EFFECTS, ids="+".join)
def test_rows_in_parts_are_those_of_the_whole_to_rounding(samples: Samples, effects):
    model = load_model("paper")
    for name in effects:
        model = model.with_effect(name)
    mechanism = mechanism_of(model)
    free = np.flatnonzero(mechanism.free)
    theta = model.theta + 0.01 * mechanism.scale
    whole = regression(mechanism, theta, samples, free, WHOLE)
    parts = regression(mechanism, theta, samples, free, PARTS)
    assert (parts.time == whole.time).all() and parts.step == whole.step
    scale = np.abs(whole.residual).max()
    np.testing.assert_allclose(parts.residual, whole.residual, atol=1e-11 * scale)
    for k in range(len(free)):
        size = np.abs(whole.columns[..., k]).max()
        np.testing.assert_allclose(
            parts.columns[..., k], whole.columns[..., k], atol=1e-9 * max(size, 1e-12)
        )
    alone = filtered_residual(mechanism, theta, samples, PARTS)
    np.testing.assert_allclose(alone, whole.residual, atol=1e-11 * scale)


def test_rows_at_rest_are_zero_in_parts_too(samples: Samples):
    mechanism = mechanism_of(load_model("paper"))
    moves = np.ones(len(samples), bool)
    moves[1000:1700] = False
    resting = replace(samples, moves=moves)
    theta, free = load_model("paper").theta, np.flatnonzero(mechanism.free)
    found = [regression(mechanism, theta, resting, free, of).residual for of in (WHOLE, PARTS)]
    assert ((found[0] == 0) == (found[1] == 0)).all() and (found[0] == 0).any()
    np.testing.assert_allclose(found[1], found[0], atol=1e-11 * np.abs(found[0]).max())


def test_a_smoothed_channel_is_computed_once(samples: Samples):
    assert samples.smoothed("torque", 5.0) is samples.smoothed("torque", 5.0)
    assert samples.smoothed("torque", 6.0) is not samples.smoothed("torque", 5.0)
    changed = replace(samples, torque=2.0 * samples.torque)
    np.testing.assert_allclose(
        changed.smoothed("torque", 5.0), 2.0 * samples.smoothed("torque", 5.0)
    )


def test_what_may_predict_a_residual_is_the_same_in_parts(samples: Samples):
    mechanism = mechanism_of(load_model("paper"))
    theta, free = load_model("paper").theta, np.flatnonzero(mechanism.free)
    rows = [regression(mechanism, theta, samples, free, WHOLE)]
    whole, parts = (predictability(mechanism, rows, [samples], 0, of) for of in (WHOLE, PARTS))
    assert parts.share == pytest.approx(whole.share, abs=1e-3)


def test_force_traces_are_the_same_in_parts(samples: Samples):
    mechanism = mechanism_of(load_model("paper").with_effect("torque_delay"))
    theta = mechanism.extend_theta(load_model("paper").theta, "torque_delay", {})
    theta[-1] = 0.03
    whole, parts = (force_traces(mechanism, theta, samples, of) for of in (WHOLE, PARTS))
    assert (parts.time == whole.time).all()
    size = np.abs(whole.measured).max()
    np.testing.assert_allclose(parts.measured, whole.measured, atol=1e-11 * size)
    np.testing.assert_allclose(parts.predicted, whole.predicted, atol=1e-9 * size)


@pytest.mark.parametrize("effects", [(), ("torque_ripple",), ("torque_delay",)], ids="+".join)
def test_a_free_run_goes_on_where_its_last_piece_ended(samples: Samples, effects):
    model = load_model("paper")
    for name in effects:
        model = model.with_effect(name)
    whole = mechanism_of(model)
    pieces = mechanism_of(model, settings=replace(whole.settings, max_run_samples=700))
    runs = [one.free_run(model.theta, samples) for one in (whole, pieces)]
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-9)


@pytest.mark.parametrize("effect", ["wheel_coulomb_friction", "torque_ripple"])
def test_noise_that_is_put_on_parts_is_that_of_the_whole(samples: Samples, effect):
    model = load_model("paper").with_effect(effect)
    mechanism, free = mechanism_of(model), np.array([0, 3])
    samples = replace(samples, angle_measured=False)
    speed = np.full(4, 0.1)
    noisy = mechanism.noisy(samples, speed, 0.0 * speed, np.random.default_rng(7))
    added = mechanism.speed_noise(samples, speed, np.random.default_rng(7))
    whole = regression(mechanism, model.theta, noisy, free, WHOLE)
    parts = regression(mechanism, model.theta, samples, free, PARTS, added)
    size = np.abs(whole.residual).max()
    np.testing.assert_allclose(parts.residual, whole.residual, atol=1e-10 * size)
    np.testing.assert_allclose(
        parts.columns, whole.columns, atol=1e-9 * np.abs(whole.columns).max()
    )


def test_numbers_that_are_passed_over_leave_the_next_ones_what_they_are():
    one, other = np.random.default_rng(3), np.random.default_rng(3)
    one.standard_normal(2_500_001)
    pass_over(other, 2_500_001)
    assert (one.standard_normal(5) == other.standard_normal(5)).all()


PEAK = """
import resource, sys
from identification import identify
from tests.identification.healthy import healthy_log
identify([healthy_log(rate=1000.0, duration=float(sys.argv[1]))], recursive=False)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


@pytest.mark.slow
def test_memory_of_a_long_log_grows_by_little_more_than_its_samples():
    """An hour at 1 kHz, 3.6 million rows, is to fit into 1.5 GB: 350 bytes a row and the rest."""
    rows = (300_000, 600_000)
    peaks = [
        int(
            subprocess.run(
                [sys.executable, "-c", PEAK, str(count / 1000)],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
        for count in rows
    ]
    assert (peaks[1] - peaks[0]) / (rows[1] - rows[0]) < 350
