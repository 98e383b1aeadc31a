"""What a diagnosis does about logs that are too long to be searched as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.candidates import _grid
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import LoggedData, averaged_to_most
from identification.mechanisms.registry import mechanism_of
from tests.identification.healthy import healthy_log
from youbot_env.model.model_file import load_model

MECHANISM = mechanism_of(load_model("paper"))


def test_logs_of_usual_length_stay_as_they_are():
    samples = [MECHANISM.samples(healthy_log(rate=1000.0, duration=5.0))]
    found, notes = averaged_to_most(samples, DiagnosisSettings())
    assert found[0] is samples[0] and not notes


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


def test_no_log_is_averaged_below_the_least_rate():
    samples = [MECHANISM.samples(healthy_log(rate=150.0, duration=5.0))]
    found, notes = averaged_to_most(samples, DiagnosisSettings(max_samples=10))
    assert found[0] is samples[0] and not notes


def test_instants_of_long_logs_are_spread_over_all_of_it():
    effect = next(e for e in MECHANISM.catalogue if any(p.instant for p in e.parameters))
    instant = next(p for p in effect.parameters if p.instant)
    short, long = _grid(instant, 300.0, 72), _grid(instant, 3600.0, 72)
    assert np.diff(short) == pytest.approx(5.0) and len(short) == 59
    assert np.diff(long) == pytest.approx(50.0) and long[-1] > 3500.0
