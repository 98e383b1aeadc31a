"""Channels that a log holds for some rows: late, or held by the drive; the fit bears both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.held_channels import as_they_mean
from identification.fitting.identify import identify
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import held_by_the_drive, held_by_the_logger, recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
COULOMB = (("wheel_coulomb_friction", (("torque", 0.25),)),)


def deviations(log) -> np.ndarray:
    found = identify([log], recursive=False).fit
    return np.abs((found.theta - PAPER.theta)[found.free] / found.std)


@pytest.mark.parametrize("rows", [2, 5, 10])
def test_efforts_that_a_logger_holds_leave_the_parameters_within_their_deviations(rows):
    assert deviations(held_by_the_logger(recording(), rows)).max() < 3.0


@pytest.mark.parametrize("rows", [2, 5, 10])
def test_efforts_that_a_drive_holds_leave_the_parameters_within_their_deviations(rows):
    assert deviations(held_by_the_drive(recording(noise=0.0), rows)).max() < 3.0


@pytest.mark.parametrize("effects", [(), COULOMB])
def test_what_a_hold_means_is_told_and_said_whatever_else_is_missing(effects):
    mechanism = Mecanum(PAPER.geometry)
    late = mechanism.samples(held_by_the_logger(recording(effects=effects), 5))
    read = as_they_mean(mechanism, [late])
    assert "values are late" in read.notes[0]
    # Straight from the first value to the second.
    assert np.allclose(read.samples[0].torque[5], late.torque[5])
    assert np.ptp(np.diff(read.samples[0].torque[5:11], axis=0), axis=0).max() < 1e-12
    true = mechanism.samples(held_by_the_drive(recording(effects=effects, noise=0.0), 5, effects))
    read = as_they_mean(mechanism, [true])
    assert "the drive holds them" in read.notes[0]
    assert read.samples[0].torque is true.torque


def test_speeds_are_never_held():
    mechanism, log = Mecanum(PAPER.geometry), recording()
    held = replace(log, velocity=np.repeat(log.velocity[::2], 2, axis=0)[: len(log)])
    read = as_they_mean(mechanism, [mechanism.samples(held)])
    assert "speeds stand for some rows" in read.notes[0]
    # After the last new value nothing is known.
    assert (np.diff(read.samples[0].twist[:-2], axis=0) != 0).any(axis=1).all()


def test_what_is_new_at_every_row_stays_as_it_is():
    mechanism = Mecanum(PAPER.geometry)
    samples = mechanism.samples(recording())
    read = as_they_mean(mechanism, [samples])
    assert read.samples[0] is samples and read.notes == ()
