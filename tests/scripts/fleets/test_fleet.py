"""A fleet of axes: resumed, killed, on several backends, and with a user's own effects."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from identification.diagnosis.structures import Ranking
from identification.logs.reading import write_log
from identification.mechanisms.axis_model import axis_model, save_axis_model
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from youbot_scripts.cli import main
from youbot_scripts.fleets import diagnosing
from youbot_scripts.fleets.diagnosing import accepted_p_values
from youbot_scripts.fleets.records import LINES, MODELS, ROBOTS


@dataclass(frozen=True)
class Fleet:
    """Folders of three healthy axes, one with a spring, and one whose log is none."""

    robots: Path
    model: Path

    def diagnosed(self, output: Path, *options: str) -> dict[str, Any]:
        """The JSON result of the command."""
        told = output.parent / f"{output.name}.json"
        status = main([*self.command(output), "--json", str(told), *options])
        assert status == 0
        return json.loads(told.read_text())

    def command(self, output: Path) -> list[str]:
        return ["fleet", "diagnose", str(self.model), str(self.robots), "-o", str(output)]


@pytest.fixture(scope="module")
def axes(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    folder = tmp_path_factory.mktemp("fleet")
    robots = folder / "robots"
    for number, name in enumerate(("a", "b", "c", "spring")):
        effects = ("spring",) if name == "spring" else ()
        values = STAGE | {"coulomb": STAGE["coulomb"] * (1 + 0.01 * number)}
        (robots / name).mkdir(parents=True)
        log = log_of(*planted(values, *effects), 50.0, noise=0.05)
        write_log(robots / name / "drive.csv", replace(log, name="drive"))
    (robots / "dead").mkdir()
    (robots / "dead" / "drive.csv").write_text("time,velocity,effort\n0,x,1\n")
    save_axis_model(folder / "axis.json", axis_model(*planted(STAGE)))
    return Fleet(robots, folder / "axis.json")


@pytest.fixture(scope="module")
def once(axes: Fleet, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The fleet's results, made in this process."""
    output = tmp_path_factory.mktemp("once") / "out"
    return output, axes.diagnosed(output, "--jobs", "1", "--audit", "0")


def same(output: Path, other: Path) -> bool:
    """Whether lines and models of two runs are the same bytes."""
    return all(
        (output / name).read_bytes() == (other / name).read_bytes()
        for name in [LINES, *(f"{MODELS}/{path.name}" for path in (other / MODELS).iterdir())]
    )


def test_a_robot_each_with_its_model_and_the_reason_where_there_is_none(once):
    output, found = once
    assert found["robots"] == 5 and found["verdicts"] == {"adequate": 3, "effect": 1}
    assert found["screen"]["by"] == {"screen": 3, "diagnosis": 1}
    assert [(row["robot"], row["effect"]) for row in found["findings"]] == [("spring", "spring")]
    assert [row["robot"] for row in found["unread"]] == ["dead"]
    assert found["unread"][0]["reason"].startswith("drive.csv: row 2")
    lines = [json.loads(line) for line in (output / LINES).read_text().splitlines()]
    assert [line["robot"] for line in lines] == ["a", "b", "c", "dead", "spring"]
    assert {path.stem for path in (output / MODELS).iterdir()} == {"a", "b", "c", "spring"}


def test_the_p_value_is_that_with_which_an_effect_won():
    """In some logs only it was tried too, and chance does as much there."""
    won: Any = SimpleNamespace(name="torque_saturation")
    first = Ranking((), {"torque_saturation": 0.001, "torque_saturation@2": 1.0}, (), won, 1.0, 0.1)
    last = Ranking((), {"cable_drag": 0.6}, (), None, 1.0, 0.1)
    assert accepted_p_values([first, last]) == {"torque_saturation": 0.001}


@pytest.mark.slow
def test_two_processes_give_the_bytes_of_one(axes: Fleet, once, tmp_path: Path):
    axes.diagnosed(tmp_path / "out", "--jobs", "2", "--audit", "0")
    assert same(tmp_path / "out", once[0])


