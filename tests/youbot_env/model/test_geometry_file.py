"""Geometry files: what is not the youBot's stands beside the five numbers, and may be left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from youbot_env.errors import InputError
from youbot_env.model.model_file import (
    LENGTHS,
    geometry_to_dict,
    load_geometry,
    load_model,
    save_model,
)
from youbot_env.physics.geometry import Geometry

LONG = Geometry(l=0.3, h=0.2, arrangement="O", torque_limit=3.0, speed_limit=9.0)
ODD = replace(Geometry(), roller_angles=(0.7, 0.8, 0.75, 0.83))


def written(folder: Path, **changes: Any) -> Path:
    """A geometry file of the youBot with some keys changed."""
    path = folder / "g.json"
    path.write_text(json.dumps(geometry_to_dict(Geometry()) | changes))
    return path


@pytest.mark.parametrize("geometry", [Geometry(), LONG, ODD])
def test_geometry_goes_out_and_comes_back(tmp_path: Path, geometry: Geometry):
    (tmp_path / "g.json").write_text(json.dumps({"geometry": geometry_to_dict(geometry)}))
    assert load_geometry(tmp_path / "g.json") == geometry
    model = replace(load_model("paper"), geometry=geometry)
    save_model(tmp_path / "m.json", model)
    again = load_model(tmp_path / "m.json")
    assert again.geometry == geometry == load_geometry(tmp_path / "m.json")
    assert again.mechanism is model.mechanism


def test_a_file_of_before_says_no_more_than_five_numbers(tmp_path: Path):
    assert set(geometry_to_dict(Geometry())) == set(LENGTHS)
    assert load_geometry(written(tmp_path)) == Geometry()


def test_one_angle_stands_for_four_and_nothing_for_the_usual(tmp_path: Path):
    found = load_geometry(written(tmp_path, roller_angles=0.7, torque_limit=None))
    assert found == replace(Geometry(), roller_angles=(0.7,) * 4)
    entry = {"value": 5.0, "unit": "rad/s"}
    assert load_geometry(written(tmp_path, speed_limit=entry)).max_wheel_speed == 5.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"arrangement": "Y"}, "arrangement"),
        ({"arrangement": ["X"]}, "arrangement"),
        ({"roller_angles": [0.7, 0.7, 0.7]}, "roller_angles"),
        ({"roller_angles": "45"}, "roller_angles"),
        ({"roller_angles": 45}, "in degrees"),
        ({"torque_limit": -2}, "torque_limit"),
        ({"torque_limit": "2"}, "torque_limit"),
        ({"speed_limit": 1e308, "R": 0.05}, ""),
        ({"speed_limit": {"value": "fast"}}, "speed_limit"),
    ],
)
def test_what_cannot_be_is_one_line_with_its_key(tmp_path: Path, changes: dict, said: str):
    if not said:
        assert load_geometry(written(tmp_path, **changes)).speed_limit == 1e308
        return
    with pytest.raises(InputError) as error:
        load_geometry(written(tmp_path, **changes))
    assert said in str(error.value) and "\n" not in str(error.value)
