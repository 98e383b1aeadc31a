"""Settings of controllers and contacts: each has a unit and a reason, is checked, and is obeyed."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from controllers.computed_torque.adaptive import AdaptiveComputedTorque, AdaptiveSettings
from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.feedback_design import FeedbackSettings
from controllers.computed_torque.online_estimator import EstimatorSettings
from controllers.computed_torque.online_regression import RowSettings
from controllers.interface import Loop
from controllers.linear.linear_system import DriveSettings, LinearisationSettings
from controllers.linear.margins import MarginSettings
from controllers.lqi.design import LQISettings
from controllers.pid.design import PIDSettings
from controllers.policy.inputs import FeatureSettings, Layout, tracking_features
from controllers.policy.policy import PolicySettings
from controllers.registry import CONTROLLERS, build
from controllers.tuning.tunable_laws import GainRanges
from controllers.tuning.tuning import SearchSettings
from youbot_env.contact.settings import EngineSettings
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

SETTINGS = (
    AdaptiveSettings,
    DriveSettings,
    EngineSettings,
    EstimatorSettings,
    FeatureSettings,
    FeedbackSettings,
    GainRanges,
    LinearisationSettings,
    LQISettings,
    MarginSettings,
    PIDSettings,
    PolicySettings,
    RowSettings,
    SearchSettings,
)
PAPER, LOOP = load_model("paper"), Loop(0.01, delay=0.01, measurement_delay=0.005)


@pytest.mark.parametrize("kind", SETTINGS, ids=lambda kind: kind.__name__)
def test_a_setting_has_a_unit_and_a_reason_and_is_checked(kind):
    settings = kind()
    for item in fields(kind):
        with pytest.raises(FrozenInstanceError):
            setattr(settings, item.name, 1.0)
        if type(getattr(settings, item.name)) in SETTINGS:
            continue
        assert item.metadata["unit"] and item.metadata["reason"]
        if isinstance(item.default, (int, float)) and not isinstance(item.default, bool):
            with pytest.raises(InputError, match=item.name):
                kind(**{item.name: -1})


def test_settings_reach_the_controllers():
    slow = FeedbackSettings(max_bandwidth=4.0)
    control = build("computed_torque", PAPER, LOOP, settings=slow)
    assert isinstance(control, ComputedTorque)
    assert control.design.bandwidth == 4.0
    whole = AdaptiveSettings(feedback=slow, estimator=EstimatorSettings(min_noise=0.5))
    adaptive = AdaptiveComputedTorque(PAPER, LOOP, settings=whole)
    assert adaptive.design.bandwidth == 4.0
    assert (adaptive.estimator.noise == 0.5).all()
    design = CONTROLLERS["pid"].design
    assert design is not None
    usual, careful = design(PAPER, LOOP), design(PAPER, LOOP, settings=PIDSettings(gain_margin=9.0))
    assert all(a < b for a, b in zip(careful["bandwidth"], usual["bandwidth"], strict=True))
    plain, loud = (
        tracking_features(Layout((1.0, 1.0, 1.0)), gains=FeatureSettings(error_gain=gain))
        for gain in (30.0, 60.0)
    )
    assert (loud[:3] == 2 * plain[:3]).all()
    assert (loud[3:] == plain[3:]).all()
