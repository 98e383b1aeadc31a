"""Results that are kept one by one as JSON lines, so that an interrupted run is taken up again."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from identification.diagnosis.threads import THREADS
from youbot_env.errors import InputError
from youbot_env.files import FileKind, read_bytes, write_atomically

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
    # A loop that diverged, or a diagnosis without a scale, has numbers that are none.
    may_hold_nan=True,
)
"""One line of the file. Which fields it has is a matter of who wrote it."""


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
    content = read_bytes(path, MAX_RESULTS)
    whole = content[: content.rfind(b"\n") + 1]
    found = {}
    for row, line in enumerate(whole.splitlines(), 1):
        source = f"{path}: row {row}"
        try:
            record = RECORD.from_text(line, source)
            found[key(record)] = record
        except InputError as error:
            cause = str(error).removeprefix(f"{source}: ")
            raise InputError(f"{source}: not a {what} ({cause}); name another folder") from None
        except (KeyError, TypeError):
            raise InputError(f"{source}: not a {what}; name another folder") from None
    if whole != content:
        write_atomically(path, whole)
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
    """What a function makes of items, by their keys, less what a folder holds already.

    Parameters
    ----------
    function : of an item; picklable if ``jobs`` is more than one; its record is JSON-able
    items : by the key that their records will have
    key : of a record
    folder : where each record is noted as it is done; None keeps none
    what : a record is, for a message
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


Result = TypeVar("Result")


def spread(
    function: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Iterator[tuple[Item, Result]]:
    """Items with what the function makes of them, as they get done.

    Parameters
    ----------
    function : picklable if ``jobs`` is more than one
    jobs : processes; one works in this process, in order
    """
    if jobs == 1:
        for item in items:
            yield item, function(item)
        return
    # A fork would inherit the threads of compiled code, half alive.
    context = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(min(jobs, len(items) or 1), context, initializer=_be_one_of_many)
    try:
        waiting = {pool.submit(function, item): item for item in items}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()  # what they are at may take minutes, and is not wanted
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _be_one_of_many() -> None:
    """Ctrl-C reaches all processes of a terminal; the parent alone decides what it means.

    The processes share the cores already: none of them works in threads.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault(THREADS, "1")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed tells nobody; its work is wanted by nobody."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
