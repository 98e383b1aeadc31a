"""Rollers in O, or at other angles: one wheel matrix, and an exact kinship of O and X.

The kinship: a wheel that is moved along the axis of its roller on the floor turns as before, for in
R phi' = VX + t VY + (t x - y) W  its t x - y stays. Move all four wheels of a robot in O by 2 h to
the other end: it is a robot in X of half the track l - 2 h, whose front wheels were the back ones.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, EFFECTS, EVERYTHING, model
from youbot_env import Plant, load_model
from youbot_env.contact.plant import ContactPlant
from youbot_env.equations.equations import equation
from youbot_env.errors import InputError
from youbot_env.exports.torch_module import torch_derivative
from youbot_env.model.model import Model
from youbot_env.motions.calibration import CALIBRATION
from youbot_env.motions.limits import MotionLimits
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import (
    SIGN_LATERAL,
    SIGN_X,
    SIGN_Y,
    Geometry,
    allocate,
    body_force,
    nearest_twist,
    roller_force,
    roller_rates,
    uneven_contacts,
    wheel_rates,
)
from youbot_env.simulation.compiled import derivative, inverse_kernel

IN_O = Geometry(l=0.55, h=0.15, arrangement="O")
IN_X = replace(IN_O, arrangement="X", l=IN_O.l - 2 * IN_O.h)
ODD = Geometry(l=0.2, h=0.26, arrangement="O", roller_angles=(0.7, 0.8, 0.75, 0.83))
ROBOTS = {"X": Geometry(), "O": IN_O, "base longer": Geometry(arrangement="O"), "odd": ODD}

EXCHANGED = [2, 3, 0, 1]
"""Front and back wheels."""

OF_PLACES = {"uneven_roller_friction", "roller_angle_error"}
"""Effects of single rollers, which do depend on where a wheel stands along its roller's axis."""


def stacked(components: Any) -> np.ndarray:
    """Components, some of which may be plain numbers, as one array."""
    return np.array(np.broadcast_arrays(*components))


@cache
def robot(name: str, case: str = "base") -> Model:
    """A model on other wheels."""
    return replace(model(case), geometry=ROBOTS[name], covariance=None, covariance_names=())


@pytest.mark.parametrize("geometry", ROBOTS.values(), ids=ROBOTS)
def test_the_rows_are_those_of_a_wheel_at_its_place(geometry: Geometry):
    rng = np.random.default_rng(0)
    for _ in range(20):
        vx, vy, w = rng.normal(size=3)
        rates = wheel_rates(geometry, (vx, vy, w))
        rollers = roller_rates(geometry, (vx, vy, w))
        for i in range(4):
            x, y = SIGN_X[i] * geometry.h, SIGN_Y[i] * geometry.l
            side = SIGN_LATERAL[i] * (1 if geometry.arrangement == "X" else -1)
            d = side * geometry.roller_angles[i]
            centre = np.array([vx - y * w, vy + x * w])
            # The contact moves along the roller's own rolling direction alone.
            rolling = centre - np.array([geometry.R * rates[i], 0.0])
            assert rolling @ [np.cos(d), np.sin(d)] == pytest.approx(0.0, abs=1e-12)
            across = rolling @ np.array([-np.sin(d), np.cos(d)])
            assert abs(across) == pytest.approx(geometry.r * abs(rollers[i]), abs=1e-12)


@pytest.mark.parametrize("geometry", ROBOTS.values(), ids=ROBOTS)
def test_all_maps_are_of_one_matrix(geometry: Geometry):
    rng, jacobian = np.random.default_rng(1), geometry.wheel_jacobian
    units = tuple(np.eye(3))
    np.testing.assert_allclose(np.array(wheel_rates(geometry, units)), jacobian, atol=1e-12)
    np.testing.assert_allclose(
        np.array(roller_rates(geometry, units)), geometry.roller_jacobian, atol=1e-11
    )
    torque, twist = rng.normal(size=(4, 50)), rng.normal(size=(3, 50))
    force = np.array(body_force(geometry, tuple(torque)))
    np.testing.assert_allclose(force, jacobian.T @ torque, atol=1e-11)
    np.testing.assert_allclose(
        stacked(roller_force(geometry, tuple(torque))),
        geometry.roller_jacobian.T @ torque,
        atol=1e-10,
    )
    least = np.array(allocate(geometry, tuple(force)))
    np.testing.assert_allclose(least, np.linalg.pinv(jacobian.T) @ force, atol=1e-10)
    np.testing.assert_allclose(geometry.wheel_torque(force.T).T, least, atol=1e-10)
    found = np.array(nearest_twist(geometry, wheel_rates(geometry, tuple(twist))))
    np.testing.assert_allclose(found, twist, atol=1e-12)
    np.testing.assert_allclose(np.array(geometry.internal) @ jacobian, 0.0, atol=1e-11)
    np.testing.assert_allclose(geometry.slip(twist.T @ jacobian.T), 0.0, atol=1e-10)


