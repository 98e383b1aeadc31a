"""Where a refitted base is beyond what a platform can be, there is a verdict and a model.

A steep slope that no candidate explains is taken up by the base parameters as far as they can: the
fitted mass ends below that of the wheels; the model stops at what can be.
"""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.report import Diagnosis
from identification.diagnosis.settings import DiagnosisSettings
from identification.proposal.settings import ProposalSettings
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict

SLOPE = ("floor_tilt", (("tilt_x", 0.0), ("tilt_y", -0.04)))
DRY = ("wheel_coulomb_friction", (("torque", 1.0),))


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    log = recording("calibration", (SLOPE, DRY), rate=50.0, noise=2.0)
    names = ["wheel_coulomb_friction", "quadratic_friction"]
    # Too short for the search for a law: it takes half of the time, and what is told here is of
    # the model without one.
    settings = replace(DiagnosisSettings(), proposal=ProposalSettings(min_duration=1e6))
    return diagnose(load_model("paper"), [log], effects=names, settings=settings)


@pytest.mark.slow
def test_the_verdict_is_given_and_so_is_a_model(found: Diagnosis):
    content = found.to_dict()
    assert (content["verdict"], content["missing"]) == ("unknown", ["wheel_coulomb_friction"])
    assert content["where"] and content["remaining"]
    again = model_from_dict(json.loads(json.dumps(model_to_dict(found.model))), "written")
    assert again.values == found.model.values
    assert again.values["m0"] > 4 * again.geometry.m1


def test_the_sentence_has_the_size_that_the_model_has(found: Diagnosis):
    torque = found.model.effects["wheel_coulomb_friction"]["torque"]
    assert torque.value == pytest.approx(1.0, rel=0.05)
    assert f"{torque.value:.3f} N m of dry friction" in found.sentences[0]
