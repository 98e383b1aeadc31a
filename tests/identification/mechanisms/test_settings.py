"""Settings of a mechanism: impossible ones are refused, and others than the usual are obeyed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.identify import identify
from identification.fitting.settings import FitSettings
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.registry import mechanism_of
from identification.mechanisms.settings import MechanismSettings
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import Geometry

PAPER: Model[Geometry] = load_model("paper")


@pytest.mark.parametrize(
    "changes",
    [
        {"part_window_duration": 0.0},
        {"internal_torque_smoothing_time": np.nan},
        {"torque_rate_smoothing_time": 0.0},
        {"max_deviation_share": -0.1},
        {"axis_bandwidths": (100.0, 30.0, 0.0)},
    ],
)
def test_impossible_settings_are_refused(changes):
    with pytest.raises(InputError, match=next(iter(changes))):
        MechanismSettings(**changes)


def test_those_of_a_fit_reach_its_warnings_and_parts():
    logs = [recording()]
    strict = FitSettings(
        mechanism=MechanismSettings(max_deviation_share=1e-6, min_part_duration=1e3)
    )
    usual, found = (identify(logs, recursive=False, settings=s) for s in (FitSettings(), strict))
    barely = [sum("barely observable" in line for line in r.warnings) for r in (usual, found)]
    assert barely[0] < barely[1] == len(PAPER.parameters)
    assert [part.kind for part in found.parts] == ["free"] and len(usual.parts) > 3
    assert found.to_dict()["settings"]["mechanism"]["min_part_duration"] == 1e3
    np.testing.assert_array_equal(usual.fit.theta, found.fit.theta)


def test_they_stay_when_effects_are_added():
    settings = MechanismSettings(torque_rate_smoothing_time=0.1)
    lagging = mechanism_of(PAPER, settings=settings).extended("actuator_lag")
    assert lagging.settings is settings
    theta = lagging.extend_theta(PAPER.theta, "actuator_lag", {})
    usual = replace(lagging, settings=MechanismSettings())
    samples = lagging.samples(recording("I"))
    # Averaged over longer, the torque's rate holds less noise.
    noise = [
        np.abs(np.diff(each.demand(theta, samples).columns([len(theta) - 1]), axis=2)).mean()
        for each in (lagging, usual)
    ]
    assert noise[0] < 0.5 * noise[1]


def test_a_pose_that_departs_by_less_than_allowed_shows_no_slip():
    log = recording("I")
    assert log.pose is not None
    slipped = replace(log, pose=log.pose + np.outer(np.linspace(0, 1, len(log)), [0.5, 0.0, 0.0]))
    patient = MechanismSettings(max_pose_angle_error=100.0)
    assert not Mecanum(PAPER.geometry).samples(slipped).angle_measured
    assert Mecanum(PAPER.geometry, settings=patient).samples(slipped).angle_measured
