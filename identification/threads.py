"""Independent pieces of work in parallel threads.

Threads need no copies of the data, and numpy releases the interpreter lock in its loops.
"""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from youbot_env.threads import threads

Item = TypeVar("Item")
Result = TypeVar("Result")
Given = ParamSpec("Given")


if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 - it stands for that of functools
        """That of functools as it is from Python 3.12 on, without a lock.

        Python 3.11 holds one lock for a property of all objects, so that threads which work out
        that of different objects wait for each other. Without it two threads that ask for that of
        one object at the same time may both work it out: it is for what each thread makes.
        """

        def __get__(self, instance, owner=None):
            if instance is None:
                return self
            found = instance.__dict__[self.attrname] = self.func(instance)
            return found


def in_one_blas_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, whose linear algebra takes one thread, as in the commands.

    The matrices here are tall and thin: a second thread of BLAS brings nothing, and where another
    process has the core it spins: a call then takes ten times as long. Results would differ in the
    last bit from one number of cores to another.
    """

    @wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


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


def give_back() -> None:
    """Return to the system what earlier threads have freed, and from now on large arrays at once.

    The C library of Linux keeps it for each thread of a pool that was, and an hour at 1 kHz took
    half a gigabyte more than it used. Other systems have no such functions, and need none.
    """
    if (trim := _trim()) is not None:
        trim(0)


@cache
def _trim() -> Callable[[int], int] | None:
    """What the C library has for it; looked for once, since each look makes types of its own."""
    library = ctypes.CDLL(None) if os.name == "posix" else None
    trim = getattr(library, "malloc_trim", None)
    if library is not None and trim is not None:
        trim_threshold, mmap_threshold = -1, -3  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD of malloc.h
        # A column of an hour at 1 kHz has 29 MB; up to 32 MB it would be kept when it is freed.
        library.mallopt(mmap_threshold, 16 << 20)
        # What is free at the end of a thread's heap no trim returns; up to 64 MB each would stay.
        library.mallopt(trim_threshold, 8 << 20)
    return trim
