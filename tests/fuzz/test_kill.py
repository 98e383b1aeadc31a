"""kill -9 in the middle of any write leaves the old file or the new one, and journals their lines.

Writes are slowed, so that a kill hits one: in small pieces with pauses, and pauses before the file
is on the disk and before it takes the place of the old one.
"""

from __future__ import annotations

import itertools
import os
import random
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from controllers.policy.policy_file import load_policy, save_policy
from identification import read_log, write_log
from tests.fuzz.readers import has
from tests.identification.healthy import healthy_log
from tests.scripts.test_files import KINDS
from youbot_env.files import write_atomically, write_json
from youbot_env.model.model_file import geometry_to_dict, load_geometry
from youbot_env.motions.calibration import motion_iii
from youbot_env.physics.geometry import Geometry
from youbot_scripts.interactive.project import Project
from youbot_scripts.shared.exported_files import LoopOptions, exported, write_files
from youbot_scripts.shared.results_folder import append_result, read_results

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and kill -9"),
]

KILLS, LONGEST = 12, 0.25
"""Kills of a kind of file, each up to so many seconds after the first write has begun."""


@dataclass(frozen=True)
class Writer:
    """Something that writes files: ``write(path, k)`` the k-th time, ``read(path)`` or raises."""

    name: str
    write: Callable[[Path, int], Any]
    read: Callable[[Path], Any]


def _log(ending: str) -> Writer:
    logs = [healthy_log(25.0, 12.0, seed=seed) for seed in (0, 1)]
    return Writer(f"log{ending}", lambda path, k: write_log(path, logs[k % 2]), read_log)


def _of_kinds() -> list[Writer]:
    # The journal grows, and a policy is two files: both have tests of their own. Geometries and
    # motions are written by the commands below.
    return [
        Writer(kind.name, lambda path, k, kind=kind: kind.write(path), kind.read)
        for name, kind in KINDS.items()
        if name not in ("results", "policy", "run", "geometry", "motion")
    ]


GEOMETRIES = (Geometry(), Geometry(arrangement="O", speed_limit=9.0))
HEAD, END = "<html>", "</html>\n"


def _page(path: Path) -> None:
    text = path.read_text("utf-8")
    assert text.startswith(HEAD) and text.endswith(END), text[-20:]


def _project(path: Path, k: int) -> None:
    project = Project.open(path.parents[1], "", [])
    project.revision = k
    project.changed()


WRITERS = {
    **{f"{writer.name} {k}": writer for k, writer in enumerate(_of_kinds())},
    "csv": _log(".csv"),
    "gz": _log(".csv.gz"),
    **({"parquet": _log(".parquet")} if has("pyarrow") else {}),
    "geometry": Writer(
        "geometry.json",
        lambda path, k: write_json(path, {"geometry": geometry_to_dict(GEOMETRIES[k % 2])}),
        load_geometry,
    ),
    "motion": Writer(
        "m.json", lambda path, k: write_json(path, motion_iii().to_dict()), KINDS["motion"].read
    ),
    "page": Writer(
        "page.html", lambda path, k: write_atomically(path, f"{HEAD}{k:09d}" * 400 + END), _page
    ),
    "project": Writer(
        "workbench/project.json", _project, lambda path: Project.open(path.parents[1], "", [])
    ),
}


class _Slow:
    """A file to which text is appended in small pieces."""

    def __init__(self, file: Any) -> None:
        self.file = file

    def __enter__(self) -> _Slow:
        return self

    def __exit__(self, *error: object) -> None:
        self.file.close()

    def write(self, text: str) -> None:
        data = text.encode()
        for start in range(0, len(data), max(len(data) // 8, 1)):
            self.file.write(data[start : start + max(len(data) // 8, 1)])
            time.sleep(0.002)


def slowed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every write through a path takes a while, and so does what makes it last."""

    def in_pieces(self: Path, data: bytes) -> int:
        with self.open("wb", buffering=0) as file:
            for start in range(0, len(data), max(len(data) // 8, 1)):
                file.write(data[start : start + max(len(data) // 8, 1)])
                time.sleep(0.002)
        return len(data)

    def late(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            time.sleep(0.004)
            return function(*arguments)

        return call

    opened = Path.open

    def slow_append(self: Path, mode: str = "r", *arguments: Any, **named: Any) -> Any:
        if mode == "a":
            return _Slow(opened(self, "ab", buffering=0))
        return opened(self, mode, *arguments, **named)

    monkeypatch.setattr(Path, "open", slow_append)
    monkeypatch.setattr(Path, "write_bytes", in_pieces)
    monkeypatch.setattr(os, "fsync", late(os.fsync))
    monkeypatch.setattr(os, "replace", late(os.replace))


def killed(write: Callable[[int], object], after: float) -> None:
    """Write without end in a process of its own, and kill it."""
    child = os.fork()
    if not child:
        try:
            for k in itertools.count(1):
                write(k)
        finally:
            os._exit(1)  # only an error ends it
    time.sleep(after)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status), "the writer failed by itself"


def times(seed: str) -> Iterator[float]:
    draw = random.Random(seed)
    for _ in range(KILLS):
        yield LONGEST * draw.random()


@pytest.mark.parametrize("name", WRITERS)
def test_the_old_file_or_the_new(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    writer = WRITERS[name]
    path = tmp_path / writer.name
    path.parent.mkdir(exist_ok=True)
    writer.write(path, 0)
    writer.read(path)
    slowed(monkeypatch)
    for after in times(name):
        killed(lambda k: writer.write(path, k), after)
        writer.read(path)


def test_a_policy_is_the_old_or_the_new_or_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two files: where only one of them is new, that is said, and nothing is played."""
    from youbot_env.errors import InputError

    path, one, other = tmp_path / "p.json", load_policy("ppo"), load_policy("residual_ppo")
    save_policy(path, *one)
    slowed(monkeypatch)
    for after in times("policy"):
        killed(lambda k: save_policy(path, *(one, other)[k % 2]), after)
        try:
            network, _ = load_policy(path)
        except InputError as error:
            assert "\n" not in str(error)
            monkeypatch.undo()
            save_policy(path, *one)
            slowed(monkeypatch)
        else:
            same = (network.mix.tobytes() == made[0].mix.tobytes() for made in (one, other))
            assert any(same)


def test_a_journal_keeps_every_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    append_result(tmp_path, {"key": "0", "rmse": [0.1]})
    slowed(monkeypatch)
    kept = 1
    for round_, after in enumerate(times("journal")):
        killed(
            lambda k, round_=round_: append_result(
                tmp_path, {"key": f"{round_}-{k}", "rmse": [0.1] * 3000}
            ),
            after,
        )
        found = list(read_results(tmp_path, lambda record: record["key"]))
        assert len(found) >= kept and found[0] == "0"
        ours = [key for key in found if key.startswith(f"{round_}-")]
        assert ours == [f"{round_}-{k}" for k in range(1, len(ours) + 1)]
        kept = len(found)


def test_an_export_is_files_that_are_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    options = LoopOptions(500.0, 1.0, 0.5, 0.01, None, None)
    files = exported("paper", "c", "robot", options)
    write_files(tmp_path, files)
    slowed(monkeypatch)
    for after in times("export"):
        killed(lambda k: write_files(tmp_path, files), after)
        for file, text in files.items():
            assert (tmp_path / file).read_text("utf-8") == text
