"""Prints sympy expressions as Python that numba compiles."""

from __future__ import annotations

from typing import Any


def python_printer() -> Any:
    """Prints expressions for a function of numbers."""
    from sympy.printing.pycode import PythonCodePrinter

    class Printer(PythonCodePrinter):
        def _print_sign(self, expr: Any) -> str:
            # Sympy prints sign as copysign(1, x), which is not 0 at 0. NaN gives 0 here.
            x = self._print(expr.args[0])
            return f"(1.0 if {x} > 0 else -1.0 if {x} < 0 else 0.0)"

    return Printer({"fully_qualified_modules": False})


def lane_printer() -> Any:
    """Prints expressions as operations that a vector loop holds: no call, no branch."""
    printer = type(python_printer())

    class Printer(printer):
        def _print_Pow(self, expr: Any, rational: bool = False) -> str:
            exponent = expr.exp
            if exponent.is_Integer:
                base = self.parenthesize(expr.base, 1000)
                power = " * ".join([base] * abs(int(exponent)))
                return f"({power})" if exponent > 0 else f"(1.0 / ({power}))"
            if exponent == 0.5:
                return f"sqrt({self._print(expr.base)})"
            if exponent == -0.5:
                return f"(1.0 / sqrt({self._print(expr.base)}))"
            return f"exp({self._print(exponent)} * log({self._print(expr.base)}))"

        def _print_Rational(self, expr: Any) -> str:
            return repr(float(expr))

        def _print_Integer(self, expr: Any) -> str:
            return repr(float(expr))

        _print_Half = _print_NegativeOne = _print_One = _print_Zero = _print_Rational

        def _print_Max(self, expr: Any) -> str:
            return self._chosen(expr, ">")

        def _print_Min(self, expr: Any) -> str:
            return self._chosen(expr, "<")

        def _chosen(self, expr: Any, sign: str) -> str:
            first, *rest = (self._print(argument) for argument in expr.args)
            for other in rest:
                first = f"({first} if {first} {sign} {other} else {other})"
            return first

    return Printer({"fully_qualified_modules": False})
