"""Results saved one by one as JSON lines, so that an interrupted run can be resumed."""

from __future__ import annotations

import hashlib
import json
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from youbot_env.errors import InputError
from youbot_env.files import FileKind, read_bytes, write_atomically
from youbot_scripts.shared.workers import spread

Record = dict[str, Any]
Item = TypeVar("Item")

RESULTS = "results.jsonl"
"""File of a folder of results: one record a line."""

MAX_RESULTS = 1 << 30
"""Size of that file [bytes]: a record has about 1 KiB, the largest of `youbot bench` 50 KiB."""

RECORD = FileKind(
    "a result",
    {"type": "object"},
    lambda content, source: content,
    version=None,
    # A loop that diverged, or a free run in a diagnosis, gives NaN.
    may_hold_nan=True,
)
"""One line of the file. The fields depend on the command that wrote it."""


def failure(error: Exception) -> Record:
    """What is kept of an exception: of an InputError, which is a refusal, its message alone."""
    kind = type(error).__name__
    last = traceback.extract_tb(error.__traceback__)[-1]
    return {
        "error": str(error) if isinstance(error, InputError) else f"{kind}: {error}",
        "error_class": kind,
        "raised_at": f"{Path(last.filename).name}:{last.lineno}",
    }


def plain(record: Record) -> Record:
    """The record, written as JSON and read again, as a resumed run would read it."""
    return json.loads(json.dumps(record, default=_plain))


def _plain(value: object) -> object:
    return value.tolist() if hasattr(value, "tolist") else str(value)  # type: ignore[attr-defined]


SEAL = "sha256"
"""Field of a line that holds a hash of the others. What is made of a record trusts its fields, so a
line that was changed by hand must not be taken for a result."""


def sealed(record: Record) -> str:
    """A record as a line of the file."""
    return json.dumps({**record, SEAL: _seal(record)}) + "\n"


def _seal(record: Record) -> str:
    return hashlib.sha256(json.dumps(record).encode()).hexdigest()[:16]


def read_results(
    folder: Path, key: Callable[[Record], str], what: str = "trial"
) -> dict[str, Record]:
    """Records in a folder, by their key; an incomplete last line is removed from the file.

    Raises
    ------
    InputError
        If a line is no such record or was changed, or the file cannot be read or mended.
    """
    path = folder / RESULTS
    if not path.exists():
        return {}
    content = read_bytes(path, MAX_RESULTS)
    found: dict[str, Record] = {}
    lines = content.split(b"\n")
    for row, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = unsealed(line, f"{path}: row {row}", what)
            found[key(record)] = record
        except InputError:
            # An interrupted run may have written a part of its last line.
            if row == len(lines):
                write_atomically(path, content[: len(content) - len(line)])
                return found
            raise
        except (KeyError, TypeError):
            raise InputError(f"{path}: row {row}: not a {what}; name another folder") from None
    # A whole last line without its end, as some editors leave it: the next one must not join it.
    if lines[-1].strip():
        write_atomically(path, content + b"\n")
    return found


def unsealed(line: bytes, source: str, what: str) -> Record:
    """The record of a line.

    Raises
    ------
    InputError
        If it is no such record or was changed.
    """
    try:
        record = RECORD.from_text(line, source)
    except InputError as error:
        cause = str(error).removeprefix(f"{source}: ")
        raise InputError(f"{source}: not a {what} ({cause}); name another folder") from None
    if record.pop(SEAL, None) != _seal(record):
        raise InputError(
            f"{source}: this {what} was changed by hand, or by another version; remove the line, "
            "and it is done again, or name another folder"
        )
    return record


def append_result(folder: Path, record: Record) -> None:
    """Append one record to the results of a folder, which is made if it is missing.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / RESULTS).open("a", encoding="utf-8") as file:
            file.write(sealed(record))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None


def resumed(
    function: Callable[[Item], Record],
    items: Mapping[str, Item],
    key: Callable[[Record], str],
    *,
    jobs: int = 1,
    folder: Path | None = None,
    what: str = "trial",
    progress: Callable[[], None] = lambda: None,
) -> dict[str, Record]:
    """Results of a function for items, by key; those in a folder are not computed again.

    Parameters
    ----------
    function : of an item; picklable if ``jobs`` is more than one; its record is JSON-able
    items : by the key that their records will have
    key : of a record
    folder : where each record is saved when it is done; None: nowhere
    what : name of a record's kind, for messages
    progress : called once for each item

    Raises
    ------
    InputError
        If the folder cannot be made or holds something else.
    """
    done = {} if folder is None else read_results(folder, key, what)
    waiting = {name: item for name, item in items.items() if name not in done}
    for _ in range(len(items) - len(waiting)):
        progress()
    for _, record in spread(function, list(waiting.values()), jobs):
        record = plain(record)
        done[key(record)] = record
        if folder is not None:
            append_result(folder, record)
        progress()
    return {name: done[name] for name in items}
