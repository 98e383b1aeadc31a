"""Efforts against the motion: offsets, signs, units, exchanged wheels, filtered channels."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from controllers.recording import record
from identification.logs.checks import check, limits_for
from identification.logs.log import Log
from identification.logs.settings import LogSettings
from tests.identification.creeping_platform import creeping_logs
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.hardware import GEAR_RATIO
from youbot_env.plugins import load_effects
from youbot_scripts.blind_bench.cases import draw_case, logs_of
from youbot_scripts.recording.named_motions import motions_named

PAPER = load_model("paper")


@pytest.fixture(scope="module")
def free() -> Log:
    motion = multisine(np.random.default_rng(5), duration=60.0)
    log = record(PAPER, [motion], rate=100.0, seed=4, torque_noise=0.03, speed_noise=0.01)[0]
    return replace(log, pose=None, gyro_z=None)


def first(log: Log) -> str:
    """The most serious finding."""
    found = [f for f in check(log, limits_for(log, None, None, None)) if f.level != "info"]
    found.sort(key=lambda finding: finding.level != "error")
    return str(found[0]) if found else ""


@pytest.mark.parametrize("offset", [(0.1, 0, 0, 0), (0.05, 0.05, 0.05, 0.05), (0, -0.08, 0.06, 0)])
def test_offsets_of_efforts(offset: tuple[float, ...]):
    turning = replace(recording(), pose=None)
    told = first(replace(turning, effort=turning.effort + offset))
    assert "the efforts have offsets" in told
    for name, value in zip(("fl", "fr", "bl", "br"), offset, strict=True):
        found = float(told.split(f"effort_{name} ")[1].split()[0].rstrip(","))
        assert found == pytest.approx(value, abs=0.02)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (("floor_tilt", (("tilt_x", 0.02), ("tilt_y", -0.01))),),
        (("wheel_coulomb_friction", (("torque", 0.2),)),),
    ],
)
def test_slopes_and_friction_are_no_offsets(effects):
    assert first(recording(effects=effects)) == ""


def test_friction_that_is_larger_one_way_is_not_told_as_an_offset_alone():
    """One wheel drags when it rolls forward: the mean of its effort is not zero."""
    log = replace(recording(), pose=None)
    drag = np.zeros(4)
    drag[2] = 0.08
    told = first(replace(log, effort=log.effort + drag * np.maximum(log.velocity, 0.0)))
    assert "offsets, which no motion explains" not in told


def test_dry_friction_of_wheels_that_stand_is_no_offset():
    """In motions I and II two wheels stand, and creep a little."""
    log = creeping_logs(6000.0, coulomb=0.15, seed=14)[0]
    assert "offset" not in first(replace(log, pose=None))


def test_efforts_at_rest(free: Log):
    still = np.zeros((200, 4))
    rng = np.random.default_rng(0)

    def with_rests(offset: float) -> Log:
        block = [still + 0.01 * rng.standard_normal((200, 4)), free.velocity]
        speed = np.concatenate([*block, block[0]])
        quiet = offset + 0.03 * rng.standard_normal((200, 4))
        effort = np.concatenate([quiet, free.effort, quiet])
        time = np.linspace(0.0, (len(speed) - 1) * free.dt, len(speed))
        return Log("rests", free.joints, time, speed, effort)

    assert "at rest the efforts are not zero" in first(with_rests(0.3))
    assert first(with_rests(0.0)) == ""


SPEED_UNITS = {
    "rpm": 30 / np.pi,
    "degrees/s": 180 / np.pi,
    "turns/s": 1 / (2 * np.pi),
    "m/s of the rim": 0.0475,
    "rad/s of the motors": GEAR_RATIO,
    "rpm of the motors": GEAR_RATIO * 30 / np.pi,
}


@pytest.mark.parametrize("unit", SPEED_UNITS)
def test_units_of_speeds_without_a_pose(free: Log, unit: str):
    told = first(replace(free, velocity=free.velocity * SPEED_UNITS[unit]))
    assert f"velocity_* look like {unit}:" in told
    assert float(told.split("multiply them by ")[1].split()[0]) == pytest.approx(
        1 / SPEED_UNITS[unit], rel=1e-3
    )


def test_drives_that_clip_the_torque_have_no_unit():
    """The masses are then far apart, as with a wrong unit; no log is refused for it."""
    case = draw_case("one", 18, 902)
    assert "torque_saturation" in str(case.planted)
    log = next(log for log in logs_of(case) if log.name == "calibration")
    strict = LogSettings(max_left_for_masses=1.0)
    assert "turns/s" in str(check(log, limits_for(log, None, None, None, strict)))
    found = check(log, limits_for(log, None, None, None))
    assert "error" not in {finding.level for finding in found}


def test_a_mass_whose_sign_an_effect_turns_refuses_no_log():
    case = draw_case("fleet", 59, 12, 50.0)
    log = next(log for log in logs_of(case) if log.name == "calibration")
    strict = LogSettings(max_left_for_masses=1.0)
    assert "are exchanged" in str(check(log, limits_for(log, None, None, None, strict)))
    found = check(log, limits_for(log, None, None, None))
    assert "error" not in {finding.level for finding in found}


ROUGH = """
from youbot_env.physics.effect import WHEEL, Parameter, effect

NAMES = [Parameter("torque", "N m", lower=0.0, size=0.5), Parameter("edge", "m", size=0.1)]
WORDS = {"source": "a test", "recognise": "by the place", "dissipative": True}

def beyond(xp, wheel, place, torque, edge):
    return torque * xp.tanh(wheel.rate / 0.05) * (1 + xp.tanh((place - edge) / 0.02)) / 2

