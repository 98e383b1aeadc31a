"""What the processor's compiler has as operations of its own, on a GPU or in its simulator."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba.cuda as _cuda
import numpy as np
from numba.core import types

cuda: Any = _cuda  # its functions are made at run time


def device(function: Callable[..., Any]) -> Any:
    """A function that functions of a GPU call."""
    return cuda.jit(device=True)(function)


def operations() -> dict[str, Any]:
    """By the names that they have in the batch's source."""
    from numba.core import config

    simulated = bool(config.ENABLE_CUDASIM)  # pyright: ignore[reportAttributeAccessIssue]
    return {**_of_arrays(), **(_simulated() if simulated else _of_device())}


def _of_arrays() -> dict[str, Any]:
    @device
    def put(array, i, value):
        array[i] = value

    return {"put": put, "sqrt": math.sqrt}


def _simulated() -> dict[str, Any]:
    """In Python: a product and a sum are rounded apart, so results differ by rounding."""

    def fma(a, b, c):
        return a * b + c

    def bits_of(x):
        return x.view(np.int64 if x.dtype == np.float64 else np.int32)

    def number_of(bits):
        return bits.view(np.float64 if bits.dtype == np.int64 else np.float32)

    def given(array, i):
        return array[i] if len(array.shape) == 1 else array[i // array.shape[1], i % array.shape[1]]

    def sqrt(x):
        return np.sqrt(x)

    named = {"floor": np.floor, "rint": np.rint, "sqrt": sqrt, "given": given}
    return {"fma": fma, "bits_of": bits_of, "number_of": number_of, **named}


def _of_device() -> dict[str, Any]:
    from numba.cuda import extending, libdevice

    overload: Any = vars(extending)["overload"]

    def by_size(large, small, whole: bool = False) -> Any:
        """A function of one number, large or small."""

        def operation(x):
            raise NotImplementedError

        @overload(operation, target="cuda")
        def _(x):
            if x == (types.int64 if whole else types.float64):
                return lambda x: large(x)
            return lambda x: small(x)

        return operation

    def given(array, i):
        raise NotImplementedError

    @overload(given, target="cuda")
    def _(array, i):
        if array.ndim == 1:
            return lambda array, i: array[i]
        return lambda array, i: array[i // array.shape[1], i % array.shape[1]]

    @device
    def fma(a, b, c):
        return cuda.fma(a, b, c)

    return {
        "fma": fma,
        "given": given,
        "bits_of": by_size(libdevice.double_as_longlong, libdevice.float_as_int),
        "number_of": by_size(libdevice.longlong_as_double, libdevice.int_as_float, whole=True),
        "floor": by_size(libdevice.floor, libdevice.floorf),
        "rint": by_size(libdevice.rint, libdevice.rintf),
    }
