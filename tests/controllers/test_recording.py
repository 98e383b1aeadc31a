"""The driving loop: timing, noise, energy, and what a fit makes of its logs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from controllers.interface import Observation, Reference
from controllers.kinematic import KinematicControl
from controllers.recording import Run, control_step, drive, run, ticks_per_row
from identification.fitting.least_squares import fit
from identification.mechanisms.mecanum import Mecanum
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import sequence
from youbot_env.motions.calibration import calibration, motion_i, motion_iii
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import SIGN_X
from youbot_env.simulation.free_run import simulate
from youbot_env.simulation.plant import Plant
from youbot_scripts.recording.named_motions import catalogue_size

PAPER = load_model("paper")
SHORT = motion_iii(duration=4.0, frequency=6.0)


class Spy:
    """Gives torques from a list of rows, and remembers what it was told."""

    def __init__(self, torques: np.ndarray) -> None:
        self.torques = torques

    def reset(self) -> None:
        self.seen: list[tuple[Observation, Reference]] = []

    def __call__(self, observation: Observation, reference: Reference) -> np.ndarray:
        copied = observation._replace(
            wheel_speed=observation.wheel_speed.copy(),
            wheel_torque=np.array(observation.wheel_torque),
        )
        self.seen.append((copied, reference))
        return self.torques[(len(self.seen) - 1) % len(self.torques)]


def control(rate: float) -> KinematicControl:
    return KinematicControl(PAPER.geometry, sample_time=control_step(rate))


@cache
def calibrated(rate: float) -> Run:
    motion = calibration(PAPER.geometry)
    return run(PAPER, motion, control(rate), rate=rate, rng=np.random.default_rng(3))


@pytest.mark.parametrize(
    ("rate", "ticks"), [(20, 25), (50, 10), (100, 5), (250, 2), (300, 2), (400, 1), (1000, 1)]
)
def test_the_loop_runs_at_a_multiple_of_the_log_rate(rate: float, ticks: int):
    assert ticks_per_row(rate) == ticks
    assert control_step(rate) == pytest.approx(1 / (rate * ticks), rel=1e-15)
    assert 350 <= 1 / control_step(rate) <= 1000


@pytest.mark.parametrize("rate", [0, 19.9, 1001, -100, np.nan, np.inf])
def test_other_rates_are_refused(rate: float):
    with pytest.raises(InputError, match="rate"):
        drive(PAPER, SHORT, control(100), rate=rate)


@pytest.mark.parametrize("rate", [30, 50, 100, 250, 1000])
def test_rows_lie_at_equal_distances_to_the_end_of_the_motion(rate: float):
    motion = motion_i(duration=2.53, frequency=15.0)
    log = drive(PAPER, motion, control(rate), rate=rate)
    np.testing.assert_allclose(log.time, np.arange(1, len(log) + 1) / rate, rtol=1e-14)
    assert motion.duration <= log.time[-1] + 1e-9 < motion.duration + 1 / rate


def test_a_row_holds_its_instant_and_the_two_commands_that_meet_there():
    torques = np.random.default_rng(0).uniform(-1, 1, (37, 4))
    spy = Spy(torques)
    found = run(PAPER, SHORT, spy, rate=100, speed_noise=0.01)
    log = found.log(0.0, np.random.default_rng(0))
    assert len(spy.seen) == 2001 and found.ticks == 5
    for row in (0, 1, 17, 399):
        tick = 5 * (row + 1)
        given = (torques[(tick - 1) % 37] + torques[tick % 37]) / 2
        np.testing.assert_array_equal(log.effort[row], given)
        observation, reference = spy.seen[tick]
        assert observation.time == pytest.approx(log.time[row])
        np.testing.assert_array_equal(log.velocity[row], observation.wheel_speed)
        np.testing.assert_array_equal(reference.twist, SHORT.twist(observation.time))
        np.testing.assert_array_equal(observation.wheel_torque, torques[(tick - 1) % 37])
        np.testing.assert_allclose(
            observation.body_twist, PAPER.geometry.body_twist(observation.wheel_speed), atol=1e-14
        )


def test_each_command_is_held_until_the_next():
    torques = np.random.default_rng(1).uniform(-1, 1, (2001, 4))
    found = run(PAPER, SHORT, Spy(torques), rate=100, speed_noise=0.0)
    # The same in fine steps: every held command is a pair of equal samples, and a jump.
    time = np.repeat(found.trace.period * np.arange(51), 2)[1:-1]
    time[1::2] += 1e-12
    held = np.repeat(torques[:50], 2, axis=0)
    fine = simulate(PAPER, np.sort(time), held[: len(time)], found.trace.states[0])
    np.testing.assert_allclose(found.trace.states[50, :10], fine[-1, :10], atol=1e-6)


@pytest.mark.parametrize("delay", [0.02, 0.0213])
def test_a_command_acts_a_delay_later(delay: float):
    plant = PAPER.with_effect("torque_delay", delay=delay)
    torques = np.random.default_rng(1).uniform(-1, 1, (2001, 4))
    found = run(plant, SHORT, Spy(torques), rate=100, speed_noise=0.0)
    reference = Plant(plant)
    for k in range(50):
        np.testing.assert_allclose(found.trace.states[k], reference.state, atol=1e-7)
        reference.step(torques[k], found.trace.period)
    assert found.trace.states[10, :3].any() == (delay < 10 * found.trace.period)


def test_a_preview_shows_the_coming_references():
    spy = Spy(np.zeros((1, 4)))
    found = run(PAPER, SHORT, spy, rate=50, preview=3)
    for tick in (0, 100, 2000):
        preview = spy.seen[tick][1].preview
        assert preview is not None and preview.shape == (3, 3)
        expected = SHORT.twist(found.trace.period * np.arange(tick + 1, tick + 4))
        np.testing.assert_allclose(preview, expected, atol=1e-14)
    np.testing.assert_allclose(preview, 0.0, atol=1e-14)


def test_noise_is_white_and_of_the_stated_size():
    found = calibrated(100.0)
    rng = np.random.default_rng(4)
    log, clean = found.log(0.05, rng), found.log(0.0, rng)
    at = np.arange(5, len(found.trace.states), 5)
    speed = log.velocity - PAPER.geometry.wheel_speeds(found.trace.states[at, :3])
    effort = log.effort - clean.effort
    for noise, size in ((speed, 0.01), (effort, 0.05)):
        np.testing.assert_allclose(noise.std(axis=0), size, rtol=0.03)
        assert np.abs(noise.mean(axis=0)).max() < 4 * size / np.sqrt(len(noise))
        correlation = np.corrcoef(np.hstack([noise[1:], noise[:-1]]).T) - np.eye(8)
        assert np.abs(correlation).max() < 5 / np.sqrt(len(noise))


def test_noise_that_lasts_has_the_stated_size_and_time():
    found = calibrated(100.0)
    white, lasting = (found.log(0.05, np.random.default_rng(4), time) for time in (0.0, 0.1))
    clean = found.log(0.0, np.random.default_rng(4))
    noise = lasting.effort - clean.effort
    np.testing.assert_allclose(noise.std(axis=0), 0.05, rtol=0.15)
    for row in (1, 10):  # 1 / e after 0.1 s, ten rows
        alike = (noise[row:] * noise[:-row]).mean(axis=0) / noise.var(axis=0)
        np.testing.assert_allclose(alike, np.exp(-row / 10), atol=0.15)
    assert (lasting.effort[0] == white.effort[0]).all()  # as large from the first row on
    assert (lasting.velocity == white.velocity).all()


def test_the_work_of_the_torques_goes_into_friction():
    found = calibrated(100.0)
    geometry, value = PAPER.geometry, PAPER.values
    twist = found.trace.states[:, :3]
    wheels = geometry.wheel_speeds(twist)
    rollers = (twist[:, 1:2] + twist[:, 2:] * geometry.h * np.array(SIGN_X)) / geometry.r * 2**0.5
    lost = value["mu1"] * (wheels**2).sum(axis=1) + value["mu2"] * (rollers**2).sum(axis=1)
    middle = 0.5 * (wheels[1:] + wheels[:-1])
    work = (found.trace.command[:-1] * middle).sum() * found.trace.period
    kinetic = 0.5 * twist[-1] @ PAPER.mass_matrix() @ twist[-1]
    assert work == pytest.approx(np.trapezoid(lost, dx=found.trace.period) + kinetic, rel=1e-5)
    assert work > 100.0, "joules in 140 s"
    from_log = found.log(0.03, np.random.default_rng(0))
    assert (from_log.effort * from_log.velocity).sum() * from_log.dt == pytest.approx(
        work, rel=0.01
    )


@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0, 1000.0])
def test_the_regression_gives_the_plant_back(rate: float):
    log = calibrated(rate).log(0.03, np.random.default_rng(5))
    mechanism = Mecanum(PAPER.geometry, PAPER.structure)
    start = PAPER.theta * 1.3
    found = fit(mechanism, [mechanism.samples(log)], start)
    assert (np.abs(found.theta - PAPER.theta) < 4 * found.std).all()
    assert (found.std < 0.1 * np.abs(PAPER.theta)).all()


EARLY = {"payload_change": {"time": 4.0}}
"""Effects that would begin after the motion of the test."""


@pytest.mark.parametrize("name", CATALOGUE.names())
def test_every_effect_of_the_catalogue_can_be_driven(name: str):
    plant = PAPER.with_effect(name, **catalogue_size(CATALOGUE[name]) | EARLY.get(name, {}))
    motion = sequence(
        [motion_i(duration=5.0, frequency=5.0), multisine(np.random.default_rng(1), duration=5.0)]
    )
    with_effect = run(plant, motion, control(100), speed_noise=0.0)
    without = run(PAPER, motion, control(100), speed_noise=0.0)
    assert not np.allclose(with_effect.trace.states[:, :3], without.trace.states[:, :3], atol=1e-4)
    assert np.abs(with_effect.trace.states[:, :3]).max() < 3.0
    log = with_effect.log(0.0, np.random.default_rng(0))
    at = np.arange(5, len(with_effect.trace.command), 5)
    meet = (with_effect.trace.command[at - 1] + with_effect.trace.command[at]) / 2
    np.testing.assert_array_equal(log.effort, meet)


def test_a_run_that_diverges_is_one_clear_line():
    wild = Spy(np.array([[1e200] * 4]))
    with pytest.raises(InputError, match=r"motion 'III': plant paper .* diverge at 0\.\d+ s"):
        run(PAPER, SHORT, wild)


def test_a_run_without_end_is_refused_before_it_starts():
    with pytest.raises(InputError, match="1e\\+09 s is longer than a day"):
        run(PAPER, motion_i(duration=1e9), control(100))


def test_progress_adds_up_to_the_duration():
    seconds: list[float] = []
    run(PAPER, SHORT, control(100), progress=seconds.append)
    assert sum(seconds) == pytest.approx(SHORT.duration, abs=0.01)
    assert len(seconds) >= 4
