"""Where what remains lives: a rule over logged columns, found and held on other stretches."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identification.fitting.regression import Regression, filtered_rows, regression
from identification.fitting.settings import FitSettings
from identification.mechanisms.registry import mechanism_of
from identification.mechanisms.samples import Samples
from identification.residual_map.regime import Regime, find_regime
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
MECHANISM = mechanism_of(PAPER)
FIT = FitSettings()
FREE = np.flatnonzero(MECHANISM.free)


# Not made when the file is imported: each process of a parallel run imports all files.
@cache
def all_samples() -> list[Samples]:
    return [
        replace(MECHANISM.samples(recording(motion, seed=seed)), name=name)
        for motion, seed, name in (("calibration", 1, "long"), ("I", 2, "short"))
    ]


@cache
def all_rows() -> list[Regression]:
    return [regression(MECHANISM, PAPER.theta, item, FREE, FIT) for item in all_samples()]


Force = Callable[[Samples], np.ndarray]
"""(N,) what is missing along X [N m]."""


def lacking(force: Force) -> list[Regression]:
    """The rows with a force that the model lacks."""
    found = []
    for row, item in zip(all_rows(), all_samples(), strict=True):
        signal = np.column_stack([force(item), np.zeros((len(item), 2))])
        more = filtered_rows(np.stack([signal[:-1], signal[1:]]), MECHANISM, item, FIT)
        found.append(replace(row, residual=row.residual + more[: len(row.residual)]))
    return found


def regime(force: Force) -> Regime | None:
    # What trees leave of a residual is more than noise: they are told only roughly.
    noise = float(np.concatenate([(row.residual**2).sum(axis=1) for row in all_rows()]).mean())
    return find_regime(MECHANISM, lacking(force), all_samples(), 4 * noise)


def drag(item: Samples) -> np.ndarray:
    return 2.0 * np.tanh(item.twist[:, 0] / 0.01)


def bounds(rule: str) -> list[float]:
    return [float(word) for word in rule.split() if word.lstrip("-").replace(".", "").isdigit()]


def test_one_direction_of_a_wheel():
    found = regime(lambda item: 2.0 * (item.wheel_speed[:, 0] < 0))
    assert found is not None and found.rule == "velocity_fl < 0"
    assert found.share > 0.9 and 0.3 < found.rows < 0.7


def test_after_a_time():
    found = regime(lambda item: drag(item) * (item.time > 60.0))
    assert found is not None and found.rule.startswith("after")
    assert bounds(found.rule) == [pytest.approx(60.0, abs=3.0)]
    assert "after" in found.sentence and "% of the time" in found.sentence


def test_between_two_places():
    x = np.concatenate([item.pose[:, 0] for item in all_samples()])
    low, high = np.quantile(x, [0.4, 0.6])
    found = regime(lambda item: drag(item) * ((item.pose[:, 0] > low) & (item.pose[:, 0] < high)))
    assert found is not None and "pose_x <" in found.rule
    assert found.share > 0.9 and found.rows == pytest.approx(0.2, abs=0.1)


def test_one_log():
    found = regime(lambda item: drag(item) * (item.name == "short"))
    assert found is not None and found.rule == "short"
    assert found.sentence.startswith("what remains lives in short:")


def test_what_acts_everywhere_has_no_regime():
    assert regime(drag) is None
    assert regime(lambda item: 2.0 * np.cos(item.pose[:, 2])) is None


def test_noise_has_none():
    assert regime(lambda item: np.zeros(len(item))) is None


def test_a_range_about_zero_keeps_its_bounds():
    std = float(np.concatenate([item.wheel_speed[:, 0] for item in all_samples()]).std())
    found = regime(lambda item: 2.0 * (np.abs(item.wheel_speed[:, 0]) < 0.04 * std))
    assert found is not None and "< velocity_fl <" in found.rule
    low, high = bounds(found.rule)
    assert low < 0 < high


@pytest.mark.parametrize(
    ("rule", "variables"),
    [
        ("after 48 s", ("time",)),
        ("-1 < pose_y < -0.9", ("position_y",)),
        ("pose_x > 1.2 and 0.1 < pose_y < 0.4", ("position_x", "position_y")),
        ("abs(velocity_fl) < 0.4", ("wheel_speed_fl",)),
        ("pose_yaw > 1", ("heading",)),
        ("multisine_a or calibration_b", ()),
    ],
)
def test_a_rule_in_the_words_of_a_map(rule: str, variables: tuple[str, ...]):
    assert Regime(rule, 0.9, 0.1).variables == variables
