"""`youbot effects`: the catalogue as a person and as a program reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.youbot_env.test_plugins import DRAG, HEAD
from youbot_env.dynamics import Structure
from youbot_env.effects import CATALOGUE
from youbot_env.symbolic import equation
from youbot_scripts import cli


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def test_every_effect_is_explained(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["effects"]) == 0
    shown = capsys.readouterr().out
    assert max(len(line.rstrip()) for line in shown.split("Effects")[1].splitlines()[:12]) <= 80
    for item in CATALOGUE:
        assert f" {item.name} " in shown, "a name must not fold at 80 columns"
        assert item.recognise in shown and item.acts_at.name in shown
        for parameter in item.public_parameters:
            assert parameter.name in shown and f"[{parameter.unit}]" in shown


def test_the_catalogue_as_json(tmp_path: Path):
    path = tmp_path / "effects.json"
    assert cli.main(["effects", "--json", str(path)]) == 0
    found = {row["name"]: row for row in json.loads(path.read_text())["effects"]}
    assert set(found) == set(CATALOGUE.names())
    for item in CATALOGUE:
        row = found[item.name]
        assert list(row["parameters"]) == list(item.public_names)
        assert row["acts_at"] == item.acts_at.name and row["recognise"] == item.recognise
        for name, entry in row["parameters"].items():
            assert entry["unit"] == item.public_parameter(name).unit
            assert (entry["size"] is None) == item.public_parameter(name).is_shape


def test_json_on_standard_output_stands_alone(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["effects", "floor_tilt", "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert [row["name"] for row in json.loads(streams.out)["effects"]] == ["floor_tilt"]
    assert "floor_tilt" in streams.err


def test_equations_of_the_effects_named(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    assert cli.main(["effects", "--equations"]) == 0
    assert capsys.readouterr().out.strip() == equation(Structure())
    path = tmp_path / "e.json"
    names = ["floor_tilt", "actuator_lag"]
    assert cli.main(["effects", *names, "--equations", "--latex", "--json", str(path)]) == 0
    expected = equation(Structure(tuple(names)), "latex")
    assert capsys.readouterr().out.strip() == expected
    assert json.loads(path.read_text())["equations"] == expected.splitlines()


def test_a_users_own_effects(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = tmp_path / "mine.py"
    path.write_text(DRAG)
    assert cli.main(["effects", "my_drag", "--effects", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "dM = coefficient phi' |phi'|" in shown and "floor_tilt" not in shown


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["rust"], "unknown effect 'rust'"),
        (["--effects", "missing.py"], "missing.py: no such file"),
        (["--json", "no/such/folder/f.json"], "does not exist"),
    ],
)
def test_mistakes_end_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
):
    assert cli.main(["effects", *arguments]) == 2
    error = capsys.readouterr().err
    assert expected in error and error.count("\n") == 1


def test_a_file_that_registers_nothing_ends_in_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    path = tmp_path / "mine.py"
    path.write_text(HEAD)
    assert cli.main(["effects", "--effects", str(path)]) == 2
    assert f"{path}: registers no effect" in capsys.readouterr().err
