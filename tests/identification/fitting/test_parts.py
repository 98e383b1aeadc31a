"""Long logs are fitted in parts: the same rows, to rounding, in bounded memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.predictability import predictability
from identification.fitting.regression import filtered_residual, regression
from identification.fitting.settings import FitSettings
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
