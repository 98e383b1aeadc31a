"""Rows in compiled periods: against the plant, the other stepper, and the laws of what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.sparing import mostly_slow
from tests.youbot_env.structures import CASES, EVERYTHING, model
from youbot_env import Estimate, load_model
from youbot_env.motions.limits import MotionLimits
from youbot_env.motions.multisine import Multisine
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import Batch, keys_of
from youbot_env.tracking.options import tracking_setup
from youbot_env.tracking.stepper import Stepper
from youbot_env.tracking.task import REPORT, REWARD, TERMS

OPTIONS = {"delay": 1, "encoder_ticks": 4000, "action_history": 2, "episode_length": 0.5}


FAST = (CASES[0], "wheel_coulomb_friction", "drive_resonance", "speed_filter")


@pytest.mark.parametrize("case", mostly_slow(CASES, FAST))
def test_equals_the_stepper_that_moves_plants(case):
    """To rounding, over every effect and all together: states, observation, reward, report.

    With a delay of the model the two cut a period into steps of different lengths.
    """
    setup = tracking_setup(model(case), **OPTIONS)
    count, rounding = 3, 1e-6 if "torque_delay" in model(case).effects else 1e-10
    batch, other = Batch(setup, count), Stepper(setup, count)
    batch.begin(keys=keys_of(range(count)))
    for row in range(count):
        other.reset(row, np.random.default_rng(0), None, batch.reference(row))
    rng = np.random.default_rng(1)
    for _ in range(setup.steps):
        action = rng.uniform(-1, 1, (count, 4)).astype(np.float32)
        found = batch.step(action)
        other.step(action.astype(float))
        shown, report = other.shown, found.report
        states = np.array([batch.state(row) for row in range(count)])
        assert np.abs(states - other.plant.states).max() < rounding
        # A count more or less where rounding decides it.
        one_count = 2 * np.pi / 4000 / setup.period
        assert np.abs(found.observation - shown.observation).max() < 2 * one_count
        assert np.abs(report[:, : TERMS.stop] - shown.report[:, : TERMS.stop]).max() < 10 * rounding
        assert np.abs(found.reward - shown.report[:, REWARD]).max() < 10 * rounding
        applied = report[:, lanes.APPLIED_AT : lanes.APPLIED_AT + 4]
        assert np.abs(applied - shown.applied).max() < 10 * rounding
    assert np.abs(states[:, REPORT["twist"].start - 3 : 3]).max() > 5e-4


def test_references_keep_what_multisines_promise():
    setup = tracking_setup(encoder_ticks=None, episode_length=10.0)
    batch = Batch(setup, 64)
    batch.begin(keys=keys_of(range(64)))
    limits, peaks = MotionLimits(), []
    for row in range(64):
        motion = batch.reference(row)
        assert isinstance(motion, Multisine)
        frequency = [tone.frequency for tone in motion.tones]
        assert len(set(frequency)) == 21 and 0.5 <= min(frequency) and max(frequency) <= 3.0
        for axis in range(3):
            own = [tone.frequency for tone in motion.tones if tone.axis == axis]
            assert len(own) == 7 and min(own) < 1.1 and max(own) > 2.3
        time = np.linspace(1.5, motion.duration - 1.5, 4001)
        twist = motion.twist(time)
        assert limits.room(twist, batch.geometry) == 1.0
        peaks.append(np.abs(twist).max(axis=0))
    # All axes shrink together where the wheels would turn too fast.
    assert (np.array(peaks) <= np.array([0.22, 0.18, 0.6]) * 1.001).all()
    assert len({tuple(peak) for peak in peaks}) == 64


def test_a_reference_is_the_same_with_and_without_a_table_of_carriers():
    """Bands of many harmonics have no table: their carriers are computed for each episode."""
    batch = Batch(tracking_setup(band=(0.5, 4.0)), 3)
    batch.begin(keys=keys_of(range(3)))
    other = Batch(tracking_setup(band=(0.5, 4.0)), 3)
    models, (*others, fine, coarse) = other._drawn_with
    assert len(fine)
    other._drawn_with = models, (*others, fine[:0], coarse[:0])
    other._place()
    other.begin(keys=keys_of(range(3)))
    assert [batch.reference(row) for row in range(3)] == [other.reference(row) for row in range(3)]
    assert np.array_equal(batch.observation, other.observation)


def test_normal_draws_have_the_covariance():
    paper = load_model("paper")
    names = ("m0", "mu1", "mu2")
    std = np.array([0.5, 0.004, 0.0002])
    correlation = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, -0.3], [0.0, -0.3, 1.0]])
    covariance = correlation * np.outer(std, std)
    fitted = replace(
        paper,
        parameters={k: Estimate(v.value, v.unit, v.std) for k, v in paper.parameters.items()},
        covariance=covariance,
        covariance_names=names,
    )
    batch = Batch(tracking_setup(fitted, randomise="covariance"), 1500)
    batch.begin(keys=keys_of(range(1500)))
    drawn = np.array([[batch.parameters(row)[name] for name in names] for row in range(1500)])
    assert np.corrcoef(drawn.T) == pytest.approx(correlation, abs=0.1)
    assert drawn.std(axis=0) == pytest.approx(std, rel=0.1)
    assert np.abs(drawn.mean(axis=0) - [35.3, 0.11, 0.00578]) == pytest.approx(0 * std, abs=0.1)


def test_what_is_not_physical_is_drawn_again():
    """m0 must exceed the wheels' mass of 5.6 kg; a centre of mass far out needs a large I0."""
    ranges = {"m0": (0.0, 8.0), "I0": (0.1, 4.0), "aX": (-1.0, 1.0)}
    batch = Batch(tracking_setup(randomise=ranges), 300)
    batch.begin(keys=keys_of(range(300)))
    drawn = [batch.parameters(row) for row in range(300)]
    assert min(values["m0"] for values in drawn) > 5.6
    for row in range(300):
        assert np.linalg.eigvalsh(batch.model(row).mass_matrix()).min() > 0.0
    assert len({values["m0"] for values in drawn}) == 300


def test_everything_at_once_is_a_case():
    assert EVERYTHING in CASES
