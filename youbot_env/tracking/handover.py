"""A thread that waits for compiled work without Python: asked and answered in a microsecond.

A thread that sleeps is woken by the operating system in 10 to 100 us, and may then wait for
Python's lock. Between the steps of a batch that is as long as a part of the step itself. So a
thread that has worked looks for more work for a while (``PATIENCE``), in compiled code that holds
no lock, before it sleeps. Numbers that two threads share change by atomic operations alone.
"""

from __future__ import annotations

import platform

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from youbot_env.caching import njit
from youbot_env.simulation.lane_math import Compiled
from youbot_env.tracking.period_lanes import (
    ACTION_CALL,
    FIRST_CALL,
    LAST_CALL,
    MOVES_CALL,
    OBSERVED_CALL,
    OVER_CALL,
    PERIOD_CALL,
    PLACES_CALL,
    REPORT_CALL,
    REPORTED_CALL,
    REWARD_CALL,
    ROWS_CALL,
    SEEN_CALL,
    TICK_CALL,
    WIDTH_CALL,
)

STATE, FUNCTION, FIRST, SECOND, RESULT, FINISHED = range(6)
"""Numbers of a thread's box: what it does, address of the work and its two arguments (pointers; 0:
the work is Python's), what the work returned, how many works are finished."""

BOX = 16
"""Numbers in a box: two lines of the cache, so that threads' boxes do not hinder each other."""

READY, ASLEEP, ASKED, RUNNING = range(4)
"""What a thread does: looks for work, sleeps, has been asked, works."""

PATIENCE = 2000
"""How often a thread looks before it sleeps: some 50 to 100 us on a PC."""

_PAUSES = {"x86_64": "llvm.x86.sse2.pause", "AMD64": "llvm.x86.sse2.pause"}


def _now(typing, box, i):
    """Number i of a box as it is now, whatever other threads write."""

    def generate(context, builder, signature, arguments):
        array = make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load_atomic(builder.gep(array.data, [arguments[1]]), "seq_cst", 8)

    return types.int64(box, types.int64), generate


def _swapped(typing, box, i, value):
    """What stood in number i of a box before ``value`` was put there."""

    def generate(context, builder, signature, arguments):
        array = make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.gep(array.data, [arguments[1]])
        return builder.atomic_rmw("xchg", place, arguments[2], "seq_cst")

    return types.int64(box, types.int64, types.int64), generate


def _changed(typing, box, i, old, new):
    """Put ``new`` in the place of ``old``, and say whether ``old`` stood there."""

    def generate(context, builder, signature, arguments):
        array = make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.gep(array.data, [arguments[1]])
        pair = builder.cmpxchg(place, arguments[2], arguments[3], "seq_cst", "seq_cst")
        return builder.extract_value(pair, 1)

    return types.boolean(box, types.int64, types.int64, types.int64), generate


def _pause(typing):
    """Say to the processor that this loop waits: its other thread may go first."""

    def generate(context, builder, signature, arguments):
        name = _PAUSES.get(platform.machine())
        if name is not None:
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [])
        return context.get_dummy_value()

    return types.void(), generate


def _work(typing, address, first, second):
    """Call a function of ``lane_calls.period_signature``."""

    def generate(context, builder, signature, arguments):
        whole = ir.IntType(64)
        place = whole.as_pointer()
        kind = ir.FunctionType(whole, [place, place])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(function, [builder.inttoptr(a, place) for a in arguments[1:]])

    return types.int64(types.int64, types.int64, types.int64), generate


now: Compiled = intrinsic(_now)  # pyright: ignore[reportAssignmentType, reportCallIssue]
swapped: Compiled = intrinsic(_swapped)  # pyright: ignore[reportAssignmentType, reportCallIssue]
changed: Compiled = intrinsic(_changed)  # pyright: ignore[reportAssignmentType, reportCallIssue]
pause: Compiled = intrinsic(_pause)  # pyright: ignore[reportAssignmentType, reportCallIssue]
work: Compiled = intrinsic(_work)  # pyright: ignore[reportAssignmentType, reportCallIssue]


@njit(cache=True, nogil=True)
def fill(call, action, seen, reward, over, report, tick, moves, first, last):
    """Write what is asked into a call, see ``period_lanes``.

    From Python that would take as long as the period of a row.
    """
    call[ACTION_CALL], call[SEEN_CALL] = action.ctypes.data, seen.ctypes.data
    call[REWARD_CALL], call[OVER_CALL] = reward.ctypes.data, over.ctypes.data
    call[REPORT_CALL], call[REPORTED_CALL] = report.ctypes.data, report.shape[0]
    call[OBSERVED_CALL], call[WIDTH_CALL] = seen.shape
    call[TICK_CALL], call[MOVES_CALL] = tick, moves
    call[FIRST_CALL], call[LAST_CALL] = first, last
    call[ROWS_CALL] = reward.shape[0]


@njit(cache=True, nogil=True)
def filled_and_done(call, action, seen, reward, over, report, tick, moves, first, last):
    """``fill``, and what ``tracking.period.period`` then returns."""
    fill(call, action, seen, reward, over, report, tick, moves, first, last)
    return work(call[PERIOD_CALL], call[PLACES_CALL], call.ctypes.data)


@njit(cache=True, nogil=True)
def done(call):
    """What ``tracking.period.period`` returns of a call that is filled already."""
    return work(call[PERIOD_CALL], call[PLACES_CALL], call.ctypes.data)


@njit(cache=True, nogil=True)
def serve(box, patience):
    """Do what one is asked for until nobody has asked for long.

    0: the thread may sleep. 1: it is asked for work in Python, and must call ``finish`` after it.
    """
    while True:
        looked = 0
        while now(box, STATE) != ASKED:
            pause()
            looked += 1
            if looked > patience:
                if changed(box, STATE, READY, ASLEEP):
                    return 0
                looked = 0
        # Whoever asked may have taken it back in between.
        if changed(box, STATE, ASKED, RUNNING):
            if box[FUNCTION] == 0:
                return 1
            box[RESULT] = work(box[FUNCTION], box[FIRST], box[SECOND])
            finish(box)


@njit(cache=True, nogil=True)
def finish(box):
    """A work is done. Ready first: whoever sees that it is finished may ask again at once."""
    swapped(box, STATE, READY)
    swapped(box, FINISHED, now(box, FINISHED) + 1)


@njit(cache=True)
def ask(box, function, first, second):
    """Offer work; whether the thread sleeps and must be woken."""
    box[FUNCTION], box[FIRST], box[SECOND], box[RESULT] = function, first, second, 0
    return swapped(box, STATE, ASKED) == ASLEEP


@njit(cache=True)
def taken_back(box):
    """Take the offer back where the thread has not begun; whether it is."""
    return changed(box, STATE, ASKED, READY)


@njit(cache=True, nogil=True)
def finished(box, works, patience):
    """Wait until so many works are finished; False if that takes longer."""
    for _ in range(patience):
        if now(box, FINISHED) >= works:
            return True
        pause()
    return now(box, FINISHED) >= works
