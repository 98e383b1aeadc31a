"""Effects on torques and forces: planted in a recording, named beside their rivals, and sized."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.diagnose import select
from identification.diagnosis.sentences import WORDS, describe
from identification.diagnosis.structures import LoggedData
from identification.fitting.final_fit import final_fit
from identification.mechanisms.physical_parameters import fitted_model
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from tests.youbot_env.structures import EFFECTS, catalogue_values
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE

PAPER = load_model("paper")

RIVALS = ["floor_tilt", "wheel_coulomb_friction", "uneven_wheel_friction", "torque_gain_error"]

PLANTED = [
    ("torque_offset", {"offset_fl": 0.06, "offset_fr": 0.02, "offset_bl": -0.04}),
    ("torque_constant_drift", {"fraction": 0.2, "time_constant": 50.0}),
    ("speed_dependent_gain", {"loss": 0.15}),
    ("torque_saturation", {"limit": 0.6}),
    ("dead_zone", {"width": 0.08}),
    ("drive_resonance", {"frequency": 25.0, "damping": 0.4}),
    (
        "torque_ripple",
        {
            "amplitude": 0.2,
            "phase_fl": 0.5,
            "phase_fr": -2.0,
            "phase_bl": 1.0,
            "phase_br": 2.5,
            "cycles": 6.0,
        },
    ),
    ("uneven_coulomb_friction", {"extra_fr": 0.2}),
    ("uneven_roller_friction", {"extra_bl": 0.05}),
    ("asymmetric_friction", {"coulomb": 0.08, "viscous": 0.02}),
    ("yaw_scrub", {"torque": 2.0}),
    ("cable_drag", {"force": 6.0}),
    ("cable_twist", {"stiffness": 0.6, "neutral": 0.4}),
]


@pytest.mark.parametrize(("name", "values"), PLANTED)
def test_a_planted_effect_is_named_and_sized(name: str, values: dict[str, float]):
    log = recording(effects=((name, tuple(values.items())),), rate=50.0)
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [log])
    names = [name, *RIVALS]
    found = select(data, mechanism, PAPER.theta, names, np.random.default_rng(0))
    assert [step.effect for step in found.steps[1:]] == [name]
    last = found.steps[-1].fitted
    args = (last.mechanism, data.samples, data.noise, last.theta, 0, data.settings.fit)
    model = fitted_model(last.mechanism, final_fit(*args))
    for key, value in seen(name, values).items():
        estimate = model.effects[name][key]
        deviation = estimate.std or 0.2 * abs(value)
        assert abs(estimate.value - value) < max(4 * deviation, 0.03 * abs(value)), key


def seen(name: str, values: dict[str, float]) -> dict[str, float]:
    """What a log can show of planted values: of offsets none that cancel on the platform."""
    if name != "torque_offset":
        return values
    internal = np.array([1.0, 1.0, -1.0, -1.0]) / 2
    keys = CATALOGUE[name].public_names
    planted = np.array([values.get(key, 0.0) for key in keys])
    return dict(zip(keys, planted - internal * (internal @ planted), strict=True))


@pytest.mark.parametrize("name", [name for name in EFFECTS if name in WORDS])
def test_a_sentence_holds_the_size_and_how_to_confirm_it(name: str):
    base = {key: entry.value for key, entry in PAPER.parameters.items()}
    sentence = describe(CATALOGUE[name], catalogue_values(name), base)
    assert any(digit.isdigit() for digit in sentence)
    assert "to confirm" in sentence or name == "payload_change"
