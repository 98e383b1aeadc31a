"""What the workbench's page shows of a project, as components: no browser is needed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dash")

from youbot_scripts.interactive import panel
from youbot_scripts.interactive.app import is_out_of_sight
from youbot_scripts.interactive.project import DONE, FAILED, RUNNING, Project, Step
from youbot_scripts.interactive.worker import DRAWN, Worker, drawn_last, shown_now


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project of a log."""
    (tmp_path / "a.csv").write_text("time\n")
    return Project.open(tmp_path, "", ["a.csv"])


@pytest.fixture
def worker(project: Project) -> Worker:
    """A worker that is asked what it would do."""
    return Worker(project)


def parts(shown: Any) -> Iterator[Any]:
    """All components and texts, outer ones first."""
    if isinstance(shown, (list, tuple)):
        for item in shown:
            yield from parts(item)
        return
    yield shown
    yield from parts(getattr(shown, "children", None) or [])


def text(shown: Any) -> str:
    return " ".join(item for item in parts(shown) if isinstance(item, str))


def draw(project: Project, step: Step) -> None:
    """As the worker does it."""
    folder = project.home / DRAWN / str(step.number)
    folder.mkdir(parents=True)
    (folder / "charts.json").write_text("{}")


def test_commands_keep_their_numbers(project: Project):
    for _ in range(9):
        project.finished(project.doctor(), DONE)
    rows = [part.value for part in parts(panel.commands(project)) if type(part).__name__ == "Li"]
    assert rows == [str(number) for number in range(9, 0, -1)]


def test_what_waits_is_said_and_can_be_cancelled(project: Project):
    project.identify().state = RUNNING
    project.diagnose()
    shown = panel.panel(project)
    assert "Identify ..." in text(shown) and "Then: Diagnose paper" in text(shown)
    cancel = [part.id for part in parts(shown) if getattr(part, "children", "") == "Cancel"]
    assert cancel == [{"do": "cancel", "with": "1"}, {"do": "cancel", "with": "2"}]
    bars = [part for part in parts(shown) if type(part).__name__ == "Progress"]
    assert len(bars) == 1 and not hasattr(bars[0], "value"), "how far it is is not known yet"


def test_charts_that_are_being_drawn_are_said(project: Project):
    project.drawing = "workbench/01_identified.json"
    assert "Drawing the charts of 01_identified.json" in text(panel.panel(project))


def test_why_a_command_failed_stands_on_top(project: Project):
    project.finished(project.identify(), FAILED, "no motion in the log")
    assert "Identify: failed: no motion in the log" in text(panel.panel(project))
    project.finished(project.doctor(), DONE)
    assert "no motion" not in text(panel.panel(project))


def test_controllers_were_driven_with_a_model_and_are_gone_with_it(project: Project):
    rows = [{"controller": "pid", "diverged": 0, "metrics": {"nrmse": {"mean": 0.5}}}]
    step = project.drive("paper", ["pid"])
    (project.folder / step.result).write_text(json.dumps({"results": rows}))
    project.finished(step, DONE)
    shown = text(panel.driven(project))
    assert "paper" in shown and "that model itself" in shown and "50.00 %" in shown
    assert "pid 50.00 %" in text(panel.panel(project)), "on top, as it has just been done"
    draw(project, step)
    assert drawn_last(project, "drive") is step
    project.finished(project.doctor(), DONE)
    assert "pid 50.00 %" not in text(panel.panel(project))
    project.finished(project.identify(), DONE)
    assert panel.driven(project) == [] and drawn_last(project, "drive") is None


def test_two_models_stand_side_by_side(project: Project):
    project.finished(project.identify(), DONE)
    steps = project.compare()
    for step, error in zip(steps, (0.2, 0.01), strict=True):
        errors = {"force_error": error, "velocity_error": None if error > 0.1 else 0.02}
        found = {"total": errors, "noise_floor": {"force_error": 0.01, "velocity_error": 0.01}}
        logs = {"a": {"seen_in_fit": True}}
        (project.folder / step.result).write_text(json.dumps({**found, "logs": logs}))
        project.finished(step, DONE)
    shown = text(panel.panel(project))
    for wanted in ("20.00 %", "1.00 %", "2.00 %", "diverges", "01_identified.json"):
        assert wanted in shown


def test_the_same_charts_are_not_drawn_twice(project: Project, worker: Worker):
    """Nor does a diagnosis replace charts of two models by those of one."""
    project.finished(identified := project.identify(), DONE)
    assert worker.is_to_be_drawn(identified)
    draw(project, identified)
    project.finished(made := project.add("floor_tilt"), DONE)
    assert worker.is_to_be_drawn(made)
    assert shown_now(project)["model"] is identified, "until then, the charts before stay"
    draw(project, made)
    assert shown_now(project)["model"] is made
    project.finished(step := project.diagnose(), DONE)
    assert not worker.is_to_be_drawn(step) and drawn_last(project, "diagnose") is made
    other, own = project.compare("paper")
    for step in (other, own):
        project.finished(step, DONE)
    assert not worker.is_to_be_drawn(other), "it speaks of another model"
    assert worker.is_to_be_drawn(own), "the published model was not beside it"
    project.undo()
    assert drawn_last(project, "compare") is shown_now(project)["model"] is identified


@pytest.mark.parametrize(
    ("marked", "span", "out"),
    [
        ([[1.0, 2.0]], None, False),
        ([[1.0, 2.0]], [3.0, 4.0], True),
        ([[1.0, 2.0], [3.5, 3.6]], [3.0, 4.0], False),
        ([], [3.0, 4.0], False),
    ],
)
def test_a_mark_that_nobody_sees_shows_the_whole_log(
    marked: list[list[float]], span: list[float] | None, out: bool
):
    assert is_out_of_sight(marked, span) is out


def test_a_card_has_the_sizes_that_were_fitted_with_the_proposed_law():
    def sizes(value: float) -> dict[str, Any]:
        return {"torque": {"value": value, "unit": "N m"}}

    item = {"effect": "yaw_scrub", "p_value": 0.001, "force_error": 0.1, "parameters": sizes(0.45)}
    other = {**item, "effect": "cable_drag"}
    joint = {"effects": {"yaw_scrub": {"parameters": sizes(0.3)}}}
    found = {
        "missing": ["yaw_scrub"],
        "ambiguous_with": {},
        "explained": [],
        "steps": [{"force_error": 0.2}],
        "proposal": {"joint_fit": joint},
    }
    told, of_other = (text(panel._card(one, found, set())) for one in (item, other))
    assert "torque = 0.3 N m" in told and "fitted with the proposed law" in told
    assert "torque = 0.45 N m" in of_other and "proposed law" not in of_other
    alone = text(panel._card(item, {**found, "proposal": None}, set()))
    assert "torque = 0.45 N m" in alone
