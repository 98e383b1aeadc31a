"""What a workbench holds: logs, versions of a model, and the commands that made them.

Every click is a command line of `youbot`, so that all of it can be repeated without the workbench.
The project is kept as one JSON file, written after each change: a reload, a second browser or a
killed server loses nothing.
"""

from __future__ import annotations

import json
import shlex
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from youbot_env.errors import InputError
from youbot_env.files import FileKind, Schema, read_json, write_atomically

WAITING, RUNNING, DONE, FAILED, CANCELLED = "waiting", "running", "done", "failed", "cancelled"

ENDINGS = (".csv", ".csv.gz", ".parquet")
"""Of logs that can be chosen or dropped."""

FOLDER = "workbench"
"""Folder below the project's own in which the workbench writes."""


@dataclass
class Step:
    """One command.

    Attributes
    ----------
    number : from 1, in the order of the clicks
    title : what it does, for people
    arguments : of `youbot`; files are named from the project's folder
    result : JSON file that it writes; model : model file that it makes, or ""
    state : waiting, running, done, failed or cancelled
    message : of a command that failed, its error line
    share : done so far, 0 to 1
    undone : whether its model was taken back
    beside : model that its charts show beside, or ""
    seconds : that it took, once it is done
    """

    number: int
    kind: str
    title: str
    arguments: list[str]
    result: str
    model: str = ""
    state: str = WAITING
    message: str = ""
    share: float = 0.0
    undone: bool = False
    beside: str = ""
    seconds: float = 0.0

    @property
    def command(self) -> str:
        """As a shell takes it."""
        return shlex.join(["youbot", *self.arguments])

    @property
    def is_open(self) -> bool:
        """Whether it waits or runs."""
        return self.state in (WAITING, RUNNING)

    @property
    def read_models(self) -> list[str]:
        """The models that its command reads."""
        if self.kind == "drive":
            named = dict(zip(self.arguments[1::2], self.arguments[2::2], strict=False))
            return [named["--plant"], named["--model"]]
        return [self.arguments[1]] if self.kind in ("compare", "diagnose", "add") else []

    @property
    def subject(self) -> str:
        """The model of which its result speaks: made or read by it; "" where it speaks of logs."""
        return self.model or next(reversed(self.read_models), "")

    @property
    def effect(self) -> str:
        """The effect that it adds, or ""."""
        return self.arguments[2] if self.kind == "add" else ""

    @property
    def logs(self) -> list[str]:
        """The logs that its command reads."""
        return [name for name in self.arguments[1:] if name.endswith(ENDINGS)]


_NAMES: Schema = {"type": "array", "items": {"type": "string"}}
_STEP: Schema = {
    "type": "object",
    "properties": {
        "number": {"type": "integer", "minimum": 1},
        **dict.fromkeys(
            ("kind", "title", "result", "model", "message", "beside"), {"type": "string"}
        ),
        "arguments": _NAMES,
        "state": {"enum": [WAITING, RUNNING, DONE, FAILED, CANCELLED]},
        "share": {"type": "number", "minimum": 0, "maximum": 1},
        "seconds": {"type": "number", "minimum": 0},
        "undone": {"type": "boolean"},
    },
    "required": ["number", "kind", "title", "arguments", "result"],
    "additionalProperties": False,
}

PROJECT_FILE = FileKind(
    "a project of the workbench (move it away to begin a new one)",
    {
        "type": "object",
        "properties": {
            **dict.fromkeys(("logs", "chosen", "versions"), _NAMES),
            "steps": {"type": "array", "items": _STEP},
            "revision": {"type": "integer", "minimum": 0},
        },
        "required": ["logs", "chosen", "versions", "steps", "revision"],
    },
    lambda content, source: content,
    version=None,
)


