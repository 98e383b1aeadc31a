"""Sentences on effects: directions and sizes that a reader can check at the robot."""

from __future__ import annotations

import pytest

from identification.diagnosis.report import _at_bound, describe_in
from identification.diagnosis.sentences import describe
from identification.mechanisms.registry import mechanism_of
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE, Parameter

BASE = {name: entry.value for name, entry in load_model("paper").parameters.items()}


@pytest.mark.parametrize(
    ("anchor", "words"),
    [
        ((0.5, -1.25), "towards (0.50, -1.25) m with 4 N/m: a cable"),
        ((0.0, 2000.0), "a force of 8000.0 N pulls the robot towards 90 degrees left"),
        ((-300.0, -300.0), "towards 135 degrees right of the start heading, wherever it stands"),
    ],
)
def test_an_anchor_beyond_any_cable_is_a_force_that_is_the_same_everywhere(anchor, words):
    values = {"stiffness": 4.0, "anchor_x": anchor[0], "anchor_y": anchor[1]}
    assert words in describe(CATALOGUE["tether"], values, BASE)


@pytest.mark.parametrize(
    ("tilt", "words"),
    [
        ((-0.02, 0.0), "straight ahead of"),
        ((0.0, -0.02), "90 degrees left"),
        ((0.02, 0.02), "135 degrees right"),
    ],
)
def test_the_floor_falls_where_a_ball_would_roll(tilt, words):
    values = {"tilt_x": tilt[0], "tilt_y": tilt[1]}
    assert words in describe(CATALOGUE["floor_tilt"], values, BASE)


def test_dry_friction_and_its_direction_are_one_law():
    model = load_model("paper").with_effect("wheel_coulomb_friction", torque=0.2)
    model = model.with_effect("asymmetric_friction", coulomb=0.06, viscous=0.0)
    words = describe_in(model, mechanism_of(model).catalogue["asymmetric_friction"])
    assert "0.260 N m forwards and 0.140 N m backwards (+30%" in words
    alone = load_model("paper").with_effect("asymmetric_friction", coulomb=0.06, viscous=0.0)
    words = describe_in(alone, mechanism_of(alone).catalogue["asymmetric_friction"])
    assert "0.060 N m more dry friction" in words


def test_what_rounding_leaves_beside_a_bound_is_the_bound():
    drag = Parameter("drag", "N m s", lower=0.0, upper=2.0, size=0.03)
    assert [_at_bound(drag, value) for value in (1.6e-30, 2.0 - 1e-12, 1e-6)] == [0.0, 2.0, 1e-6]
