"""When a log began on the clock of what swings in time is read from the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.clocks import (
    _between,
    first_placed_on_clock,
    has_own_clock,
    placed_on_clock,
    words_of_clock,
)
from identification.fitting.errors import SumsOfSquares, velocity_traces
from identification.mechanisms.registry import mechanism_of
from identification.proposal.law import FoundLaw
from identification.proposal.periodic_laws import SWAY, swinging
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE, WORLD, Parameter, effect

PERIOD = 3.7
SIZE = np.array([6.0, -2.0, 1.0, 4.0])
"""[N] sine and cosine along x, and along y."""

NAMES = ("sine_x", "cosine_x", "sine_y", "cosine_y")


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """The platform knows a deck that sways, and what a test registers is gone after it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    CATALOGUE.add(FoundLaw(swinging(SWAY, PERIOD), {"period": PERIOD}).effect())


def begun_at(start: float) -> dict[str, float]:
    """Strengths that a log shows which began so long [s] after the period did."""
    turn = 2 * np.pi * start / PERIOD
    c, s = np.cos(turn), np.sin(turn)
    # sin(w (t + start)) and cos(w (t + start)), as sums of sin(w t) and cos(w t)
    rotation = np.array([[c, -s], [s, c]])
    found = np.concatenate([rotation @ SIZE[:2], rotation @ SIZE[2:]])
    return dict(zip(NAMES, found.tolist(), strict=True))


def model_and_samples(*starts: float):
    model = load_model("paper").with_effect("sway", **begun_at(0.0), period=PERIOD)
    mechanism = mechanism_of(model)
    logs = [
        recording(motion, (("sway", (*begun_at(start).items(), ("period", PERIOD))),))
        for motion, start in zip(("calibration", "I"), starts, strict=False)
    ]
    return mechanism, model.theta, mechanism.samples_of(logs)


def apart(a: float, b: float) -> float:
    """How far two starts are from each other within the period [s]."""
    return abs((a - b + PERIOD / 2) % PERIOD - PERIOD / 2)


def test_the_start_of_a_log_within_the_period_is_found():
    mechanism, theta, samples = model_and_samples(2.3, 0.4)
    assert has_own_clock(mechanism)
    placed = placed_on_clock(mechanism, theta, samples)
    assert [item.start for item in placed] == pytest.approx([2.3, 0.4], abs=0.02)
    # A free run takes it from there.
    before, after = (
        SumsOfSquares.of(velocity_traces(mechanism, theta, items[0])).ratio
        for items in (samples, placed)
    )
    assert after < 0.02 < 0.1 * before
    (words,) = words_of_clock(mechanism, placed)
    said = ", ".join(f"{item.name} at {item.start:.3g} s" for item in placed)
    assert said in words and "no log yet it is not known" in words
    assert words_of_clock(mechanism_of(load_model("paper")), placed) == []


def test_logs_are_placed_though_the_size_of_the_swing_is_not_known():
    mechanism, theta, samples = model_and_samples(2.3, 0.4)
    unknown = theta.copy()
    for name in NAMES:
        unknown[list(mechanism.parameter_names).index(f"sway.{name}")] = 0.0
    first, second = first_placed_on_clock(mechanism, unknown, samples)
    # Only where one began against the other is known: the clock begins with the longest log.
    assert apart(first.start, 0.0) < 0.01
    assert apart(second.start - first.start, 0.4 - 2.3) < 0.05


def test_logs_stay_as_they_are_where_nothing_swings():
    mechanism, theta, samples = model_and_samples(2.3, 0.4)
    paper = load_model("paper")
    assert placed_on_clock(mechanism_of(paper), paper.theta, samples) == samples
    still = theta.copy()
    still[[list(mechanism.parameter_names).index(f"sway.{name}") for name in NAMES]] = 0.0
    placed = placed_on_clock(mechanism, still, samples)
    assert [item.start for item in placed] == [0.0, 0.0]


def test_a_common_clock_that_another_effect_reads_is_left_as_it_is():
    model = load_model("paper").with_effect("sway", **begun_at(0.0), period=PERIOD)
    both = model.with_effect("friction_warmup", fraction=0.5, time_constant=30.0)
    mechanism = mechanism_of(both)
    _, _, samples = model_and_samples(2.3, 0.4)
    samples = [replace(item, start=start) for item, start in zip(samples, (0.0, 90.0), strict=True)]
    assert not has_own_clock(mechanism)
    placed = placed_on_clock(mechanism, both.theta, samples)
    assert [item.start for item in placed] == [0.0, 90.0]


def test_a_curve_of_three_harmonics_is_known_from_seven_values():
    rng = np.random.default_rng(0)
    order, parts = np.arange(4), rng.standard_normal((2, 4))

    def curve(turn):
        angle = 2 * np.pi * np.multiply.outer(turn, order)
        return np.cos(angle) @ parts[0] + np.sin(angle) @ parts[1]

    turn = np.linspace(0.0, 1.0, 23)
    np.testing.assert_allclose(_between(turn, 7) @ curve(np.arange(7) / 7), curve(turn), atol=1e-12)


def test_a_clock_is_one_of_the_parameters():
    def swinging_alone(xp, world, force):
        return force, 0.0, 0.0

    declare = effect(
        acts_at=WORLD,
        parameters=[Parameter("force", "N")],
        source="A test",
        recognise="By nothing",
        own_clock="period",
    )
    with pytest.raises(InputError, match="own_clock is 'period', which is none of its parameters"):
        declare(swinging_alone)
