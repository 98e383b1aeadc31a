"""What the results of robots say together: chance over a fleet, outliers, misses of the screen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from youbot_scripts.fleets.settings import FleetSettings
from youbot_scripts.fleets.summary import (
    Cost,
    findings_of,
    outliers_of,
    robust_deviations,
    summary_of,
)

LEAST = 1 / 20_000
"""Smallest p-value of a diagnosis."""


def result(
    robot: str,
    *,
    by: str = "screen",
    passed: bool = True,
    m0: float = 35.0,
    std: float = 0.2,
    **p: Any,
) -> dict[str, Any]:
    """A result; ``p``: p-values of the effects that are named."""
    return {
        "robot": robot,
        "by": by,
        "verdict": "effect" if p else "adequate",
        "missing": list(p),
        "p_values": p,
        "screen": {"passed": passed, "doubts": []},
        "set_aside": [],
        "parameters": {"m0": {"value": m0, "unit": "kg", "std": std}},
    }  # fmt: skip


def healthy(count: int) -> list[dict[str, Any]]:
    return [result(f"healthy {k}") for k in range(count)]


def test_one_robot_in_two_hundred_can_be_told_from_chance():
    found = findings_of([*healthy(199), result("bad", floor_tilt=LEAST)], 0.01)
    assert [(f.robot, f.effect, f.beyond_chance) for f in found] == [("bad", "floor_tilt", True)]
    found = findings_of([*healthy(399), result("bad", floor_tilt=LEAST)], 0.01)
    assert not found[0].beyond_chance, "of so many robots one has such a p-value by chance"


def test_the_second_effect_of_a_robot_stands_at_the_level_of_its_robot():
    robots = [*healthy(90), *(result(f"bad {k}", tether=LEAST) for k in range(9))]
    robots.append(result("two", floor_tilt=LEAST, yaw_scrub=0.009))
    found = {f.effect: f.beyond_chance for f in findings_of(robots, 0.01) if f.robot == "two"}
    assert found == {"floor_tilt": True, "yaw_scrub": False}


def test_false_discoveries_are_rare_over_many_fleets():
    """Sound robots that a diagnosis at 1 % names, beside robots with an effect."""
    rng, shares = np.random.default_rng(0), []
    for _ in range(80):
        bad = [result(f"bad {k}", tether=LEAST) for k in range(10)]
        p_values = rng.uniform(size=490)
        sound = [
            result(f"sound {k}", **({"yaw_scrub": p} if p <= 0.01 else {}))
            for k, p in enumerate(p_values)
        ]
        found = [f for f in findings_of([*bad, *sound], 0.01) if f.beyond_chance]
        shares.append(np.mean([f.robot.startswith("sound") for f in found]) if found else 0.0)
    named_at_one_percent = 490 * 0.01 / 15
    assert np.mean(shares) < 0.015 < named_at_one_percent


def test_a_robot_that_weighs_more_is_an_outlier_unless_it_is_known_badly():
    rng = np.random.default_rng(1)
    robots = [result(f"r{k}", m0=35.0 + 0.3 * rng.normal()) for k in range(30)]
    robots += [result("heavy", m0=40.0), result("unsure", m0=40.0, std=3.0)]
    found = outliers_of(robots, FleetSettings())
    assert [(item.robot, item.parameter) for item in found] == [("heavy", "m0")]
    assert found[0].deviations > 10 and abs(found[0].median - 35.0) < 0.2
    assert outliers_of(robots[-6:], FleetSettings()) == [], "too few to know their spread"


def test_robots_that_are_all_the_same_have_no_outliers():
    assert not robust_deviations(np.full(9, 35.0), np.zeros(9)).any()


def test_robust_deviations_of_normal_values_are_standard_deviations():
    values = np.random.default_rng(2).normal(3.0, 2.0, 20_000)
    assert robust_deviations(values, np.zeros(20_000)).std() == pytest.approx(1.0, abs=0.03)


def test_misses_of_the_screen_are_those_of_robots_that_passed_and_were_diagnosed():
    robots = [
        *healthy(5),
        result("audited", by="diagnosis"),
        result("missed", by="diagnosis", payload_change=LEAST),
        result("doubted", by="diagnosis", passed=False, floor_tilt=LEAST),
        {"robot": "dead", "error": "calibration.csv: row 3: no number"},
    ]
    found = summary_of(robots)
    assert (found.misses.count, found.misses.total) == (1, 2)
    assert found.by == {"screen": 5, "diagnosis": 3}
    assert found.unread == (("dead", "calibration.csv: row 3: no number"),)
    assert found.to_dict()["robots"] == 9
    assert [row["effect"] for row in found.effects] == ["floor_tilt", "payload_change"]


def test_a_fleet_of_which_nothing_can_be_read_has_a_summary():
    found = summary_of([{"robot": "dead", "error": "no logs"}])
    assert found.effects == [] and found.outliers == () and found.misses.total == 0


def test_the_cost_of_many_follows_from_the_mean():
    robots = [result("a"), result("b", by="diagnosis")]
    cost = Cost.of(robots, [{"cpu": 1.0}, {"cpu": 3.0}])
    assert (cost.screened, cost.diagnosed) == (1.0, 3.0)
    assert cost.of_many == pytest.approx(10_000 * 2.0 / 3600)
