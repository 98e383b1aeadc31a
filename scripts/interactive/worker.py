"""Runs the workbench's commands, one after another, each in a process of its own.

A process can be killed at any time without harm to the server, and its memory goes with it.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import Queue

from youbot_scripts.interactive.project import CANCELLED, DONE, FAILED, RUNNING, Project, Step
from youbot_scripts.shared.options import PROGRESS_FILE

POLL = 0.2
"""Seconds between two looks at a running command."""

TERMINATE = 3.0
"""Seconds that a cancelled command gets to end by itself."""

DRAWN = "drawn"
"""Folder below the workbench's in which the charts' data lie."""


class Worker:
    """A thread that takes steps from a queue and runs their commands.

    Charts are drawn when no command waits: one that is put while they are drawn goes first.
    """

    def __init__(self, project: Project) -> None:
        self.project = project
        self._queue: Queue[Step] = Queue()
        self._undrawn: list[Step] = []
        self._process: subprocess.Popen[str] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, step: Step) -> None:
        """Run a step when those before it have ended."""
        self._queue.put(step)
        # Which process first: the one that is found is then that of the drawing, or has ended.
        process = self._process
        if self.project.drawing:
            self._stop(process)

    def cancel(self, number: int) -> None:
        """Stop a step that waits or runs."""
        for step in self.project.steps:
            if step.number == number and step.is_open:
                running = step.state == RUNNING
                self.project.finished(step, CANCELLED, "cancelled")
                if running:
                    self._stop(self._process)

    def close(self) -> None:
        """Stop what runs."""
        self._stop(self._process)

    def _run(self) -> None:
        while True:
            step = self._queue.get()
            if step.state != CANCELLED:
                self._do(step)
            # The newest first: what others would show may be seen in its charts already.
            while self._undrawn and self._queue.empty():
                last = self._undrawn.pop()
                if self.is_to_be_drawn(last):
                    self._draw(last)

    def _do(self, step: Step) -> None:
        step.state, self.project.since = RUNNING, time.time()
        # A project that began anew numbers its steps from 1, as the one before it did.
        shutil.rmtree(self.project.home / DRAWN / str(step.number), ignore_errors=True)
        self.project.changed()
        status, error = self._call([*_YOUBOT, *step.arguments], step)
        if step.state == CANCELLED:
            return
        if status != 0:
            self.project.finished(step, FAILED, error or _ending(status))
            return
        step.seconds = time.time() - self.project.since
        self.project.finished(step, DONE)
        self._undrawn.append(step)

    def is_to_be_drawn(self, step: Step) -> bool:
        """Whether a finished step has something to show that no chart shows yet."""
        project = self.project
        if step.subject != project.model:
            return False  # it speaks of logs, or of the other model of a comparison
        if step.kind == "drive":
            return True
        shown = drawn_last(project, step.kind)
        if shown is None or shown.logs != step.logs:
            return True
        return bool(step.beside) and shown.beside != step.beside

    def _draw(self, step: Step) -> None:
        """Compute what the charts show of a step; a failure leaves the step as it is."""
        project = self.project
        project.drawing, project.since = step.subject, time.time()
        project.revision += 1
        arguments = [*_DRAW, str(project.home / DRAWN), step.kind, str(step.number)]
        rest = step.arguments if step.kind == "drive" else step.logs
        models = [step.subject, step.beside, project.effects]
        status, _ = self._call([*arguments, *models, *rest], step)
        if status != 0 and not self._queue.empty():
            self._undrawn.append(step)  # a command goes first
        project.drawing = ""
        project.changed()

    def _call(self, line: list[str], step: Step) -> tuple[int, str]:
        """Exit status and last error line of a process; its progress goes into the step."""
        told = self.project.home / "progress"
        told.unlink(missing_ok=True)
        environment = {**os.environ, PROGRESS_FILE: str(told)}
        with open(self.project.home / "errors.txt", "w+", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                line, cwd=self.project.folder, env=environment, text=True,
                stdout=subprocess.DEVNULL, stderr=errors, stdin=subprocess.DEVNULL,
                start_new_session=True,
            )  # fmt: skip
            while True:
                try:
                    status = self._process.wait(POLL)
                    break
                except subprocess.TimeoutExpired:
                    self._tell(step, told)
            self._process = None
            errors.seek(0)
            lines = [text.strip() for text in errors.read().splitlines() if text.strip()]
        return status, lines[-1].removeprefix("youbot: error: ") if lines else ""

    def _tell(self, step: Step, told: Path) -> None:
        try:
            share = min(max(float(told.read_text("utf-8")), 0.0), 1.0)
        except (OSError, ValueError):
            return
        if share != step.share:
            step.share = share
            self.project.revision += 1  # shown, not kept: it is no change of the project

    @staticmethod
    def _stop(process: subprocess.Popen[str] | None) -> None:
        if process is None:
            return
        try:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(TERMINATE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass


def _ending(status: int) -> str:
    """Why a command ended without a word; negative: minus the signal that ended it."""
    if status == -signal.SIGKILL:
        return "it was killed: by somebody, or by the system where memory ran out"
    return f"it was ended by signal {-status}" if status < 0 else f"it ended with status {status}"


_YOUBOT = [sys.executable, "-m", "youbot_scripts.cli"]
_DRAW = [sys.executable, "-m", "youbot_scripts.interactive.drawing"]

_SHOW = (("identify", "compare", "diagnose", "add"), ("drive",))
"""Kinds of steps that the same charts show."""


def drawn_last(project: Project, kind: str, model: str = "") -> Step | None:
    """The step about a model (the active one) that the charts of a kind of steps show."""
    kinds = next(kinds for kinds in _SHOW if kind in kinds)
    for step in reversed(project.steps):
        there = project.home / DRAWN / str(step.number) / "charts.json"
        if step.kind in kinds and step.subject == (model or project.model) and there.exists():
            return step
    return None


def shown_now(project: Project) -> dict[str, Step | None]:
    """The steps whose charts the page shows: of the model and logs, and of driven controllers.

    Until charts of a new model are drawn, those of the one before it stay: they say whose they are.
    """
    models = (drawn_last(project, "identify", name) for name in reversed(project.versions))
    return {"model": next(filter(None, models), None), "drive": drawn_last(project, "drive")}
