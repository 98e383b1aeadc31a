"""Allocation: least norm inside the limits, the largest force of that direction beyond them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from controllers.allocation import allocate
from youbot_env.physics.geometry import Geometry

GEOMETRY = Geometry()


def forces(count: int, size: float) -> np.ndarray:
    rng = np.random.default_rng(5)
    return size * rng.uniform(-1, 1, (count, 3)) * [60.0, 60.0, 20.0]


def largest_share(force: np.ndarray, limit: np.ndarray) -> float:
    """The same question as a linear programme: torques and share, share at most 1."""
    equal = np.hstack([GEOMETRY.wheel_jacobian.T, -force[:, None]])
    bounds = [*((-b, b) for b in limit), (0.0, 1.0)]
    found = linprog([0, 0, 0, 0, -1.0], A_eq=equal, b_eq=np.zeros(3), bounds=bounds)
    assert found.success
    return float(found.x[4])


def test_idle_torques_exert_no_force() -> None:
    np.testing.assert_allclose(GEOMETRY.body_force(GEOMETRY.internal), 0.0, atol=1e-12)


def test_within_the_limits_it_is_the_least_norm() -> None:
    for force in forces(50, 0.3):
        torque, share = allocate(GEOMETRY, force, 2.0)
        assert share == 1.0
        np.testing.assert_allclose(torque, GEOMETRY.wheel_torque(force), atol=1e-12)


@pytest.mark.parametrize("limit", [(2.0,) * 4, (2.0, 0.5, 1.0, 2.0), (0.0, 2.0, 2.0, 2.0)])
def test_the_force_keeps_its_direction_and_no_larger_one_exists(limit: tuple) -> None:
    limits, saturated = np.array(limit), 0
    for force in forces(60, 4.0):
        torque, share = allocate(GEOMETRY, force, limits)
        assert (np.abs(torque) <= limits).all()
        np.testing.assert_allclose(GEOMETRY.body_force(torque), share * force, atol=1e-9)
        assert share == pytest.approx(largest_share(force, limits), abs=1e-8)
        saturated += share < 1.0
    assert 10 < saturated, "the case is tried"


def test_bracing_makes_room_that_clipping_has_not() -> None:
    """Forward, leftward and turning demands that add up at one wheel leave the others some room."""
    force = GEOMETRY.body_force(np.array([3.0, 1.0, 0.0, 0.0]))
    plain = GEOMETRY.wheel_torque(force)
    spread = np.array(GEOMETRY.internal) * plain
    limit = 0.5 * float(np.ptp(spread))
    assert np.abs(plain).max() > 1.2 * limit
    torque, share = allocate(GEOMETRY, force, limit)
    assert share == pytest.approx(1.0)
    np.testing.assert_allclose(GEOMETRY.body_force(torque), force, atol=1e-9)


def test_a_shift_is_no_larger_than_needed() -> None:
    for force in forces(200, 1.5):
        torque, share = allocate(GEOMETRY, force, 2.0)
        if share == 1.0 and np.abs(GEOMETRY.wheel_torque(force)).max() > 2.0:
            assert np.abs(torque).max() == pytest.approx(2.0)
            return
    pytest.fail("no force of the sample needs a shift alone")
