"""One function of many items in many processes, by joblib: on this machine or on a cluster.

Workers are joblib's: loky's processes of this machine by default, those of Ray or Dask where
:func:`on_backend` or ``joblib.parallel_config`` says so. What travels is a function by its name and
items as plain data; a user's files of effects are named by their paths and run by each worker.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, TypeVar

import joblib
from joblib.parallel import get_active_backend
from threadpoolctl import threadpool_limits

from youbot_env.errors import InputError, optional_library
from youbot_env.plugins import load_effects, loaded_files
from youbot_env.threads import THREADS

Item = TypeVar("Item")
Result = TypeVar("Result")

BACKENDS = ("loky", "ray", "dask")
"""Loky: processes of this machine. Ray, Dask: the cluster that RAY_ADDRESS or
DASK_SCHEDULER_ADDRESS names, or one of this machine alone that ends with the command."""

ITEMS_PER_WORKER = 8
"""In a batch, where a backend hands results over by batches alone (Ray): a worker that is done
early waits for an eighth of the others' time at most, and progress is still seen."""

PARENT_LOOK = 0.5
"""[s] between two looks whether the parent lives."""


def spread(
    function: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Iterator[tuple[Item, Result]]:
    """Items with their results, in the order in which they are finished.

    Parameters
    ----------
    function : a module's function, or a ``partial`` of one, if ``jobs`` is more than one
    jobs : number of workers; with one, all is done in this process, in order
    """
    if jobs == 1 or len(items) < 1:
        for item in items:
            yield item, function(item)
        return
    # Loky begins a worker anew when its memory has grown, and says so as if something was wrong. It
    # says it from a thread of its own, so that no filter of this block alone would reach it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    task = joblib.delayed(_WorkerCall(function, loaded_files(), os.getpid(), os.getcwd()))
    numbered = list(enumerate(items))
    # An item takes seconds: one a message. No memory maps: items are small.
    how = {"n_jobs": min(jobs, len(items)), "batch_size": 1, "max_nbytes": None}
    backend: Any = get_active_backend()[0]
    if backend.supports_return_generator:
        pool: Any = joblib.Parallel(return_as="generator_unordered", **how)
        found = pool(task(number, item) for number, item in numbered)
        try:
            yield from ((items[number], result) for number, result in found)
        finally:
            found.close()  # after Ctrl-C or an error nobody needs what is still running
        return
    size = ITEMS_PER_WORKER * jobs
    with joblib.Parallel(**how) as pool:
        for start in range(0, len(items), size):
            found = pool(task(number, item) for number, item in numbered[start : start + size])
            yield from ((items[number], result) for number, result in found or ())


@dataclass(frozen=True)
class _WorkerCall:
    """A function as a worker calls it: set up first.

    effects : files of the user's effects, which the parent's catalogue holds
    parent : the process that waits for the results
    folder : its working folder, from which paths are meant
    """

    function: Callable
    effects: tuple[str, ...]
    parent: int
    folder: str

    def __call__(self, number: int, item: object) -> tuple[int, object]:
        if os.getpid() != self.parent:
            # A worker outlives a command, and the next one may be given from another folder.
            with suppress(OSError):  # another machine may have no such folder
                os.chdir(self.folder)
            _be_one_of_many(self.effects, self.parent)
        # The workers share the cores, and sums of several BLAS threads differ in the last bit.
        with threadpool_limits(1):
            return number, self.function(item)


def _be_one_of_many(effects: Sequence[str], parent: int) -> None:
    """Set up a worker process; once or again.

    It ignores Ctrl-C, which a terminal sends to all processes; the parent handles it. It uses one
    thread, since the workers share the cores. It ends if the parent dies.
    """
    # setdefault: a number that the user has set stays.
    os.environ.setdefault(THREADS, "1")
    for path in effects:
        if path not in loaded_files():
            load_effects(path)
    name = f"parent {parent}"
    if any(thread.name == name for thread in threading.enumerate()):
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if os.getppid() == parent:  # on a cluster the parent is another, which sees to its workers
        threading.Thread(target=_end_with, args=(parent,), name=name, daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process if its parent has died: a killed parent cannot stop its workers."""
    while os.getppid() == parent:
        time.sleep(PARENT_LOOK)
    # Not sys.exit, which would end this thread only.
    os._exit(1)


@contextmanager
def on_backend(name: str, jobs: int) -> Iterator[None]:
    """Let :func:`spread` work on a backend, of ``BACKENDS``, within the context.

    Raises
    ------
    InputError
        If its library is missing, or the name is no backend's.
    """
    if name not in BACKENDS:
        raise InputError(f"--backend: {name!r} is none of {', '.join(BACKENDS)}")
    start = {"loky": _nothing_more, "ray": _ray, "dask": _dask}[name]
    with start(jobs), joblib.parallel_config(backend=name, n_jobs=jobs):
        yield


@contextmanager
def _nothing_more(jobs: int) -> Iterator[None]:
    yield


@contextmanager
def _ray(jobs: int) -> Iterator[None]:
    # No report of this use to anybody.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Without it Ray warns of a change in how it hides GPUs, which nothing here uses.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    ray = optional_library("ray", "ray", "--backend ray needs ray", "leave --backend out")
    from ray.util.joblib import register_ray

    register_ray()
    own = not ray.is_initialized()
    if own:
        local = {"num_cpus": jobs, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
        known = "RAY_ADDRESS" in os.environ
        ray.init(log_to_driver=False, logging_level="ERROR", **({} if known else local))
    try:
        yield
    finally:
        if own:
            ray.shutdown()


@contextmanager
def _dask(jobs: int) -> Iterator[None]:
    dask = optional_library(
        "distributed", "dask", "--backend dask needs distributed", "leave --backend out"
    )
    address = os.environ.get("DASK_SCHEDULER_ADDRESS")
    local = {"n_workers": jobs, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with dask.Client(address) if address else dask.Client(**local):
        yield
