"""Periods over a floor and over angles are found without trying each."""

from __future__ import annotations

import numpy as np
import pytest

from identification.proposal.periods import cycles_of_angles, periods_over_floor
from identification.proposal.settings import ProposalSettings

SETTINGS = ProposalSettings()

SLOW, FAST = np.linspace(0.0, 0.6, 50), np.linspace(0.0, 8.0, 50)


def walk(rng, n=20000, size=3.0):
    return size * np.column_stack(
        [np.sin(np.arange(n) * 0.0031 + rng.uniform()), np.sin(np.arange(n) * 0.0047)]
    )


@pytest.mark.parametrize(("period", "direction"), [(0.1, 0.0), (0.23, 0.7), (0.6, -1.2)])
def test_the_period_and_direction_of_a_floor(period, direction):
    rng = np.random.default_rng(0)
    place = walk(rng)
    unit = np.array([np.cos(direction), np.sin(direction)])
    wave = np.sin(2 * np.pi * place @ unit / period + 0.4)
    force = wave[:, None] * unit + 2.0 * rng.standard_normal((len(place), 2))
    found = periods_over_floor(place, force, SLOW, 10.0, SETTINGS)
    assert found[0][0] == pytest.approx(period, rel=0.03)
    assert np.cos(found[0][1] - direction) == pytest.approx(1.0, abs=3e-3)


def test_no_floor_without_a_way():
    assert periods_over_floor(np.zeros((100, 2)), np.ones((100, 2)), SLOW, 10.0, SETTINGS) == []


def test_cycles_that_are_no_whole_number():
    rng = np.random.default_rng(1)
    angles = [60 * np.sin(np.arange(30000) * 0.001 * (k + 1)) for k in range(4)]
    torques = [np.sin(7.3 * a) + 3.0 * rng.standard_normal(len(a)) for a in angles]
    found = cycles_of_angles(angles, torques, FAST, 10.0, SETTINGS)
    assert found[0] == pytest.approx(7.3, abs=0.02)
    assert cycles_of_angles([a / 60 for a in angles], torques, FAST, 10.0, SETTINGS) == []
