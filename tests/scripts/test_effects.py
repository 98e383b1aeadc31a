"""`youbot effects`: the catalogue as a person and as a program reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import sympy

from identification.mechanisms.axis_effects import AXIS_CATALOGUE, UNITS, Scales
from tests.youbot_env.test_plugins import DRAG, HEAD
from youbot_env.equations.equations import equation
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.mecanum import mecanum_structure
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


def sizes_shown(printed: str) -> list[str]:
    """The last column of the table, by line."""
    lines = [line.rstrip() for line in printed.splitlines()]
    first = next(k for k, line in enumerate(lines) if "──" in line) + 1
    return [line.split("  ")[-1].strip() for line in lines[first : lines.index("", first)]]


def test_catalogue_sizes_have_a_column(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["effects"]) == 0
    printed = capsys.readouterr().out
    header = printed.split("─")[0].split()
    assert header == ["Effects", "catalogue", "effect", "acts", "at", "parameters", "size"]
    expected = [
        f"{parameter.size:.4g}" if parameter.default is None else f"[{parameter.default:.4g}]"
        for item in CATALOGUE
        for parameter in item.public_parameters
    ]
    assert sizes_shown(printed) == expected


def test_the_catalogue_of_an_axis(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = tmp_path / "effects.json"
    assert cli.main(["effects", "--mechanism", "axis", "--json", str(path)]) == 0
    shown = capsys.readouterr().out
    assert max(len(line.rstrip()) for line in shown.split("Sizes are")[0].splitlines()) <= 80
    found = {row["name"]: row for row in json.loads(path.read_text())["effects"]}
    assert set(found) == set(AXIS_CATALOGUE.names())
    for item in AXIS_CATALOGUE:
        assert f" {item.name} " in shown and item.recognise in shown
        for parameter in item.parameters:
            entry = found[item.name]["parameters"][parameter.name]
            assert entry["unit"] == parameter.unit
            assert entry["size"] == (None if parameter.is_shape else parameter.size)
            # What it is a multiple of has the parameter's unit.
            scales = Scales(False, speed=2.0, acceleration=3.0, force=5.0, travel=7.0)
            typical = UNITS[parameter.unit].typical(scales)
            letters = {"F": 5.0, "v": 2.0, "a": 3.0, "x": 7.0, "s": 1.0}
            text = entry.get("times", "")
            value = float(sympy.sympify(text).subs(letters)) if text else 1.0
            assert value == pytest.approx(typical)


def test_the_equation_of_an_axis(capsys: pytest.CaptureFixture[str]):
    line = ["effects", "--mechanism", "axis", "spring", "cogging", "actuator_lag", "--equations"]
    assert cli.main(line) == 0
    assert capsys.readouterr().out.splitlines() == [
        "F = inertia v' + viscous v + coulomb tanh(v/smoothing) + offset + stiffness x"
        " + cosine cos(2 pi x/period) + sine sin(2 pi x/period)",
        "M_command = M + time_constant M'",
    ]
    assert cli.main([*line, "--latex"]) == 0
    assert r"\mathrm{inertia} \, \dot{v}" in capsys.readouterr().out


def test_json_on_standard_output_stands_alone(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["effects", "floor_tilt", "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert [row["name"] for row in json.loads(streams.out)["effects"]] == ["floor_tilt"]
    assert "floor_tilt" in streams.err


def test_equations_of_the_effects_named(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    assert cli.main(["effects", "--equations"]) == 0
    assert capsys.readouterr().out.strip() == equation(mecanum_structure())
    path = tmp_path / "e.json"
    names = ["floor_tilt", "actuator_lag"]
    assert cli.main(["effects", *names, "--equations", "--latex", "--json", str(path)]) == 0
    expected = equation(mecanum_structure(tuple(names)), "latex")
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
        (["--mechanism", "boat"], "unknown mechanism 'boat'"),
        (["--mechanism", "axis", "floor_tilt"], "unknown effect 'floor_tilt'"),
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
