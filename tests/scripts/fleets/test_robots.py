"""Which folders are robots, what their results rest on, and which results count."""

from __future__ import annotations

from pathlib import Path

import pytest

from youbot_env.errors import InputError
from youbot_scripts.fleets.records import MODELS, ROBOTS, RobotFiles, make_folders
from youbot_scripts.fleets.robots import fingerprint, robots_of


def make(folder: Path, *logs: str) -> Path:
    folder.mkdir(parents=True)
    for name in logs:
        (folder / name).write_text(f"{name}\n")
    return folder


def test_a_folder_with_logs_is_a_robot_and_one_without_holds_robots(tmp_path: Path):
    one = make(tmp_path / "b", "run.csv", "more.csv.gz", "truth.json")
    make(tmp_path / "site" / "c", "x.parquet")
    make(tmp_path / "site" / "a")
    found = robots_of([one, tmp_path / "site"])
    assert [robot.name for robot in found] == ["a", "b", "c"]
    assert [path.name for path in found[1].logs] == ["more.csv.gz", "run.csv"]
    assert found[0].logs == (), "it is told of among those that could not be read"


def test_two_robots_of_one_name_are_refused(tmp_path: Path):
    folders = [make(tmp_path / site / "r1", "run.csv") for site in ("x", "y")]
    with pytest.raises(InputError, match="robot 'r1' is in .*x/r1 too"):
        robots_of(folders)
    with pytest.raises(InputError, match="no such folder"):
        robots_of([tmp_path / "none"])


def test_a_result_rests_on_each_log_its_name_and_the_options(tmp_path: Path):
    folder = make(tmp_path / "r", "a.csv", "b.csv")
    seen = set()

    def now(given: str = "seed 0") -> str:
        return fingerprint(robots_of([folder])[0], given)

    seen.add(now())
    assert now() in seen
    (folder / "a.csv").write_text("changed")
    seen.add(now())
    (folder / "b.csv").rename(folder / "c.csv")
    seen.add(now())
    (folder / "c.csv").unlink()
    seen.add(now())
    seen.add(now("seed 1"))
    assert len(seen) == 5


NAMES = ("r1", "..", "a/b", "Ü %2F", "CON")


@pytest.mark.parametrize("name", NAMES)
def test_results_stay_in_their_folder_whatever_a_robot_is_called(tmp_path: Path, name: str):
    make_folders(tmp_path)
    files = RobotFiles(tmp_path, name)
    files.model.write_text("{}")
    files.write({"robot": name, "fingerprint": "f"}, {"cpu": 1.0})
    assert {path.parent.name for path in tmp_path.rglob("*.json")} == {ROBOTS, MODELS}
    read = files.read("f")
    assert read == ({"robot": name, "fingerprint": "f"}, {"cpu": 1.0})


def test_a_result_counts_only_whole_unchanged_and_of_the_same_logs(tmp_path: Path):
    make_folders(tmp_path)
    files = RobotFiles(tmp_path, "r")
    assert files.read("f") is None
    files.write({"robot": "r", "fingerprint": "f"}, {"cpu": 1.0})
    assert files.read("f") is None, "its model is missing"
    files.model.write_text("{}")
    assert files.read("f") and files.read("other") is None
    path = tmp_path / ROBOTS / "r.json"
    whole = path.read_text()
    path.write_text(whole.replace('"r"', '"s"'))
    assert files.read("f") is None, "changed by hand"
    path.write_text(whole[: len(whole) // 2])
    assert files.read("f") is None, "torn"


def test_a_fault_of_the_program_is_tried_again_and_a_refusal_is_not(tmp_path: Path):
    make_folders(tmp_path)
    files = RobotFiles(tmp_path, "r")
    files.write({"fingerprint": "f", "error": "a.csv: row 2: no number"}, {"cpu": 0.1})
    assert files.read("f")
    files.write(
        {"fingerprint": "f", "error": "KeyError: x", "error_class": "KeyError"}, {"cpu": 0.1}
    )
    assert files.read("f") is None and files.read("f", failed=True)
