"""What formulas compute with: numbers of any kind, and the namespace ``xp`` of functions of them.

For arrays ``xp`` is :mod:`numpy` itself; here are those of floats, sympy symbols and tensors. An
effect may use ``tanh, exp, sin, cos, sqrt, abs, sign, where, maximum, minimum`` and the arithmetic
operators.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib import import_module
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray


class Number(Protocol):
    """A float, an array, a symbol or a tensor: what a formula computes with.

    Two operands are of one kind, or one of them is a float.
    """

    def __add__(self, other: Self | float, /) -> Self: ...
    def __radd__(self, other: float, /) -> Self: ...
    def __sub__(self, other: Self | float, /) -> Self: ...
    def __rsub__(self, other: float, /) -> Self: ...
    def __mul__(self, other: Self | float, /) -> Self: ...
    def __rmul__(self, other: float, /) -> Self: ...
    def __truediv__(self, other: Self | float, /) -> Self: ...
    def __rtruediv__(self, other: float, /) -> Self: ...
    def __pow__(self, exponent: int, /) -> Self: ...
    def __neg__(self) -> Self: ...
    def __lt__(self, other: Self | float, /) -> object: ...
    def __le__(self, other: Self | float, /) -> object: ...
    def __gt__(self, other: Self | float, /) -> object: ...
    def __ge__(self, other: Self | float, /) -> object: ...
    def __float__(self) -> float: ...


N = TypeVar("N", bound=Number)
"""The kind of number of a motion; what a function returns is of the same kind, or a float."""

Triple = tuple[Number, Number, Number]
"""Components of a twist, its acceleration, a pose or a generalised force."""

Values = Sequence[N] | NDArray[np.float64]
"""Numbers in order: values of parameters, or a state."""

# Of its arguments nothing is said: those of numpy, of torch and of sympy have types of their own.
Function = Callable[..., Number]
"""A function of numbers, each element for itself."""


class Namespace(Protocol):
    """The functions that an effect may use, of one kind of numbers."""

    @property
    def tanh(self) -> Function: ...
    @property
    def exp(self) -> Function: ...
    @property
    def sin(self) -> Function: ...
    @property
    def cos(self) -> Function: ...
    @property
    def sqrt(self) -> Function: ...
    @property
    def abs(self) -> Function: ...
    @property
    def sign(self) -> Function: ...
    @property
    def where(self) -> Function: ...
    @property
    def maximum(self) -> Function: ...
    @property
    def minimum(self) -> Function: ...


@dataclass(frozen=True)
class Functions:
    """A namespace made of single functions, each under its name in :class:`Namespace`."""

    tanh: Function
    exp: Function
    sin: Function
    cos: Function
    sqrt: Function
    abs: Function
    sign: Function
    where: Function
    maximum: Function
    minimum: Function


def _abs(x: float) -> float:
    return builtins.abs(x)


def _sign(x: float) -> float:
    # 0 at 0, as numpy's; math.copysign has no such value.
    return (x > 0) - (x < 0)


def _where(condition: bool, yes: float, no: float) -> float:
    return yes if condition else no


floats = Functions(
    tanh=math.tanh,
    exp=math.exp,
    sin=math.sin,
    cos=math.cos,
    sqrt=math.sqrt,
    abs=_abs,
    sign=_sign,
    where=_where,
    maximum=max,
    minimum=min,
)
"""Plain Python numbers: fastest for a single evaluation."""


@cache
def symbols() -> Namespace:
    """Sympy expressions: prints equations and generates the compiled kernels."""
    # Imported late: it takes a second to load, and most runs need none. By name: it has no types.
    sympy = import_module("sympy")

    def where(condition: object, yes: Number, no: Number) -> Number:
        return sympy.Piecewise((yes, condition), (no, True))

    return Functions(
        tanh=sympy.tanh,
        exp=sympy.exp,
        sin=sympy.sin,
        cos=sympy.cos,
        sqrt=sympy.sqrt,
        abs=sympy.Abs,
        sign=sympy.sign,
        where=where,
        maximum=sympy.Max,
        minimum=sympy.Min,
    )


@cache
def tensors() -> Namespace:
    """Torch tensors, with gradients. Needs the extra ``rl``.

    Python numbers mix with tensors as they do in arithmetic; torch's own functions refuse them.
    """
    import torch  # an optional library, and slow to load

    def lift(name: str) -> Function:
        function, plain = getattr(torch, name), getattr(floats, name)

        def call(*arguments: object) -> Number:
            tensors = [value for value in arguments if isinstance(value, torch.Tensor)]
            if not tensors:
                return plain(*arguments)
            # as_tensor without a dtype would round the number to single precision. The dtype comes
            # from a floating-point argument: conditions are tensors of bool.
            like = next((value for value in tensors if value.is_floating_point()), None)
            dtype = torch.get_default_dtype() if like is None else like.dtype
            device = tensors[0].device
            return function(
                *(
                    value
                    if isinstance(value, torch.Tensor)
                    else torch.as_tensor(value, dtype=dtype, device=device)
                    for value in arguments
                )
            )

        return call

    return Functions(**{field.name: lift(field.name) for field in fields(Functions)})
