"""What a record hides, and what a comparison of two records finds."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest

from tests.behaviour import cases, compare, normalise, record
from tests.behaviour.compare import differences
from tests.behaviour.steps import Code

PATHS = {"/home/anna/tmp/behaviour-1": "<folder>", "/home/anna": "<home>"}


def shown(raw: str) -> str:
    return "\n".join(normalise.text(raw, PATHS))


def found(before, after, relative: float = 0.0) -> list[str]:
    return [path for path, _, _ in differences(before, after, relative)]


# --- what is hidden --------------------------------------------------------------------------


def test_paths_durations_and_versions_are_hidden():
    assert shown("/home/anna/tmp/behaviour-1/a.csv: 3 rows") == "<folder>/a.csv: 3 rows"
    assert shown("512 steps, 31 s (29 s of one core), seed 0") == (
        "512 steps, <duration> (<duration> of one core), seed 0"
    )
    assert shown(" seconds a case, median        1.53   ").split() == (
        ["seconds", "a", "case,", "median", "<duration>"]
    )
    assert shown("version 0.1.0, seed 4, numpy 2.4.6") == (
        "version <version>, seed 4, numpy <version>"
    )
    result = {"version": "0.1.0", "wall_time": 3.2, "versions": {"numpy": "2.4.6"}}
    assert normalise.value(result, {}) == {
        "version": normalise.VERSION,
        "wall_time": normalise.DURATION,
        "versions": normalise.VERSION,
    }


def test_nothing_else_is_hidden():
    for text in (
        "error: a.csv: row 3, column time: time does not increase",
        "m0  35.41 ± 0.20   35.01 ... 35.81   kg",
        " I           0-34 s      6   0.8 x1 + x2 + x5 - 0.2 x7",
        "140.0 s at 100 Hz, noise 0.01 rad/s; 20 s of it",
        "schema_version is 9, this version of youbot reads 1",
    ):
        assert shown(text) == text
    result = {"duration": 140.0, "time": [1.0, 2.5], "schema_version": 1, "std": None}
    assert normalise.value(result, PATHS) == result


def test_of_a_crash_only_the_place_is_hidden():
    crash = (
        "before\nTraceback (most recent call last):\n"
        '  File "/home/anna/a.py", line 3, in f\n    g()\nKeyError: 3\nafter'
    )
    assert shown(crash).splitlines() == [
        "before",
        "Traceback (most recent call last):",
        "KeyError: 3",
        "after",
    ]
    assert shown("/home/anna/a.py:3: RuntimeWarning: overflow\n  x = a / b\nm0") == (
        "RuntimeWarning: overflow\nm0"
    )


def test_a_table_is_kept_as_numbers_with_the_hash_of_all(tmp_path: Path):
    rows = "".join(f"{k},{k / 7}\n" for k in range(100))
    for name, content in (("a.csv", f"time,x\n{rows}"), ("b.csv", f"time,x\n{rows}".upper())):
        (tmp_path / name).write_text(content)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress((tmp_path / "a.csv").read_bytes()))
    table = normalise.file(tmp_path / "a.csv", {})
    assert table["columns"] == ["time", "x"] and table["rows"] == 100
    assert table["some"]["x"][1] == pytest.approx(table["some"]["time"][1] / 7)
    assert normalise.file(tmp_path / "a.csv.gz", {}) == table
    assert normalise.file(tmp_path / "b.csv", {})["sha256"] != table["sha256"]


# --- what is found ---------------------------------------------------------------------------


def test_a_changed_number_is_found_by_its_path():
    before = {"m0": {"value": 35.3}, "rows": [1.0, 2.0]}
    after = {"m0": {"value": 35.300000000000004}, "rows": [1.0, 2.0]}
    assert found(before, before) == []
    assert found(before, after) == ["/m0/value"]
    assert found(before, after, 1e-12) == []
    assert found(before, after, 1e-17) == ["/m0/value"]


def test_numbers_are_held_against_the_list_that_they_stand_in():
    before, after = {"x": [1000.0, 1e-9], "y": 1e-9}, {"x": [1000.0, 3e-9], "y": 3e-9}
    assert found(before, after, 1e-9) == ["/y"]
    assert found([float("nan"), 1.0], [float("nan"), 1.0]) == []
    assert found([float("nan")], [1.0], 1e-3) == ["[0]"]
    assert found([1], [True]) == ["[0]"]


def test_a_changed_word_is_found_whatever_the_tolerance():
    before = {"stdout": ["Verdict: effect", "- the floor falls by 1.06 degrees"]}
    rounded = {"stdout": ["Verdict: effect - the floor", "falls by 1.07 degrees"]}
    changed = {"stdout": ["Verdict: unknown", "- the floor falls by 1.06 degrees"]}
    assert found(before, rounded) == ["/stdout[0]", "/stdout[1]"]
    assert found(before, rounded, 1e-6) == []
    assert found(before, changed, 1e-6) == ["/stdout from word 2"]
    assert found({"verdict": "effect"}, {"verdict": "adequate"}, 0.1) == ["/verdict"]
    assert found(["x1 + x2"], ["x1 + x3"], 0.1) == [" from word 3"]


def test_what_is_missing_or_new_is_found():
    assert found({"a": 1, "b": 2}, {"a": 1, "c": 2}) == ["/b", "/c"]
    assert found([1.0, 2.0], [1.0]) == [""]
    assert found({"status": 0}, {"status": "timeout"}, 0.5) == ["/status"]
    assert found({"std": None}, {"std": 0.0}, 0.5) == ["/std"]


def test_the_command_tells_differences_and_lone_cases(tmp_path: Path, capsys):
    for folder, value in (("before", 1.0), ("after", 1.1)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.json").write_text("{}")
        (tmp_path / folder / "_about.json").write_text(str(value))
        (tmp_path / folder / "many.json").write_text(json.dumps({"x": [value] * 100}))
    (tmp_path / "before" / "lone.json").write_text("{}")
    one, other = str(tmp_path / "before"), str(tmp_path / "after")
    assert compare.main([one, other]) == 1
    printed = capsys.readouterr().out
    assert f"only in {one}: lone" in printed
    assert "many/x[0]\n    before 1.0\n    after  1.1" in printed
    assert printed.count("before 1.0") == compare.MOST and "many: 60 more" in printed
    assert "2 cases compared, 1 differ" in printed
    assert compare.main([one, other, "--relative", "0.2"]) == 0
    assert compare.main([one, str(tmp_path)]) == 2


# --- what is recorded ------------------------------------------------------------------------


def test_cases_and_their_steps_have_names_of_their_own(tmp_path: Path):
    everything = cases.cases()
    names = [case.name for case in everything]
    assert len(set(names)) == len(names)
    for case in everything:
        steps = [step.name or " ".join(step.words[:2]) for step in case.steps]
        assert len(set(steps)) == len(steps), case.name
    assert all(cases.missing(c, Code(tmp_path, tmp_path)) for c in everything if c.needs)


def test_a_record_is_not_written_over_another(tmp_path: Path, capsys):
    (tmp_path / "case.json").write_text("{}")
    assert record.main([str(tmp_path), "--only", "nothing of this name"]) == record.UNUSABLE
    assert "--resume" in capsys.readouterr().err
