"""Whatever logs hold, identify gives a model that can be, and says where it does not fit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.identify import Identification, identify
from identification.fitting.physical_fit import within_limits
from identification.logs.log import Log
from identification.mechanisms.axis_model import axis_from_dict, axis_to_dict, base_axis_model
from identification.mechanisms.mecanum import BASE, Mecanum
from identification.mechanisms.physical_parameters import limits, well_inside
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict
from youbot_env.physics.geometry import Geometry

PAPER = load_model("paper")
SLOPE = ("floor_tilt", (("tilt_x", 0.0), ("tilt_y", -0.04)))
TETHER = ("tether", (("stiffness", 100.0), ("anchor_x", -1.0), ("anchor_y", 1.0)))
LOAD = ("payload_change", (("mass", 60.0), ("x", -0.3), ("y", 0.2), ("time", 20.0)))


def plain() -> Log:
    return recording(rate=50.0)


def with_effort(change) -> Log:
    log = plain()
    return replace(log, effort=change(log.effort))


CASES = {
    "slope": lambda: recording(effects=(SLOPE,), rate=50.0),
    "tether": lambda: recording(effects=(TETHER,), rate=50.0),
    "payload": lambda: recording(effects=(LOAD,), rate=50.0),
    "exchanged": lambda: with_effort(lambda effort: effort[:, [0, 2, 1, 3]]),
    "unsigned": lambda: with_effort(np.abs),
    "against": lambda: with_effort(lambda effort: -effort),
    "offsets": lambda: with_effort(lambda effort: effort + [1.0, -2.0, 0.5, 3.0]),
}


def reloaded(result: Identification) -> dict[str, float]:
    return model_from_dict(json.loads(json.dumps(model_to_dict(result.model))), "written").values


@pytest.mark.parametrize("case", list(CASES))
def test_there_is_a_model_that_loads_again(case: str):
    result = identify([CASES[case]()], recursive=False)
    assert reloaded(result) == result.model.values
    assert result.misfit and result.misfit == result.warnings[0]
    assert "times the noise floor" in result.misfit and "youbot diagnose" in result.misfit
    entries = result.to_dict()["parameters"].values()
    assert all(entry["interval"] is None and entry["std"] is not None for entry in entries)


def test_efforts_that_are_noise_alone_make_a_model_too():
    noise = np.random.default_rng(0)
    log = with_effort(lambda effort: noise.standard_normal(effort.shape))
    assert reloaded(identify([log], recursive=False))["m0"] > 4 * PAPER.geometry.m1


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["tether", "uneven_wheel_friction", "torque_gain_error"])
def test_effects_of_the_start_stay_within_their_bounds_too(effect: str):
    result = identify([CASES["exchanged"]()], start=PAPER.with_effect(effect), recursive=False)
    assert reloaded(result) == result.model.values


def test_a_fit_that_can_be_is_left_as_it_is():
    result = identify([plain()], recursive=False)
    assert result.misfit is None
    assert within_limits(result.mechanism, result.fit) is result.fit
    low, high = result.to_dict()["parameters"]["m0"]["interval"]
    assert low < PAPER.values["m0"] < high


def test_the_constrained_fit_has_the_least_squares_of_all_that_can_be():
    result = identify([CASES["slope"]()], recursive=False)
    # From there no small step within the limits lowers the squares.
    mechanism, found = result.mechanism, result.fit
    rng = np.random.default_rng(0)
    columns = np.concatenate([r.columns.reshape(-1, len(found.free)) for r in found.rows])
    residual = np.concatenate([r.residual.ravel() for r in found.rows])
    least = residual @ residual
    for _ in range(200):
        step = 1e-3 * rng.standard_normal(len(found.free)) / mechanism.scale[found.free]
        theta = found.theta.copy()
        theta[found.free] += step
        if min(limits(mechanism, theta).values()) >= 0:
            left = residual - columns @ step
            assert left @ left > least * (1 - 1e-6)


@pytest.mark.parametrize("m1", [0.0, 1.4, 10.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_search_can_begin_wherever_a_fit_has_ended(m1: float, seed: int):
    mechanism = Mecanum(replace(Geometry(), m1=m1), BASE).with_effects(
        ("tether", "uneven_wheel_friction", "payload_change")
    )
    rng = np.random.default_rng(seed)
    size = np.array([label.parameter.size for label in mechanism.labels])
    theta = 10 ** rng.uniform(-3, 3, len(size)) * rng.standard_normal(len(size)) * size
    assert min(limits(mechanism, well_inside(mechanism, theta)).values()) >= 0


def test_an_axis_without_inertia_has_a_model_too():
    log = log_of(*planted(STAGE))
    still = replace(log, effort=-log.effort)
    result = identify(
        [still], start=base_axis_model([still], unit="m", every=True), recursive=False
    )
    assert axis_from_dict(axis_to_dict(result.model), "written").values["inertia"] > 0
    assert result.misfit
