"""Dry friction of an axis that turns about standstill within another speed than usual."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.diagnose import diagnose
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
