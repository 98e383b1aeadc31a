"""What closed loops are judged by: laws on signals made by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controllers.loop import Trace
from youbot_scripts.evaluation.metrics import integrated_pose, interval, judge, mean_nrmse

PERIOD, COUNT = 0.01, 2001
TIME = np.arange(COUNT, dtype=np.float64) * PERIOD
SINES = np.column_stack([0.2 * np.sin(TIME), 0.1 * np.cos(2 * TIME), 0.5 * np.sin(3 * TIME)])


def trace(twist: np.ndarray, reference: np.ndarray = SINES, **changes: Any) -> Trace:
    """A platform that moved like ``twist`` and stayed on its pose's integral."""
    pose = integrated_pose(twist, PERIOD, np.zeros(3))
    torque = np.zeros((COUNT, 4))
    made = Trace(PERIOD, reference, np.hstack([twist, pose]), torque, torque, torque_limit=2.0)
    return replace(made, **changes)


def test_perfect_tracking_leaves_nothing():
    found = judge(trace(SINES))
    for name in ("rmse", "nrmse", "worst"):
        assert found[name] == [0.0, 0.0, 0.0]
    assert found["position_drift"] == found["heading_drift"] == mean_nrmse(found) == 0.0


@pytest.mark.parametrize("share", [-1.0, 0.03, 0.5])
def test_an_error_in_proportion_is_its_share(share: float):
    """Standing still is 100 %; the unit of the reference does not matter, the RMSE keeps it."""
    found = judge(trace((1 + share) * SINES))
    np.testing.assert_allclose(found["nrmse"], abs(share))
    assert mean_nrmse(found) == pytest.approx(abs(share))
    size = np.sqrt(np.mean(SINES**2, axis=0))
    np.testing.assert_allclose(found["rmse"], abs(share) * size)


def test_the_worst_twentieth_of_a_sine():
    """|sin| stays below sin(0.95 pi/2) for 95 % of the time."""
    cycles = np.column_stack([np.sin(2 * np.pi * (TIME - 0.005) / 5.0)] * 3)
    found = judge(trace(SINES + 1e-3 * cycles))
    expected = 1e-3 * math.sin(0.95 * math.pi / 2) / np.sqrt(np.mean(SINES**2, axis=0))
    np.testing.assert_allclose(found["worst"], expected, rtol=1e-3)


def test_the_start_is_left_out():
    late = SINES * (1 + (TIME < 5.0)[:, None])
    assert max(judge(trace(late), start=5.0)["rmse"]) == 0.0
    assert min(judge(trace(late), start=4.9)["rmse"]) > 0.0


def test_an_axis_at_rest_has_no_ratio():
    flat = SINES * [1.0, 0.0, 1.0]
    found = judge(trace(flat + 0.01, flat))
    assert found["nrmse"][1] is None and found["worst"][1] is None
    assert found["rmse"][1] == pytest.approx(0.01)
    assert mean_nrmse(found) == pytest.approx((found["nrmse"][0] + found["nrmse"][2]) / 2)


def test_a_constant_twist_is_an_arc():
    speed, turn, length = 0.3, 0.7, TIME[-1]
    pose = integrated_pose(np.tile([speed, 0.0, turn], (COUNT, 1)), PERIOD, np.array([1, 2, 0.5]))
    radius, end = speed / turn, 0.5 + turn * length
    expected = [
        1 + radius * (math.sin(end) - math.sin(0.5)),
        2 - radius * (math.cos(end) - math.cos(0.5)),
        end,
    ]
    np.testing.assert_allclose(pose[-1], expected, atol=1e-5)


def test_drift_is_where_it_ends_and_not_how():
    """One that stands still is left behind by the whole way; heading is judged on its own."""
    way = np.tile([0.1, 0.0, 0.0], (COUNT, 1))
    assert judge(trace(0 * way, way))["position_drift"] == pytest.approx(0.1 * TIME[-1])
    turned = trace(way, way)
    turned.pose[-1, 2] = -0.2
    found = judge(turned)
    assert found["heading_drift"] == pytest.approx(0.2) and found["position_drift"] < 1e-12


def test_the_course_tells_when_the_error_was():
    late = SINES * (1 + 0.1 * ((TIME >= 10.0) & (TIME < 15.0)))[:, None]
    constant = np.tile([0.1, 0.2, 0.3], (COUNT, 1))
    found = judge(trace(1.2 * constant, constant))["course"]
    np.testing.assert_allclose(found, 0.2 * np.ones(4))
    one = judge(trace(late))["course"]
    assert len(one) == 4 and one[2] > 0.05 and max(one[0], one[1], one[3]) < 1e-12


def test_effort_rate_and_saturation():
    steady = judge(trace(SINES, command=np.full((COUNT, 4), -0.7)))
    assert (steady["effort"], steady["torque_rate"]) == (pytest.approx(0.7), 0.0)
    flips = 0.7 * np.where(np.arange(COUNT) % 2, 1.0, -1.0)[:, None] * np.ones(4)
    assert judge(trace(SINES, command=flips))["torque_rate"] == pytest.approx(1.4 / PERIOD)
    one_wheel = 2.0 * (np.arange(COUNT) % 4 == 1)[:, None] * np.array([0.0, 0.0, -1.0, 0.0])
    quarter = judge(trace(SINES, command=one_wheel))
    assert quarter["saturation"] == pytest.approx(0.25, abs=1e-3)


def test_a_loop_that_diverged_has_no_numbers():
    found = judge(trace(SINES, diverged=3.2))
    assert found == {"diverged": 3.2} and math.isnan(mean_nrmse(found))


class TestInterval:
    def test_three_values(self):
        found = interval([1.0, 2.0, 3.0])
        assert found["mean"] == 2.0 and found["runs"] == 3
        assert found["half"] == pytest.approx(4.302653 / math.sqrt(3), rel=1e-6)

    def test_too_few(self):
        assert interval([5.0]) == {"mean": 5.0, "half": None, "runs": 1}
        assert interval([]) == {"mean": None, "half": None, "runs": 0}

    def test_it_holds_the_truth_in_95_of_100(self):
        rng = np.random.default_rng(0)
        draws = [interval(row) for row in rng.standard_normal((2000, 5))]
        held = np.mean([abs(found["mean"]) <= found["half"] for found in draws])
        assert 0.94 < held < 0.96