@dataclass
class Project:
    """The state of a workbench.

    Attributes
    ----------
    folder : no file outside it can be chosen
    logs : that may be chosen, and ``chosen`` ones, named from the folder
    model : the active model, a file or "paper"; ``versions`` : all before it, the active one last
    steps : commands, in order
    revision : grows with each change, so that a browser knows when to draw again
    effects : the user's file of effects, which every command that reads models takes, or ""
    since : [s of the epoch] when what runs now began; drawing : model whose charts are being
        drawn, or "". These three are of this server's run, and not kept
    """

    folder: Path
    logs: list[str] = field(default_factory=list)
    chosen: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=lambda: ["paper"])
    steps: list[Step] = field(default_factory=list)
    revision: int = 0

    def __post_init__(self) -> None:
        # The server's threads and the worker change it.
        self.lock = threading.RLock()
        self.effects, self.since, self.drawing = "", 0.0, ""

    @property
    def model(self) -> str:
        """The active model."""
        return self.versions[-1]

    @property
    def home(self) -> Path:
        """Where the workbench writes."""
        return self.folder / FOLDER

    # --- the file ---------------------------------------------------------------------------

    @classmethod
    def open(cls, folder: Path, model: str, logs: Sequence[str]) -> Project:
        """The project of a folder as it was left, with what the command line adds.

        Raises
        ------
        InputError
            If the folder cannot be written, or its project file is damaged.
        """
        home = folder / FOLDER
        try:
            home.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{home}: cannot be made: {error.strerror}") from None
        path = home / "project.json"
        found = cls(folder) if not path.exists() else cls._read(path, folder)
        if model and model != found.model:
            found.versions.append(model)
        found.find_logs()
        new = [log for log in logs if log not in found.chosen]
        found.logs += [log for log in new if log not in found.logs]
        found.chosen += new
        for step in found.steps:
            if step.is_open:  # the server was killed while it ran
                step.state, step.message = CANCELLED, "the workbench was closed"
        found.changed()
        return found

    @classmethod
    def _read(cls, path: Path, folder: Path) -> Project:
        data = read_json(path, PROJECT_FILE)
        steps = [Step(**step) for step in data["steps"]]
        lists = {name: list(data[name]) for name in ("logs", "chosen", "versions")}
        found = cls(folder, **lists, steps=steps, revision=int(data["revision"]))
        found.versions = found.versions or ["paper"]
        return found

    def changed(self) -> None:
        """Count and keep a change."""
        with self.lock:
            self.revision += 1
            data = {
                "logs": self.logs,
                "chosen": self.chosen,
                "versions": self.versions,
                "steps": [asdict(step) for step in self.steps],
                "revision": self.revision,
            }
            write_atomically(self.home / "project.json", json.dumps(data, indent=1) + "\n")

    # --- logs -------------------------------------------------------------------------------

    def find_logs(self) -> None:
        """Offer all logs in the folder and one level below it."""
        paths = [*self.folder.glob("*"), *self.folder.glob("*/*")]
        names = sorted(
            str(path.relative_to(self.folder))
            for path in paths
            if path.name.endswith(ENDINGS) and path.is_file()
        )
        self.logs += [name for name in names if name not in self.logs]

    def choose(self, names: Sequence[str]) -> None:
        """Work on these logs from now on.

        Raises
        ------
        InputError
            If one of them was not offered.
        """
        strangers = [name for name in names if name not in self.logs]
        if strangers:
            raise InputError(f"{strangers[0]!r}: is no log of this folder")
        with self.lock:
            self.chosen = list(names)
            self.changed()

    def dropped(self, name: str, content: bytes) -> str:
        """Keep a log that was dropped into the browser, and choose it; its name.

        Raises
        ------
        InputError
            If its name is not that of a log.
        """
        letters = (c if c.isalnum() or c in "._-" else "_" for c in Path(name).name)
        # Not hidden, and no option of a command.
        plain = "".join(letters).lstrip(".-")
        if not plain.endswith(ENDINGS):
            raise InputError(f"{plain or 'file'}: a log ends with {', '.join(ENDINGS)}")
        (self.home / "dropped").mkdir(exist_ok=True)
        path = self.home / "dropped" / plain
        write_atomically(path, content)
        with self.lock:
            shown = str(path.relative_to(self.folder))
            self.logs += [] if shown in self.logs else [shown]
            self.chosen += [] if shown in self.chosen else [shown]
            self.changed()
        return shown

    # --- commands ---------------------------------------------------------------------------

    def doctor(self) -> Step:
        """Check the chosen logs."""
        return self._add("doctor", "Check the logs", ["doctor", *self._logs()])

    def identify(self) -> Step:
        """Fit the base model."""
        return self._add("identify", "Identify", ["identify", *self._logs()], makes="identified")

    def compare(self, beside: str = "") -> list[Step]:
        """Errors of the active model and of another one, by default the version before it.

        Two commands, unless the other's errors on these logs are known.

        Raises
        ------
        InputError
            If the other is no model of this workbench.
        """
        if beside and beside not in self._models():
            raise InputError(f"{beside!r}: is no model of this workbench")
        other = beside or (self.versions[-2] if len(self.versions) > 1 else "")
        other = other if other != self.model else ""
        steps = []
        if other and self.comparison(other, self._logs()) is None:
            steps.append(self._compare(other))
        return [*steps, self._compare(self.model, other)]

    def _compare(self, model: str, beside: str = "") -> Step:
        line = ["compare", model, *self._logs()]
        return self._add("compare", f"Compare {_short(model)}", line, beside=beside)

    def comparison(self, model: str, logs: Sequence[str]) -> Step | None:
        """The last finished comparison of a model with these logs."""
        for step in reversed(self.steps):
            is_one = step.kind == "compare" and step.state == DONE
            if is_one and step.subject == model and step.logs == list(logs):
                return step
        return None

    def _models(self) -> set[str]:
        made = {step.model for step in self.steps if step.model and step.state == DONE}
        return {*self.versions, *made, "paper"}

    def diagnose(self) -> Step:
        """What the active model lacks."""
        line = ["diagnose", self.model, *self._logs()]
        return self._add("diagnose", f"Diagnose {_short(self.model)}", line)

    def add(self, effect: str) -> Step:
        """Add an effect to the active model.

        Raises
        ------
        InputError
            If the name could be an option, or logs are missing.
        """
        if not effect.isidentifier():
            raise InputError(f"{effect!r}: is no name of an effect")
        line = ["add", self.model, effect, *self._logs()]
        makes = f"with_{effect}"
        return self._add("add", f"Add {effect}", line, makes=makes, beside=self.model)

    def drive(self, plant: str, controllers: Sequence[str]) -> Step:
        """Drive controllers that believe the active model on a plant.

        Raises
        ------
        InputError
            If a name is not one that is offered.
        """
        if plant not in self._models():
            raise InputError(f"{plant!r}: is no model of this workbench")
        line = ["evaluate", "--plant", plant, "--model", self.model]
        line += ["--controllers", ",".join(controllers), "--bands", "0.5-3", "--seeds", "1"]
        return self._add("drive", f"Drive on {_short(plant)}", line)

    def _logs(self) -> list[str]:
        if not self.chosen:
            raise InputError("choose a log first")
        return list(self.chosen)

    def _add(
        self, kind: str, title: str, line: list[str], makes: str = "", beside: str = ""
    ) -> Step:
        with self.lock:
            number = len(self.steps) + 1
            model = f"{FOLDER}/{number:02d}_{makes}.json" if makes else ""
            result = f"{FOLDER}/{number:02d}_{kind}_result.json"
            line = line + (["-o", model] if model else []) + ["--json", result]
            # Written into the command, so that it can be repeated outside of this server.
            line += ["--effects", self.effects] if self.effects and kind != "doctor" else []
            step = Step(number, kind, title, line, result, model, beside=beside)
            self.steps.append(step)
            self.changed()
            return step

    def finished(self, step: Step, state: str, message: str = "") -> None:
        """Note how a step ended; a model that it made becomes the active one."""
        with self.lock:
            step.state, step.message = state, message
            step.share = 1.0 if state == DONE else step.share
            if state == DONE and step.model:
                self.versions.append(step.model)
            self.changed()

    def undo(self) -> None:
        """Go back to the version before the active one; its file stays."""
        with self.lock:
            if len(self.versions) > 1:
                gone = self.versions.pop()
                for step in self.steps:
                    step.undone = step.undone or step.model == gone
                self.changed()

    def last(self, *kinds: str) -> Step | None:
        """The last finished command of some kinds that speaks of the active model, or of logs."""
        return self.last_of(self.model, *kinds)

    def last_of(self, model: str, *kinds: str) -> Step | None:
        """:meth:`last` of another model."""
        for step in reversed(self.steps):
            if step.kind in kinds and step.state == DONE and step.subject in (model, ""):
                return step
        return None

    def maker(self, model: str) -> Step | None:
        """The command that made a model; None of a file that was there before."""
        return next((step for step in self.steps if step.model == model), None)

    def result(self, step: Step | None) -> dict[str, Any] | None:
        """What a finished command found."""
        if step is None or step.state != DONE:
            return None
        try:
            return json.loads((self.folder / step.result).read_text("utf-8"))
        except (OSError, ValueError):
            return None

    # --- export -----------------------------------------------------------------------------

    @property
    def kept(self) -> list[Step]:
        """The commands that led to what is there now, and all that they need.

        Those about a model that was taken back are left out, unless one that is kept reads it.
        """
        done = [step for step in self.steps if step.state == DONE]
        needed = {*self.versions, ""}
        while True:
            kept = [step for step in done if step.subject in needed]
            read = {name for step in kept for name in (*step.read_models, step.beside)}
            if read <= needed:
                return kept
            needed |= read

    def script(self) -> str:
        """All kept commands as a shell script."""
        lines = [
            "#!/bin/sh",
            "# What was done in the workbench, to be run in the folder of the logs.",
            "set -e",
            f"mkdir -p {FOLDER}",
            *(step.command for step in self.kept),
        ]
        return "\n".join(lines) + "\n"

    def notebook(self) -> str:
        """The same as a Jupyter notebook: a cell a command."""
        title = "# From the workbench\n\nRun in the folder of the logs."
        cells: list[dict[str, Any]] = [_text(title)]
        cells.append(_code(f"!mkdir -p {FOLDER}"))
        for step in self.kept:
            cells += [_text(f"## {step.title}"), _code("!" + step.command.replace("{", "{{"))]
            cells.append(_code(f"import json\njson.load(open({step.result!r})).keys()"))
        form = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
        for k, cell in enumerate(cells):
            cell["id"] = f"cell{k}"
        book = {"cells": cells, "metadata": form, "nbformat": 4, "nbformat_minor": 5}
        return json.dumps(book, indent=1) + "\n"


def _text(source: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": source}


def _code(source: str) -> dict[str, Any]:
    nothing = {"outputs": [], "execution_count": None}
    return {"cell_type": "code", "metadata": {}, "source": source, **nothing}


def _short(model: str) -> str:
    return model.removeprefix(f"{FOLDER}/")
