"""How many threads the package's own loops take."""

from __future__ import annotations

import os

from youbot_env.errors import InputError

MAX_THREADS = 4
"""Largest default number of threads: with more, memory bandwidth is the limit."""

THREADS = "YOUBOT_THREADS"
"""Environment variable: how many threads are taken, where the cores have other work."""


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
