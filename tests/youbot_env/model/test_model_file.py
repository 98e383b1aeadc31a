"""Model files: what goes in comes out, nothing half-written, and no file that surprises."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, model
from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_env.model import model_file
from youbot_env.model.model_file import (
    load_geometry,
    load_model,
    model_to_dict,
    save_model,
    shipped_models,
)
from youbot_env.physics.geometry import Geometry


def content() -> dict[str, Any]:
    """A model file's content with something in each of its fields."""
    m = model("wheel_coulomb_friction")
    names = ("m0", "mu1", "wheel_coulomb_friction.torque")
    return model_to_dict(
        replace(
            m,
            covariance=np.array([[0.04, 1e-4, 0.0], [1e-4, 1e-4, 0.0], [0.0, 0.0, 1e-4]]),
            covariance_names=names,
            logs=({"name": "a.csv", "sha256": "0" * 64},),
            errors={"force_error": 0.01},
            provenance={"seed": 0},
        )
    )


@pytest.mark.parametrize("case", CASES)
def test_round_trip(tmp_path: Path, case: str):
    m = model(case)
    save_model(tmp_path / "m.json", m)
    again = load_model(tmp_path / "m.json")
    assert again.values == m.values
    assert again.structure == m.structure
    assert again.geometry == m.geometry
    assert model_to_dict(again) == model_to_dict(m)


def test_round_trip_of_all_that_a_fit_leaves(tmp_path: Path):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(content()))
    m = load_model(path)
    save_model(tmp_path / "again.json", m)
    assert model_to_dict(load_model(tmp_path / "again.json")) == content()
    np.testing.assert_array_equal(m.covariance, np.array(content()["covariance"]["matrix"]))
    assert m.covariance_names[-1] == "wheel_coulomb_friction.torque"
    assert m.parameters["m0"].std is None


def test_the_file_is_as_the_contract_says(tmp_path: Path):
    """Field names that other tools rely on."""
    data = content()
    assert set(data["parameters"]) == {"m0", "I0", "I1", "aX", "aY", "mu1", "mu2"}
    assert data["parameters"]["m0"] == {"value": 35.3, "unit": "kg", "std": None}
    effect = data["effects"]["wheel_coulomb_friction"]["parameters"]
    assert effect["torque"] == {"value": 0.25, "unit": "N m", "std": None}
    assert data["geometry"] == {"l": 0.15, "h": 0.2355, "R": 0.0475, "r": 0.014, "m1": 1.4}
    assert isinstance(data["schema_version"], int)


def test_what_json_lacks_is_written_as_null(tmp_path: Path):
    errors = {
        "force_error": np.float64(np.nan),
        "by_axis": np.array([1.0, np.inf]),
        "n": np.int64(3),
    }
    m = replace(model("base"), errors=errors, provenance={"path": Path("a"), "flag": True})
    save_model(tmp_path / "m.json", m)
    again = load_model(tmp_path / "m.json")
    assert again.errors == {"force_error": None, "by_axis": [1.0, None], "n": 3}
    assert again.provenance == {"path": "a", "flag": True}


def test_the_papers_model_ships():
    m = load_model("paper")
    assert shipped_models() == ("paper",)
    assert m.geometry == Geometry()
    published = {"m0": 35.3, "I0": 4.4, "I1": 6.0e-3, "aX": 0.016, "aY": -0.026}
    assert m.values == published | {"mu1": 0.11, "mu2": 5.78e-3}
    assert load_model(m) is m


# --- writing ---------------------------------------------------------------------------------


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "m.json"
    save_model(path, model("base"))
    before = path.read_bytes()

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(model_file.os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        save_model(path, model("floor_tilt"))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]


