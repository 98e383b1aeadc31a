"""A blind set that other tools can try: logs without answers, and the answers apart.

A folder holds ``cases/CODE/`` (three logs, and a motion that nobody has seen the torques of),
``cases.json`` (the codes), ``README.md`` (the rules), and ``answers/CODE.json`` with what was
planted and what the base model's error is. Whoever tries a tool gives it ``cases`` alone.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.logs.reading import read_logs
from youbot_env.errors import InputError
from youbot_env.files import FileKind, read_json
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.blind_bench.cases import UNSEEN

Array = NDArray[np.float64]

CASES, ANSWERS, INDEX = "cases", "answers", "cases.json"

LOGS = ("calibration", "multisine_a", "multisine_b")


def read_table(path: Path) -> dict[str, Array]:
    """Columns of numbers of a CSV file with a header.

    Raises
    ------
    InputError
        If it cannot be read, or a cell is no number: file and row.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = list(csv.reader(file))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); give a CSV file with a header"
        ) from None
    for number, row in enumerate(rows, start=2):
        if len(row) != len(head):
            raise InputError(f"{path}: row {number}: {len(row)} cells under {len(head)} columns")
    try:
        values = np.array(rows, float).reshape(len(rows), len(head))
    except ValueError as error:
        raise InputError(f"{path}: {error}: a cell is no number") from None
    return dict(zip(head, values.T, strict=True))


@dataclass(frozen=True)
class Published:
    """A blind set on disk."""

    folder: Path

    @property
    def codes(self) -> tuple[str, ...]:
        """Of its cases.

        Raises
        ------
        InputError
            If the folder holds no blind set.
        """
        path = self.folder / INDEX
        if not path.is_file():
            raise InputError(
                f"{self.folder}: holds no blind set; write one with --publish on an empty folder"
            )
        return tuple(read_json(path, INDEX_FILE))

    def logs(self, code: str) -> list[Log]:
        """The logs of a case."""
        return read_logs([self.folder / CASES / code / f"{name}.csv" for name in LOGS])

    def motion(self, code: str) -> Log:
        """The motion of a case whose torques nobody has seen: zeros stand in their place."""
        table = read_table(self.folder / CASES / code / f"{UNSEEN}.csv")
        return _log_of(table, np.zeros((len(table["time"]), len(WHEELS))))

    def answer(self, code: str) -> dict[str, Any]:
        """What was planted, and the base model's errors."""
        return json.loads((self.folder / ANSWERS / f"{code}.json").read_text("utf-8"))

    def unseen(self, code: str) -> Log:
        """The fourth run with its torques."""
        (log,) = read_logs([self.folder / ANSWERS / f"{code}.csv"])
        return log


def _log_of(table: dict[str, Array], effort: Array) -> Log:
    pose = None
    if "pose_x" in table:
        pose = np.column_stack([table[f"pose_{name}"] for name in ("x", "y", "yaw")])
    speed = np.column_stack([table[f"velocity_{wheel}"] for wheel in WHEELS])
    return Log(UNSEEN, WHEELS, table["time"], speed, effort, pose=pose)


INDEX_FILE = FileKind(
    "the index of a blind set",
    {
        "type": "object",
        "properties": {"cases": {"type": "array", "items": {"type": "string"}}},
        "required": ["cases"],
    },
    lambda content, source: list(content["cases"]),
)
