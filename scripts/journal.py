"""Results that are kept one by one as JSON lines, so that an interrupted run is taken up again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from youbot_env.errors import InputError

Record = dict[str, Any]

RESULTS = "results.jsonl"
"""File of a folder of results: one record a line."""


def plain(record: Record) -> Record:
    """The record as it reads after a round through JSON: what a resumed run would see."""
    return json.loads(json.dumps(record, default=_plain))


def _plain(value: object) -> object:
    return value.tolist() if hasattr(value, "tolist") else str(value)  # type: ignore[attr-defined]


def read_results(
    folder: Path, key: Callable[[Record], str], what: str = "trial"
) -> dict[str, Record]:
    """Records that a folder holds, by their key; a last line cut short is taken away.

    Raises
    ------
    InputError
        If a line is no such record, or the file cannot be read.
    """
    path = folder / RESULTS
    if not path.exists():
        return {}
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); name another folder") from None
    whole = text[: text.rfind("\n") + 1]
    found = {}
    for row, line in enumerate(whole.splitlines(), 1):
        try:
            record = json.loads(line)
            found[key(record)] = record
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: row {row}: not a {what}; name another folder") from None
    if whole != text:
        path.write_text(whole, "utf-8")
    return found


def append_result(folder: Path, record: Record) -> None:
    """Note one record in a folder, which is made if it is missing.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / RESULTS).open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
