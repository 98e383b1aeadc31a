"""Files of a user: effects wherever a model is read, controllers in `evaluate`."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import numpy as np
import pytest

from tests.identification.healthy import healthy_log
from tests.youbot_env.test_plugins import DRAG, HEAD
from youbot_env.model.model_file import load_model, save_model
from youbot_env.physics.effect import CATALOGUE, Place
from youbot_env.plugins import load_effects
from youbot_scripts import cli
from youbot_scripts.shared import effect_points

WITH_MODELS = (
    *("identify", "compare", "diagnose", "add", "record", "evaluate", "train", "tune"),
    *("effects", "export", "workbench"),
)
"""Commands that read a model."""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """A file with an effect, and a model that has it; the catalogue does not know it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    # Workers load what was loaded here: not the files of other tests.
    monkeypatch.setattr("youbot_env.plugins._loaded", [])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_effects.py").write_text(HEAD + DRAG)
    before = dict(CATALOGUE._effects)
    (effect,) = load_effects(tmp_path / "my_effects.py")
    model = load_model("paper").with_effect(effect.name)
    save_model("own.json", model)
    monkeypatch.setattr(CATALOGUE, "_effects", before)
    return {"effects": "my_effects.py", "model": "own.json", "name": effect.name}


@pytest.mark.parametrize("command", WITH_MODELS)
def test_every_command_that_reads_a_model_takes_effects(command: str) -> None:
    main = __import__(f"youbot_scripts.{command}", fromlist=["main"]).main
    assert "effects" in inspect.signature(main).parameters


def test_without_the_file_the_cure_is_named(
    own: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["record", "runs", "--plant", own["model"], "--motions", "I"]) == 2
    said = capsys.readouterr().err
    assert own["name"] in said and "--effects FILE.py" in said


def test_with_the_file_it_is_read(own: dict[str, str]) -> None:
    from identification.logs.reading import write_log

    write_log("log.csv", healthy_log(duration=30.0))
    arguments = ["compare", own["model"], "log.csv", "--effects", own["effects"]]
    assert cli.main([*arguments, "--json", "errors.json"]) == 0
    assert json.loads(Path("errors.json").read_text())["total"]["force_error"] > 0


CONTROLLER = """
import numpy as np

class Proportional:
    def __init__(self, model, loop):
        self.jacobian = model.geometry.wheel_jacobian
    def reset(self):
        pass
    def __call__(self, observation, reference):
        return 0.5 * (self.jacobian @ reference.twist - observation.wheel_speed)
"""


def test_evaluate_drives_a_users_controller_on_a_model_with_a_users_effect(
    own: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """In other processes too, which have to run both files again."""
    Path("mine.py").write_text(CONTROLLER)
    arguments = ["evaluate", "--plant", own["model"], "--model", "known"]
    arguments += ["--controllers", "kinematic,mine.py", "--against", "kinematic"]
    arguments += ["--bands", "1-2", "--seeds", "1", "--duration", "2", "--jobs", "2"]
    assert cli.main([*arguments, "--effects", own["effects"], "--json", "found.json"]) == 0
    assert "mine.py" in capsys.readouterr().out
    found = json.loads(Path("found.json").read_text())
    assert {result["controller"] for result in found["results"]} == {"kinematic", "mine.py"}
    own_error, stock = (
        next(r["nrmse"] for r in found["trials"] if r["controller"] == name)
        for name in ("mine.py", "kinematic")
    )
    assert own_error != stock


def test_every_field_of_every_site_is_described() -> None:
    assert {"BODY", "WHEEL", "ROLLER", "WORLD", "ACTUATOR", "CHANNEL"} <= set(effect_points.NAMES)
    for place in effect_points.NAMES.values():
        assert isinstance(place, Place)
        assert effect_points.returned(place)
        for field in effect_points.fields_of(place):
            assert effect_points.described(place, field)[1], f"{place.name}: {field}"


def test_sites_are_shown_and_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["effects", "--points", "--json", str(tmp_path / "sites.json")]) == 0
    shown = capsys.readouterr().out
    assert "acts_at=WORLD" in shown and "com_x" in shown
    sites = json.loads((tmp_path / "sites.json").read_text())["sites"]
    assert {"wheel joint", "world"} <= {site["name"] for site in sites}


def test_the_sign_is_said_where_a_force_is_returned() -> None:
    told = {site["acts_at"]: site["sign"] for site in effect_points.sites_to_dict()}
    assert {name for name, sign in told.items() if sign} == {"BODY", "WORLD", "WHEEL", "ROLLER"}
    notes = {table.title: table.notes for table in effect_points.site_tables()}
    assert "returns + k x" in notes["acts_at=WORLD"][1] and len(notes["acts_at=CLOCK"]) == 1


def test_the_stated_sign_is_that_of_the_physics() -> None:
    """A spring that pulls to the origin: at x > 0 the drives must push ahead to hold the robot."""
    pulled = load_model("paper").with_effect("tether", stiffness=5.0)
    held = pulled.wrench(np.zeros(3), np.zeros(3), pose=np.array([2.0, 0.0, 0.0]))
    assert held[0] > 0.0
