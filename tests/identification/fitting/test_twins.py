"""Parameters of an effect that act alike: no wheel is told where nothing tells it from another."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.add_effect import add_effect
from identification.diagnosis.sentences import describe
from identification.fitting.errors import NoiseLevel
from identification.fitting.final_fit import final_fit
from identification.fitting.twins import doubt_between_twins
from identification.mechanisms.mecanum import Mecanum
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")
ROLLERS = "uneven_roller_friction"
WHEELS = ("fl", "fr", "bl", "br")


def fitted(name: str, planted: dict[str, float]):
    """The last fit of a log with an effect, and the places of its values of single wheels."""
    log = recording(effects=((name, tuple(planted.items())),))
    mechanism = Mecanum(PAPER.geometry, mecanum_structure([name]))
    samples = [mechanism.samples(log)]
    noise = [NoiseLevel.of(item) for item in samples]
    found = final_fit(mechanism, samples, noise, PAPER.with_effect(name).theta, 0)
    own = [f"{name}.extra_{wheel}" for wheel in WHEELS]
    names = [mechanism.parameter_names[k] for k in found.free]
    return mechanism, found, [names.index(one) for one in own]


@pytest.mark.parametrize("wheel", WHEELS)
def test_of_two_rollers_that_turn_alike_either_may_be_the_one(wheel: str):
    truth = {f"extra_{wheel}": 0.05}
    _, found, own = fitted(ROLLERS, truth)
    values, std = found.theta[found.free[own]], found.std[own]
    planted = np.array([truth.get(f"extra_{one}", 0.0) for one in WHEELS])
    assert (np.abs(values - planted) < 2.0 * std + 1e-3).all()
    for pair in (slice(0, 2), slice(2, 4)):
        both, places = planted[pair].sum(), own[pair]
        spread = np.sqrt(found.covariance[np.ix_(places, places)].sum())
        # What they drag together is as sure as ever.
        assert abs(values[pair].sum() - both) < 3.0 * spread + 1e-4 and spread < 1e-3
        # Where the fits of forces and of the free run share it in other ways, that is added.
        half = 0.5 * np.abs(values[pair]).sum()
        assert (std[pair] > half - 1e-3).all() and (std[pair] < 1.5 * half + 1e-3).all()


def test_wheels_that_can_be_told_apart_are():
    mechanism, found, own = fitted("uneven_coulomb_friction", {"extra_fr": 0.2})
    assert not doubt_between_twins(mechanism, found).any()
    assert found.theta[found.free[own]] == pytest.approx([0.0, 0.2, 0.0, 0.0], abs=0.01)
    assert found.std[own].max() < 0.01


def test_it_is_worth_adding_though_no_single_wheel_is_sure():
    log = recording(effects=((ROLLERS, (("extra_bl", 0.05),)),))
    found = add_effect(PAPER, ROLLERS, [log])
    assert found.worthwhile, found.reasons
    drags = [found.model.values[f"{ROLLERS}.extra_{wheel}"] for wheel in WHEELS]
    assert sum(drags[2:]) == pytest.approx(0.05, abs=0.003)


def test_the_words_tell_the_end_and_no_wheel():
    base = {key: entry.value for key, entry in PAPER.parameters.items()}
    values = {"extra_fl": 0.01, "extra_fr": 0.04, "extra_bl": 0.0, "extra_br": 0.001}
    words = describe(CATALOGUE[ROLLERS], {**values, "smoothing": 0.1}, base)
    assert "front wheels drag: 0.050 N m" in words and "left" not in words and "right" not in words
