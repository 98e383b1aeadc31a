"""Threads that help: what they are asked for is done once, whether they look for work or sleep."""

from __future__ import annotations

import os
import threading
import time

import numba
import numpy as np
import pytest

from youbot_env.caching import njit
from youbot_env.simulation.lane_calls import address_of, period_signature
from youbot_env.simulation.lane_math import taken_before
from youbot_env.tracking import handover
from youbot_env.tracking.workers import Call, _Workers

carray = numba.carray  # pyright: ignore[reportPrivateImportUsage]


@njit(nogil=True)
def pieces(numbers, taken):
    """Mark numbers that nobody else has taken; how many."""
    numbers, taken, found = carray(numbers, (1000,)), carray(taken, (1, 1)), 0
    while True:
        at = taken_before(taken, 10)
        if at >= 1000:
            return found
        for i in range(at, at + 10):
            numbers[i] += 1
            found += 1


@pytest.fixture(scope="module")
def workers() -> _Workers:
    return _Workers()


@pytest.mark.parametrize("pause", [0.0, 0.02])
@pytest.mark.parametrize("helpers", [1, 3])
def test_pieces_of_compiled_work_are_done_once(workers: _Workers, helpers: int, pause: float):
    """One after the other, and after a pause in which the threads have gone to sleep."""
    address = address_of(pieces, period_signature())
    numbers, taken = np.zeros(1000, np.int64), np.zeros((1, 1), np.int64)
    call = Call(address, numbers.ctypes.data, taken.ctypes.data)

    def own() -> int:
        return int(_called(call.function, call.first, call.second))

    for count in range(1, 21 if pause else 2001):
        taken[0] = 0
        assert workers.share(own, [call] * helpers) == 1000
        assert taken[0, 0] >= 1000 and (numbers == count).all()
        time.sleep(pause)


@njit(nogil=True)
def _called(function, first, second):
    return handover.work(function, first, second)


def test_a_thread_that_has_slept_long_still_helps(workers: _Workers):
    where: set[str] = set()

    def mark() -> None:
        where.add(threading.current_thread().name)
        time.sleep(0.05)  # long enough for a thread to wake up

    workers.share(mark, [mark])
    time.sleep(0.1)
    where.clear()
    workers.share(mark, [mark])
    assert where == {threading.current_thread().name, "youbot-rows"}


def test_an_error_of_a_helper_is_raised_and_the_threads_go_on(workers: _Workers):
    def fail() -> None:
        raise ValueError("a row is missing")

    for _ in range(3):
        with pytest.raises(ValueError, match="a row is missing"):
            workers.share(lambda: time.sleep(0.05), [fail])
    done: list[int] = []
    workers.share(lambda: time.sleep(0.05), [lambda: done.append(1)])
    assert done == [1]


def test_what_has_begun_is_over_when_an_interrupt_is_raised(workers: _Workers):
    begun, over = threading.Event(), threading.Event()

    def slow() -> None:
        begun.set()
        time.sleep(0.2)
        over.set()

    def interrupted() -> None:
        assert begun.wait(5)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        workers.share(interrupted, [slow])
    assert over.is_set()


def test_a_helper_that_has_not_begun_is_not_waited_for(workers: _Workers):
    """The work is done by then: its thread was late."""
    block, done = threading.Event(), list[int]()
    inner: list[float] = []

    def while_busy() -> None:
        # The helper sits in its first task: a second one, offered by another caller, is not begun.
        start = time.perf_counter()
        workers.share(lambda: done.append(1), [lambda: done.append(2)])
        inner.append(time.perf_counter() - start)
        block.set()

    def held() -> None:
        block.wait(5)

    workers.share(while_busy, [held])
    assert done == [1] and inner[0] < 1.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_fork_makes_threads_of_its_own(workers: _Workers):
    workers.share(lambda: None, [lambda: None])
    child = os.fork()
    if child == 0:
        names: set[str] = set()

        def mark() -> None:
            names.add(threading.current_thread().name)
            time.sleep(0.05)

        workers.share(mark, [mark])
        os._exit(0 if len(names) == 2 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
