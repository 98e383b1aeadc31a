"""A map of the residual is fitted, judged within its range, told as a curve, and refused beyond."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification import add_effect, compare, diagnose, identify
from identification.mechanisms.residual_maps import curve_of
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

pytestmark = pytest.mark.slow

TWIST = (("cable_twist", (("stiffness", 1.5), ("neutral", 0.2))),)


@pytest.fixture(scope="module")
def log():
    return recording("calibration", TWIST)


@pytest.fixture(scope="module")
def added(log):
    return add_effect(load_model("paper"), "residual:heading", [log])


def test_the_error_falls_to_the_noise_and_the_curve_is_the_truth_within_its_bars(added):
    floor = added.noise_floor["force_error"]
    assert added.before.force_error > 1.5 * floor > added.after.force_error
    assert added.worthwhile
    rows = curve_of(added.model, "residual:heading", 9)
    away = [
        (row["turn"]["value"] - 1.5 * (row["at"] - 0.2)) / row["turn"]["std"] for row in rows[1:-1]
    ]
    assert np.abs(away).max() < 4.0 and max(row["turn"]["std"] for row in rows[1:-1]) < 0.3
    assert added.to_dict()["curve"][0]["turn"]["unit"] == "N m"
    assert "it explains nothing" in added.sentence and len(added.sentence) < 300


def test_logs_that_leave_its_range_are_refused_by_every_command(added, log):
    assert compare(added.model, [log]).to_dict()["total"]["force_error"] < 0.05
    low = added.model.values["residual:heading.low"]
    pose = np.zeros((len(log), 3))
    pose[:, 2] = np.linspace(0.0, low - 1.0, len(log))
    elsewhere = replace(log, name="elsewhere", pose=pose)
    told = r"residual:heading: elsewhere goes to .* rad, and the map has seen"
    for refused in (
        lambda: compare(added.model, [elsewhere]),
        lambda: diagnose(added.model, [elsewhere]),
        lambda: identify([elsewhere], start=added.model),
        lambda: add_effect(added.model, "floor_tilt", [elsewhere]),
    ):
        with pytest.raises(InputError, match=told):
            refused()


def test_two_maps_at_one_place_are_refused(added, log):
    with pytest.raises(InputError, match="acts at the same place"):
        add_effect(added.model, "residual:position_x", [log])


def test_a_weak_map_is_worth_it_though_none_of_its_humps_is_sure_alone():
    weak = (("cable_twist", (("stiffness", 0.6), ("neutral", 0.0))),)
    logs = [recording("calibration", weak, rate=50.0, seed=seed) for seed in (1, 2)]
    found = add_effect(load_model("paper"), "residual:heading", logs)
    assert found.worthwhile, found.reasons
    assert found.after.force_error < 0.95 * found.before.force_error
