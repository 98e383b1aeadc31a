"""Pieces of work side by side: the same results in the same order, however many threads."""

from __future__ import annotations

import threading
import time

import numpy as np  # loads BLAS
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from identification.diagnosis.diagnose import diagnose
from identification.threads import cached_property, in_one_blas_thread, side_by_side
from youbot_env.errors import InputError
from youbot_env.threads import MAX_THREADS, THREADS, threads


@pytest.mark.parametrize("count", ["1", "3"])
def test_results_come_in_order_and_progress_from_the_calling_thread(monkeypatch, count):
    monkeypatch.setenv(THREADS, count)
    callers = []

    def work(item: int) -> int:
        time.sleep(0.01 * (3 - item))  # the last begun is the first done
        return item * item

    found = side_by_side(work, range(4), lambda: callers.append(threading.current_thread()))
    assert found == [0, 1, 4, 9]
    assert callers == [threading.current_thread()] * 4


def test_two_threads_work_at_once(monkeypatch):
    monkeypatch.setenv(THREADS, "2")
    meeting = threading.Barrier(2, timeout=5.0)
    assert len(side_by_side(lambda _: meeting.wait(), range(2))) == 2


class Slow:
    """Something with a property that takes its time."""

    def __init__(self, meeting: threading.Barrier) -> None:
        self.meeting, self.times = meeting, 0

    @cached_property
    def found(self) -> int:
        """Comes to an end once another thread is at the same point."""
        self.times += 1
        self.meeting.wait()
        return self.times


def test_threads_work_out_a_property_of_two_objects_at_once(monkeypatch):
    """That of functools lets one wait for the other, in Python 3.11."""
    monkeypatch.setenv(THREADS, "2")
    meeting = threading.Barrier(2, timeout=5.0)
    both = [Slow(meeting), Slow(meeting)]
    assert side_by_side(lambda one: one.found, both) == [1, 1]
    assert [one.found for one in both] == [1, 1]  # kept


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_after_a_failure_nothing_else_is_begun(monkeypatch, failure):
    monkeypatch.setenv(THREADS, "1")
    begun = []

    def work(item: int) -> None:
        begun.append(item)
        time.sleep(0.2)
        raise failure

    with pytest.raises(failure):
        side_by_side(work, range(20))
    assert len(begun) < 5


def test_threads_are_the_cores_unless_the_user_says(monkeypatch):
    monkeypatch.delenv(THREADS, raising=False)
    assert 1 <= threads() <= MAX_THREADS
    monkeypatch.setenv(THREADS, "7")
    assert threads() == 7
    for wrong in ("0", "two", "-1", "1.5"):
        monkeypatch.setenv(THREADS, wrong)
        with pytest.raises(InputError, match="YOUBOT_THREADS: .* whole number"):
            threads()


def blas_threads() -> list[int]:
    assert np.linalg.eigvalsh(np.eye(2)).size == 2
    return [item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"]


def test_linear_algebra_takes_one_thread_within_and_those_that_were_given_outside():
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        assert set(in_one_blas_thread(blas_threads)()) == {1}
        assert blas_threads() == before
    assert hasattr(diagnose, "__wrapped__")  # its signature and documentation are its own
    assert "logs" in (diagnose.__doc__ or "")
