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
    sign=lambda x: (x > 0) - (x < 0),
    where=lambda condition, yes, no: yes if condition else no,
    maximum=max,
    minimum=min,
)
"""Plain Python numbers: fastest for a single evaluation."""


@cache
def symbols() -> Any:
    """Sympy expressions: prints equations and generates the compiled kernels."""
    import sympy

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

    Python numbers are turned into tensors first: torch's own functions refuse them.
    """
    import torch

    def lift(function: Any) -> Any:
        return lambda *arguments: function(*(torch.as_tensor(value) for value in arguments))

    names = "tanh exp sin cos sqrt abs sign where maximum minimum".split()
    return SimpleNamespace(**{name: lift(getattr(torch, name)) for name in names})
