"""What a fleet's folder holds: a result and a model of each robot, and one line of JSON each.

``robots/NAME.json`` is written by the worker that diagnosed the robot, complete or not at all;
``fleet.jsonl`` holds all results in the order of the robots' names, once all are there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from youbot_env.errors import InputError
from youbot_env.files import read_bytes, write_atomically
from youbot_scripts.shared.results_folder import plain, sealed, unsealed

Record = dict[str, Any]

ROBOTS, MODELS, LINES = "robots", "models", "fleet.jsonl"

SCREEN, DIAGNOSIS = "screen", "diagnosis"
"""What a verdict comes from."""

MAX_RECORD = 1 << 20
"""Size of one result [bytes]; most have 4 KiB."""


@dataclass(frozen=True)
class RobotFiles:
    """The files of one robot in the folder of a fleet's results."""

    folder: Path
    robot: str

    @property
    def model(self) -> Path:
        """The robot's model."""
        return self.folder / MODELS / f"{self._stem}.json"

    @property
    def _stem(self) -> str:
        # A folder may have any name, a file that is written beside others not.
        return quote(self.robot, safe=" +,=@()[]~'&#")

    def write(self, record: Record, cost: Mapping[str, float]) -> None:
        """Keep the result; ``cost`` in seconds, which is no part of it."""
        text = sealed({"record": plain(record), "cost": dict(cost)})
        write_atomically(self.folder / ROBOTS / f"{self._stem}.json", text)

    def read(
        self, fingerprint: str, *, failed: bool = False
    ) -> tuple[Record, dict[str, float]] | None:
        """The result and its cost; None where there is none on the same logs and options.

        One that failed by a fault of this program is tried again: it counts with ``failed`` alone.
        """
        path = self.folder / ROBOTS / f"{self._stem}.json"
        try:
            kept = unsealed(read_bytes(path, MAX_RECORD), str(path), "result")
            record, cost = kept["record"], kept["cost"]
        except (InputError, KeyError, TypeError):
            return None
        if record.get("fingerprint") != fingerprint or ("error_class" in record and not failed):
            return None
        if "error" not in record and not self.model.is_file():
            return None
        return record, cost


def make_folders(folder: Path) -> None:
    """Make the folder of a fleet's results.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    for part in (ROBOTS, MODELS):
        try:
            (folder / part).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None


def write_lines(folder: Path, records: Iterable[Record]) -> None:
    """Write all results, one a line: the same bytes for the same results."""
    write_atomically(folder / LINES, "".join(sealed(record) for record in records))
