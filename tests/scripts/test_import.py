"""`youbot import`: what it writes, what it asks, and that the way on is said."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from identification.logs.reading import read_log
from tests.identification.importing.layouts import (
    LOG,
    joined,
    names,
    plain,
    plotjuggler_half_empty as plotjuggler,
    rows,
)
from youbot_scripts import cli


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_plain_file_needs_one_command(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "foreign.csv").write_text(plotjuggler())
    assert cli.main(["import", "foreign.csv", "-o", "log.csv"]) == 0
    shown = capsys.readouterr().out
    assert "log.csv: 599 rows" in shown and "velocity, effort" in shown
    assert len(read_log("log.csv")) == 599
    # The map that was used reads it again.
    assert cli.main(["import", "foreign.csv", "-o", "again.csv", "--map", "log.map.toml"]) == 0
    assert (here / "again.csv").read_bytes() == (here / "log.csv").read_bytes()


def test_what_is_asked_comes_with_the_command_to_go_on(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = [["1.70E+09", *row[1:]] for row in rows(LOG)]
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    (here / "excel.csv").write_text(joined(header, body))
    assert cli.main(["import", "excel.csv", "-o", "log.csv"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and not (here / "log.csv").exists()
    command = re.search(r"then: (youbot import .*)$", said.strip())
    assert command is not None
    assert cli.main(shlex.split(command[1])[1:]) == 0
    assert len(read_log("log.csv")) == len(LOG)
    assert "CHECK" in (here / "log.map.toml").read_text()


def test_show_tells_topics_columns_and_reasons(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "foreign.csv").write_text(plotjuggler())
    assert cli.main(["import", "foreign.csv", "--show", "--json", "show.json"]) == 0
    shown = capsys.readouterr().out
    assert "velocity_fl (rad/s)" in shown and "[velocity]" in shown
    (found,) = json.loads((here / "show.json").read_text())["sources"]
    assert found["why"]["velocity"] and not found["undecided"]
    used = [column["used"] for column in found["tables"][0]["columns"]]
    assert "effort_br (N m)" in used
    assert cli.main(["import", "foreign.csv", "--show", "-o", "robot.toml"]) == 0
    assert "[velocity]" in (here / "robot.toml").read_text()


def test_a_folder_takes_a_log_of_each_source_and_stretch(here: Path) -> None:
    body = rows(LOG)
    late = [[f"{float(row[0]) + 12:.5f}", *row[1:]] for row in body[300:]]
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    (here / "gap.csv").write_text(joined(header, body[:300] + late))
    (here / "twice.csv").write_text(joined(header, body + [[r[0], *r[2:], r[1]] for r in body]))
    (here / "whole.csv").write_text(plain())
    sources = ["gap.csv", "twice.csv", "whole.csv"]
    assert cli.main(["import", *sources, "-o", "runs"]) == 0
    made = sorted(path.name for path in (here / "runs").glob("*.csv"))
    assert made == ["gap_1.csv", "gap_2.csv", "twice_1.csv", "twice_2.csv", "whole.csv"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no.csv", "-o", "log.csv"], "no.csv: no such file"),
        (["foreign.csv"], "where to? -o LOG.csv"),
        (["foreign.csv", "-o", "log.txt"], "log.txt: is no name of a log; end it in .csv"),
        (["foreign.csv", "-o", "no/log.csv"], "no/log.csv"),
        (["foreign.csv", "-o", "log.csv", "--map", "no.toml"], "no.toml: no such file; `youbot"),
        (["foreign.csv", "--show", "--json", "."], "is a folder"),
    ],
)
def test_mistakes_are_one_line(
    arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "foreign.csv").write_text(plain())
    assert cli.main(["import", *arguments]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("youbot: error: ") and message in said
    assert not (here / "log.csv").exists()


def test_doctor_prints_the_command_that_reads_a_foreign_file(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "foreign.csv").write_text(plotjuggler())
    assert cli.main(["doctor", "foreign.csv"]) == 2
    command = re.search(r"this reads it: (youbot import .*)", capsys.readouterr().out)
    assert command is not None
    assert cli.main(shlex.split(command[1])[1:]) == 0
    assert cli.main(["doctor", "foreign_log.csv"]) == 0


def test_export_and_back(here: Path) -> None:
    pytest.importorskip("mcap")
    pytest.importorskip("rosbags")
    (here / "log.csv").write_text(plain())
    assert cli.main(["import", "log.csv", "-o", "log.mcap"]) == 0
    assert cli.main(["import", "log.mcap", "-o", "back.csv"]) == 0
    assert read_log("back.csv").velocity == pytest.approx(read_log("log.csv").velocity)
