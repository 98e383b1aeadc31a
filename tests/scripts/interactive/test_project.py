"""A workbench's project: every click is a command, and nothing is lost."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

from identification.logs.reading import write_log
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_scripts.interactive.project import CANCELLED, DONE, FAILED, RUNNING, Project
from youbot_scripts.interactive.worker import Worker


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project of one log; what is in the log does not matter here."""
    (tmp_path / "a b.csv").write_text("time\n")
    return Project.open(tmp_path, "", ["a b.csv"])


def test_clicks_are_commands(project: Project):
    identify, add = project.identify(), None
    project.finished(identify, DONE)
    assert project.model == identify.model == "workbench/01_identified.json"
    add = project.add("floor_tilt")
    words = shlex.split(add.command)
    assert words[:5] == ["youbot", "add", identify.model, "floor_tilt", "a b.csv"]
    assert words[5:] == ["-o", add.model, "--json", add.result]


def test_a_user_s_effects_go_with_every_command_that_reads_models(project: Project):
    project.effects = "mine.py"
    steps = [project.doctor(), project.identify(), project.diagnose(), project.add("x_spring")]
    steps += [*project.compare(), project.drive("paper", ["pid"])]
    for step in steps:
        project.finished(step, DONE)
        words = shlex.split(step.command)
        assert (words[-2:] == ["--effects", "mine.py"]) == (step.kind != "doctor")
    assert steps[-1].read_models == ["paper", "paper"] and steps[3].effect == "x_spring"
    assert project.script().count("--effects mine.py") == len(steps) - 1


OWN = """
from youbot_env import WORLD, Parameter, effect


@effect(
    acts_at=WORLD,
    parameters=[Parameter("stiffness", "N/m", size=5.0)],
    source="a rubber band",
    recognise="It pulls back to where the robot began.",
)
def x_spring(xp, world, stiffness):
    \"\"\"Force of a band along world X [N].\"\"\"
    return stiffness * world.x, 0.0, 0.0
"""


@pytest.mark.slow
def test_commands_with_a_user_s_effects_make_the_same_model_elsewhere(tmp_path: Path):
    """By the workbench's worker, and by the exported script in another folder: to the bit."""
    folder, again = tmp_path / "first", tmp_path / "again"
    for place in (folder, again):
        place.mkdir()
        (place / "mine.py").write_text(OWN)
        write_log(place / "drive.csv", recording("calibration", rate=50.0))
    project = Project.open(folder, "", ["drive.csv"])
    project.effects = "mine.py"
    worker = Worker(project)
    try:
        for act in (project.identify, lambda: project.add("x_spring")):
            worker.put(step := act())
            end = time.monotonic() + 120.0
            while step.is_open and time.monotonic() < end:
                time.sleep(0.1)
            assert step.state == DONE, step.message
    finally:
        worker.close()
    path = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    subprocess.run(
        ["sh", "-e"], input=project.script(), text=True, cwd=again, check=True,
        env={**os.environ, **path}, capture_output=True,
    )  # fmt: skip
    made = [json.loads((place / project.model).read_text()) for place in (folder, again)]
    assert made[0]["effects"]["x_spring"] == made[1]["effects"]["x_spring"]
    assert made[0]["parameters"] == made[1]["parameters"]


def test_undo_goes_back_and_the_export_forgets_it(project: Project):
    for step in (project.identify(), project.add("floor_tilt")):
        project.finished(step, DONE)
        last = step
    failed = project.diagnose()
    project.finished(failed, FAILED, "no such thing")
    project.undo()
    assert project.model == "workbench/01_identified.json" and last.undone
    script, cells = project.script(), json.loads(project.notebook())["cells"]
    assert "identify" in script and " add " not in script and "diagnose" not in script
    assert any("youbot identify" in cell["source"] for cell in cells)
    project.undo()
    project.undo()
    assert project.model == "paper", "there is nothing before the published model"


