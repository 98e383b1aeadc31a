"""Threads that help with a step, so that it costs microseconds to ask them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from youbot_env.tracking import handover

Task = Callable[[], None]


@dataclass(frozen=True)
class Call:
    """Compiled work: address of a function and of its two arguments, see ``handover``."""

    function: int
    first: int
    second: int


class _Worker(threading.Thread):
    def __init__(self) -> None:
        super().__init__(daemon=True, name="youbot-rows")
        self._woken, self._box = threading.Semaphore(0), np.zeros(handover.BOX, np.int64)
        self._box[handover.STATE] = handover.ASLEEP
        self._asked = 0
        self._task: Task | None = None
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        box = self._box
        while True:
            self._woken.acquire()
            while handover.serve(box, handover.PATIENCE):
                try:
                    if self._task is not None:
                        self._task()
                except BaseException as error:  # raised where the result is waited for
                    self._error = error
                self._task = None  # or its arrays would not be free until the next one
                handover.finish(box)

    def ask(self, work: Task | Call) -> None:
        """Offer work."""
        self._wait()  # an interrupt may have left the last work unfinished
        call = work if isinstance(work, Call) else Call(0, 0, 0)
        self._task = None if isinstance(work, Call) else work
        self._asked += 1
        if handover.ask(self._box, call.function, call.first, call.second):
            self._woken.release()

    def settle(self) -> BaseException | int:
        """Take the offer back where it has not begun; wait for its end where it has.

        What it raised, or what it returned (0 where it has not begun).
        """
        if handover.taken_back(self._box):
            self._asked -= 1
            self._task = None
            return 0
        self._wait()
        error, self._error = self._error, None
        return int(self._box[handover.RESULT]) if error is None else error

    def _wait(self) -> None:
        while not handover.finished(self._box, self._asked, handover.PATIENCE):
            time.sleep(20e-6)  # another program may have taken its core


class _Workers:
    """The threads of one process: made when first used, and again after a fork."""

    def __init__(self) -> None:
        self._busy = threading.Lock()
        self._process, self._workers = 0, list[_Worker]()

    def share(self, own: Callable[[], int | None], others: Sequence[Task | Call]) -> int:
        """Work that any number of threads can share: one part here, the others beside it.

        Each takes pieces of the same work until none is left. One whose thread has not woken up
        by then never begins: on a busy machine nobody waits for a core. Returns the sum of what
        they return.
        """
        if self._process != os.getpid():
            # A fork copies no threads, and may copy a lock that is held.
            self._process, self._workers, self._busy = os.getpid(), [], threading.Lock()
        # Another thread steps an environment of its own: then this one works alone.
        if not others or not self._busy.acquire(blocking=False):
            return own() or 0
        try:
            while len(self._workers) < len(others):
                self._workers.append(_Worker())
            asked: list[_Worker] = []
            found: list[BaseException | int] = []
            try:
                for worker, work in zip(self._workers, others, strict=False):
                    asked.append(worker)
                    worker.ask(work)
                found.append(own() or 0)
            finally:
                # Also where this thread was interrupted: the arrays are still being written to.
                found += [worker.settle() for worker in asked]
            for result in found:
                if isinstance(result, BaseException):
                    raise result
            return sum(result for result in found if isinstance(result, int))
        finally:
            self._busy.release()


WORKERS = _Workers()
