"""Platforms that are not the youBot: lighter, heavier, with dry friction of another steepness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.candidates import fit_base, rank
from identification.diagnosis.structures import LoggedData
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import WHEELS

PAPER = load_model("paper")
RNG = np.random.default_rng

PER_TORQUE = {"N m", "N", "kg", "kg m^2", "N m s", "N m s^2", "N/m", "N m/rad"}
"""Units that hold a force once: all of them grow with the platform's mass."""


def scaled(log: Log, factor: float) -> tuple[Mecanum, Log]:
    """A platform whose masses and frictions are ``factor`` times the paper's, and its log.

    It moves by ``factor`` times the torques as the paper's does by its own.
    """
    geometry = replace(PAPER.geometry, m1=factor * PAPER.geometry.m1)
    return Mecanum(geometry), replace(log, effort=factor * log.effort)


@pytest.mark.parametrize("factor", [0.1, 20.0])
def test_a_limit_of_the_torque_is_found_on_lighter_and_heavier_platforms(factor: float):
    limit = ("torque_saturation", (("limit", 0.8),))
    mechanism, log = scaled(recording(effects=(limit,), rate=50.0), factor)
    data, start = LoggedData(mechanism, [log]), PAPER.theta * factor
    rivals = ["wheel_coulomb_friction", "quadratic_friction", limit[0]]
    ranking = rank(data, fit_base(data, mechanism, start), rivals, RNG(0))
    assert ranking.best is not None and ranking.best.name == limit[0]
    place = ranking.best.mechanism.parameter_names.index("torque_saturation.limit")
    assert ranking.best.theta[place] == pytest.approx(0.8 * factor, rel=0.05)


@pytest.mark.parametrize("name", CATALOGUE.names())
def test_bounds_leave_room_for_a_platform_of_two_tonnes(name: str):
    for parameter in CATALOGUE[name].public_parameters:
        if parameter.unit in PER_TORQUE and not parameter.is_shape:
            assert parameter.upper >= 60 * parameter.size, parameter.name


@pytest.mark.parametrize("smoothing", [0.004, 0.15])
def test_steeper_or_wider_dry_friction_is_no_breakaway(smoothing: float):
    """A peak at standstill makes up for a step of another width than the usual one."""
    dry = ("wheel_coulomb_friction", (("torque", 0.25), ("smoothing", smoothing)))
    log = recording(effects=(dry,), rate=50.0, noise=0.3)
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [log])
    rivals = [dry[0], "wheel_stribeck_friction", "uneven_coulomb_friction"]
    ranking = rank(data, fit_base(data, mechanism, PAPER.theta), rivals, RNG(0))
    assert ranking.best is not None and ranking.best.name == dry[0]
    found = dict(zip(ranking.best.mechanism.parameter_names, ranking.best.theta, strict=True))
    assert found["wheel_coulomb_friction.torque"] == pytest.approx(0.25, rel=0.05)


def test_true_breakaway_is_still_named():
    peak = (("torque", 0.1), ("breakaway", 0.2), ("stribeck_speed", 1.2))
    log = recording(effects=(("wheel_stribeck_friction", peak),), rate=50.0)
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [log])
    rivals = ["wheel_coulomb_friction", "wheel_stribeck_friction"]
    ranking = rank(data, fit_base(data, mechanism, PAPER.theta), rivals, RNG(0))
    assert ranking.best is not None and ranking.best.name == "wheel_stribeck_friction"


def test_rows_in_which_all_wheels_stand_are_no_rows_of_a_fit():
    """Dry friction holds a platform at rest by any torque up to its own."""
    log = recording("I", rate=50.0)
    mechanism = mechanism_of(PAPER)
    assert mechanism.samples(log).moves is None  # two wheels stand all the time, two turn
    noise = 0.01 * RNG(1).standard_normal((200, 4))
    rest = Log(
        "rest",
        WHEELS,
        np.arange(len(log) + 200, dtype=np.float64) * float(log.dt),
        np.concatenate([log.velocity, noise]),
        np.concatenate([log.effort, np.full((200, 4), 0.3)]),
    )
    samples = mechanism.samples(rest)
    assert samples.moves is not None
    assert samples.moves[: len(log) - 50].all() and not samples.moves[-150:].any()
