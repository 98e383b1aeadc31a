"""Settings of a diagnosis are checked once, and those in force are printed with the result."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, replace

import pytest

from identification.comparison import ComparisonSettings
from identification.diagnosis.add_effect import add_effect
from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.settings import FitSettings
from identification.residual_map.settings import ResidualMapSettings
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"max_p_value": 0.0}, "max_p_value: 0.0 must be positive"),
        ({"max_tied_deviations": float("nan")}, "max_tied_deviations: nan is not a finite number"),
        ({"bootstrap_draws": 2.5}, "bootstrap_draws: 2.5 is not a whole number of at least 1"),
    ],
)
def test_what_is_no_number_of_its_kind_is_refused_in_a_line(changes: dict, words: str):
    with pytest.raises(InputError, match=words) as caught:
        DiagnosisSettings(**changes)
    assert str(caught.value).startswith("diagnosis settings: ")
    assert "\n" not in str(caught.value)


def test_times_and_places_may_start_at_zero_and_nothing_else_may_be():
    assert ResidualMapSettings(time_knots=(0.0, 0.5, 1.0)).time_knots[0] == 0.0
    with pytest.raises(InputError, match="residual map settings: ridge_strengths"):
        ResidualMapSettings(ridge_strengths=(0.0, 1.0))
    with pytest.raises(InputError, match="comparison settings: max_stretches"):
        ComparisonSettings(max_stretches=0)


def test_they_stay_as_they_are():
    with pytest.raises(FrozenInstanceError):
        DiagnosisSettings().max_p_value = 0.5  # type: ignore[misc]


def test_effects_are_chosen_on_rows_of_their_own_rate():
    fit = FitSettings(row_rate=30.0, huber_threshold=2.0)
    settings = DiagnosisSettings(fit=fit, row_rate=40.0)
    assert settings.rows == replace(fit, row_rate=40.0)
    assert settings.fit.row_rate == 30.0


def test_a_threshold_decides_and_is_printed_with_the_result():
    log = recording("calibration", (("floor_tilt", (("tilt_x", 0.02), ("tilt_y", 0.0))),), rate=50)
    usual, strict = DiagnosisSettings(), DiagnosisSettings(min_share_of_residual=0.9999)
    model = load_model("paper")
    found = [add_effect(model, "floor_tilt", [log], settings=s) for s in (usual, strict)]
    assert [item.worthwhile for item in found] == [True, False]
    assert "less than 100%" in found[1].reasons[0]
    printed = json.loads(json.dumps(found[1].to_dict()["settings"]))
    assert printed["min_share_of_residual"] == 0.9999
    assert printed["fit"]["row_rate"] == FitSettings().row_rate
    assert printed["residual_map"]["max_rows"] == ResidualMapSettings().max_rows