@effect(acts_at=WHEEL, parameters=NAMES, **WORDS)
def rough_ahead(xp, wheel, torque, edge):
    return beyond(xp, wheel, wheel.contact.x, torque, edge)

@effect(acts_at=WHEEL, parameters=NAMES, **WORDS)
def rough_aside(xp, wheel, torque, edge):
    return beyond(xp, wheel, wheel.contact.y, torque, edge)
"""


@pytest.mark.parametrize(
    ("effect", "motion", "seed", "torque", "edge"),
    [
        ("rough_aside", "multisine_a", 2, 0.6, -0.2),
        ("rough_ahead", "multisine_a", 3, 0.8, -0.2),
        ("rough_ahead", "multisine_a", 3, 2.0, 0.1),
        ("rough_aside", "multisine_a", 3, 0.4, 0.0),
        ("rough_ahead", "multisine_a", 7, 2.0, 0.1),
        ("rough_ahead", "multisine_b", 7, 0.4, 0.0),
    ],
)
def test_a_floor_that_is_rough_in_places_is_no_fault_of_the_columns(
    tmp_path, monkeypatch, effect: str, motion: str, seed: int, torque: float, edge: float
):
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    monkeypatch.setattr("youbot_env.plugins._loaded", [])
    (tmp_path / "rough.py").write_text(ROUGH)
    load_effects(tmp_path / "rough.py")
    plant = PAPER.with_effect(effect, torque=torque, edge=edge)
    log = record(plant, motions_named(motion, PAPER.geometry, seed), rate=50.0, seed=seed)[0]
    found = check(log, limits_for(log, None, None, None))
    said = " ".join(str(finding) for finding in found if finding.level != "info")
    assert not [word for word in ("look like", "exchanged", "offsets") if word in said]
    # As a possibility, after what is more likely.
    for finding in found:
        if "turns one of" in finding.message:
            assert finding.level == "info"
            assert finding.message.index("something large acts") < finding.message.index("or else")


@pytest.mark.parametrize("friction", [0.0, 0.15])
def test_turns_are_named_though_friction_is_missing(friction: float):
    effects = (("wheel_coulomb_friction", (("torque", friction),)),) if friction else ()
    log = replace(recording(effects=effects), pose=None)
    told = first(replace(log, velocity=log.velocity / (2 * np.pi)))
    assert "velocity_* look like turns/s" in told
    assert ("unless something large acts" in told) == bool(friction)


@pytest.mark.parametrize(
    ("unit", "numbers"),
    [("torques of the motors", 1 / GEAR_RATIO), ("N mm", 1e3), ("N cm", 1e2)],
)
def test_units_of_efforts(free: Log, unit: str, numbers: float):
    told = first(replace(free, effort=free.effort * numbers))
    assert f"effort_* look like {unit}" in told


@pytest.mark.parametrize("order", [[2, 3, 0, 1], [3, 2, 1, 0]])
def test_wheels_exchanged_in_speeds_and_efforts(free: Log, order: list[int]):
    swapped = replace(free, velocity=free.velocity[:, order], effort=free.effort[:, order])
    assert "are exchanged" in first(swapped)


@pytest.mark.parametrize("signs", [s for s in product((1, -1), repeat=4) if min(s) < 0])
def test_signs_of_efforts(free: Log, signs: tuple[int, ...]):
    told = first(replace(free, effort=free.effort * signs))
    names = [w for w, s in zip(("fl", "fr", "bl", "br"), signs, strict=True) if s < 0]
    assert " and ".join(f"effort_{w}" for w in names) in told and "sign" in told


def test_order_and_sign_at_once(free: Log):
    told = first(replace(free, effort=free.effort[:, [1, 0, 2, 3]] * (1, 1, -1, 1)))
    assert "another order" in told and "the sign of effort_bl is wrong" in told


def test_speeds_without_their_sign(free: Log):
    assert "the sign is lost" in first(replace(free, velocity=np.abs(free.velocity)))
    one = free.velocity.copy()
    one[:, 2] = np.abs(one[:, 2])
    assert "velocity_bl: never negative" in first(replace(free, velocity=one))


def test_speeds_that_are_filtered(free: Log):
    decay = np.exp(-free.dt / 0.05)
    speed = free.velocity.copy()
    for k in range(1, len(speed)):
        speed[k] = decay * speed[k - 1] + (1 - decay) * speed[k]
    told = first(replace(free, velocity=speed))
    assert "the speeds are low-passed" in told
    assert 40 < float(told.split("fades over ")[1].split()[0]) < 60
    means = np.column_stack([np.convolve(c, np.ones(8) / 8, "same") for c in free.velocity.T])
    assert "the speeds are means" in first(replace(free, velocity=means))


@pytest.mark.parametrize("rows", [2, 5])
def test_interpolated_channels(free: Log, rows: int):
    at = np.arange(len(free))
    lines = np.column_stack([np.interp(at, at[::rows], c[::rows]) for c in free.effort.T])
    told = first(replace(free, effort=lines))
    assert told.startswith(f"effort_* lies on straight lines of {10 * rows}")
    one = free.velocity.copy()
    one[:, 3] = np.interp(at, at[::rows], one[::rows, 3])
    assert first(replace(free, velocity=one)).startswith("velocity_br lies on straight lines")


def test_one_channel_that_is_held(free: Log):
    effort = free.effort.copy()
    effort[:, 1] = effort[(np.arange(len(effort)) // 5) * 5, 1]
    assert "effort_fr is new every 50 ms only" in first(replace(free, effort=effort))


def test_motors_that_are_off_for_a_stretch(free: Log):
    effort = free.effort.copy()
    effort[2000:3500] = 0.0
    told = first(replace(free, effort=effort))
    assert "all efforts are 0" in told and "rows 2002 to 3501" in told