def test_only_what_is_missing_changed_or_torn_is_done_again(axes, once, tmp_path, monkeypatch):
    done: list[str] = []
    real = diagnosing._diagnosed

    def counted(task):
        done.append(task.robot.name)
        return real(task)

    monkeypatch.setattr(diagnosing, "_diagnosed", counted)
    output = tmp_path / "out"
    for name in (ROBOTS, MODELS):
        (output / name).mkdir(parents=True)
        for path in (once[0] / name).iterdir():
            (output / name / path.name).write_bytes(path.read_bytes())
    record = output / ROBOTS / "b.json"
    record.write_text(record.read_text()[:-20])
    (output / MODELS / "a.json").unlink()
    axes.diagnosed(output, "--jobs", "1", "--audit", "0")
    assert sorted(done) == ["a", "b"] and same(output, once[0])
    axes.diagnosed(output, "--jobs", "1", "--audit", "0", "--seed", "1")
    assert len(done) == 2 + 5, "another seed is another question"


def test_an_audit_diagnoses_robots_that_the_screen_passes(axes: Fleet, tmp_path: Path):
    found = axes.diagnosed(tmp_path / "out", "--jobs", "1", "--audit", "1")
    assert found["screen"]["by"] == {"diagnosis": 4}
    assert found["screen"]["misses"]["count"] == 0 and found["screen"]["misses"]["total"] == 3


def test_a_fault_of_one_robot_does_not_stop_the_others(axes, tmp_path, monkeypatch):
    real = diagnosing.identify

    def breaks(logs, **options):
        if "b/" in logs[0].source:
            raise ZeroDivisionError("by zero")
        return real(logs, **options)

    monkeypatch.setattr(diagnosing, "identify", breaks)
    found = axes.diagnosed(tmp_path / "out", "--jobs", "1", "--audit", "0")
    assert found["unread"][0] == {"robot": "b", "reason": "ZeroDivisionError: by zero"}
    assert not (tmp_path / "out" / MODELS / "b.json").exists()


def test_a_report_shows_effects_outliers_and_what_could_not_be_read(axes, once, tmp_path, capsys):
    page = tmp_path / "fleet.html"
    status = main([*axes.command(once[0]), "--audit", "0", "--report", str(page)])
    assert status == 0
    told = capsys.readouterr().out
    assert "5 robots: 3 adequate, 1 effect, 1 could not be diagnosed" in told
    text = page.read_text()
    assert all(f'data-for="{name}"' in text for name in ("effects", "parameters"))
    assert "dead" in text and "drive.csv: row 2" in text and "spring" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fleet", "diagnose", "paper", "nowhere", "-o", "out"], "no such folder"),
        (["fleet", "diagnose", "no.json", ".", "-o", "out"], "no.json"),
        (["fleet", "drive", "paper", ".", "-o", "out"], "diagnose"),
    ],
)
def test_a_mistake_is_one_line(arguments, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_run_that_is_killed_loses_no_robot_and_ends_as_if_it_was_not(
    axes: Fleet, once, tmp_path: Path
):
    output = tmp_path / "out"
    command = [sys.executable, "-m", "youbot_scripts.cli", *axes.command(output), "--audit", "0"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: any((output / ROBOTS).glob("*.json")))
    run.send_signal(signal.SIGKILL)
    run.wait()
    kept = {path: path.stat().st_mtime_ns for path in (output / ROBOTS).glob("*.json")}
    axes.diagnosed(output, "--jobs", "1", "--audit", "0")
    assert same(output, once[0])
    assert all(path.stat().st_mtime_ns == before for path, before in kept.items())


def wait_for(what, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("backend", "library"), [("ray", "ray"), ("dask", "distributed")])
def test_a_cluster_of_two_workers_gives_the_same_bytes(
    axes: Fleet, once, tmp_path: Path, backend: str, library: str
):
    if find_spec(library) is None:
        pytest.skip(f"{library} is not installed: pip install 'youbot[{backend}]'")
    output = tmp_path / "out"
    command = [*axes.command(output), "--audit", "0", "--backend", backend, "--jobs", "2"]
    # In a process of its own: a cluster's library leaves threads and settings behind.
    script = "import sys\nfrom youbot_scripts.cli import main\n"
    script += "if __name__ == '__main__':\n    sys.exit(main(sys.argv[1:]))\n"
    (tmp_path / "run.py").write_text(script)
    run = subprocess.run(
        [sys.executable, str(tmp_path / "run.py"), *command],
        capture_output=True, text=True, timeout=300, env=os.environ | {"COLUMNS": "80"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert same(output, once[0])
