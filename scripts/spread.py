"""Work spread over processes, one result at a time, that Ctrl-C ends cleanly."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

from identification.parallel import THREADS

Item = TypeVar("Item")
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
