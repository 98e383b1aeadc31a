"""What a diagnosis does about logs that are too long to be searched as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.candidates import _instants, fit_base, rank
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import LoggedData
from identification.mechanisms.registry import mechanism_of
from tests.identification.healthy import healthy_log
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

MECHANISM = mechanism_of(load_model("paper"))


def test_long_logs_are_averaged_down_and_it_is_said():
    settings = DiagnosisSettings(max_samples=2000)
    logs = [
        replace(healthy_log(rate=rate, duration=10.0), name=f"at_{rate:g}")
        for rate in (1000.0, 50.0)
    ]
    data = LoggedData(MECHANISM, logs, settings=settings)
    fast, slow = data.samples
    # A fifth would be enough of 10 500 samples, and 50 Hz are below the least rate.
    assert 1.0 / fast.dt == pytest.approx(200.0) and len(slow) == 500
    before = MECHANISM.samples(logs[0])
    np.testing.assert_allclose(fast.torque[7], before.torque[35:40].mean(axis=0))
    assert fast.time[-1] == pytest.approx(before.time[-1], abs=0.01)
    (note,) = data.notes
    assert "at_1000: 10500 samples" in note and "from 1000 Hz to 200 Hz" in note


def test_instants_of_long_logs_are_spread_over_all_of_it():
    effect = next(e for e in MECHANISM.catalogue if any(p.instant for p in e.parameters))
    instant = next(p for p in effect.parameters if p.instant)
    short, long = (_instants(instant.grid, longest, 72) for longest in (300.0, 3600.0))
    assert np.diff(short) == pytest.approx(5.0) and len(short) == 59
    assert np.diff(long) == pytest.approx(50.0) and long[-1] > 3500.0


def test_a_long_log_is_ranked_as_a_short_one_without_keeping_rows():
    log = recording("calibration", (("floor_tilt", (("tilt_x", -0.018), ("tilt_y", -0.004))),))
    names = ["floor_tilt", "torque_delay", "wheel_coulomb_friction", "tether"]
    theta, rankings = load_model("paper").theta, []
    short = DiagnosisSettings()
    long = replace(short, fit=replace(short.fit, max_part_samples=3000, part_samples=2500))
    for settings in (short, long):
        data = LoggedData(MECHANISM, [log], settings=settings)
        base = fit_base(data, MECHANISM, theta)
        rankings.append(rank(data, base, names, np.random.default_rng(0)))
    kept, made = rankings
    assert made.best is not None and made.best.name == "floor_tilt"
    assert [c.name for c in made.candidates] == [c.name for c in kept.candidates]
    for one, other in zip(kept.candidates, made.candidates, strict=True):
        assert one.kept is not None and other.kept is None
        assert other.square == pytest.approx(one.square, rel=1e-6)
        assert made.p_values[other.name] == pytest.approx(kept.p_values[one.name], abs=2e-3)
        for mine, theirs in zip(other.columns, one.columns, strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-6 * np.abs(theirs).max())
        for mine, theirs in zip(other.left, one.left, strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-6 * np.abs(theirs).max())
