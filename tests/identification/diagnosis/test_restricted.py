"""Effects in some logs only: found by sums over logs, named with the logs, simulated there."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.restricted import BaseSums, LogSums, choices
from identification.diagnosis.settings import DiagnosisSettings
from identification.logs.log import Log, in_order_of_time
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

SETTINGS = DiagnosisSettings()
TILT = (("floor_tilt", (("tilt_x", -0.018), ("tilt_y", 0.006))),)


def sums(strengths: list[float], seed: int = 0) -> tuple[LogSums, float]:
    """Of logs of white noise, in which a column acts with these strengths; and all squares."""
    rng = np.random.default_rng(seed)
    shape = (1200, 3)
    base = [rng.standard_normal((*shape, 2)) for _ in strengths]
    columns = [rng.standard_normal((*shape, 1)) for _ in strengths]
    residual = [
        rng.standard_normal(shape) + strength * column[..., 0]
        for strength, column in zip(strengths, columns, strict=True)
    ]
    whole = BaseSums(residual, base, 0.02, SETTINGS)
    return LogSums(whole, columns), float(sum((part**2).sum() for part in residual))


def best(found: LogSums, square: float) -> tuple[int, ...] | None:
    everywhere, _ = found.step(range(len(found)))
    choice = found.best_choice(square, everywhere, lambda logs, strength: True)
    return None if choice is None else choice[0]


@pytest.mark.parametrize("logs", [(1,), (0, 2), (2, 3)])
def test_the_logs_in_which_it_acts_are_chosen(logs: tuple[int, ...]):
    found, square = sums([1.0 if k in logs else 0.0 for k in range(4)])
    assert best(found, square) == logs


def test_the_step_is_that_of_least_squares():
    found, _ = sums([0.0, 0.7, 0.0])
    fall, strength = found.step((1,))
    assert strength == pytest.approx([0.7], abs=0.05)
    assert fall == pytest.approx(0.7**2 * 3600, rel=0.1)


def test_what_acts_alike_in_all_logs_is_no_matter_of_some():
    found, square = sums([0.8, 0.8, 0.8])
    assert best(found, square) is None


def test_noise_has_no_logs():
    for seed in range(5):
        found, square = sums([0.0, 0.0, 0.0], seed)
        assert best(found, square) is None


def test_a_log_that_does_not_show_it_is_not_named():
    found, square = sums([0.0, 1.0, 0.0])
    found.own[2] *= 1e-9
    found.cross[2] *= 1e-9
    found.scores[2] *= 1e-9
    assert best(found, square) == (1,)


def test_of_many_logs_single_ones_and_those_since_one_are_tried():
    tried = choices(8, SETTINGS)
    assert (3,) in tried and (5, 6, 7) in tried and (0, 1) in tried
    assert (1, 4) not in tried and len(tried) < 3 * 8


def renamed(log: Log, name: str) -> Log:
    return replace(log, name=name)


@pytest.fixture(scope="module")
def differing() -> list[Log]:
    """Two logs of a level floor, and one of a floor that slopes."""
    return [
        renamed(recording("calibration", seed=1), "monday"),
        renamed(recording("I", seed=2), "tuesday"),
        renamed(recording("I", TILT, seed=3), "wednesday"),
    ]


def test_a_slope_in_one_log_is_named_with_the_log(differing: list[Log]):
    found = diagnose(load_model("paper"), differing, effects=["floor_tilt", "quadratic_friction"])
    told = found.to_dict()
    assert (told["verdict"], told["missing"]) == ("effect", ["floor_tilt"])
    assert told["logs"] == {"floor_tilt": ["wednesday"]}
    assert told["steps"][1] == {**told["steps"][1], "effect": "floor_tilt", "logs": ["wednesday"]}
    assert told["words"][0].startswith("floor_tilt, in wednesday alone: the floor falls by")
    tilt = found.model.effects["floor_tilt"]
    assert tilt["tilt_x"].value == pytest.approx(-0.018, abs=3 * tilt["tilt_x"].std)
    assert found.model.effect_logs == {"floor_tilt": ("wednesday",)}


@pytest.mark.slow
def test_a_slope_in_all_logs_is_one_of_all():
    logs = [
        renamed(recording("calibration", TILT, seed=1), "monday"),
        renamed(recording("I", TILT, seed=2), "tuesday"),
    ]
    found = diagnose(load_model("paper"), logs, effects=["floor_tilt", "quadratic_friction"])
    assert (found.missing, found.logs) == (("floor_tilt",), {})


def test_logs_are_taken_in_the_order_of_their_time_not_of_their_files():
    log = recording("I")
    later, last = (replace(log, time=log.time + shift) for shift in (1000.0, 2000.0))
    assert in_order_of_time([last, log, later]) == [log, later, last]
    # Logs that overlap have no order of time: that of the files stays.
    alike = [replace(log, time=log.time + 1.0), log]
    assert in_order_of_time(alike) == alike
