"""One mutated file: it is read, or refused in one line, in bounded time and memory."""

from __future__ import annotations

import resource
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from youbot_env.errors import LONGEST_MESSAGE, InputError

SECONDS, MEGABYTES = 5.0, 512.0
"""Most that the reading of one file may take."""


class Late(BaseException):
    """Time is over: no handler of exceptions in a reader stops it."""


def fault(read: Callable[[Path], object], path: Path) -> str | None:
    """What is wrong with how a file is read; None if nothing is."""
    before, start = _peak(), time.process_time()
    try:
        with warnings.catch_warnings(), _limited(SECONDS):
            # A warning of a library on the screen is a fault, too.
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            read(path)
    except InputError as error:
        text = str(error)
        if not text.isprintable() or not 0 < len(text) <= LONGEST_MESSAGE + 100:
            return f"no line for a terminal: {text[:200]!r}"
    except Late:
        return f"takes longer than {SECONDS:g} s\n{traceback.format_exc(limit=-6)}"
    except Exception:
        return traceback.format_exc(limit=-8)
    seconds, megabytes = time.process_time() - start, _peak() - before
    if seconds > SECONDS or megabytes > MEGABYTES:
        return f"takes {seconds:.1f} s and {megabytes:.0f} MB"
    return None


def _peak() -> float:
    """Most memory [MB] that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def late(*_: object) -> None:
        raise Late

    # Of this process alone: other programs run on the machine, too.
    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
