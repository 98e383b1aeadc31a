"""Where a refitted base is beyond what a platform can be, the verdict is given all the same.

A steep slope that no candidate explains is taken up by the base parameters as far as they can: the
fitted mass ends below that of the wheels.
"""

from __future__ import annotations

import pytest

from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.report import Diagnosis
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

SLOPE = ("floor_tilt", (("tilt_x", 0.0), ("tilt_y", -0.04)))
DRY = ("wheel_coulomb_friction", (("torque", 1.0),))


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    log = recording("calibration", (SLOPE, DRY), rate=50.0, noise=2.0)
    names = ["wheel_coulomb_friction", "quadratic_friction"]
    return diagnose(load_model("paper"), [log], effects=names)


def test_the_verdict_is_given_with_a_warning(found: Diagnosis):
    content = found.to_dict()
    assert (content["verdict"], content["missing"]) == ("unknown", ["wheel_coulomb_friction"])
    assert found.fitted_model is None
    (warning,) = [w for w in content["warnings"] if "do not show the base parameters" in w]
    assert "m0" in warning and "given model" in warning
    assert content["where"] and content["remaining"]


def test_sizes_are_those_beside_the_given_parameters(found: Diagnosis):
    torque = found.candidates[0]["parameters"]["torque"]
    assert torque["value"] == pytest.approx(1.0, rel=0.05) and torque["std"] > 0
    assert f"{torque['value']:.3f} N m of dry friction" in found.sentences[0]


def test_there_is_no_model_and_a_line_says_why(found: Diagnosis):
    with pytest.raises(InputError, match=r"do not show the base parameters \(.*m0") as caught:
        _ = found.model
    assert "\n" not in str(caught.value)
