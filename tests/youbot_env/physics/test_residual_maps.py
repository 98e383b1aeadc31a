"""Smooth maps of a residual as effects: their functions, their range, and that they refuse."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict, save_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.residual_maps import (
    PREFIX,
    VARIABLES,
    Places,
    basis_at,
    refuse_unseen,
    seen_range,
)
from youbot_env.simulation.free_run import initial_state, simulate
from youbot_env.simulation.plant import Plant

NAMES = [PREFIX + name for name in VARIABLES]


def with_map(name: str = "residual:position_x", low: float = -0.5, high: float = 0.5) -> Model:
    return load_model("paper").with_effect(name, low=low, high=high)


@pytest.mark.parametrize("name", NAMES)
def test_a_map_is_an_effect_that_the_catalogue_has_and_does_not_list(name):
    assert CATALOGUE[name].name == name and name not in CATALOGUE.names()
    model = load_model("paper").with_effect(name)
    assert model.structure.is_linear, "coefficients are identified linearly"
    at = {"pose": (0.1, 0.2, 0.3), "wheel_angle": (0.1, 0.2, 0.3, 0.4), "time": 0.5}
    alone = load_model("paper").wrench((0.01, 0.01, 0.02), (0.1, 0.1, 0.1), **at)
    np.testing.assert_allclose(model.wrench((0.01, 0.01, 0.02), (0.1, 0.1, 0.1), **at), alone)


@pytest.mark.parametrize("name", NAMES)
def test_what_a_map_adds_is_its_coefficients_times_its_functions(name):
    variable, rng = VARIABLES[name.removeprefix(PREFIX)], np.random.default_rng(0)
    bare = with_map(name, -3.0, 3.0)
    coefficients = {k: rng.standard_normal() for k in bare.effects[name] if "_" in k}
    model = bare.with_effect(name, **coefficients, low=-3.0, high=3.0)
    twist, pose = np.array([0.02, -0.01, 0.05]), np.array([0.4, -0.7, 1.1])
    angle, time = np.array([0.3, -0.2, 0.7, 1.5]), 0.8
    speed = model.geometry.wheel_speeds(twist)
    at = {"pose": pose, "wheel_angle": angle, "time": time}
    still = np.zeros(3)
    found = model.wrench(twist, still, **at) - load_model("paper").wrench(twist, still, **at)
    x = variable.of(Places(twist, pose, angle, speed, np.array(time)))
    assert x is not None
    shapes = basis_at(name, np.atleast_1d(x), (-3.0, 3.0))
    values = model.effects[name]
    if "x_1" in values:
        parts = [[values[f"{part}_{k + 1}"].value for k in range(shapes.shape[1])]
                 for part in ("x", "y", "turn")]  # fmt: skip
        force = np.array(parts) @ shapes[0]
        if variable.place.name == "world":
            c, s = math.cos(pose[2]), math.sin(pose[2])
            force[:2] = c * force[0] + s * force[1], c * force[1] - s * force[0]
    else:
        own = [[f"torque_{k + 1}_{wheel}" for wheel in ("fl", "fr", "bl", "br")]
               if f"torque_{k + 1}_fl" in values else [f"torque_{k + 1}"] * 4
               for k in range(shapes.shape[1])]  # fmt: skip
        torque = np.array([
            sum(values[own[k][i]].value * shapes[i, k] for k in range(shapes.shape[1]))
            for i in range(4)
        ])  # fmt: skip
        force = model.geometry.body_force(torque) if hasattr(model.geometry, "body_force") else None
        if force is None:
            force = model.joint_jacobian.T @ torque
    np.testing.assert_allclose(found, force, atol=1e-9)


def test_splines_add_up_to_one_and_those_of_a_speed_hold_no_viscous_friction():
    x = np.linspace(-0.5, 0.5, 101)
    assert np.allclose(basis_at("residual:position_x", x, (-0.5, 0.5)).sum(axis=1), 1.0)
    of_speed = basis_at("residual:wheel_speed", x, (-0.5, 0.5))
    assert np.linalg.matrix_rank(of_speed) == of_speed.shape[1]
    assert np.abs(x @ of_speed).max() < 0.01 * np.abs(x) @ np.abs(of_speed).max(axis=1)


def test_humps_close_the_turn():
    turn = basis_at("residual:heading", np.array([-0.3, 2 * math.pi - 0.3]), (-math.pi, math.pi))
    np.testing.assert_allclose(turn[0], turn[1], atol=1e-12)


def test_the_range_of_an_angle_is_an_arc_or_the_whole_turn():
    pose = np.zeros((200, 3))
    pose[:, 2] = np.linspace(2.5, 4.0, 200)
    arc = seen_range("residual:heading", [Places(pose=pose)])
    assert arc == pytest.approx({"low": 2.5, "high": 4.0})
    pose[:, 2] = np.linspace(0, 7, 200)
    around = seen_range("residual:heading", [Places(pose=pose)])
    assert around == {"low": -math.pi, "high": math.pi}
    with pytest.raises(InputError, match="does not change"):
        seen_range("residual:position_x", [Places(pose=pose)])
    # Seen across +-pi, asked for on the other side.
    limits = {"residual:heading": (2.5, 4.0)}
    refuse_unseen(limits, Places(pose=np.array([0.0, 0.0, -2.9])))
    with pytest.raises(InputError, match=r"residual:heading: .* goes to .* has seen 2.5 to 4"):
        refuse_unseen(limits, Places(pose=np.array([0.0, 0.0, 0.0])))


def test_whoever_goes_where_it_has_not_been_is_refused_in_one_line():
    model = with_map()
    far = {"pose": (0.7, 0.0, 0.0)}
    told = r"^residual:position_x: .* 0\.7 m, and the map has seen -0\.5 to 0\.5: fit it again"
    for call in (model.wrench, model.inverse_dynamics):
        call((0.1, 0, 0), (0, 0, 0), pose=(0.4, 0, 0))
        with pytest.raises(InputError, match=told) as error:
            call((0.1, 0, 0), (0, 0, 0), **far)
        assert "\n" not in str(error.value)
    with pytest.raises(InputError, match=told):
        model.forward_dynamics((0.1, 0, 0), (0, 0, 0, 0), **far)


@pytest.mark.slow  # two kernels are compiled
def test_a_free_run_and_a_plant_that_leave_the_range_are_refused():
    model = with_map("residual:position_x", -0.1, 0.1)
    time = np.linspace(0, 2, 201)
    push = np.full((201, 4), 0.6)
    start = initial_state(model)
    assert len(simulate(model, time[:20], push[:20], start)) == 20
    with pytest.raises(InputError, match="the free run goes to"):
        simulate(model, time, push, start)
    plant = Plant(model)
    plant.step((0.6,) * 4, 0.1)
    with pytest.raises(InputError, match="the plant goes to"):
        for _ in range(20):
            plant.step((0.6,) * 4, 0.1)


def test_an_unknown_variable_is_told_with_the_known_ones():
    with pytest.raises(InputError, match=r"no map is drawn over 'torque_fl'; there are residual:h"):
        load_model("paper").with_effect("residual:torque_fl")


def test_a_model_file_holds_a_map_as_numbers_alone(tmp_path):
    model = with_map().with_effect("residual:position_x", x_3=1.5, turn_2=0.2, low=-1.0, high=2.0)
    save_model(tmp_path / "model.json", model)
    content = json.loads((tmp_path / "model.json").read_text())
    entry = content["effects"]["residual:position_x"]["parameters"]["x_3"]
    assert entry == {"value": 1.5, "unit": "N", "std": None}
    again = load_model(str(tmp_path / "model.json"))
    assert again.values == model.values and again.map_limits == {"residual:position_x": (-1.0, 2.0)}
    content["effects"]["residual:nothing"] = content["effects"].pop("residual:position_x")
    with pytest.raises(InputError, match="no map is drawn over 'nothing'"):
        model_from_dict(content)
    assert model_to_dict(again) == model_to_dict(model)
