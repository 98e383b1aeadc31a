"""`youbot export`: the files of each form, and one line where a form or an option cannot be."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.youbot_env.exports.c_compiler import compiled, run
from youbot_env import load_model, save_model
from youbot_scripts.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "export_c.md").read_text("utf-8")


def test_the_page_names_the_files_that_are_written(tmp_path: Path):
    command = ["export", "paper", "--to", "c", "-o", str(tmp_path), "--name", "base"]
    assert main(command) == 0
    shown = re.findall(r"^robot/(\S+)$", PAGE, re.MULTILINE)
    assert set(shown) == {path.name for path in tmp_path.iterdir()}
    # The names that its listing uses stand in the header.
    header = (tmp_path / "base_controller.hpp").read_text()
    listing = PAGE.split("```cpp")[1].split("```")[0]
    for name in set(re.findall(r"base_control::(\w+)|(?:state|reference)\.(\w+)", listing)):
        assert any(part and part in header for part in name), name


def test_c_is_written_and_compiles(tmp_path: Path, capsys):
    folder = tmp_path / "a" / "robot"
    command = ["export", "paper", "--to", "c", "-o", str(folder), "--rate", "250", "--delay", "2"]
    assert main([*command, "--name", "base", "--json", str(tmp_path / "r.json")]) == 0
    assert "base_controller.hpp" in capsys.readouterr().out
    written = json.loads((tmp_path / "r.json").read_text())["files"]
    assert sorted(Path(name).name for name in written) == sorted(p.name for p in folder.iterdir())
    header = (folder / "base_controller.h").read_text()
    assert "BASE_PERIOD 0.004" in header and "delay of commands: 0.008 s" in header
    sources = [path.name for path in folder.glob("*.c")]
    assert run(compiled("gcc", folder, sources, "driver")).endswith("passed\n")


def test_mjcf_and_json(tmp_path: Path):
    assert main(["export", "paper", "--to", "mjcf", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "youbot.xml").read_text().find("<mujoco") >= 0
    assert main(["export", "paper", "--to", "json", "-o", str(tmp_path)]) == 0
    assert load_model(tmp_path / "youbot.json").values == load_model("paper").values


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--to", "c", "--rate", "0"], "--rate"),
        (["--to", "c", "--rate", "1e308"], "sample_time"),
        (["--to", "c", "--rate", "1e-9"], "sample_time"),
        (["--to", "c", "--rate", "nan"], "--rate"),
        (["--to", "c", "--delay", "-1"], "--delay"),
        (["--to", "c", "--delay", "1e9"], "delay"),
        (["--to", "c", "--age", "1e9"], "measurement_delay"),
        (["--to", "c", "--name", "a b"], "a name of C"),
        (["--to", "json", "--name", "../x"], "a name of C"),
        (["--to", "ros"], "--to"),
    ],
)
def test_what_cannot_be_is_one_line(options, told, tmp_path: Path, capsys):
    assert main(["export", "paper", "-o", str(tmp_path / "out"), *options]) == 2
    told_lines = capsys.readouterr().err.splitlines()
    assert len(told_lines) == 1 and told in told_lines[0]
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_a_file(tmp_path: Path, capsys):
    (tmp_path / "out").write_text("")
    assert main(["export", "paper", "--to", "json", "-o", str(tmp_path / "out")]) == 2
    assert "cannot be made a folder" in capsys.readouterr().err


def test_a_model_that_bodies_cannot_have(tmp_path: Path, capsys):
    save_model(tmp_path / "m.json", load_model("paper").with_effect("torque_ripple", amplitude=0.1))
    assert main(["export", str(tmp_path / "m.json"), "--to", "mjcf", "-o", str(tmp_path)]) == 2
    assert "torque_ripple" in capsys.readouterr().err
