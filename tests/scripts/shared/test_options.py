"""Files that are whole or not there, tables at 80 columns, and silent progress."""

from __future__ import annotations

import io
import json
import os
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from youbot_env.errors import InputError
from youbot_env.files import atomic_path
from youbot_scripts.shared import options as common


def test_json_has_only_plain_values(tmp_path: Path):
    target = tmp_path / "result.json"
    data = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "number": np.float32(0.5),
        "count": np.int64(3),
        "flag": np.bool_(True),
        "tuple": (1, float("nan")),
        "path": Path("a/b"),
        2: None,
    }
    common.write_json(target, data)
    assert json.loads(target.read_text()) == {
        "array": [[1.0, None], [None, 2.0]],
        "number": 0.5,
        "count": 3,
        "flag": True,
        "tuple": [1, None],
        "path": "a/b",
        "2": None,
    }


def test_floats_survive_the_round_trip_to_the_bit(tmp_path: Path):
    values = np.random.default_rng(0).normal(size=100) * 10.0 ** np.arange(-50, 50)
    common.write_json(tmp_path / "f.json", values)
    assert json.loads((tmp_path / "f.json").read_text()) == values.tolist()


def test_what_json_cannot_hold_leaves_no_file(tmp_path: Path):
    with pytest.raises(TypeError):
        common.write_json(tmp_path / "f.json", {"a": object()})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, failure):
    target = tmp_path / "plot.csv.gz"
    target.write_text("old")
    with pytest.raises(failure), atomic_path(target) as stand_in:
        assert stand_in.name.endswith(".csv.gz")
        stand_in.write_text("half")
        raise failure
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_that_cannot_be_written_is_the_users_error(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be written"):
        common.write_text(tmp_path / "missing" / "f.json", "text")
    with pytest.raises(InputError, match="cannot be written"):
        common.write_text(tmp_path, "text")
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_a_link(tmp_path: Path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    link.symlink_to(real)
    common.write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_device_is_written_in_place(tmp_path: Path):
    common.write_text("/dev/null", "text")
    assert not Path("/dev/null").is_file()


def test_new_files_have_the_usual_permissions(tmp_path: Path):
    common.write_text(tmp_path / "ours", "")
    (tmp_path / "usual").touch()
    assert os.stat(tmp_path / "ours").st_mode == os.stat(tmp_path / "usual").st_mode


def test_dash_is_standard_output(capsys):
    common.write_result(common.STDOUT, {"a": 1}, seed=7)
    result = json.loads(capsys.readouterr().out)
    assert result["a"] == 1
    assert (result["seed"], result["version"]) == (7, version("youbot"))
    assert set(result["versions"]) == {"python", "numpy", "scipy", "numba"}


def test_tables_go_to_stderr_when_the_json_goes_to_stdout(capsys):
    common.console(common.STDOUT).print("table")
    common.console(Path("f.json")).print("[m/s]")
    assert capsys.readouterr() == ("[m/s]\n", "table\n")


def test_no_result_file_unless_asked_for(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    common.write_result(None, {"a": 1})
    assert list(tmp_path.iterdir()) == []


def test_progress_is_silent_without_a_terminal(capsys):
    with common.progress(3, "fitting") as advance:
        advance()
        advance(2)
    assert capsys.readouterr() == ("", "")


def test_an_interrupt_gives_the_terminal_its_cursor_back(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    with pytest.raises(KeyboardInterrupt), common.progress(3, "fitting") as advance:
        advance()
        raise KeyboardInterrupt
    show, hide = "\x1b[?25h", "\x1b[?25l"
    assert "fitting" in terminal.getvalue()
    assert terminal.getvalue().rindex(show) > terminal.getvalue().rindex(hide)
