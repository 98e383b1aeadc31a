"""Threads that wait for pieces of a step, so that a step costs microseconds to hand out."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence

Task = Callable[[], None]


class _Worker(threading.Thread):
    def __init__(self) -> None:
        super().__init__(daemon=True, name="youbot-rows")
        self._asked, self._done = threading.Lock(), threading.Lock()
        self._asked.acquire()
        self._done.acquire()
        self._task: Task | None = None
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        while True:
            self._asked.acquire()
            try:
                assert self._task is not None
                self._task()
            except BaseException as error:  # raised where the result is waited for
                self._error = error
            self._done.release()

    def hand(self, task: Task) -> None:
        self._task = task
        self._asked.release()

    def wait(self) -> BaseException | None:
        self._done.acquire()
        error, self._error, self._task = self._error, None, None
        return error


class _Workers:
    """The threads of one process: made when first used, and again after a fork."""

    def __init__(self) -> None:
        self._busy = threading.Lock()
        self._process, self._workers = 0, list[_Worker]()

    def run(self, tasks: Sequence[Task]) -> None:
        """All tasks, side by side, the first in this thread."""
        if self._process != os.getpid():
            # A fork copies no threads, and may copy a lock that is held.
            self._process, self._workers, self._busy = os.getpid(), [], threading.Lock()
        # Another thread steps an environment of its own: then one after the other.
        if len(tasks) == 1 or not self._busy.acquire(blocking=False):
            for task in tasks:
                task()
            return
        try:
            while len(self._workers) < len(tasks) - 1:
                self._workers.append(_Worker())
            taken = self._workers[: len(tasks) - 1]
            for worker, task in zip(taken, tasks[1:], strict=True):
                worker.hand(task)
            errors: list[BaseException | None] = []
            try:
                tasks[0]()
            finally:
                # Also where this thread was interrupted: the arrays are still being written to.
                errors = [worker.wait() for worker in taken]
            for error in errors:
                if error is not None:
                    raise error
        finally:
            self._busy.release()


WORKERS = _Workers()
