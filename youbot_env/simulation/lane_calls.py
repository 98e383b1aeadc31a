"""Compiled functions that compiled code calls by their addresses.

So what is the same for all platforms is compiled once on a machine, and only the physics of a set
of effects for each set. A call by address costs some nanoseconds for a block of rows.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from youbot_env.caching import njit
from youbot_env.simulation.lane_math import Compiled


def address_of(function: Any, signature: Any) -> int:
    """Address of a compiled function of pointers and whole numbers; compiles it if need be.

    Its arguments and result are C's. It is valid while ``function`` lives.
    """
    function.compile(signature)
    found = function.overloads[tuple(signature.args)]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name))


class Bound(partial[Any]):
    """A compiled function with addresses as its first arguments, which hold in this process."""

    def __reduce__(self) -> Any:
        raise TypeError("compiled code is found again in another process, not carried there")

    def __deepcopy__(self, memo: object) -> Bound:
        return self


def plant_signature(real: Any) -> Any:
    """Of functions of a block's rows: (x, w, out, lanes, substeps, lengths)."""
    numbers, whole = types.CPointer(numba.from_dtype(np.dtype(real))), types.int64
    return whole(numbers, numbers, numbers, whole, whole, numbers)


def draw_signature(real: Any) -> Any:
    """Of a function of a model's parameters: (stated, geometry, lengths, theta)."""
    numbers = types.CPointer(types.float64)
    lengths = types.CPointer(numba.from_dtype(np.dtype(real)))
    return types.int64(numbers, numbers, lengths, numbers)


def period_signature() -> Any:
    """Of ``tracking.period.period`` and of work that a thread is asked for: (places, call)."""
    whole = types.CPointer(types.int64)
    return types.int64(whole, whole)


def beginnings_signature(real: Any) -> Any:
    """Of ``tracking.period.begin_rows``: (places, call, start, first, last)."""
    whole = types.CPointer(types.int64)
    numbers = types.CPointer(numba.from_dtype(np.dtype(real)))
    return types.int64(whole, whole, numbers, types.int64, types.int64)


def numbers_signature(arrays: int) -> Any:
    """Of a function of so many arrays of numbers, of which it fills the last."""
    return types.int64(*[types.CPointer(types.float64)] * arrays)


def rates_signature() -> Any:
    """Of a function of (state, factor, slope, torque, known, out)."""
    numbers = types.CPointer(types.float64)
    return types.int64(numbers, types.float64, *[numbers] * 4)


def _call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Call what stands at the first argument with the others, arrays as pointers to their data."""
    address, *others = arguments
    values = [
        make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
        for kind, value in zip(signature.args[1:], others, strict=True)
    ]
    kind = ir.FunctionType(ir.IntType(64), [value.type for value in values])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), values)


def _on_rows(typing, address, x, w, out, lanes, substeps, lengths):
    """Call a function of ``plant_signature``."""
    whole = types.int64
    return whole(whole, x, w, out, whole, whole, lengths), _call


def _on_parameters(typing, address, stated, geometry, lengths, theta):
    """Call a function of ``draw_signature``."""
    return types.int64(types.int64, stated, geometry, lengths, theta), _call


def _on_beginnings(typing, address, places, call, start, first, last):
    """Call a function of ``beginnings_signature``."""
    whole = types.int64
    return whole(whole, places, call, start, whole, whole), _call


def _known(typing, address, lengths, theta, out):
    """Call a function of three arrays, contiguous ones."""
    return types.int64(types.int64, lengths, theta, out), _call


def _rates(typing, address, state, factor, slope, torque, known, out):
    """Call a function of ``rates_signature``; all arrays are contiguous."""
    given = (state, types.float64, slope, torque, known, out)
    return types.int64(types.int64, *given), _call


def _demand(typing, address, motion, torque, lengths, theta, out):
    """The same of five."""
    return types.int64(types.int64, motion, torque, lengths, theta, out), _call


def _command(typing, address, torque, rate, second, motion, lengths, theta, out):
    """The same of seven."""
    given = (torque, rate, second, motion, lengths, theta, out)
    return types.int64(types.int64, *given), _call


call_known: Compiled = intrinsic(_known)  # pyright: ignore[reportAssignmentType, reportCallIssue]
call_rates: Compiled = intrinsic(_rates)  # pyright: ignore[reportAssignmentType, reportCallIssue]
call_demand: Compiled = intrinsic(_demand)  # pyright: ignore[reportAssignmentType, reportCallIssue]
call_command: Compiled = intrinsic(_command)  # pyright: ignore[reportAssignmentType, reportCallIssue]
on_beginnings: Compiled = intrinsic(_on_beginnings)  # pyright: ignore[reportAssignmentType, reportCallIssue]
on_rows: Compiled = intrinsic(_on_rows)  # pyright: ignore[reportAssignmentType, reportCallIssue]
on_parameters: Compiled = intrinsic(_on_parameters)  # pyright: ignore[reportAssignmentType, reportCallIssue]


@njit(cache=True, inner=True, error_model="numpy")
def copied(source, target):
    """Put numbers side by side, as a function that takes a pointer reads them."""
    # An assignment to a slice compiles what it would say of wrong shapes as well: half a second.
    for i in range(len(target)):
        target[i] = source[i]
