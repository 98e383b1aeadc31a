"""Expressions put in order by what they depend on: parameters, held torques, states.

A rate is a polynomial in states and in what is no polynomial (the tanh of a dry friction, say),
with coefficients of parameters. Numbers that follow from parameters alone are computed once a
period, what depends on torques once for each time that they are held, and only the rest in every
evaluation.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from youbot_env.simulation.printing import lane_printer

Monomial = tuple[tuple[Any, int], ...]
"""Powers of symbols, in order of their names; () is 1."""

MOST_TERMS = 60
"""A product of sums with more terms than this stays a product: it costs less than its expansion."""


@dataclass
class LaneProgram:
    """Expressions in states and torques, put in order by what they depend on.

    Attributes
    ----------
    states, torques : symbols that vary within a period, and those that are held in it
    constants : name -> expression of parameters alone
    held : name -> expression of constants and torques
    opaque : symbol -> what is no polynomial, an expression of states, torques and constants
    """

    states: Sequence[Any]
    torques: Sequence[Any]
    constants: dict[str, Any] = field(default_factory=dict)
    held: dict[str, Any] = field(default_factory=dict)
    opaque: dict[Any, Any] = field(default_factory=dict)
    _names: dict[Any, Any] = field(default_factory=dict)

    def polynomial(self, expression: Any) -> dict[Monomial, Any]:
        """Coefficients, of parameters alone, by monomial."""
        import sympy

        expression = sympy.sympify(expression)
        free = expression.free_symbols
        varying = self._varying
        if not free & varying:
            return {(): expression}
        if expression.is_Symbol:
            return {((expression, 1),): sympy.Integer(1)}
        if expression.is_Add:
            return self._sum([self.polynomial(part) for part in expression.args])
        if expression.is_Mul:
            # Parameters first: they stay together, as one coefficient.
            fixed = [part for part in expression.args if not part.free_symbols & varying]
            found: dict[Monomial, Any] = {(): self.constant(sympy.Mul(*fixed))}
            for part in expression.args:
                if part.free_symbols & varying:
                    found = self._product(found, self.polynomial(part))
            return found
        if expression.is_Pow and expression.exp.is_Integer and 2 <= expression.exp <= 4:
            base = self.polynomial(expression.base)
            found = base
            for _ in range(int(expression.exp) - 1):
                found = self._product(found, base)
            return found
        atom = self._atom(expression)
        if not atom.free_symbols & self._varying:
            return {(): atom}
        return {((atom, 1),): sympy.Integer(1)}

    @property
    def _varying(self) -> set[Any]:
        return {*self.states, *self.torques, *self.opaque}

    def _sum(self, parts: Sequence[dict[Monomial, Any]]) -> dict[Monomial, Any]:
        found: dict[Monomial, Any] = {}
        for part in parts:
            for monomial, coefficient in part.items():
                known = found.get(monomial)
                found[monomial] = coefficient if known is None else known + coefficient
        return {monomial: c for monomial, c in found.items() if c != 0}

    def _product(
        self, left: dict[Monomial, Any], right: dict[Monomial, Any]
    ) -> dict[Monomial, Any]:
        if len(left) * len(right) > MOST_TERMS:
            left, right = self._as_one(left), self._as_one(right)
        found: list[dict[Monomial, Any]] = []
        for a, p in left.items():
            for b, q in right.items():
                powers: dict[Any, int] = dict(a)
                for symbol, power in b:
                    powers[symbol] = powers.get(symbol, 0) + power
                ordered = tuple(sorted(powers.items(), key=lambda item: item[0].name))
                found.append({ordered: p * q})
        return self._sum(found)

    def _as_one(self, found: dict[Monomial, Any]) -> dict[Monomial, Any]:
        """A polynomial of many terms as a symbol of its own."""
        import sympy

        if len(found) < 3:
            return found
        return {((self._atom(self.text(found)), 1),): sympy.Integer(1)}

    def _atom(self, expression: Any) -> Any:
        """A symbol for what is no polynomial; its arguments are polynomials again.

        What turns out to follow from parameters alone, once they are (a determinant from which the
        states have cancelled), is returned as it is.
        """
        import sympy

        if expression not in self._names:
            simple = expression
            if not isinstance(expression, str):
                simple = self._with_simple_arguments(expression)
                if not simple.free_symbols & self._varying:
                    self._names[expression] = simple
                    return simple
            symbol = sympy.Symbol(f"q{len(self.opaque)}", real=True)
            self._names[expression] = symbol
            self.opaque[symbol] = simple
        return self._names[expression]

    def _with_simple_arguments(self, expression: Any) -> Any:
        import sympy

        if isinstance(expression, (sympy.Piecewise, sympy.logic.boolalg.Boolean)):
            return expression.xreplace(
                {part: self.constant(part) for part in self._fixed_parts(expression)}
            )
        arguments = []
        for argument in expression.args:
            if not argument.free_symbols & self._varying:
                arguments.append(self.constant(argument))
                continue
            parts = self.polynomial(argument)
            arguments.append(
                sympy.Add(
                    *(
                        self.constant(c) * sympy.Mul(*(s**p for s, p in monomial))
                        for monomial, c in parts.items()
                    )
                )
            )
        return expression.func(*arguments)

    def _fixed_parts(self, expression: Any) -> list[Any]:
        """Largest parts of an expression that parameters determine."""
        import sympy

        if isinstance(expression, sympy.Expr) and not expression.free_symbols & self._varying:
            return [] if expression.is_number or expression.is_Symbol else [expression]
        return [part for argument in expression.args for part in self._fixed_parts(argument)]

    def constant(self, expression: Any) -> Any:
        """A number as it is; else a symbol that stands for an expression of parameters."""
        import sympy

        expression = sympy.sympify(expression)
        if expression.is_number:
            return expression
        sign = 1
        if expression.could_extract_minus_sign():
            sign, expression = -1, -expression
        if expression not in self._names:
            symbol = sympy.Symbol(f"c{len(self.constants)}", real=True)
            self._names[expression] = symbol
            self.constants[symbol.name] = expression
        return sign * self._names[expression]

    def text(self, found: dict[Monomial, Any]) -> str:
        """A polynomial as code: fused multiply-adds over monomials, what is held first."""
        import sympy

        moving, still = [], []
        for monomial, coefficient in found.items():
            row = (self.constant(coefficient), monomial)
            (moving if any(self.moves(s) for s, _ in monomial) else still).append(row)
        start = sympy.Add(*(c * sympy.Mul(*(s**p for s, p in m)) for c, m in still))
        code = self._held(start)
        for coefficient, monomial in moving:
            factors = [name for s, p in monomial for name in [s.name] * p]
            product = " * ".join(factors)
            if coefficient == 1:
                code = product if code == "0.0" else f"{code} + {product}"
            elif coefficient == -1:
                code = f"{code} - {product}" if code != "0.0" else f"-({product})"
            elif code == "0.0":
                code = f"{number(coefficient)} * ({product})"
            else:
                code = f"fma({number(coefficient)}, {product}, {code})"
        return code

    def moves(self, symbol: Any) -> bool:
        """Whether a symbol changes while torques are held."""
        if symbol in self.states:
            return True
        if symbol not in self.opaque:
            return False
        inside = self.opaque[symbol]
        if isinstance(inside, str):
            return True
        return any(self.moves(part) for part in inside.free_symbols)

    def _held(self, expression: Any) -> str:
        if expression.is_number or expression.is_Symbol:
            return number(expression)
        if expression not in self._names:
            name = f"h{len(self.held)}"
            self._names[expression] = name
            self.held[name] = expression
        return str(self._names[expression])

    def turned_states(self) -> dict[str, tuple[int, str]]:
        """Names of sines and cosines of a state itself: which state, and "sine" or "cosine"."""
        import sympy

        kinds = {sympy.sin: "sine", sympy.cos: "cosine"}
        return {
            symbol.name: (self.states.index(value.args[0]), kinds[value.func])
            for symbol, value in self.opaque.items()
            if getattr(value, "func", None) in kinds and value.args[0] in self.states
        }

    def symbol(self, name: str) -> Any:
        """What stands for an opaque expression under a name."""
        return next(symbol for symbol in self.opaque if symbol.name == name)

    def code(self, value: Any) -> str:
        """An opaque expression as code."""
        return value if isinstance(value, str) else lane_printer().doprint(value)

    def read_states(self, polynomials: Sequence[dict[Monomial, Any]]) -> set[Any]:
        """States that a rate depends on in another way than as a weighted sum that nobody reads."""
        states = set(self.states)

        def inside(symbol: Any) -> set[Any]:
            if symbol in states:
                return {symbol}
            value = self.opaque.get(symbol)
            if value is None:
                return set()
            if isinstance(value, str):
                known = {s.name: s for s in (*self.states, *self.opaque)}
                parts = [known[w] for w in words(value) if w in known]
            else:
                parts = list(value.free_symbols)
            return set().union(*(inside(part) for part in parts))

        found: set[Any] = set()
        for polynomial in polynomials:
            for monomial in polynomial:
                for symbol, _ in monomial:
                    found |= inside(symbol)
        return found


def number(value: Any) -> str:
    """A number, or the name of one, as code."""
    if value.is_Symbol:
        return value.name
    if value.is_number:
        return repr(float(value))
    return lane_printer().doprint(value)


def words(code: str) -> list[str]:
    """Names that code reads or calls."""
    return [node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)]


def is_weighted_sum(found: dict[Monomial, Any], states: set[Any]) -> bool:
    """Whether a polynomial is a sum of states with fixed weights."""
    return all(
        not monomial or (len(monomial) == 1 and monomial[0][0] in states and monomial[0][1] == 1)
        for monomial in found
    )
