"""Independent pieces of work in parallel threads.

Threads need no copies of the data, and numpy releases the interpreter lock in its loops.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from youbot_env.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")

MAX_THREADS = 4
"""Largest default number of threads: with more, memory bandwidth is the limit."""


THREADS = "YOUBOT_THREADS"
"""Environment variable: how many threads a diagnosis takes, where the cores have other work."""


def threads() -> int:
    """Threads to use: as many as this process has cores, unless ``YOUBOT_THREADS`` says.

    Raises
    ------
    InputError
        If that variable is not a whole number of at least 1.
    """
    wanted = os.environ.get(THREADS)
    if wanted:
        # isdigit alone also accepts signs such as a superscript 2, which int refuses.
        if not (wanted.isascii() and wanted.isdigit() and int(wanted)):
            raise InputError(f"{THREADS}: {wanted!r} is not a whole number of at least 1")
        return int(wanted)
    if hasattr(os, "sched_getaffinity"):
        # Cores that this process may use; cpu_count gives all cores of the machine.
        return min(MAX_THREADS, len(os.sched_getaffinity(0)))
    return min(MAX_THREADS, os.cpu_count() or 1)


def side_by_side(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    progress: Callable[[], None] = lambda: None,
) -> list[Result]:
    """``work(item)`` of each item, in their order; the same results as one after another.

    An interruption waits for the pieces that have begun, and begins no other.

    Parameters
    ----------
    progress : called from this thread, after each piece
    """
    with ThreadPoolExecutor(threads()) as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            found = []
            for future in futures:
                found.append(future.result())
                progress()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return found
