"""The closed loop: what a controller is shown, when a loop has diverged, and that it is one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.interface import Controller, Loop
from controllers.kinematic import Gains, KinematicControl
from controllers.loop import (
    ControllerRows,
    Trace,
    at_limit,
    closed_loop,
    instants,
    sensors_of,
    started,
)
from controllers.recording import SPEED_NOISE, run
from tests.controllers.driving import LATE, ONE_SAMPLE, PAPER, Condition, Silent, track
from youbot_env.errors import InputError
from youbot_env.motions.multisine import multisine
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE
from youbot_env.simulation.plant import Plant
from youbot_env.tracking.randomisation import episode_streams
from youbot_env.tracking.task import TrackingTask

MOTION = multisine(np.random.default_rng(0), band=(1.0, 3.0), duration=5.0)
OTHER = multisine(np.random.default_rng(1), band=(1.0, 3.0), duration=5.0)
BOUND = TrackingTask().largest_twist(PAPER.geometry)
LATE_LOOP = Loop(0.01, delay=0.02, speed_noise=0.0)


def loop(controller: Controller, **options: Any) -> Trace:
    rng = np.random.default_rng(0)
    return closed_loop(
        Plant(), controller, MOTION, LATE_LOOP, rng, count=100, bound=BOUND, **options
    )


def test_a_controller_sees_what_the_interface_says():
    silent = Silent()
    found = loop(silent)
    observation, reference = silent.seen[40]
    assert observation.time == pytest.approx(0.4) and observation.pose is None
    assert observation.wheel_torque is not None and reference.preview is not None
    coming = MOTION.evaluate(0.01 * np.arange(41, 44))
    np.testing.assert_array_equal(reference.twist, MOTION.twist(0.4))
    np.testing.assert_array_equal(reference.preview, coming[0])
    np.testing.assert_array_equal(reference.preview_acceleration, coming[1])
    assert found.diverged is None and len(found.time) == 100


def test_it_is_shown_its_own_commands_within_the_limit():
    silent = Silent(torque=9.0)
    found = loop(silent)
    told = [o.wheel_torque for o, _ in silent.seen if o.wheel_torque is not None]
    np.testing.assert_array_equal(told[0], np.zeros(4))
    np.testing.assert_allclose(told[1:], np.full((99, 4), MAX_WHEEL_TORQUE))
    assert found.saturated.all()


def test_the_pose_only_where_it_is_measured():
    silent = Silent(torque=0.5)
    found = loop(silent, show_pose=True)
    poses = [o.pose for o, _ in silent.seen if o.pose is not None]
    np.testing.assert_array_equal(poses, found.pose)
    assert found.pose[-1, 0] > 0.05


def test_no_number_is_no_control():
    found = loop(Silent(nan_from=30))
    assert found.diverged == pytest.approx(0.3) and len(found.time) == 30


def test_what_runs_away_has_diverged():
    strong = Loop(torque_limit=300.0, speed_noise=0.0)
    rng = np.random.default_rng(0)
    found = closed_loop(Plant(), Silent(torque=200.0), MOTION, strong, rng, count=400, bound=BOUND)
    assert found.diverged is not None and found.diverged < 4.0
    assert len(found.time) == round(found.diverged / 0.01)


@pytest.mark.parametrize("condition", [ONE_SAMPLE, LATE, Condition(50.0, delay=0)])
@pytest.mark.parametrize("name", ["kinematic", "computed_torque"])
def test_it_is_the_environments_loop(condition: Condition, name: str):
    """Another code for the same loop: without noise they differ by rounding.

    The environment's actions have single precision, its noise a generator of its own.
    """
    condition = replace(condition, noise=0.0)

    def make() -> Controller:
        if name == "computed_torque":
            return ComputedTorque(condition.model, condition.loop)
        gains = Gains(0.5, 2.0, lead=condition.loop.sample_time)
        return KinematicControl(PAPER.geometry, gains, 1.0, condition.loop.sample_time)

    rng = episode_streams(np.random.default_rng(5)).noise
    plant, count = Plant(condition.model), 151
    found = closed_loop(plant, make(), MOTION, condition.loop, rng, count=count)
    seconds = (count - 1) / condition.rate
    driven = track(make(), condition, seconds, seed=5, motion=MOTION)
    np.testing.assert_allclose(found.twist[1:], driven.twist, rtol=0, atol=1e-5)
    # There the command is what the controller returned, before it became an action.
    np.testing.assert_allclose(found.command[:-1], driven.command, rtol=0, atol=2e-3)
    assert found.twist.any()


def test_a_row_moves_as_it_would_alone():
    loop_, count = Loop(0.01, delay=0.013, measurement_delay=0.01), 100

    def make() -> list[Controller]:
        weak, strong = Gains(0.2, 1.0), Gains(0.6, 4.0)
        return [KinematicControl(PAPER.geometry, g, 1.0, 0.01) for g in (weak, strong, weak)]

    motions, sensors = (MOTION, OTHER, OTHER), sensors_of(loop_)
    noise = [sensors.noise(np.random.default_rng(row), count) for row in range(3)]
    sampled = started(Plant(platforms=3), loop_, noise)
    law = ControllerRows(make(), motions, 0.01, count)
    driven = instants(sampled, law, count, loop_.torque_limit)
    together = [(now.states, command) for now, command in driven]
    for row in range(3):
        rng = np.random.default_rng(row)
        alone = closed_loop(Plant(), make()[row], motions[row], loop_, rng, count=count)
        np.testing.assert_array_equal([states[row] for states, _ in together], alone.states)
        np.testing.assert_array_equal([command[row] for _, command in together], alone.command)


def test_a_loop_can_be_left_at_any_instant():
    sampled = started(Plant(), Loop(), [np.zeros((50, 4))])
    law = ControllerRows([Silent(torque=1.0)], [MOTION], 0.01, 50)
    for now, _ in instants(sampled, law, 50):
        if now.index == 20:
            break
    assert sampled.clock.tolist() == [20], "the command of the last instant was not applied"
    np.testing.assert_array_equal(now.states, sampled.plant.states)


def test_recording_is_the_same_loop_without_a_limit():
    rng, rate = np.random.default_rng(3), 50.0
    made = run(PAPER, MOTION, KinematicControl(), rate=rate, rng=np.random.default_rng(3))
    endless = Loop(made.trace.period, torque_limit=np.inf, speed_noise=SPEED_NOISE)
    count = len(made.trace.states)
    found = closed_loop(Plant(), KinematicControl(), MOTION, endless, rng, count=count)
    # A recording integrates in coarser steps: 500 Hz are fine enough for themselves.
    np.testing.assert_allclose(found.states, made.trace.states, atol=1e-6)


@pytest.mark.parametrize(("age", "window"), [(0.0, 0), (0.005, 1), (0.01, 2), (0.035, 7)])
def test_encoders_are_as_old_as_the_loop_says(age: float, window: int):
    found = sensors_of(Loop(0.01, measurement_delay=age, speed_noise=0.02))
    assert found.wheel_speed_noise == 0.02
    assert found.window == max(window, 1) and (found.encoder_ticks is None) == (window == 0)


def test_an_age_that_no_encoder_has_is_one_clear_line():
    with pytest.raises(InputError, match="measurement_delay: 0.0034 s is no multiple of half"):
        closed_loop(
            Plant(), Silent(), MOTION, Loop(measurement_delay=0.0034), np.random.default_rng(0)
        )


def test_a_command_is_at_its_limit_but_for_rounding():
    limit = MAX_WHEEL_TORQUE
    rows = np.array([[limit, -limit, 0.99 * limit, 0.0], [limit * (1 - 1e-15)] * 4])
    assert at_limit(rows, limit).tolist() == [[True, True, False, False], [True] * 4]
    assert not at_limit(rows, np.inf).any()