def test_writing_follows_links_and_spares_devices(tmp_path: Path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    link.symlink_to(real)
    write_atomically(link, "new")
    assert link.is_symlink() and real.read_text() == "new"
    write_atomically(os.devnull, "gone")
    assert not Path(os.devnull).is_file()


def test_a_place_that_cannot_be_written_to_is_named(tmp_path: Path):
    for place in (tmp_path / "no" / "m.json", tmp_path):
        with pytest.raises(InputError, match="cannot be written"):
            save_model(place, model("base"))


def test_a_new_file_has_the_users_permissions(tmp_path: Path):
    save_model(tmp_path / "m.json", model("base"))
    (tmp_path / "plain").touch()
    assert (tmp_path / "m.json").stat().st_mode == (tmp_path / "plain").stat().st_mode


# --- files that cannot be used ---------------------------------------------------------------

Change = Callable[[dict[str, Any]], Any]


def find(data: dict[str, Any], path: str) -> tuple[Any, Any]:
    """The container and the key at a path such as ``parameters/m0``."""
    holder: Any = data
    *way, last = (int(key) if key.isdigit() else key for key in path.split("/"))
    for key in way:
        holder = holder[key]
    return holder, last


def put(path: str, value: Any) -> Change:
    def change(data: dict[str, Any]) -> None:
        holder, key = find(data, path)
        holder[key] = value

    return change


def drop(path: str) -> Change:
    def change(data: dict[str, Any]) -> None:
        holder, key = find(data, path)
        del holder[key]

    return change


COULOMB = "effects/wheel_coulomb_friction/parameters"

MALFORMED: dict[str, tuple[Change, str]] = {
    "no version": (drop("schema_version"), "schema_version"),
    "later version": (put("schema_version", 99), "schema_version is 99"),
    "version in words": (put("schema_version", "1"), "schema_version"),
    "version true": (put("schema_version", True), "schema_version"),
    "another mechanism": (put("mechanism", "axis"), "not a mecanum"),
    "no geometry": (drop("geometry"), "geometry must be"),
    "geometry list": (put("geometry", [1, 2]), "geometry must be"),
    "no wheel radius": (drop("geometry/R"), "geometry lacks 'R'"),
    "negative wheel radius": (put("geometry/R", -0.05), "geometry R"),
    "radius in words": (put("geometry/R", "5 cm"), "geometry.R"),
    "no parameters": (drop("parameters"), "parameters must be"),
    "mass missing": (drop("parameters/m0"), "'m0' is missing"),
    "mass null": (put("parameters/m0", None), "parameters.m0"),
    "mass in words": (put("parameters/m0/value", "35 kg"), "parameters.m0"),
    "mass true": (put("parameters/m0/value", True), "parameters.m0"),
    "mass nan": (put("parameters/m0/value", float("nan")), "parameters.m0"),
    "mass infinite": (put("parameters/m0/value", float("inf")), "parameters.m0"),
    "mass huge": (put("parameters/m0/value", 10**400), "parameters.m0"),
    "mass nested": (put("parameters/m0/value", {"value": 35}), "parameters.m0"),
    "mass negative": (put("parameters/m0/value", -35.3), "must be positive"),
    "mass of the wheels": (put("parameters/m0/value", 5.6), "four wheels"),
    "grams": (put("parameters/m0/unit", "g"), "unit 'g', expected 'kg'"),
    "negative std": (put("parameters/m0/std", -1.0), "std"),
    "std in words": (put("parameters/m0/std", "small"), "std"),
    "centre of mass outside": (put("parameters/aX/value", 3.0), "positive definite"),
    "negative friction": (put("parameters/mu1/value", -0.1), "mu1"),
    "unknown parameter": (put("parameters/mass", 35.3), "unknown parameter 'mass'"),
    "effects list": (put("effects", ["floor_tilt"]), "effects must be"),
    "unknown effect": (put("effects/rust", {"parameters": {}}), "unknown effect 'rust'"),
    "effect null": (put("effects/wheel_coulomb_friction", None), "wheel_coulomb_friction"),
    "effect parameter missing": (drop(f"{COULOMB}/torque"), "'torque' is missing"),
    "effect parameter unknown": (put(f"{COULOMB}/force", 1.0), "unknown parameter 'force'"),
    "effect out of bounds": (put(f"{COULOMB}/torque/value", -1.0), "outside"),
    "smoothing zero": (put(f"{COULOMB}/smoothing/value", 0.0), "outside"),
    "two drives in words": (put("effects/actuator_lag", {"parameters": "x"}), "actuator_lag"),
    "covariance list": (put("covariance", [1]), "covariance must be"),
    "covariance names": (put("covariance/names", 5), "names must be"),
    "covariance unknown": (put("covariance/names", ["a", "b", "c"]), "covariance"),
    "covariance shape": (put("covariance/matrix", [[1.0]]), "3 x 3"),
    "covariance ragged": (put("covariance/matrix", [[1], [1, 2], [3]]), "3 x 3"),
    "covariance words": (put("covariance/matrix", [["a"] * 3] * 3), "3 x 3"),
    "covariance null": (put("covariance/matrix", None), "matrix must be"),
    "covariance asymmetric": (put("covariance/matrix/0", [0.04, 1.0, 0.0]), "symmetric"),
    "covariance negative": (put("covariance/matrix/0", [-1.0, 1e-4, 0.0]), "covariance"),
    "logs number": (put("logs", 5), "logs must be"),
    "logs of words": (put("logs", ["a.csv"]), "logs[0] must be"),
    "errors list": (put("errors", [1]), "errors must be"),
    "name of two lines, no mass": (
        lambda data: (put("name", "two\nlines")(data), put("parameters/m0/value", -1)(data)),
        "must be positive",
    ),
}


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_model(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 1000
    assert message.startswith(f"{path}: ")
    return message


@pytest.mark.parametrize("kind", MALFORMED)
def test_malformed_content_is_one_clear_line(tmp_path: Path, kind: str):
    change, expected = MALFORMED[kind]
    data = copy.deepcopy(content())
    change(data)
    path = tmp_path / "m"  # a short name, which may well be part of the message
    path.write_text(json.dumps(data))
    assert expected in refused(path)


RAW: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "row 1, column 1: not valid JSON"),
    "torn": (json.dumps({"schema_version": 1}).encode()[:-5], "not valid JSON"),
    "a log": (b"time,velocity_fl\n0,1\n", "not valid JSON"),
    "a list": (b"[]", "must be a JSON object"),
    "a number": (b"1", "must be a JSON object"),
    "null": (b"null", "must be a JSON object"),
    "binary": (bytes(range(256)), "not a text file"),
    "byte order mark": (b"\xef\xbb\xbf{}", "schema_version is None"),
    "deep": (b"[" * 100_000, "not valid JSON"),
    "endless number": (b'{"schema_version": ' + b"1" * 5000 + b"}", "not valid JSON"),
    "single quotes": (b"{'schema_version': 1}", "not valid JSON"),
}


