"""Every kind of file that is read: what no file may hold is refused with one line, by all alike.

A new kind of file is tested by one more entry of `KINDS`.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.kinematic import Gains
from controllers.policy.policy_file import load_policy, save_policy
from controllers.tuning.gains_file import load_gains, save_gains
from identification.logs.log import Log
from identification.logs.recorded_motion import recorded_motion
from identification.mechanisms.axis import AXIS, Axis, default_theta
from identification.mechanisms.axis_effects import Scales
from identification.mechanisms.axis_model import axis_model, save_axis_model
from identification.mechanisms.registry import load_any_model
from youbot_env.errors import InputError
from youbot_env.files import MAX_DEPTH, FileKind, read_bytes, read_json
from youbot_env.model.model_file import load_geometry, load_model, save_model
from youbot_env.motions.calibration import motion_iii
from youbot_env.physics.geometry import WHEELS
from youbot_env.physics.mechanism import ModelStructure
from youbot_scripts.recording.named_motions import motions_named
from youbot_scripts.shared.results_folder import append_result, read_results

PAPER = load_model("paper")


@dataclass(frozen=True)
class Kind:
    """A kind of file: how a good one is made at a path, how it is read, where it holds a number.

    unknown: the cause where a key is added, None if it may be
    """

    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    number: tuple[str, ...]
    name: str = "file.json"
    unknown: str | None = None
    may_hold_nan: bool = False


def write_model(path: Path) -> None:
    names = ("m0", "mu1")
    covariance = np.array([[0.04, 1e-4], [1e-4, 1e-4]])
    fitted = replace(PAPER, covariance=covariance, covariance_names=names)
    save_model(path, fitted)


def write_axis(path: Path) -> None:
    axis = Axis(Scales(True, 1.0, 2.0, 3.0, 4.0), ModelStructure(("spring",), AXIS))
    model = axis_model(axis, default_theta(axis))
    covariance = np.array([[0.04, 1e-4], [1e-4, 1e-4]])
    names = ("inertia", "viscous")
    save_axis_model(path, replace(model, covariance=covariance, covariance_names=names))


def write_run(path: Path) -> None:
    from youbot_scripts.training.run_folder import RunFolder
    from youbot_scripts.training.settings import LEARNERS, Choice

    RunFolder(path.parent).begin(Choice("ppo", LEARNERS["ppo"]), PAPER, "youbot train ppo")


def read_run(path: Path) -> Any:
    from youbot_scripts.training.run_folder import RunFolder

    return RunFolder(path.parent).asked()


def geometry(path: Path) -> None:
    path.write_text(json.dumps({"l": 0.2, "h": 0.3, "R": 0.06, "r": 0.011, "m1": 2.0}))


KINDS: dict[str, Kind] = {
    "model": Kind(write_model, load_model, ("parameters", "m0", "value")),
    "model of any mechanism": Kind(write_model, load_any_model, ("parameters", "m0", "value")),
    "axis model": Kind(write_axis, load_any_model, ("parameters", "inertia", "value")),
    "geometry": Kind(geometry, load_geometry, ("R",)),
    "gains": Kind(
        lambda path: save_gains(path, Gains(0.5, 4.0, 0.02)),
        load_gains,
        ("gains", "integral", "value"),
        unknown="unknown key 'stranger'; known are schema_version",
    ),
    "policy": Kind(
        lambda path: save_policy(path, *load_policy("ppo")),
        load_policy,
        ("action", "torque_limit"),
        unknown="unknown key 'stranger'; known are schema_version",
    ),
    "motion": Kind(
        lambda path: path.write_text(json.dumps(motion_iii().to_dict() | {"name": "m"})),
        lambda path: motions_named(str(path), PAPER.geometry, 0),
        ("duration",),
        unknown="field 'stranger' is unknown",
    ),
    "results": Kind(
        lambda path: append_result(path.parent, {"key": "a", "rmse": [0.1]}),
        lambda path: read_results(path.parent, lambda record: record["key"]),
        ("rmse",),
        name="results.jsonl",
        unknown="was changed by hand",
        may_hold_nan=True,
    ),
}
if importlib.util.find_spec("torch"):
    KINDS["run"] = Kind(
        write_run, read_run, ("model", "parameters", "m0", "value"), name="run.json"
    )


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


@pytest.fixture
def path(kind: Kind, tmp_path: Path) -> Path:
    kind.write(tmp_path / kind.name)
    return tmp_path / kind.name


def content(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text("utf-8"))


def put(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content) + "\n", "utf-8")


def with_number(kind: Kind, path: Path, literal: str) -> None:
    """Put a literal where the file holds a number."""
    found = content(path)
    holder: Any = found
    for key in kind.number[:-1]:
        holder = holder[key]
    holder[kind.number[-1]] = "HERE"
    path.write_text(json.dumps(found).replace('"HERE"', literal) + "\n")


def refused(kind: Kind, path: Path) -> str:
    """The one line of a refusal; nothing is written on the way."""
    before = {p.name: p.read_bytes() for p in path.parent.iterdir()}
    with pytest.raises(InputError) as caught:
        kind.read(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 1000
    assert message.startswith(f"{path}: ")
    assert before == {p.name: p.read_bytes() for p in path.parent.iterdir()}
    return message


def test_a_good_file_is_read(kind: Kind, path: Path):
    assert kind.read(path) is not None


def test_a_key_given_twice_is_refused(kind: Kind, path: Path):
    text = path.read_text().strip()
    path.write_text('{"twice": 1, "twice": 2, ' + text[1:] + "\n")
    assert "key 'twice' is given twice" in refused(kind, path)


@pytest.mark.parametrize("literal", ["1e400", "-1e400", "1" * 400, "NaN", "-Infinity"])
def test_a_number_that_is_none_is_refused_by_its_path(kind: Kind, path: Path, literal: str):
    with_number(kind, path, literal)
    if kind.may_hold_nan and literal != "1" * 400:
        assert "was changed by hand" in refused(kind, path)
        return
    message = refused(kind, path)
    assert "is not a finite number" in message and ".".join(kind.number) in message


@pytest.mark.parametrize(
    ("name", "key"), [("model", "m0"), ("model", "I1"), ("axis model", "coulomb")]
)
def test_numbers_that_overflow_together_are_one_line(name: str, key: str, tmp_path: Path):
    kind, path = KINDS[name], tmp_path / "m.json"
    kind.write(path)
    found = content(path)
    found["parameters"][key]["value"] = 1e308
    put(path, found)
    try:
        kind.read(path)
    except InputError:
        refused(kind, path)


@pytest.mark.parametrize("number", [1e308, -1e308, 5e-324])
@pytest.mark.parametrize("stands", ["X", "O"])
@pytest.mark.parametrize("key", ["l", "h", "R", "r", "m1", "torque_limit", "speed_limit"])
def test_lengths_of_any_size_are_read_or_refused(
    key: str, stands: str, number: float, tmp_path: Path
):
    path = tmp_path / "g.json"
    geometry(path)
    put(path, content(path) | {"arrangement": stands, key: number})
    try:
        load_geometry(path)
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("key", ["duration", "frequency", "speed"])
def test_motions_of_any_size_are_read_or_refused(key: str, tmp_path: Path):
    kind, path = KINDS["motion"], tmp_path / "m.json"
    kind.write(path)
    put(path, content(path) | {key: 1e308})
    try:
        kind.read(path)
    except InputError:
        refused(kind, path)


@pytest.mark.parametrize("mechanism", ["arm", 1, ["axis"], {"a": 1}, None, [], {}, ""])
def test_a_mechanism_that_is_none_is_refused(mechanism: Any, tmp_path: Path):
    kind, path = KINDS["model of any mechanism"], tmp_path / "m.json"
    kind.write(path)
    put(path, content(path) | {"mechanism": mechanism})
    assert "unknown mechanism" in refused(kind, path)


def test_an_integer_of_thousands_of_digits_is_refused(kind: Kind, path: Path):
    with_number(kind, path, "1" * 5000)
    assert "not valid JSON" in refused(kind, path)


@pytest.mark.parametrize("opening, closing", [("[", "]"), ('{"a":', "}")])
def test_nesting_without_end_is_refused(kind: Kind, path: Path, opening: str, closing: str):
    with_number(kind, path, opening * MAX_DEPTH + "1" + closing * MAX_DEPTH)
    assert f"nested more than {MAX_DEPTH} deep" in refused(kind, path)
    with_number(kind, path, opening * 100_000 + "1" + closing * 100_000)
    assert "not valid JSON" in refused(kind, path)


@pytest.mark.parametrize("other", [[1], 1, "text", None, True])
def test_what_is_no_object_is_refused(kind: Kind, path: Path, other: Any):
    put(path, other)
    assert "must be a JSON object" in refused(kind, path)


@pytest.mark.parametrize("other", ["text", [1.0], True, None])
def test_a_value_of_another_type_is_refused_by_its_path(kind: Kind, path: Path, other: Any):
    if kind.name == "results.jsonl":
        pytest.skip("a result holds what its command wrote")
    with_number(kind, path, json.dumps(other))
    assert kind.number[-1] in refused(kind, path)


def test_unknown_keys_are_refused_where_a_file_has_no_room_for_them(kind: Kind, path: Path):
    put(path, content(path) | {"stranger": 1})
    if kind.unknown is None:
        assert kind.read(path) is not None
    else:
        assert kind.unknown in refused(kind, path)


def test_a_file_cut_short_is_refused(kind: Kind, path: Path):
    whole = path.read_bytes().strip()
    # A line of results that is empty is none.
    empty = () if kind.name == "results.jsonl" else (0,)
    for size in (*empty, 1, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size] + b"\n")
        assert "not valid JSON" in refused(kind, path)


@pytest.mark.parametrize("bad", [b"\xff\xfe{}\n", b'{"\xe9": 1}\n', b"\xef\xbb\xbf{\n", b"\0\n"])
def test_what_is_no_utf8_text_is_refused(kind: Kind, path: Path, bad: bytes):
    path.write_bytes(bad)
    message = refused(kind, path)
    assert any(
        cause in message for cause in ("not a text file", "not valid JSON", "is UTF-16 text")
    )


def test_a_byte_order_mark_is_no_fault(kind: Kind, path: Path):
    """Editors on Windows write one."""
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert kind.read(path) is not None


def test_a_terminals_commands_in_a_file_do_not_reach_it(kind: Kind, path: Path):
    evil = "\x1b]0;owned\x07\x1b[31m\u202e\u2028"
    put(path, content(path) | {evil: {"a": 1e308}})
    if kind.unknown:
        assert refused(kind, path).isprintable()
    with_number(kind, path, json.dumps(evil))
    if kind.name != "results.jsonl":
        assert refused(kind, path).isprintable()


def test_a_strangers_text_does_not_fill_the_screen(kind: Kind, path: Path):
    long = "x" * 100_000
    put(path, content(path) | {long: {"a": 1e308}})
    if kind.unknown:
        refused(kind, path)
    with_number(kind, path, json.dumps(long))
    if kind.name != "results.jsonl":
        refused(kind, path)


@pytest.mark.parametrize("effect", [1, {"parameters": {"x" * 100_000: "x"}}, {"parameters": {}}])
def test_nor_does_a_strangers_path(effect: Any, tmp_path: Path):
    kind, path = KINDS["model"], tmp_path / "m.json"
    kind.write(path)
    put(path, content(path) | {"effects": {"x" * 100_000: effect}})
    refused(kind, path)


def test_a_million_keys_with_one_twice_are_refused_at_once(tmp_path: Path):
    path = tmp_path / "m.json"
    keys = [f'"{k}":0' for k in range(10**6)]
    path.write_text("{" + ",".join([*keys, keys[-1]]) + "}")
    assert "key '999999' is given twice" in refused(KINDS["model"], path)


def test_other_versions_are_refused(kind: Kind, path: Path):
    found = content(path)
    if "schema_version" not in found:
        pytest.skip("a kind without versions")
    for version in (2, 0, True, "1", None, [1]):
        put(path, found | {"schema_version": version})
        assert "this version of youbot reads 1" in refused(kind, path)


@pytest.mark.parametrize("name", ["model", "axis model"])
@pytest.mark.parametrize(
    ("matrix", "cause"),
    [
        ([[0.04, 1e-3], [1e-4, 1e-4]], "symmetric"),
        ([[0.04, 0.0], [0.0, -1e-4]], "variances"),
        ([[1.0, 2.0], [2.0, 1.0]], "positive semidefinite"),
        ([[1e-300, 1e300], [1e300, 1e-300]], "too far apart"),
        ([[1.0]], "2 x 2"),
        ([[1.0, 0.0], [0.0]], "2 x 2"),
        ([["a", "b"], ["c", "d"]], "2 x 2"),
        ("text", "covariance.matrix must be a JSON list"),
    ],
)
def test_what_is_no_covariance_is_refused(name: str, matrix: Any, cause: str, tmp_path: Path):
    kind = KINDS[name]
    path = tmp_path / kind.name
    kind.write(path)
    found = content(path)
    put(path, found | {"covariance": found["covariance"] | {"matrix": matrix}})
    assert cause in refused(kind, path)
    for names in (["a", "b"], [found["covariance"]["names"][0]] * 2):
        put(path, found | {"covariance": found["covariance"] | {"names": names}})
        assert "must be parameters, each once" in refused(kind, path)


def test_a_file_is_never_read_past_its_limit(tmp_path: Path):
    kind = FileKind("a small file", {}, lambda content, source: content, None, max_bytes=1 << 20)
    large = tmp_path / "large.json"
    large.write_text('{"a": "' + "x" * (1 << 20) + '"}')
    with pytest.raises(InputError, match="is larger than 1 MiB"):
        read_json(large, kind)
    if os.path.exists("/dev/zero"):
        with pytest.raises(InputError, match="is larger than 1 MiB"):
            read_bytes("/dev/zero", 1 << 20)


def test_a_record_that_cannot_be_read_tells_no_motion(tmp_path: Path):
    zeros = np.zeros((2, 4))
    log = Log("m", WHEELS, np.arange(2.0), zeros, zeros, source=str(tmp_path / "m.csv"))
    motion = motion_iii().to_dict() | {"name": "m"}
    good = {"logs": {"m.csv": {"sha256": log.sha256}}, "motions": [motion]}
    put(tmp_path / "record.json", good)
    assert recorded_motion(log) is not None
    for bad in ([], {"logs": []}, good | {"motions": [1]}, good | {"motions": [motion, motion]}):
        put(tmp_path / "record.json", bad)
        assert recorded_motion(log) is None
    (tmp_path / "record.json").write_text('{"logs": {}, ' + json.dumps(good)[1:])
    assert recorded_motion(log) is None
    (tmp_path / "record.json").unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "record.json")
        assert recorded_motion(log) is None


# --- journals of results ---------------------------------------------------------------------


def journal(folder: Path) -> list[str]:
    """Keys of the results in a folder, read as a resumed run reads them."""
    return list(read_results(folder, lambda record: record["key"]))


def filled(folder: Path) -> Path:
    for key in "abc":
        append_result(folder, {"key": key, "rmse": [0.1, math.nan], "name": "\ud800 ü"})
    return folder / "results.jsonl"


def test_results_come_back_as_they_were(tmp_path: Path):
    filled(tmp_path)
    found = read_results(tmp_path, lambda record: record["key"])["b"]
    assert found["name"] == "\ud800 ü" and math.isnan(found["rmse"][1]) and len(found) == 3


def test_a_last_line_without_its_end_is_kept_if_it_is_whole(tmp_path: Path):
    """Some editors leave the end out, and the next line must not join it."""
    path = filled(tmp_path)
    path.write_bytes(path.read_bytes()[:-1])
    assert journal(tmp_path) == ["a", "b", "c"]
    append_result(tmp_path, {"key": "d"})
    assert journal(tmp_path) == ["a", "b", "c", "d"]


@pytest.mark.parametrize("change", (b"\r\n", b"\n\n", b"\n \n"))
def test_blank_lines_and_ends_of_windows_are_no_fault(change: bytes, tmp_path: Path):
    path = filled(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", change))
    assert journal(tmp_path) == ["a", "b", "c"]


def test_a_line_that_was_changed_by_hand_is_told(tmp_path: Path):
    path = filled(tmp_path)
    for old, new in ((b'"b"', b'"x"'), (b"0.1", b"0.2"), (b'"rmse": [0.1, NaN]', b'"rmse": 3')):
        whole = path.read_bytes()
        lines = whole.split(b"\n")
        lines[1] = lines[1].replace(old, new)
        path.write_bytes(b"\n".join(lines))
        with pytest.raises(InputError, match=r"row 2: this trial was changed by hand.*remove the"):
            journal(tmp_path)
        path.write_bytes(whole)


def test_a_torn_line_is_removed_and_a_full_disk_loses_none(tmp_path: Path, monkeypatch):
    path = filled(tmp_path)
    whole = path.read_bytes()
    torn = whole + b'{"key": "d", "rm'
    path.write_bytes(torn)

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_bytes", full)
        with pytest.raises(InputError, match="No space left"):
            journal(tmp_path)
    assert path.read_bytes() == torn
    assert journal(tmp_path) == ["a", "b", "c"]
    assert path.read_bytes() == whole
