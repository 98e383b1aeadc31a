"""Processes that tests start."""

from __future__ import annotations

import signal


def heed_interrupts() -> None:
    """Let Ctrl-C reach a child process; for ``subprocess.Popen(preexec_fn=...)``.

    A shell starts a background job with SIGINT ignored, and children inherit that. Commands keep
    it so, since a job in the background must not end when Ctrl-C is meant for another one.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