def test_two_models_are_compared_also_one_that_was_taken_back(project: Project):
    for step in (project.identify(), project.add("floor_tilt")):
        project.finished(step, DONE)
        last = step
    other, own = project.compare()
    assert other.subject == own.beside == "workbench/01_identified.json", "the version before"
    assert own.subject == last.model and other.logs == own.logs == ["a b.csv"]
    project.finished(other, DONE)
    (again,) = project.compare()
    assert again.beside == other.subject, "its errors are known: it is not compared anew"
    project.undo()
    assert [step.subject for step in project.compare(last.model)] == [last.model, other.subject]
    assert [step.beside for step in project.compare(project.model)] == [""]
    assert project.drive(last.model, ["pid"]).arguments[1:3] == ["--plant", last.model]
    with pytest.raises(InputError, match="is no model of this workbench"):
        project.compare("../other.json")


def _unmade(project: Project) -> list[str]:
    """Models that a command of the exported script reads and that none before it has made."""
    made, missing = {"paper"}, []
    for line in project.script().splitlines()[4:]:
        words = shlex.split(line)
        out = words[words.index("-o") + 1] if "-o" in words else ""
        read = [word for word in words if word.endswith(".json") and "result" not in word]
        missing += [word for word in read if word != out and word not in made]
        made.add(out)
    return missing


def test_the_script_makes_every_model_that_it_reads(project: Project):
    """Also after an undo: what was asked about the undone model goes with it, or it stays."""
    for act in (project.identify, project.diagnose, lambda: project.add("floor_tilt")):
        step = act()
        project.finished(step, DONE)
    gone = step.model
    for act in (project.diagnose, lambda: project.drive(gone, ["pid"])):
        project.finished(act(), DONE)
    project.undo()
    assert gone not in project.script() and _unmade(project) == []
    kinds = [step.kind for step in project.kept]
    assert kinds == ["identify", "diagnose"]
    # Driven on the undone model: now it is needed.
    project.finished(project.drive(gone, ["pid"]), DONE)
    assert gone in project.script() and _unmade(project) == []
    assert project.model != gone


def test_a_killed_server_loses_nothing(project: Project):
    step = project.identify()
    project.finished(step, DONE)
    project.diagnose().state = RUNNING
    project.changed()
    again = Project.open(project.folder, "", [])
    assert again.chosen == ["a b.csv"] and again.model == step.model
    assert [step.state for step in again.steps] == [DONE, CANCELLED]


@pytest.mark.parametrize("name", ["../../etc/passwd", "nowhere.csv", "/etc/hosts"])
def test_only_offered_logs_can_be_chosen(project: Project, name: str):
    with pytest.raises(InputError, match="is no log of this folder"):
        project.choose([name])


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../../x.csv", "x.csv"),
        ("-o.csv", "o.csv"),
        (".hidden.csv", "hidden.csv"),
        ("<b>&.csv", "_b__.csv"),
    ],
)
def test_dropped_files_stay_in_the_folder(project: Project, name: str, kept: str):
    assert project.dropped(name, b"time\n") == f"workbench/dropped/{kept}"
    assert (project.home / "dropped" / kept).read_bytes() == b"time\n"


def test_what_is_no_log_is_refused(project: Project):
    for name in ("run.py", "", "x"):
        with pytest.raises(InputError, match="a log ends with"):
            project.dropped(name, b"")


@pytest.mark.parametrize("name", ["--output", "floor tilt", "x;rm", ""])
def test_an_effect_is_a_name(project: Project, name: str):
    with pytest.raises(InputError, match="is no name of an effect"):
        project.add(name)


def test_a_plant_is_one_that_is_there(project: Project):
    with pytest.raises(InputError, match="is no model of this workbench"):
        project.drive("--help", ["pid"])


def test_the_script_is_plain_shell(project: Project):
    project.finished(project.doctor(), DONE)
    done = subprocess.run(["sh", "-n"], input=project.script(), text=True, capture_output=True)
    assert done.returncode == 0 and not done.stderr


def test_a_damaged_project_is_told_in_one_line(project: Project):
    (project.home / "project.json").write_text('{"steps": 3}')
    with pytest.raises(InputError, match=r"is it a project of the workbench"):
        Project.open(project.folder, "", [])
