"""Run one case of a record: its steps, one after another, in a folder of its own."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.behaviour import normalise

TIMEOUT = 120.0
"""Seconds that one step may take."""

INSIDE = Path(__file__).with_name("inside.py")
"""The cases that call the package from Python."""

STEADY = {
    "COLUMNS": "80",
    "TERM": "dumb",
    "NO_COLOR": "1",
    "MPLBACKEND": "agg",
    "SDL_VIDEODRIVER": "dummy",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "YOUBOT_THREADS": "1",
    "PYTHONHASHSEED": "0",
    "PYTHONUTF8": "1",
}
"""Environment of every step. Cases run side by side already, so each takes one thread."""


@dataclass(frozen=True)
class Code:
    """The checkout under test, and the data that it is tried on.

    Attributes
    ----------
    root : folder of the checkout
    data : folder of logs that are not part of it
    python : the interpreter, which finds the packages of ``root``
    """

    root: Path
    data: Path
    python: str = sys.executable

    def find(self, name: str) -> Path | None:
        """A file of the checkout, wherever it lies; `name` ends its path."""
        for folder, folders, files in os.walk(self.root):
            folders[:] = sorted(f for f in folders if not f.startswith(".") and f != "build")
            for file in sorted(files):
                path = Path(folder) / file
                if str(path).endswith(f"/{name}"):
                    return path
        return None


@dataclass(frozen=True)
class Step:
    """One command.

    Attributes
    ----------
    words : of the command; MODEL stands for the model that `identify` wrote, or for the paper's
        if it wrote none; a word with a star for the files that it fits
    kind : "youbot" runs the command line, "inside" a function of inside.py, anything else the
        script of the checkout that is called so
    name : in the record; default: the first words
    environment : beside STEADY
    """

    words: tuple[str, ...]
    kind: str = "youbot"
    name: str = ""
    environment: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Case:
    """Steps that share a folder.

    Attributes
    ----------
    quick : whether it is part of the short record
    needs : files of the data without which it is left out
    prepare : makes the files that the steps read, in their folder
    """

    name: str
    steps: tuple[Step, ...]
    quick: bool = False
    needs: tuple[str, ...] = ()
    prepare: Callable[[Path, Code], None] = field(default=lambda folder, code: None)


MODEL = "MODEL"


def youbot(line: str, name: str = "", **environment: str) -> Step:
    """A step of the command line, from its words with blanks between."""
    return Step(tuple(line.split()), name=name, environment=tuple(environment.items()))


def lines(name: str, given: Iterable[str]) -> Step:
    """A step that runs many command lines in one process."""
    return Step(("lines", *given), "inside", name)


class StoppedError(Exception):
    """The record was interrupted."""


class Runner:
    """Runs cases; `stop` ends all commands that are running."""

    def __init__(self, code: Code):
        self.code = code
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in self._running:
                _kill(process)

    def run(self, case: Case) -> dict[str, Any]:
        """Everything that the steps of a case print, write and return."""
        with tempfile.TemporaryDirectory(prefix="behaviour-", ignore_cleanup_errors=True) as name:
            folder = Path(name).resolve()
            if self.code.data.is_dir():
                (folder / "data").symlink_to(self.code.data)
            case.prepare(folder, self.code)
            found: dict[str, Any] = {}
            for step in case.steps:
                label = step.name or " ".join(step.words[:2])
                assert label not in found, f"case {case.name}: two steps are called {label!r}"
                found[label] = self._step(step, folder)
            return found

    def _step(self, step: Step, folder: Path) -> dict[str, Any]:
        words = [one for word in step.words for one in _expanded(word, folder)]
        paths = self._paths(folder)
        before = dict(_files(folder))
        status, out, err = self._command(step, words, folder)
        changed = [path for path, stamp in _files(folder) if before.get(path) != stamp]
        return {
            "command": " ".join(words[:1] if step.kind == "inside" else words),
            "status": status,
            "stdout": normalise.text(out, paths),
            "stderr": normalise.text(err, paths),
            "files": {
                str(path.relative_to(folder)): normalise.file(path, paths) for path in changed
            },
        }

    def _command(self, step: Step, words: list[str], folder: Path) -> tuple[int | str, str, str]:
        program = self._program(step.kind)
        if program is None:
            return f"{step.kind} is not there", "", ""
        # -P: what is imported is what the interpreter has installed, not what lies about.
        command = [self.code.python, "-P", *program, *words]
        environment = {**os.environ, **STEADY, **dict(step.environment)}
        environment.pop("PYTHONPATH", None)
        with (folder / ".out").open("wb") as out, (folder / ".err").open("wb") as err:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )
            status = self._wait(process)
        if status == "timeout":
            return status, "", ""  # how far it came is chance
        out_text, err_text = (
            (folder / name).read_text("utf-8", "replace") for name in (".out", ".err")
        )
        return status, out_text, err_text

    def _wait(self, process: subprocess.Popen[bytes]) -> int | str:
        with self._lock:
            self._running.add(process)
        try:
            if self._stopped:
                _kill(process)
            status = process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            _kill(process)
            process.wait()
            return "timeout"
        finally:
            with self._lock:
                self._running.discard(process)
        if self._stopped:
            raise StoppedError
        return status

    def _program(self, kind: str) -> list[str] | None:
        if kind == "youbot":
            return ["-m", "youbot_scripts.cli"]
        if kind == "inside":
            return [str(INSIDE)]
        script = self.code.find(kind)
        return None if script is None else [str(script)]

    def _paths(self, folder: Path) -> dict[str, str]:
        return {
            str(folder): "<folder>",
            str(self.code.data): "<data>",
            str(self.code.root): "<code>",
            sys.prefix: "<python>",
            sys.base_prefix: "<python>",
            str(INSIDE.parent): "<record>",
        }


def _expanded(word: str, folder: Path) -> list[str]:
    if word == MODEL:
        return ["model.json" if (folder / "model.json").exists() else "paper"]
    if "*" in word:
        return sorted(str(path.relative_to(folder)) for path in folder.glob(word))
    return [word]


def _files(folder: Path) -> Iterator[tuple[Path, tuple[int, int]]]:
    """Files of a case with size and time of change; not the data, nor what is hidden."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        hidden = parts[0] == "data" or any(part.startswith((".", "__")) for part in parts)
        if not hidden and path.is_file():
            yield path, (path.stat().st_size, path.stat().st_mtime_ns)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def shipped(folder: Path, code: Code) -> None:
    """Copy the logs that ship with the package, wherever they lie in it, to `shipped/`."""
    log = code.find("data/calibration.csv.gz")
    if log is not None:
        shutil.copytree(log.parent, folder / "shipped", ignore=shutil.ignore_patterns("*.md"))


def write_json(path: Path, content: Any) -> None:
    """As a whole or not at all, so that an interrupted record holds no half of a case."""
    whole = path.with_suffix(".tmp")
    whole.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")
    whole.replace(path)


def clock() -> Callable[[], float]:
    """Seconds since now."""
    start = time.perf_counter()
    return lambda: time.perf_counter() - start
