"""Independent pieces of work in parallel threads.

Threads need no copies of the data, and numpy releases the interpreter lock in its loops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from youbot_env.threads import threads

Item = TypeVar("Item")
Result = TypeVar("Result")


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