def test_what_is_written_out_for_x_is_the_rows():
    geometry, rng = Geometry(), np.random.default_rng(2)
    rows = uneven_contacts(geometry)
    twist, torque = tuple(rng.normal(size=(3, 40))), tuple(rng.normal(size=(4, 40)))
    for plain, values in (
        (wheel_rates, twist),
        (roller_rates, twist),
        (body_force, torque),
        (roller_force, torque),
        (nearest_twist, torque),
        (allocate, twist),
    ):
        found = (stacked(plain(g, values)) for g in (geometry, rows))
        np.testing.assert_allclose(*found, rtol=1e-12, atol=1e-12)


def exchanged(stated: Model) -> Model:
    """A model in O with the parameters that each wheel has of its own at the other wheel."""
    values = dict(stated.values)
    for name in stated.effects:
        for parameter in CATALOGUE[name].public_parameters:
            if parameter.each_wheel:
                for i, key in enumerate(parameter.names):
                    other = parameter.names[EXCHANGED[i]]
                    values[f"{name}.{key}"] = stated.values[f"{name}.{other}"]
    return stated.with_values(values)


@pytest.mark.parametrize("case", [c for c in CASES if c not in OF_PLACES and c != EVERYTHING])
def test_a_robot_in_o_is_one_in_x_with_front_and_back_wheels_exchanged(case: str):
    x = replace(model(case), geometry=IN_X, covariance=None, covariance_names=())
    o = replace(exchanged(x), geometry=IN_O)
    rng = np.random.default_rng(3)
    size = len(x.structure.state_names)
    state, torque = rng.uniform(-1, 1, (30, size)), rng.uniform(-2, 2, (30, 4))
    order = list(range(size))
    order[6:10] = [6 + k for k in EXCHANGED]
    for start in range(11, 11 + 4 * x.structure.drive_order, 4):
        order[start : start + 4] = [start + k for k in EXCHANGED]
    rates = x.state_derivative(state, torque)
    found = o.state_derivative(state[:, order], torque[:, EXCHANGED])
    np.testing.assert_allclose(found, rates[:, order], rtol=1e-9, atol=1e-9)


def test_which_effects_the_kinship_leaves_out():
    assert set(EFFECTS) >= OF_PLACES


@pytest.mark.parametrize("name", ["O", "odd"])
@pytest.mark.parametrize("case", ["base", "wheel_radius_error", "roller_angle_error", EVERYTHING])
def test_compiled_code_and_tensors_are_the_same_physics(name: str, case: str):
    m, rng = robot(name, case), np.random.default_rng(4)
    size = len(m.structure.state_names)
    state, torque = rng.uniform(-1, 1, (20, size)), rng.uniform(-2, 2, (20, 4))
    expected = m.state_derivative(state, torque)
    code = derivative(m.structure)
    for row, drive, rates in zip(state, torque, expected, strict=True):
        found = code(row, drive, m.lengths, m.theta)
        np.testing.assert_allclose(found, rates, rtol=1e-9, atol=1e-9)


def test_torch_has_the_rollers_too():
    torch = pytest.importorskip("torch")
    m, rng = robot("odd"), np.random.default_rng(5)
    state, torque = rng.uniform(-1, 1, (20, 11)), rng.uniform(-2, 2, (20, 4))
    columns = [torch.tensor(c) for c in (*state.T, *torque.T)]
    found = torch_derivative(m.structure, m.geometry)(*columns, *map(torch.tensor, m.theta))
    expected = m.state_derivative(state, torque)
    for k in range(3):
        np.testing.assert_allclose(np.asarray(found[k]), expected[:, k], rtol=1e-10)


