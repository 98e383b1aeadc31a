"""A robot in O is identified and diagnosed as one in X: the same numbers from the same motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.recording import record
from identification import diagnose, identify, write_log
from identification.logs.log import Log
from identification.logs.reading import read_log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.registry import mechanism_of
from youbot_env import load_model
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.geometry import Geometry

IN_O = Geometry(l=0.55, h=0.15, R=0.06, arrangement="O")
IN_X = replace(IN_O, arrangement="X", l=IN_O.l - 2 * IN_O.h)
EXCHANGED = [2, 3, 0, 1]
TRUE = load_model("paper").with_values({"m0": 42.0, "I0": 3.5})


def on(geometry: Geometry, truth: Model = TRUE) -> Model:
    """The same platform on other wheels."""
    return replace(truth, geometry=geometry)


def logs_of(model: Model, count: int = 1) -> list[Log]:
    """Multisines, driven by the stock loop."""
    motions = [
        multisine(
            np.random.default_rng(k),
            amplitude=(0.3, 0.25, 0.8),
            duration=40.0,
            geometry=model.geometry,
            name=f"run_{k}",
        )
        for k in range(count)
    ]
    return record(model, motions, rate=50.0, seed=3)


def exchanged(log: Log) -> Log:
    """The log with front and back wheels exchanged."""
    return replace(
        log, velocity=log.velocity[:, EXCHANGED], effort=log.effort[:, EXCHANGED], pose=log.pose
    )


def test_the_log_of_o_identifies_the_robot_and_as_x_the_same():
    (log,) = logs_of(on(IN_O))
    found = identify([log], geometry=IN_O).model
    for name, wanted in TRUE.values.items():
        estimate = found.parameters[name]
        assert estimate.std and abs(estimate.value - wanted) < 4 * estimate.std, name
    as_x = identify([exchanged(log)], geometry=IN_X).model
    for name in TRUE.values:
        # Noise that is drawn for the correction of its bias goes to other wheels.
        apart = abs(as_x.values[name] - found.values[name])
        assert apart < 0.05 * (found.parameters[name].std or 0.0), name
    assert found.geometry == IN_O and as_x.geometry == IN_X
    mechanism = Mecanum(IN_O)
    np.testing.assert_allclose(mechanism.jacobian, IN_O.wheel_jacobian)
    assert mechanism.kind is found.mechanism


def test_the_wrong_arrangement_is_no_silent_model():
    (log,) = logs_of(on(IN_O))
    right = identify([log], geometry=IN_O).model.errors["force_error"]
    try:
        wrong = identify([log], geometry=replace(IN_O, arrangement="X"))
    except InputError:
        return
    assert wrong.warnings and wrong.model.errors["force_error"] > 3 * right


def test_a_model_takes_the_geometry_that_is_given():
    mechanism = mechanism_of(on(IN_X), IN_O)
    assert mechanism.kind is on(IN_O).mechanism is not on(IN_X).mechanism
    np.testing.assert_allclose(mechanism.jacobian, IN_O.wheel_jacobian)


@pytest.mark.slow
def test_a_missing_effect_is_named_with_its_wheel():
    truth = on(IN_O).with_effect("uneven_coulomb_friction", extra_bl=0.3)
    found = diagnose(on(IN_O), logs_of(truth, 2), seed=0).to_dict()
    assert found["missing"] == ["uneven_coulomb_friction"]
    (leader,) = [c for c in found["candidates"] if c["effect"] == "uneven_coulomb_friction"]
    assert leader["parameters"]["extra_bl"]["value"] == pytest.approx(0.3, rel=0.02)


def test_doctor_tells_the_arrangement_from_the_pose(tmp_path):
    (log,) = logs_of(on(IN_O))
    write_log(tmp_path / "o.csv", log)
    read_log(tmp_path / "o.csv", geometry=IN_O)
    with pytest.raises(InputError, match="the rollers stand in O, in X by the geometry"):
        read_log(tmp_path / "o.csv", geometry=replace(IN_O, arrangement="X"))
