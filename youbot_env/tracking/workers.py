"""Threads that help with a step, so that it costs microseconds to ask them."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence

Task = Callable[[], None]


class _Worker(threading.Thread):
    def __init__(self) -> None:
        super().__init__(daemon=True, name="youbot-rows")
        self._asked, self._done = threading.Semaphore(0), threading.Lock()
        self._done.acquire()
        # Whoever takes the task out, this thread or the one that asked, has it: popping is one
        # operation for all threads.
        self._offer: deque[Task] = deque(maxlen=1)
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        while True:
            self._asked.acquire()
            try:
                task = self._offer.pop()
            except IndexError:  # taken back
                continue
            try:
                task()
            except BaseException as error:  # raised where the result is waited for
                self._error = error
            del task  # or its arrays would not be free until the next one
            self._done.release()

    def ask(self, task: Task) -> None:
        """Offer a task."""
        self._offer.append(task)
        self._asked.release()

    def settle(self) -> BaseException | None:
        """Take the offer back where it has not begun; wait for its end where it has."""
        try:
            self._offer.pop()
            return None
        except IndexError:
            self._done.acquire()
        error, self._error = self._error, None
        return error


class _Workers:
    """The threads of one process: made when first used, and again after a fork."""

    def __init__(self) -> None:
        self._busy = threading.Lock()
        self._process, self._workers = 0, list[_Worker]()

    def share(self, tasks: Sequence[Task]) -> None:
        """Work that any number of threads can share: the first task here, the others beside it.

        Each task takes pieces of the same work until none is left. One whose thread has not woken
        up by then never begins: on a busy machine nobody waits for a core.
        """
        if self._process != os.getpid():
            # A fork copies no threads, and may copy a lock that is held.
            self._process, self._workers, self._busy = os.getpid(), [], threading.Lock()
        # Another thread steps an environment of its own: then this one works alone.
        if len(tasks) == 1 or not self._busy.acquire(blocking=False):
            tasks[0]()
            return
        try:
            while len(self._workers) < len(tasks) - 1:
                self._workers.append(_Worker())
            asked = self._workers[: len(tasks) - 1]
            for worker, task in zip(asked, tasks[1:], strict=True):
                worker.ask(task)
            errors: list[BaseException | None] = []
            try:
                tasks[0]()
            finally:
                # Also where this thread was interrupted: the arrays are still being written to.
                errors = [worker.settle() for worker in asked]
            for error in errors:
                if error is not None:
                    raise error
        finally:
            self._busy.release()


WORKERS = _Workers()
