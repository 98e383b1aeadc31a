"""What the workbench says and advises, from results as the commands write them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from youbot_scripts.interactive.advice import advice, diagnosis_on_the_way, named_left, sentences
from youbot_scripts.interactive.panel import cards_of
from youbot_scripts.interactive.project import DONE, Project, Step

FRICTION, TILT = "wheel_coulomb_friction", "floor_tilt"
MISFIT = "the force error is 7 times the noise floor; next: youbot diagnose m.json a.csv"


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project of two logs, of which one is chosen."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("time\n")
    return Project.open(tmp_path, "", ["a.csv"])


def end(project: Project, step: Step, **found: Any) -> None:
    """A command has ended and written its result."""
    (project.folder / step.result).write_text(json.dumps(found))
    project.finished(step, DONE)


def force(error: float) -> dict[str, float]:
    return {"force_error": error, "velocity_error": error}


def identified(project: Project, error: float = 0.2) -> None:
    errors = {"force_error": error, "noise_floor": {"force_error": 0.01}}
    end(project, project.identify(), errors=errors, misfit=MISFIT if error > 0.02 else None)


def diagnosed(project: Project, *missing: str) -> None:
    end(
        project, project.diagnose(), headline=f"lacks {missing}", words=[], missing=list(missing),
        verdict="effect" if missing else "adequate", candidates=[], ambiguous_with={},
    )  # fmt: skip


def added(project: Project, effect: str, error: float) -> None:
    end(
        project, project.add(effect), effect=effect, before=force(0.2), after=force(error),
        noise_floor=force(0.01), worthwhile=True, reasons=[], words="dry friction",
        misfit=MISFIT if error > 0.02 else None,
    )  # fmt: skip


def compared(project: Project, step: Step, error: float, *, seen: bool = False) -> None:
    logs = {"a": {"seen_in_fit": seen}}
    floor, misfit = force(0.01), MISFIT if error > 0.02 else None
    end(project, step, total=force(error), noise_floor=floor, logs=logs, misfit=misfit)


def says(project: Project) -> str:
    return " ".join([*sentences(project), *(item.text for item in advice(project))])


def pressed(project: Project) -> tuple[str, str]:
    """What the first button does."""
    (first, *_) = advice(project)
    return first.do, first.which


def test_undo_brings_the_verdict_of_that_model_back(project: Project):
    identified(project)
    diagnosed(project, FRICTION)
    before = says(project)
    added(project, FRICTION, 0.01)
    assert "20.00 % → 1.00 %" in says(project) and "It fits." in says(project)
    diagnosed(project)
    assert pressed(project) == ("drive", "")
    project.undo()
    assert says(project) == before and pressed(project) == ("add", FRICTION)
    project.undo()
    assert sentences(project) == [], "nothing was found out of the published model"


def test_two_causes_are_added_one_after_the_other(project: Project):
    identified(project)
    diagnosed(project, FRICTION, TILT)
    assert pressed(project) == ("add", FRICTION) and "then floor tilt" in says(project)
    added(project, FRICTION, 0.09)
    assert named_left(project) == [TILT] and pressed(project) == ("add", TILT)
    added(project, TILT, 0.01)
    assert named_left(project) == [] and "It fits." in says(project)


def test_what_still_lacks_something_is_diagnosed_again(project: Project):
    identified(project)
    assert pressed(project) == ("diagnose", "")
    diagnosed(project, FRICTION, TILT)
    # Not what was named: what it named may be explained now.
    added(project, "dead_zone", 0.1)
    assert named_left(project) == [] and pressed(project) == ("diagnose", "")
    assert "still lacks something" in says(project)


def test_a_diagnosis_of_the_published_model_holds_once_it_is_fitted(project: Project):
    diagnosed(project, FRICTION)
    identified(project)
    assert pressed(project) == ("add", FRICTION)
    added(project, FRICTION, 0.01)
    identified(project)
    # Now one without the effect, of which nothing was said.
    assert diagnosis_on_the_way(project)[0] is None and pressed(project) == ("diagnose", "")


def test_errors_say_on_which_logs_they_are(project: Project):
    identified(project)
    assert "on the logs that the model was fitted to" in says(project)
    assert "known only roughly while something is missing" in says(project)
    diagnosed(project, FRICTION)
    assert "held out" in says(project)
    added(project, FRICTION, 0.01)
    assert "held out" in says(project)
    other, own = project.compare()
    compared(project, other, 0.2)
    compared(project, own, 0.01)
    assert "20.00 % → 1.00 % on logs that its fit has not seen" in says(project)
    (again,) = project.compare()
    compared(project, again, 0.01, seen=True)
    assert "1.00 % on the logs that the model was fitted to" in says(project)


def test_a_log_is_to_be_kept_back_where_all_are_chosen(project: Project):
    assert "Keep one log back" not in says(project)
    project.choose(project.logs)
    assert "Keep one log back" in says(project)
    identified(project, 0.01)
    assert "drop another one" in says(project)


def test_named_candidates_come_first_and_each_once():
    names = ("dead_zone", "dead_zone", "uneven", FRICTION, "x1", "x2", "x3", "x4", TILT)
    found = {
        "candidates": [{"effect": name, "p_value": k} for k, name in enumerate(names)],
        "ambiguous_with": {FRICTION: ["uneven"]},
    }
    leading, others = cards_of(found, [FRICTION, TILT])
    assert [item["effect"] for item in leading] == [FRICTION, TILT, "uneven"]
    assert [item["effect"] for item in others] == ["dead_zone", "x1", "x2"]
    assert others[0]["p_value"] == 0, "the first of two"
    assert len(cards_of(found, [])[1]) == 6
