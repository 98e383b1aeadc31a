"""Plants side by side move as each would alone, and as exactly as promised."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest

from tests.youbot_env.structures import exact_step
from youbot_env import InputError, Plant, load_model
from youbot_env.physics.geometry import Geometry

LAG = {"actuator_lag": {"time_constant": 0.03}}
MODELS = {
    "paper": {},
    "fast lag": {"actuator_lag": {"time_constant": 0.005}},
    "tilt": {"floor_tilt": {"tilt_x": 0.02}},
    "dry friction": {"wheel_coulomb_friction": {"torque": 0.25}},
    "ripple": {"torque_ripple": {"amplitude": 0.2}},
    "tether": {"tether": {"stiffness": 5.0, "anchor_x": 1.0}},
    "load": {"load_dependent_friction": {"share": 0.15}},
}


def with_effects(effects):
    model = load_model("paper")
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    return model


@pytest.mark.parametrize("case", MODELS)
def test_error_stays_as_small_as_promised(case):
    model, rng = with_effects(MODELS[case]), np.random.default_rng(0)
    plant = Plant(model)
    state, worst = plant.state, 0.0
    for torque in rng.uniform(-2, 2, (25, 4)):
        state = exact_step(model, state, torque, 0.01)
        worst = max(worst, np.abs(plant.step(torque, 0.01) - state)[:3].max())
    assert worst < (2e-5 if case in ("dry friction", "load") else 1e-6)


def test_error_falls_with_the_fourth_power_of_the_step():
    torque = np.random.default_rng(0).uniform(-2, 2, (50, 4))
    ends = {}
    for count in (1, 2, 4, 64):
        plant = Plant("paper", substeps=count)
        ends[count] = np.array([plant.step(row, 0.02) for row in torque])[:, :3]
    errors = [np.abs(ends[count] - ends[64]).max() for count in (1, 2, 4)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.3)


def test_rows_equal_single_plants_to_the_bit():
    model, rng = with_effects(LAG), np.random.default_rng(0)
    heavy = model.with_values({"m0": 50.0})
    side_by_side = Plant(model, platforms=3)
    side_by_side.reset(heavy, row=1, twist=(0.1, 0.2, 0.3))
    alone = [Plant(model), Plant(heavy), Plant(model)]
    alone[1].reset(twist=(0.1, 0.2, 0.3))
    for torque in rng.uniform(-2, 2, (50, 3, 4)):
        side_by_side.step(torque, 0.01)
        for plant, row in zip(alone, torque, strict=True):
            plant.step(row, 0.01)
    assert np.array_equal(side_by_side.state, [plant.state for plant in alone])
    assert side_by_side.twist.shape == (3, 3) and side_by_side.wheel_angle.shape == (3, 4)
    assert side_by_side.wheel_speed[2] == pytest.approx(alone[2].wheel_speed)


def test_states_handed_out_are_copies():
    plant = Plant()
    state, twist = plant.state, plant.twist
    plant.step((1.0, 1.0, 1.0, 1.0), 0.1)
    assert not state.any() and not twist.any()
    assert plant.state[0] > 0 and plant.pose[0] > 0


@pytest.mark.parametrize("copier", [copy.deepcopy, lambda plant: pickle.loads(pickle.dumps(plant))])
def test_a_copy_moves_as_the_original(copier):
    plant = Plant(with_effects(LAG))
    plant.step((1.0, 0.5, 0.2, 0.1), 0.1)
    twin = copier(plant)
    assert np.array_equal(plant.step((1.0, 0.0, 0.0, 0.0), 0.1), twin.step((1.0, 0, 0, 0), 0.1))


def test_torque_that_acts_follows_drive_and_channel():
    lagging = Plant(with_effects(LAG))
    command = np.ones((1, 4))
    lagging.step(command[0], 0.03)
    assert lagging.acting_torque(command) == pytest.approx(
        np.full((1, 4), 1 - np.exp(-1)), abs=1e-5
    )
    wrong = Plant(with_effects({"torque_gain_error": {"gain_fl": 0.2}}))
    assert wrong.acting_torque(command)[0].tolist() == [1.2, 1.0, 1.0, 1.0]


LATE = {"torque_delay": {"delay": 0.0237}}


@pytest.mark.parametrize("effects", [LATE, {**LATE, **LAG}, {"torque_delay": {"delay": 0.02}}])
@pytest.mark.parametrize("duration", [0.01, 0.04])
def test_commands_act_a_delay_later(effects, duration):
    """Against a platform without delay that is given each torque when it is to act."""
    late = with_effects(effects)
    prompt = with_effects({name: v for name, v in effects.items() if name != "torque_delay"})
    commands = np.random.default_rng(0).uniform(-2, 2, (20, 4))
    plant, fine = Plant(late), Plant(prompt, substeps=20)
    plant.reset(twist=(0.2, 0.1, -0.3))
    fine.reset(twist=(0.2, 0.1, -0.3))
    ends = duration * np.arange(1, 21)
    moments = np.unique(np.round([0.0, *ends, *(ends + late.delay), late.delay], 9))
    now = 0.0
    for k, command in enumerate(commands):
        plant.step(command, duration)
        for moment in moments[(moments > now + 1e-8) & (moments < ends[k] + 1e-8)]:
            which = int(np.floor((0.5 * (now + moment) - late.delay) / duration))
            acting = commands[which] if which >= 0 else np.zeros(4)
            fine.step(acting, moment - now)
            now = moment
        shared = fine.state.size - (4 if "actuator_lag" in effects else 0)
        assert plant.state[:shared] == pytest.approx(fine.state[:shared], abs=1e-6)
        if "actuator_lag" not in effects:
            assert plant.acting_torque(command[None])[0].tolist() == acting.tolist()


def test_rows_with_delays_of_their_own_do_not_touch_each_other():
    model = with_effects(LATE)
    other = model.with_values({"torque_delay.delay": 0.005})
    together, alone = Plant(model, platforms=2), [Plant(model), Plant(other)]
    together.reset(other, row=1)
    rng = np.random.default_rng(1)
    for k in range(30):
        if k == 15:  # a platform that begins anew forgets what was on its way to it alone
            together.reset(row=1)
            alone[1].reset()
        torque = rng.uniform(-2, 2, (2, 4))
        together.step(torque, 0.01)
        for plant, row in zip(alone, torque, strict=True):
            plant.step(row, 0.01)
        assert np.array_equal(together.state, [plant.state for plant in alone])


def test_a_copy_has_the_same_commands_on_their_way():
    plant = Plant(with_effects(LATE))
    plant.step((1.0, 0.5, 0.2, 0.1), 0.01)
    twin = pickle.loads(pickle.dumps(plant))
    for _ in range(5):
        assert np.array_equal(plant.step([0.0] * 4, 0.01), twin.step([0.0] * 4, 0.01))
    assert plant.twist.any()


def test_nothing_acts_before_it_is_commanded():
    with pytest.raises(InputError, match="before it is commanded"):
        Plant(with_effects({"torque_delay": {"delay": -0.01}}))


def test_what_cannot_be_is_one_clear_line():
    plant = Plant()
    for wrong in ([1.0, 2.0], [[1.0] * 4] * 2, 0.5):
        with pytest.raises(InputError, match="four torques"):
            plant.step(wrong, 0.01)
    with pytest.raises(InputError, match="other effects"):
        plant.reset(with_effects(LAG))
    with pytest.raises(InputError, match="geometry"):
        paper = load_model("paper")
        plant.reset(type(paper)(Geometry(l=0.2), paper.parameters))
    with pytest.raises(InputError, match="at least 1"):
        Plant(platforms=0)
    with pytest.raises(InputError, match="no such file"):
        Plant("nowhere.json")


@pytest.mark.parametrize("torque", ([math.nan] * 4, [1.0, math.inf, 0.0, 0.0], ["a"] * 4, None))
def test_torques_that_are_no_numbers_are_refused_and_nothing_moves(torque):
    plant = Plant("paper")
    plant.reset(twist=(0.1, 0.0, 0.0))
    before = plant.state
    with pytest.raises(InputError, match="^plant: "):
        plant.step(torque, 0.01)
    np.testing.assert_array_equal(plant.state, before)


@pytest.mark.parametrize("duration", (math.nan, math.inf, -1.0, "a", None))
def test_durations_that_are_none_are_refused(duration):
    with pytest.raises(InputError, match="^plant: duration"):
        Plant("paper").step(np.zeros(4), duration)