def test_feed_forward_of_a_robot_in_o_drives_it():
    m = robot("O", "wheel_coulomb_friction")
    twist, acceleration = np.array([0.2, -0.3, 0.4]), np.array([0.5, 0.2, -0.6])
    torque = m.inverse_dynamics(twist, acceleration)
    np.testing.assert_allclose(m.forward_dynamics(twist, torque), acceleration, atol=1e-10)
    motion = np.r_[twist, acceleration, np.zeros(8)][None]
    found = np.zeros((1, 4))
    code = inverse_kernel(m.structure, dynamics)
    code.acting(motion, m.lengths, m.theta, 1e-12, found)
    np.testing.assert_allclose(found[0], torque, atol=1e-10)


def test_a_plant_in_o_goes_left_by_the_other_wheels():
    o, x = (Plant(robot(name)) for name in ("O", "X"))
    for plant, signs in ((o, [1, -1, -1, 1]), (x, [-1, 1, 1, -1])):
        for _ in range(20):
            plant.step(np.array(signs, float), 0.01)
        assert plant.twist[1] > 0.05
        assert np.sign(plant.wheel_speed).tolist() == signs


@pytest.mark.parametrize("name", ["O", "odd"])
def test_real_rollers_move_as_the_model_says(name: str):
    pytest.importorskip("mujoco")
    m = load_model("paper")
    m = replace(m, geometry=replace(ROBOTS[name], R=0.0475, r=0.014))
    for force in ((20.0, 0.0, 0.0), (0.0, 25.0, 0.0), (0.0, 0.0, 6.0)):
        torque = m.geometry.wheel_torque(force)
        moved = []
        for plant in (Plant(m), ContactPlant(m)):
            for _ in range(30):
                plant.step(torque, 0.01)
            moved.append(np.array(plant.twist))
        ideal, real = moved
        axis = int(np.argmax(np.abs(force)))
        assert real[axis] == pytest.approx(ideal[axis], rel=0.12), (force, real, ideal)


def test_printed_equations_have_the_arm_of_the_robot():
    said = equation(robot("O"))
    assert "F_Y = (M1 + M4 - M2 - M3)/R" in said
    assert "M_W = L (M2 + M4 - M1 - M3)/R" in said
    assert "M_W = L (M1 + M3 - M2 - M4)/R" in equation(robot("base longer"))
    assert "I0 + 4 I1 L^2/R^2" in said
    assert "tan_d1" in equation(robot("odd"))


def test_limits_of_a_robot_are_those_of_its_geometry():
    slow = replace(Geometry(), torque_limit=1.2, speed_limit=5.0)
    limits = MotionLimits.of(slow)
    assert limits.wheel_speed < 5.0 and limits.wheel_torque == 1.2
    assert MotionLimits.of(Geometry()) == MotionLimits()
    for make in CALIBRATION.values():
        motion = make(slow)
        time = np.linspace(0, motion.duration, 500)
        assert np.abs(slow.wheel_speeds(motion.twist(time))).max() <= 1.06 * limits.wheel_speed


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"arrangement": "x"}, "neither 'X' nor 'O'"),
        ({"arrangement": "O", "l": 0.2355}, "cannot turn the robot"),
        ({"roller_angles": (45.0,) * 4}, "in degrees? multiply by pi/180"),
        ({"roller_angles": (0.7, 0.7)}, "not four finite numbers"),
        ({"roller_angles": (0.0, 0.7, 0.7, 0.7)}, "of wheel fl"),
        ({"roller_angles": (np.nan, 0.7, 0.7, 0.7)}, "not four finite numbers"),
        ({"torque_limit": 0.0}, "torque_limit"),
        ({"speed_limit": np.inf}, "speed_limit"),
    ],
)
def test_wheels_that_cannot_be(changes: dict[str, object], said: str):
    with pytest.raises(InputError, match=said.replace("(", r"\(").replace("?", r"\?")):
        replace(Geometry(), **changes)  # type: ignore[arg-type]
