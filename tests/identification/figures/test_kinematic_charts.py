"""Charts of lengths from wheels and pose: the way that the wheels say is the measured one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from identification.figures.chart_style import log_axis
from identification.figures.kinematic_charts import charts_of_kinematics, in_words
from identification.kinematics import estimate_kinematics
from identification.kinematics.kinematics import Length
from tests.identification.kinematics.made_platforms import Made, made
from youbot_env.physics.geometry import Geometry

GEOMETRY = Geometry(l=0.16, h=0.22, R=0.0499)
TURNED = Made(geometry=GEOMETRY, seconds=30.0, delay=0.03, frame_yaw=0.4, lever=(0.1, -0.05))


@pytest.fixture(scope="module")
def figures():
    """Of a frame that is turned, a point off the centre, late speeds in rpm."""
    motion = made(TURNED, 1)
    motion = replace(motion, velocity=motion.velocity * 60 / (2 * np.pi))
    found = estimate_kinematics([motion], GEOMETRY)
    return {chart.name: chart.figure for chart in charts_of_kinematics(found, [motion])}


def test_wheels_alone_go_the_measured_way(figures):
    measured, rolled = figures["way_0"].data
    off = np.hypot(np.subtract(measured.x, rolled.x), np.subtract(measured.y, rolled.y))
    way = np.hypot(np.diff(measured.x), np.diff(measured.y)).sum()
    assert off[:100].max() < 0.05 and off.max() < 0.05 * way


def test_speeds_of_wheels_and_pose_agree(figures):
    lines = figures["speeds_0"].data
    for pose, wheels in zip(lines[::2], lines[1::2], strict=True):
        assert (pose.name, wheels.name) == ("pose", "wheels")
        at = np.interp(pose.x, wheels.x, wheels.y)
        assert np.sqrt(np.mean((at - pose.y) ** 2)) < 0.1 * np.std(pose.y)


def test_lengths_have_intervals_in_units_that_people_use(figures):
    titles = [note.text for note in figures["lengths"].layout.annotations]
    assert "<b>R [mm]</b>" in titles and "<b>delay [ms]</b>" in titles
    assert in_words(Length(0.0475, "m", 0.0001)) == "47.50 ± 0.20 mm"
    assert in_words(Length(9.4944e-6, "s", 1.3e-5)) == "0.009 ± 0.025 ms"
    assert in_words(Length(0.12, "1", 0.001)) == "0.1200 ± 0.0020 1"


def test_a_clock_that_counts_from_1970_draws_the_same_charts():
    motion = made(TURNED, 1)
    late = replace(motion, time=motion.time + 1.764e9)
    charts: list[dict[str, Any]] = [
        {chart.name: chart.figure for chart in charts_of_kinematics(found, [one])}
        for one in (motion, late)
        for found in [estimate_kinematics([one], GEOMETRY)]
    ]
    for mine, other in zip(charts[0]["speeds_0"].data, charts[1]["speeds_0"].data, strict=True):
        assert np.allclose(mine.x, other.x, atol=1e-3) and mine.x[0] < 1 < 25 < mine.x[-1] < 31
    shown = [chart["way_0"].data[0].customdata for chart in charts]
    assert np.allclose(*shown, atol=1e-3)


def test_a_logarithmic_axis_has_few_labels_inside_its_range():
    for values in ([1.0], [0.02, 80.0], [1e-6, 1e6], [3.0, 4.0], [0.0, -1.0], []):
        axis = log_axis(values)
        low, high = (10.0**end for end in axis["range"])
        assert 1 <= len(axis["tickvals"]) <= 14, values
        assert all(low <= tick <= high for tick in axis["tickvals"])
