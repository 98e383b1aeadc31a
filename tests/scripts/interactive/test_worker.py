"""The order in which the workbench's worker does things."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from youbot_scripts.interactive.project import DONE, Project, Step
from youbot_scripts.interactive.worker import DRAWN, Worker


class Recorder(Worker):
    """Runs nothing: notes what it would run. A drawing lasts until it is stopped or let go."""

    def __init__(self, project: Project) -> None:
        self.calls: list[str] = []
        self.begun, self.let_go, self.stopped = (threading.Event() for _ in range(3))
        super().__init__(project)

    def _call(self, line: list[str], step: Step) -> tuple[int, str]:
        if not any("drawing" in word for word in line):
            self.calls.append(step.kind)
            return 0, ""
        self.begun.set()
        while not self.let_go.wait(0.005):
            if self.stopped.is_set():
                self.stopped.clear()
                self.calls.append(f"stopped drawing {step.number}")
                return -15, ""
        self.calls.append(f"drew {step.number}")
        folder = self.project.home / DRAWN / str(step.number)
        folder.mkdir(parents=True)
        (folder / "charts.json").write_text("{}")
        return 0, ""

    def _stop(self, process: object) -> None:  # type: ignore[override]
        self.stopped.set()


def test_a_command_does_not_wait_for_charts(tmp_path: Path):
    """What is being drawn is put off; afterwards it is drawn, and once."""
    (tmp_path / "a.csv").write_text("time\n")
    project = Project.open(tmp_path, "", ["a.csv"])
    worker = Recorder(project)
    worker.put(project.identify())
    assert worker.begun.wait(5.0)
    worker.put(step := project.diagnose())
    wait_for(lambda: step.state == DONE)
    worker.let_go.set()
    wait_for(lambda: "drew" in worker.calls[-1] and not project.drawing)
    # Of the diagnosis, which is the newer: its model's charts are the same.
    assert worker.calls == ["identify", "stopped drawing 1", "diagnose", "drew 2"]
    time.sleep(0.05)
    assert len(worker.calls) == 4, "not the same charts for the other command again"


def wait_for(holds) -> None:
    end = time.monotonic() + 5.0
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)
