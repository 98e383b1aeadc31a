"""Twins are told as sets, and what an effect leaves by itself is no second one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.candidates import (
    _base_sums,
    _of_drives,
    fit_base,
    rank,
    try_candidate,
)
from identification.diagnosis.structures import Candidate, LoggedData, Ranking
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
MECHANISM = mechanism_of(PAPER)
DRIVES = ["actuator_lag", "torque_delay", "drive_resonance", "speed_filter"]

Effect = tuple[str, tuple[tuple[str, float], ...]]


def ranked(*effects: Effect) -> Ranking:
    data = LoggedData(MECHANISM, [recording("calibration", effects)])
    base = fit_base(data, MECHANISM, PAPER.theta)
    return rank(data, base, DRIVES, np.random.default_rng(0))


def told(ranking: Ranking) -> list[str]:
    """The set that is told, the best first."""
    assert ranking.best is not None
    return [ranking.best.name, *ranking.tied]


def test_a_lag_and_a_delay_are_told_beside_the_resonance_that_imitates_both():
    lag = ("actuator_lag", (("time_constant", 0.06),))
    late = ("torque_delay", (("delay", 0.04),))
    found = told(ranked(lag, late))
    assert {"actuator_lag", "torque_delay"} <= set(found) and len(found) <= 3


def test_a_resonance_that_swings_is_told_alone():
    swing = ("drive_resonance", (("frequency", 9.0), ("damping", 0.25)))
    assert told(ranked(swing)) == ["drive_resonance"]


def test_a_resonance_of_which_little_is_seen_is_in_the_set():
    """A delay does nearly as well, a lag surely worse: neither a lag nor a filter is named."""
    stiff = ("drive_resonance", (("frequency", 28.0), ("damping", 0.45)))
    found = told(ranked(stiff))
    assert "drive_resonance" in found and not {"actuator_lag", "speed_filter"} & set(found)


@pytest.mark.parametrize(("share", "twins"), [(0.001, ("torque_delay",)), (0.01, ())])
def test_a_delay_that_is_worse_by_a_hair_is_told_beside_the_resonance(share: float, twins):
    """However sure the difference is: how a drive holds its commands makes as much."""
    log = recording("calibration", (("torque_delay", (("delay", 0.05),)),))
    base = fit_base(LoggedData(MECHANISM, [log]), MECHANISM, PAPER.theta)
    names = ("drive_resonance", "torque_delay")
    best, late = (try_candidate(base, None, name)[0] for name in names)
    square = best.square + share * (base.held_out.square - best.square)
    late = replace(late, lost_fall=late.lost_fall + square - late.square)
    assert _of_drives(best, [], [best, late], base) == (best, twins)


def test_without_a_pose_a_drive_that_lags_is_named_before_a_filter_of_the_speeds():
    first, *others = told(ranked(("actuator_lag", (("time_constant", 0.1),))))
    assert first == "actuator_lag" and "speed_filter" in others and len(others) <= 2


def once_more(effect: str, *of_logs: tuple[tuple[str, float], ...]) -> list[Candidate]:
    """What is tried of an effect that the structure holds: at other values in a log each.

    Without a pose, so that angles are integrated.
    """
    logs = [
        replace(recording("calibration", ((effect, values),), seed=k + 1), name=f"{k}", pose=None)
        for k, values in enumerate(of_logs)
    ]
    data = LoggedData(MECHANISM, logs)
    held = fit_base(
        data, MECHANISM.extended(effect), MECHANISM.extend_theta(PAPER.theta, effect, {})
    )
    return try_candidate(held, _base_sums(held), effect)


@pytest.mark.parametrize(("other", "counts"), [(0.030, True), (0.0205, False)])
def test_a_slope_that_differs_by_a_hair_is_not_a_second_slope(other: float, counts: bool):
    slopes = [(("tilt_x", size), ("tilt_y", 0.0)) for size in (0.02, other)]
    assert bool(once_more("floor_tilt", *slopes)) == counts


@pytest.mark.slow
def test_a_ripple_whose_angle_drifts_is_not_a_second_ripple():
    ripple = (("amplitude", 0.2), ("phase_fl", 0.3), ("cycles", 12.0))
    other = (("amplitude", 0.2), ("phase_fl", 0.8), ("cycles", 12.0))
    assert once_more("torque_ripple", ripple, other) == []


def test_noise_that_is_in_a_column_and_in_the_residual_is_no_evidence():
    """A resonance bends the logged torque, and with it the noise that the residual holds."""
    data = LoggedData(MECHANISM, [recording("calibration", rate=50.0, noise=3.0)])
    base = fit_base(data, MECHANISM, PAPER.theta)
    found = rank(data, base, ["drive_resonance", "wheel_creep"], np.random.default_rng(0))
    assert min(found.p_values.values()) > 0.05
