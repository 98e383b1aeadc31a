"""Sympy expressions brought into the form in which a person would type or typeset them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import sympy
from sympy.printing.latex import LatexPrinter
from sympy.printing.str import StrPrinter

Group = tuple[Any, Any]
"""A coefficient and the motion that it multiplies."""


def collected(side: Any, motion: set[Any]) -> list[Group]:
    """A sum as coefficients times motions; functions of one coefficient stand in one bracket."""
    found: dict[Any, Any] = {}
    for term in sympy.Add.make_args(sympy.expand(tidy(sympy.sympify(side)))):
        coefficient, moved = term.as_independent(*motion, as_Add=False)
        if not term.is_zero:
            found[moved] = found.get(moved, 0) + coefficient
    shared: dict[Any, Any] = {}
    for moved, coefficient in found.items():
        # a tanh(x1) - a tanh(x2) becomes a (tanh(x1) - tanh(x2)): the sign goes to the function, so
        # that both have the coefficient a.
        is_function = not moved.is_polynomial(*motion)
        sign = -1 if is_function and coefficient.could_extract_minus_sign() else 1
        key = (sign * coefficient, None if is_function else moved)
        shared[key] = shared.get(key, 0) + sign * moved
    rows = ((coefficient, moved) for (coefficient, _), moved in shared.items())
    return [(-c, -m) if not m.is_Add and m.could_extract_minus_sign() else (c, m) for c, m in rows]


def tidy(expression: Any) -> Any:
    """Makes floats exact that are, up to rounding, a fraction, its root or a fraction of pi."""
    floats = expression.atoms(sympy.Float)
    return expression.xreplace({number: _exact(number) for number in floats})


def _exact(number: Any) -> Any:
    value = float(number)
    # Denominators up to 64 and 1e-12: a measured value hardly ever fits by chance.
    for power, restore in ((1, sympy.Rational), (2, _root)):
        fraction = Fraction(value**power).limit_denominator(64)
        if fraction and abs(float(fraction) / value**power - 1) < 1e-12:
            # The square has lost the sign.
            exact = restore(fraction.numerator, fraction.denominator)
            return exact if value > 0 or power == 1 else -exact
    turn = Fraction(value / math.pi).limit_denominator(64)
    if turn and abs(float(turn) * math.pi / value - 1) < 1e-12:
        return sympy.Rational(turn.numerator, turn.denominator) * sympy.pi
    return number


def _root(numerator: int, denominator: int) -> Any:
    return sympy.sqrt(sympy.Rational(numerator, denominator))


def with_values(expression: Any, values: dict[sympy.Expr, float]) -> Any:
    """Values in place of their symbols, to six digits."""
    if not values:
        return expression
    # 17 digits carry a double exactly; rounding to six comes after all products are made.
    found = sympy.N(expression.subs(values), 17)
    rounded = {number: sympy.Float(f"{float(number):.6g}") for number in found.atoms(sympy.Float)}
    return found.xreplace(rounded)


class _Ordered:
    """Sums with the plain and positive terms first."""

    def _as_ordered_terms(self, expr: Any, order: str | None = None) -> list[Any]:
        def rank(term: Any) -> tuple[bool, bool, str]:
            negative = term.could_extract_minus_sign()
            return sympy.denom(term) != 1, negative, str(-term if negative else term)

        return sorted(expr.args, key=rank)


class _Text(_Ordered, StrPrinter):
    def _print_Abs(self, expr: Any) -> str:
        return f"|{self._print(expr.args[0])}|"

    def _print_Piecewise(self, expr: Any) -> str:
        """A switch as Iverson's bracket: one where its condition holds, else zero."""
        condition = _switched_on(expr)
        return self._print_Function(expr) if condition is None else f"[{self._print(condition)}]"


class _Latex(_Ordered, LatexPrinter):
    def _print_Piecewise(self, expr: Any) -> str:
        condition = _switched_on(expr)
        if condition is None:
            return super()._print_Piecewise(expr)
        return rf"\left[{self._print(condition)}\right]"


def _switched_on(expr: Any) -> Any:
    """The condition of a piecewise function that is one where it holds and zero elsewhere."""
    (first, condition), *rest = expr.args
    is_switch = (first - 1).is_zero and len(rest) == 1 and rest[0].args[0].is_zero
    return condition if is_switch else None


def text(expression: Any) -> str:
    """Plain text: products by spaces, powers by ``^``, derivatives by primes."""
    # full_prec=False: 0.1, not 0.100000000000000.
    printed = _Text({"full_prec": False}).doprint(expression)
    return printed.replace("**", "^").replace("*", " ")


def latex(expression: Any) -> str:
    """LaTeX with dotted derivatives and upright names."""
    names = {symbol: _latex_name(symbol.name) for symbol in expression.atoms(sympy.Symbol)}
    # A space of its own between factors: a name of letters and a function would run together.
    settings = {"symbol_names": names, "mul_symbol": r" \, ", "full_prec": False}
    return _Latex(settings).doprint(expression)


def join(groups: Sequence[Group], show: Callable[[Any], str]) -> str:
    """A sum of coefficients times motions."""
    parts: list[str] = []
    for coefficient, motion in groups:
        negative = coefficient.could_extract_minus_sign()
        parts.append("-" if negative else "+")
        parts.append(_product(-coefficient if negative else coefficient, motion, show))
    if not parts:
        return "0"
    first = parts[1] if parts[0] == "+" else f"-{parts[1]}"
    return " ".join([first, *parts[2:]])


def _product(coefficient: Any, motion: Any, show: Callable[[Any], str]) -> str:
    if motion == 1:
        return show(coefficient)
    inner = _bracket(show(motion), show) if motion.is_Add else show(motion)
    if coefficient == 1:
        return inner
    is_fraction = show is text and sympy.denom(coefficient) != 1
    outer = show(coefficient)
    between = " " if show is text else r" \, "
    return (_bracket(outer, show) if coefficient.is_Add or is_fraction else outer) + between + inner


def _bracket(shown: str, show: Callable[[Any], str]) -> str:
    return f"({shown})" if show is text else rf"\left({shown}\right)"


_GREEK = {"mu", "phi", "gamma", "psi"}


def _latex_name(name: str) -> str:
    if name.startswith("d") and name[1:2] in ("F", "M"):
        return r"\Delta " + _latex_name(name[1:])
    if " " in name:  # m aX
        return r" \, ".join(_latex_name(part) for part in name.split())
    stem = name.rstrip("'")
    dots = {0: "", 1: r"\dot", 2: r"\ddot"}[len(name) - len(stem)]
    match = re.fullmatch(r"(mu|phi|gamma|psi|VX|VY|[a-zA-Z])_?(\w*)", stem)
    if match is None or (len(stem) > 3 and match[1] not in _GREEK and "_" not in stem[:2]):
        # A name of words: the first, and the others as its index.
        first, _, rest = stem.partition("_")
        body = rf"\mathrm{{{first}}}"
        others = rest.replace("_", r"\, ")
        index = rf"\mathrm{{{others}}}" if rest else ""
    else:
        body, index = match[1], match[2]
        body, index = (body[0], body[1]) if body in ("VX", "VY") else (body, index)
        body = r"\varphi" if body == "phi" else rf"\{body}" if body in _GREEK else body
    dotted = f"{dots}{{{body}}}" if dots else body
    return f"{dotted}_{{{index}}}" if index else dotted
