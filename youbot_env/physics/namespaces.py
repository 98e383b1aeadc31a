"""Namespaces that an effect's first argument ``xp`` can be: floats, sympy symbols, tensors.

For arrays ``xp`` is :mod:`numpy` itself. An effect may use ``tanh, exp, sin, cos, sqrt, abs,
sign, where, maximum, minimum`` and the arithmetic operators.
"""

from __future__ import annotations

import builtins
import math
from functools import cache
from types import SimpleNamespace
from typing import Any

floats: Any = SimpleNamespace(
    tanh=math.tanh,
    exp=math.exp,
    sin=math.sin,
    cos=math.cos,
    sqrt=math.sqrt,
    abs=builtins.abs,
    # 0 at 0, as numpy's; math.copysign has no such value.
    sign=lambda x: (x > 0) - (x < 0),
    where=lambda condition, yes, no: yes if condition else no,
    maximum=max,
    minimum=min,
)
"""Plain Python numbers: fastest for a single evaluation."""


@cache
def symbols() -> Any:
    """Sympy expressions: prints equations and generates the compiled kernels."""
    import sympy  # imported late: it takes a second to load, and most runs need none

    return SimpleNamespace(
        tanh=sympy.tanh,
        exp=sympy.exp,
        sin=sympy.sin,
        cos=sympy.cos,
        sqrt=sympy.sqrt,
        abs=sympy.Abs,
        sign=sympy.sign,
        where=lambda condition, yes, no: sympy.Piecewise((yes, condition), (no, True)),
        maximum=sympy.Max,
        minimum=sympy.Min,
    )


@cache
def tensors() -> Any:
    """Torch tensors, with gradients. Needs the extra ``rl``.

    Python numbers mix with tensors as they do in arithmetic; torch's own functions refuse them.
    """
    import torch  # an optional library, and slow to load

    def lift(name: str) -> Any:
        function, plain = getattr(torch, name), getattr(floats, name)

        def call(*arguments: Any) -> Any:
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

    return SimpleNamespace(**{name: lift(name) for name in vars(floats)})