@pytest.mark.parametrize("kind", RAW)
def test_what_is_no_model_file_is_one_clear_line(tmp_path: Path, kind: str):
    raw, expected = RAW[kind]
    path = tmp_path / "m.json"
    path.write_bytes(raw)
    assert expected in refused(path)


def test_missing_folder_null_byte_and_locked_files(tmp_path: Path):
    assert "no such file" in refused(tmp_path / "missing.json")
    assert "paper" in refused(tmp_path / "missing.json")
    assert "cannot be read" in refused(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load_model("a\0b")
    if os.geteuid() != 0:
        locked = tmp_path / "locked.json"
        locked.touch(mode=0o000)
        assert "Permission denied" in refused(locked)


def test_loading_never_runs_code(tmp_path: Path):
    """Strings that look like code, a pickle, a template or a path stay strings."""
    trap = tmp_path / "trap"
    strings = [
        f"__import__('os').system('touch {trap}')",
        f"!!python/object/apply:os.system ['touch {trap}']",
        f"$(touch {trap})",
        f"{{{{ open('{trap}', 'w') }}}}",
        f"cos\nsystem\n(S'touch {trap}'\ntR.",
    ]
    data = content() | {
        "name": strings[0],
        "logs": [{"name": text, "sha256": text} for text in strings],
        "errors": {text: text for text in strings},
        "provenance": {"__class__": strings[0], "py/object": strings[1]},
        "__reduce__": strings,
    }
    path = tmp_path / "m.json"
    path.write_text(json.dumps(data))
    m = load_model(path)
    assert m.name == strings[0]
    assert m.provenance["__class__"] == strings[0]
    assert not trap.exists()
    data["effects"] = {strings[0]: {"parameters": {}}}
    path.write_text(json.dumps(data))
    assert "unknown effect" in refused(path)
    assert not trap.exists()


# --- geometry files --------------------------------------------------------------------------


def test_geometry_comes_from_a_file_a_model_or_a_name(tmp_path: Path):
    other = {"l": 0.2, "h": 0.3, "R": 0.06, "r": 0.011, "m1": 2.0}
    plain, whole = tmp_path / "g.json", tmp_path / "m.json"
    plain.write_text(json.dumps(other))
    whole.write_text(json.dumps(content() | {"geometry": other}))
    assert load_geometry(plain) == load_geometry(whole) == Geometry(0.2, 0.3, 0.06, 0.011, 2.0)
    assert load_geometry("paper") == Geometry()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ({}, "geometry lacks 'l'"),
        ({"l": 0.1, "h": 0.2, "R": 0.05, "r": 0.01}, "geometry lacks 'm1'"),
        ({"l": 0, "h": 0.2, "R": 0.05, "r": 0.01, "m1": 1}, "geometry l"),
        ({"l": 0.1, "h": 0.2, "R": 0.05, "r": "x", "m1": 1}, "geometry.r"),
        ({"l": 0.1, "h": 0.2, "R": 0.05, "r": 0.01, "m1": -1}, "geometry m1"),
        ([1], "must be a JSON object"),
    ],
)
def test_a_geometry_that_cannot_be_is_one_clear_line(tmp_path: Path, data: Any, expected: str):
    path = tmp_path / "g.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as caught:
        load_geometry(path)
    assert expected in str(caught.value) and str(caught.value).startswith(f"{path}: ")
