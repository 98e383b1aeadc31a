"""Set points for a real robot: within limits, consistent, and on the floor that they state."""

from __future__ import annotations

import numpy as np
import pytest

from youbot_env.errors import InputError
from youbot_env.motions.calibration import calibration, motion_iii
from youbot_env.motions.limits import MotionLimits
from youbot_env.motions.set_points import COLUMNS, MARGIN, set_points
from youbot_env.physics.geometry import Geometry

GEOMETRY = Geometry(l=0.2, h=0.3, R=0.07)


def test_rows_are_the_motion_between_two_rests() -> None:
    motion = motion_iii(GEOMETRY)
    points = set_points(motion, GEOMETRY, rate=50, rest=2.0)
    assert points.table.shape == (39 * 50 + 1, len(COLUMNS))
    assert np.allclose(np.diff(points.time), 0.02)
    assert not points.twist[points.time <= 2.0].any() and not points.twist[-100:].any()
    at = np.searchsorted(points.time, 20.0)
    assert points.twist[at] == pytest.approx(motion.twist(points.time[at] - 2.0))
    assert points.wheel_speed == pytest.approx(GEOMETRY.wheel_speeds(points.twist))


def test_a_motion_beyond_a_limit_is_slowed_as_a_whole() -> None:
    limits = MotionLimits(wheel_speed=5.0, body_speed=0.2)
    free, slowed = (
        set_points(calibration(GEOMETRY), GEOMETRY),
        set_points(calibration(GEOMETRY), GEOMETRY, limits=limits),
    )
    assert free.scale == 1.0 and slowed.scale < 1.0
    assert slowed.twist == pytest.approx(slowed.scale * free.twist)
    assert np.abs(slowed.wheel_speed).max() <= 5.0 + 1e-9
    assert np.hypot(*slowed.twist[:, :2].T).max() <= 0.2 + 1e-9


def test_the_floor_holds_the_robot_all_the_way() -> None:
    points = set_points(calibration(GEOMETRY), GEOMETRY)
    floor = points.floor
    reach = np.hypot(GEOMETRY.h + GEOMETRY.R, GEOMETRY.l + GEOMETRY.R)
    for axis in (0, 1):
        path = points.pose[:, axis]
        assert floor.least[axis] <= path.min() - (GEOMETRY.l + GEOMETRY.R) + 1e-9
        assert path.min() - reach <= floor.least[axis]
        assert path.max() + reach >= floor.most[axis] >= path.max()
        assert floor.size[axis] == pytest.approx(floor.most[axis] - floor.least[axis] + 2 * MARGIN)
    # A robot that stands as told has the start of its path inside, its back at the margin or more.
    assert 0 < floor.start[0] < floor.size[0] and 0 < floor.start[1] < floor.size[1]


def test_an_integrated_path_closes_where_the_motion_returns() -> None:
    """Motion III is a circle driven in whole turns between its ramps; its heading stays."""
    points = set_points(motion_iii(GEOMETRY), GEOMETRY, rate=200)
    assert np.abs(points.pose[:, 2]).max() == 0


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 0.01])
def test_a_rate_that_cannot_be_is_refused(rate: float) -> None:
    with pytest.raises(InputError, match="rate"):
        set_points(motion_iii(GEOMETRY), GEOMETRY, rate=rate)
