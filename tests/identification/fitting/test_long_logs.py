"""Logs of more samples than a fit needs are averaged down, and it is said."""

from __future__ import annotations

import pytest

from identification.fitting.identify import identify
from identification.fitting.long_logs import averaged_to_most
from identification.fitting.settings import FitSettings
from identification.mechanisms.registry import mechanism_of
from tests.identification.healthy import healthy_log
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

MECHANISM = mechanism_of(load_model("paper"))


def samples(rate, duration=5.0):
    return [MECHANISM.samples(healthy_log(rate=rate, duration=duration))]


def test_logs_of_usual_length_stay_as_they_are():
    logs = samples(1000.0)
    found, notes = averaged_to_most(logs, 200_000, 100.0, "a test needs")
    assert found[0] is logs[0] and not notes


def test_no_log_is_averaged_below_the_least_rate():
    logs = samples(150.0)
    found, notes = averaged_to_most(logs, 10, 100.0, "a test needs")
    assert found[0] is logs[0] and not notes


def test_the_words_say_what_became_of_which_log():
    found, (note,) = averaged_to_most(samples(1000.0), 1000, 150.0, "a test needs")
    assert len(found[0]) == 1000 and 1.0 / found[0].dt == pytest.approx(200.0)
    assert "5000 samples are more than a test needs; averaged from 1000 Hz to 200 Hz" in note


def test_a_fit_of_a_long_log_takes_the_means_and_says_so():
    """As near to the truth as all samples, with the less noise on the regressors."""
    log = recording("calibration", rate=500.0)
    few = FitSettings(max_samples=len(log) // 2)
    found = identify([log], recursive=False, settings=few)
    every = identify([log], recursive=False)
    assert len(found.samples[0]) == len(every.samples[0]) // 2
    assert any("averaged from 500 Hz to 250 Hz" in line for line in found.warnings)
    assert not any("averaged" in line for line in every.warnings)
    truth = load_model("paper").values
    for name, estimate in found.model.parameters.items():
        assert abs(estimate.value - truth[name]) < 3.5 * estimate.std, name
        assert estimate.std < 1.1 * every.model.parameters[name].std, name
