"""A platform that an effect holds is said to hardly move, and the effect is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from controllers.recording import holding_effects
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import motion_i
from youbot_env.physics.effect import CATALOGUE
from youbot_env.plugins import load_effects
from youbot_scripts import cli

OWN = """
from youbot_env.physics.effect import BODY, WHEEL, Parameter, effect

WORDS = {"source": "a user", "recognise": "by nothing"}

@effect(acts_at=WHEEL, parameters=[Parameter("share", "1", lower=0.0, size=1.5)], **WORDS)
def takes_all(xp, wheel, share):
    return share * xp.abs(wheel.torque) * xp.tanh(wheel.rate / 0.01)

@effect(acts_at=WHEEL, parameters=[Parameter("torque", "N m", lower=0.0, size=0.3)], **WORDS)
def no_number_at_rest(xp, wheel, torque):
    return torque * wheel.rate / xp.abs(wheel.rate)

@effect(acts_at=BODY, parameters=[Parameter("force", "N", lower=0.0, size=3.0)], **WORDS)
def no_direction_at_rest(xp, body, force):
    vx, vy, w = body.twist
    speed = xp.sqrt(vx**2 + vy**2)
    return force * vx / speed, force * vy / speed, 0.0 * w
"""


@pytest.fixture
def effects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    monkeypatch.setattr("youbot_env.plugins._loaded", [])
    path = tmp_path / "own.py"
    path.write_text(OWN)
    load_effects(path)
    return str(path)


def test_the_effect_that_takes_all_torque_is_named(
    effects: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tilted = ["--effect", "floor_tilt:tilt_x=0.01"]
    motion = ["record", str(tmp_path / "runs"), "--motions", "I", "--effects", effects]
    assert cli.main([*motion, *tilted, "--effect", "takes_all"]) == 0
    said = capsys.readouterr().out
    assert "I: the platform hardly moves" in said and "takes_all takes the torque" in said
    assert "floor_tilt takes" not in said
    assert cli.main([*motion, *tilted]) == 0
    assert "hardly moves" not in capsys.readouterr().out


def test_of_two_effects_that_hold_alone_neither_is_named_alone(effects: str) -> None:
    once = load_model("paper").with_effect("takes_all", share=1.5)
    assert holding_effects(once, motion_i()) == ("takes_all",)
    twice = once.with_effect("wheel_coulomb_friction", torque=4.0)
    assert holding_effects(twice, motion_i()) == ()


@pytest.mark.parametrize(
    ("name", "values"),
    [("no_number_at_rest", {"torque": 1.0}), ("no_direction_at_rest", {"force": 1.0})],
)
def test_an_effect_without_a_number_at_rest_is_named_with_the_cure(
    effects: str, name: str, values: dict[str, float]
) -> None:
    tilted = load_model("paper").with_effect("floor_tilt", tilt_x=0.01)
    with pytest.raises(InputError, match=rf"effect {name} is no number where the robot rests.*xp"):
        tilted.with_effect(name, **values)


def test_sizes_that_overflow_are_no_effects_fault() -> None:
    with pytest.raises(InputError, match="overflow together"):
        load_model("paper").with_effect("floor_tilt").with_values({"m0": 1e308, "I0": 1e308})
