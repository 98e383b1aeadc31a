"""Dry friction of an axis that turns about standstill within another speed than usual."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.candidates import fit_base
from identification.diagnosis.diagnose import _free_run_holds, diagnose
from identification.diagnosis.structures import FittedStructure, LoggedData
from identification.mechanisms.axis_model import base_axis_model
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted

RIVALS = ["thinning_friction", "stribeck_friction", "load_dependent_friction", "spring"]


@pytest.mark.parametrize("missing", [(), ("spring",)])
def test_another_width_is_no_missing_friction(missing: tuple[str, ...]):
    axis, theta = planted(STAGE, *missing)
    place = axis.parameter_names.index("smoothing")
    width = theta[place] = 15 * theta[place]
    log = log_of(axis, theta, noise=0.004)
    found = diagnose(base_axis_model([log]), [log], effects=RIVALS)
    assert found.missing == missing
    assert found.verdict == ("effect" if missing else "adequate")
    assert found.model.parameters["smoothing"].value == pytest.approx(width, rel=0.3)
    assert any("about standstill within" in line for line in found.sentences)


def test_true_stribeck_friction_is_still_named():
    axis, theta = planted(STAGE, "stribeck_friction")
    log = log_of(axis, theta, noise=0.004)
    found = diagnose(base_axis_model([log]), [log], effects=RIVALS)
    assert found.missing == ("stribeck_friction",)
    assert np.isclose(found.model.parameters["smoothing"].value, theta[3], rtol=0.5)


@pytest.mark.parametrize(
    ("after", "by_noise", "before_by_noise", "holds"),
    [
        (0.0333, 0.026, 0.01, True),
        (0.0333, 0.026, 0.026, False),  # as much of the free run without it
        (0.0333, 0.005, 0.005, False),
        (0.053, 0.052, 0.005, False),
        (0.031, 0.005, 0.005, True),
    ],
)
def test_what_noise_makes_of_a_free_run_is_no_fault_of_an_effect(
    monkeypatch: pytest.MonkeyPatch,
    after: float,
    by_noise: float,
    before_by_noise: float,
    holds: bool,
):
    """A true cogging is met out of step in free run; one that is 1.7 times worse is not there."""
    axis, theta = planted(STAGE)
    data = LoggedData(axis, [log_of(axis, theta, noise=0.004)])
    step = data.step(fit_base(data, axis, theta), None)
    without = replace(step, velocity_error=0.0314)
    found = replace(step, velocity_error=after, fitted=replace(step.fitted))

    def floor(data: LoggedData, fitted: FittedStructure) -> SimpleNamespace:
        error = by_noise if fitted is found.fitted else before_by_noise
        return SimpleNamespace(to_dict=lambda: {"velocity_error": error})

    monkeypatch.setattr(LoggedData, "floor", floor)
    assert _free_run_holds(data, without, found) is holds
