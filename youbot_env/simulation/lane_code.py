"""Turns the one definition of physics into loops over rows that a compiler vectorises.

The state's derivative is evaluated once on sympy symbols, as for the other kernels, and then put
in order by what it depends on: numbers that follow from parameters alone are computed once a
period, what depends on torques once for each time that they are held, and only the rest in every
evaluation. A rate is a polynomial in states and in what is no polynomial (the tanh of a dry
friction, say), with coefficients of parameters. No equation of motion is written in this file.

A block holds ``LANES`` rows. ``x`` is one block, field by field: number ``f`` of row ``i`` stands
at ``x[f * LANES + i]``. Distances between fields are then known to the compiler.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from youbot_env.physics.mechanism import Instant
from youbot_env.physics.namespaces import symbols
from youbot_env.physics.stated_parameters import internal_values, public_parameters
from youbot_env.simulation.generated_code import CALLED, Dynamics, Structure, _printer, real_symbols

LANES = 144
"""Rows in a block: a block of some 100 numbers a row stays in the second-level cache, and what each
loop costs before its first row is little beside its rows (64 rows: 3 to 15 % slower; 256: slower
again, as a block then leaves the first-level cache between loops). No power of two: fields would
lie a power of two apart and share a few places of the first-level cache (128 rows: one effect 8 %
slower, six 12 %). A multiple of 16, so that loops end with whole vectors."""

TOGETHER = 48
"""Rows that are integrated to the end of a period before others begin: what they work with stays in
the first-level cache. A part of ``LANES``."""

TORQUE, DURATION, LATE, COEFFICIENTS = 0, 4, 5, 6
"""Fields of the workspace ``w``: torques at the interface, length of a step [s], delay of torques
[s], coefficients."""

DRAWS = ("drawn",)
"""Generated functions that serve the draw of an episode's model: always in double precision."""

STAGES = ("ka", "kb", "kc", "kd")
"""Names of the four slopes of a step in generated code."""

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
            found: dict[Monomial, Any] = {(): self._constant(sympy.Mul(*fixed))}
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
                {part: self._constant(part) for part in self._fixed_parts(expression)}
            )
        arguments = []
        for argument in expression.args:
            if not argument.free_symbols & self._varying:
                arguments.append(self._constant(argument))
                continue
            parts = self.polynomial(argument)
            arguments.append(
                sympy.Add(
                    *(
                        self._constant(c) * sympy.Mul(*(s**p for s, p in monomial))
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

    def _constant(self, expression: Any) -> Any:
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
            row = (self._constant(coefficient), monomial)
            (moving if any(self._moves(s) for s, _ in monomial) else still).append(row)
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
                code = f"{_number(coefficient)} * ({product})"
            else:
                code = f"fma({_number(coefficient)}, {product}, {code})"
        return code

    def _moves(self, symbol: Any) -> bool:
        """Whether a symbol changes while torques are held."""
        if symbol in self.states:
            return True
        if symbol not in self.opaque:
            return False
        inside = self.opaque[symbol]
        if isinstance(inside, str):
            return True
        return any(self._moves(part) for part in inside.free_symbols)

    def _held(self, expression: Any) -> str:
        if expression.is_number or expression.is_Symbol:
            return _number(expression)
        if expression not in self._names:
            name = f"h{len(self.held)}"
            self._names[expression] = name
            self.held[name] = expression
        return str(self._names[expression])


def _number(value: Any) -> str:
    if value.is_Symbol:
        return value.name
    if value.is_number:
        return repr(float(value))
    return _lane_printer().doprint(value)


def _lane_printer() -> Any:
    """Prints expressions as operations that a vector loop holds: no call, no branch."""
    printer = type(_printer())

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


@dataclass(frozen=True)
class LaneLayout:
    """Sizes of what a structure's generated lanes read: S states, P parameters, Q stated ones."""

    states: int
    parameters: int
    stated: int


def lane_layout(structure: Structure) -> LaneLayout:
    """See ``LaneLayout``."""
    stated = public_parameters(structure, structure.mechanism.geometry)
    return LaneLayout(len(structure.state_names), len(structure.parameter_names), len(stated))


def lane_source(structure: Structure, dynamics: Dynamics) -> str:
    """Source of functions of one block, see the module: what a period of the plant is made of.

    They are called by address, with pointers in place of arrays: functions of rows with the
    arguments (x, w, out, lanes, substeps, lengths), which return nothing of use.

    integrate
        Rows ``x`` move on by ``substeps`` steps of w[DURATION] [s] under the torques w[TORQUE ...].
    joint_rates
        Rates of the joints (J fields of ``out``) [rad/s].
    acting
        Torques that act at the joints (J fields of ``out``) under those at the interface.
    shifts
        Delay of the torques in the model [s], one field.
    drawn(stated, geometry, lengths, theta)
        Fills parameters (P,) from those as people state them (Q,); 1 if the mass matrix is then
        positive definite, else 0.
    """
    mechanism = structure.mechanism
    size = len(structure.state_names)
    names = {
        "state": [f"s{i}" for i in range(size)],
        "torque": [f"u{i}" for i in range(len(mechanism.joints))],
        "lengths": [f"g_{name}" for name in mechanism.lengths],
        "theta": [f"p{i}" for i in range(len(structure.parameter_names))],
    }
    symbol = {key: real_symbols(group) for key, group in names.items()}
    geometry = SimpleNamespace(**dict(zip(mechanism.lengths, symbol["lengths"], strict=True)))
    rates = dynamics.state_derivative(
        symbols(), structure, geometry, symbol["theta"], symbol["state"], symbol["torque"]
    )
    parts = [
        _integration(structure, names, symbol, rates),
        _rates_of_joints(structure, names, symbol, rates),
        _acting_torques(structure, names, symbol, geometry, dynamics),
        _fields_function(
            "shifts",
            structure,
            names,
            [dynamics.torque_delay(symbols(), structure, symbol["theta"])],
        ),
        _draw(structure, names, symbol, geometry, dynamics),
    ]
    return "\n\n".join(parts)


_INLINED = '@njit(inner=True, error_model="numpy", forceinline=True)'


def _loads(names: Sequence[str], array: str, first: int = 0) -> list[str]:
    return [f"{name} = {array}[{(first + i) * LANES} + i]" for i, name in enumerate(names)]


def _integration(
    structure: Structure, names: Mapping[str, list[str]], symbol: Mapping[str, Any], rates: Any
) -> str:
    states = symbol["state"]
    program = LaneProgram(states, symbol["torque"])
    polynomials = [program.polynomial(rate) for rate in rates]
    read = _read_states(program, polynomials)
    # Such a state is the integral of others with fixed weights and nobody reads it: it needs their
    # mean over a step, not four evaluations.
    integral = [
        index
        for index, (state, found) in enumerate(zip(states, polynomials, strict=True))
        if state not in read and _is_weighted_sum(found, set(states))
    ]
    direct = [index for index in range(len(states)) if index not in integral]
    code = {index: program.text(polynomials[index]) for index in direct}
    weights = {
        index: [
            (_number(program._constant(c)), monomial[0][0].name if monomial else "")
            for monomial, c in polynomials[index].items()
        ]
        for index in integral
    }
    opaque = {name.name: _code_of(program, value) for name, value in program.opaque.items()}
    still = [name for name in opaque if not program._moves(_symbol_of(program, name))]
    inputs = sorted({states.index(state) for state in read})
    turned = _turned(program)
    moving = [name for name in opaque if name not in still and name not in turned]
    formulas = [*code.values(), *(opaque[name] for name in moving)]
    formulas += [weight for rows in weights.values() for weight, _ in rows]
    used = {word for formula in formulas for word in _words(formula)}
    given = (*names["theta"], *names["torque"])
    kept = [n for n in (*program.constants, *program.held, *still, *given) if n in used]
    angles = sorted({index for index, _ in turned.values()})
    lines = _prepared(structure, names, program, opaque, still, kept, angles)
    body = [f"    {name} = {opaque[name]}" for name in moving]
    returned = ", ".join(code[index] for index in direct)
    derivative = "\n".join(
        [
            _INLINED,
            f"def lane_derivative({', '.join([*(f's{i}' for i in inputs), *turned, *kept])}):",
            *body,
            f"    return ({returned},)",
        ]
    )
    return "\n\n".join(
        [derivative, lines, _runge_kutta(names, kept, inputs, turned, direct, integral, weights)]
    )


def _turned(program: LaneProgram) -> dict[str, tuple[int, str]]:
    """Names of sines and cosines of a state itself: which state, and "sine" or "cosine"."""
    import sympy

    kinds = {sympy.sin: "sine", sympy.cos: "cosine"}
    return {
        symbol.name: (program.states.index(value.args[0]), kinds[value.func])
        for symbol, value in program.opaque.items()
        if getattr(value, "func", None) in kinds and value.args[0] in program.states
    }


def _symbol_of(program: LaneProgram, name: str) -> Any:
    return next(symbol for symbol in program.opaque if symbol.name == name)


def _code_of(program: LaneProgram, value: Any) -> str:
    return value if isinstance(value, str) else _lane_printer().doprint(value)


def _read_states(program: LaneProgram, polynomials: Sequence[dict[Monomial, Any]]) -> set[Any]:
    """States that a rate depends on in another way than as a weighted sum that nobody reads."""
    states = set(program.states)

    def inside(symbol: Any) -> set[Any]:
        if symbol in states:
            return {symbol}
        value = program.opaque.get(symbol)
        if value is None:
            return set()
        if isinstance(value, str):
            known = {s.name: s for s in (*program.states, *program.opaque)}
            parts = [known[w] for w in _words(value) if w in known]
        else:
            parts = list(value.free_symbols)
        return set().union(*(inside(part) for part in parts))

    found: set[Any] = set()
    for polynomial in polynomials:
        for monomial in polynomial:
            for symbol, _ in monomial:
                found |= inside(symbol)
    return found


def _words(code: str) -> list[str]:
    return [node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)]


def _is_weighted_sum(found: dict[Monomial, Any], states: set[Any]) -> bool:
    return all(
        not monomial or (len(monomial) == 1 and monomial[0][0] in states and monomial[0][1] == 1)
        for monomial in found
    )


def _prepared(
    structure: Structure,
    names: Mapping[str, list[str]],
    program: LaneProgram,
    opaque: Mapping[str, str],
    still: Sequence[str],
    kept: Sequence[str],
    angles: Sequence[int],
) -> str:
    """What does not change while torques are held, and sines of angles, into the workspace."""
    import sympy

    printer = _lane_printer()
    # In terms of parameters alone, not of each other: so the compiler of common parts sees all.
    known: dict[Any, Any] = {}
    for name, value in program.constants.items():
        known[sympy.Symbol(name, real=True)] = sympy.sympify(value).xreplace(known)
    shared, values = sympy.cse(
        list(known.values()), symbols=sympy.numbered_symbols("y"), order="none"
    )
    body = _loads(names["theta"], "x", len(names["state"])) + _loads(names["torque"], "w", TORQUE)
    body += [f"{name} = {printer.doprint(value)}" for name, value in shared]
    body += [
        f"{name} = {printer.doprint(value)}"
        for name, value in zip(program.constants, values, strict=True)
    ]
    body += [f"{name} = {opaque[name]}" for name in still]
    body += [f"{name} = {printer.doprint(value)}" for name, value in program.held.items()]
    body += [f"w[{(COEFFICIENTS + i) * LANES} + i] = {name}" for i, name in enumerate(kept)]
    for at, index in enumerate(angles, COEFFICIENTS + len(kept)):
        body.append(f"angle = x[{index * LANES} + i]")
        body.append(f"w[{at * LANES} + i] = sin(angle)")
        body.append(f"w[{(at + len(angles)) * LANES} + i] = cos(angle)")
    lengths = [f"    {name} = lengths[{i}]" for i, name in enumerate(names["lengths"])]
    return "\n".join(
        [
            f"WORKSPACE = {COEFFICIENTS + len(kept) + 2 * len(angles)}\n\n",
            _INLINED,
            "def prepare(x, w, first, last, lengths):",
            *lengths,
            "    for i in range(first, last):",
            *(f"        {line}" for line in body),
        ]
    )


def _runge_kutta(
    names: Mapping[str, list[str]],
    kept: Sequence[str],
    inputs: Sequence[int],
    turned: Mapping[str, tuple[int, str]],
    direct: Sequence[int],
    integral: Sequence[int],
    weights: Mapping[int, Sequence[tuple[str, str]]],
) -> str:
    """The classical Runge-Kutta steps of a block, with the same torque from start to end.

    A step turns an angle by little. So its sine and cosine are computed at the start of a period,
    and turned by the little that each stage and each step adds.
    """
    body = _loads(kept, "w", COEFFICIENTS)
    body += _loads(["dt"], "w", DURATION)
    body += _loads(names["state"], "x")
    body += ["half = 0.5 * dt", "sixth = dt * 0.16666666666666666"]
    stage = {index: f"s{index}" for index in range(len(names["state"]))}
    angles = sorted({index for index, _ in turned.values()})
    sines = COEFFICIENTS + len(kept)
    body += _loads([f"sine{index}" for index in angles], "w", sines)
    body += _loads([f"cosine{index}" for index in angles], "w", sines + len(angles))
    turns = [f"{kind}{index}" for index, kind in turned.values()]
    points: list[dict[int, str]] = []
    for number, (letter, step) in enumerate(zip(STAGES, ("half", "half", "dt", ""), strict=True)):
        points.append(dict(stage))
        arguments = ", ".join([*(stage[index] for index in inputs), *turns, *kept])
        results = ", ".join(f"{letter}{index}" for index in direct)
        body.append(f"{results}{',' if len(direct) == 1 else ''} = lane_derivative({arguments})")
        if number < 3:
            for index in inputs:
                value = f"{letter}{index}"
                if index in integral:
                    value = _weighted(weights[index], points[-1])
                body.append(f"{letter}_{index} = fma({step}, {value}, s{index})")
                stage[index] = f"{letter}_{index}"
            for index in angles:
                body += _turn(f"{letter}{index}", f"{step} * {letter}{index}", index)
            turns = [f"{kind}_{letter}{index}" for index, kind in turned.values()]
    for index in direct:
        a, b, c, d = (f"{letter}{index}" for letter in STAGES)
        total = f"({a} + 2.0 * ({b} + {c}) + {d})"
        body.append(f"x[{index * LANES} + i] = fma(sixth, {total}, s{index})")
        if index in angles:
            at = sines + angles.index(index)
            body += _turn(f"step{index}", f"sixth * {total}", index)
            body.append(f"w[{at * LANES} + i] = sine_step{index}")
            body.append(f"w[{(at + len(angles)) * LANES} + i] = cosine_step{index}")
    needed = sorted({int(name[1:]) for rows in weights.values() for _, name in rows if name})
    for index in needed:
        a, b, c, d = (point[index] for point in points)
        body.append(f"m{index} = {a} + 2.0 * ({b} + {c}) + {d}")
    for index in integral:
        means = {int(name[1:]): f"m{name[1:]}" for _, name in weights[index] if name}
        total = _weighted([(w, n) for w, n in weights[index] if n], means) if means else "0.0"
        fixed = [w for w, n in weights[index] if not n]
        code = f"fma(sixth, {total}, s{index})"
        for weight in fixed:
            code = f"fma(dt, {weight}, {code})"
        body.append(f"x[{index * LANES} + i] = {code}")
    return "\n".join(
        [
            _INLINED,
            "def lane_step(x, w, first, last):",
            "    for i in range(first, last):",
            *(f"        {line}" for line in body),
            "\n",
            CALLED,
            "def integrate(x, w, out, lanes, substeps, lengths):",
            f"    for first in range(0, lanes, {TOGETHER}):",
            f"        last = min(first + {TOGETHER}, lanes)",
            "        prepare(x, w, first, last, lengths)",
            "        for _ in range(substeps):",
            "            lane_step(x, w, first, last)",
            "    return 0",
        ]
    )


def _turn(stage: str, little: str, index: int) -> list[str]:
    """Sine and cosine of a stage's angle from those at the start of the step."""
    return [
        f"little = {little}",
        "u, v = sine_of_little(little), cosine_of_little(little)",
        f"sine_{stage} = fma(sine{index}, v, cosine{index} * u)",
        f"cosine_{stage} = fma(cosine{index}, v, -(sine{index} * u))",
    ]


def _weighted(weights: Sequence[tuple[str, str]], values: Mapping[int, str]) -> str:
    code = ""
    for weight, name in weights:
        term = values[int(name[1:])] if name else "1.0"
        code = f"fma({weight}, {term}, {code})" if code else f"({weight}) * {term}"
    return code or "0.0"


def _rates_of_joints(
    structure: Structure, names: Mapping[str, list[str]], symbol: Mapping[str, Any], rates: Any
) -> str:
    mechanism = structure.mechanism
    start = len(mechanism.velocity_state) + len(mechanism.pose_state)
    wanted = list(rates[start : start + len(mechanism.angle_state)])
    return _fields_function("joint_rates", structure, names, wanted)


def _acting_torques(
    structure: Structure,
    names: Mapping[str, list[str]],
    symbol: Mapping[str, Any],
    geometry: Any,
    dynamics: Any,
) -> str:
    """The torques that act: the drives' first states, or what channels make of the interface's."""
    twist, _, _, time = structure.mechanism.split(symbol["state"])
    drives = list(symbol["state"][len(structure.mechanism.state) :])[: len(names["torque"])]
    start = symbol["state"][-1] if structure.reads_start else 0.0
    through = dynamics.channel_torque(
        symbols(),
        structure,
        geometry,
        symbol["theta"],
        symbol["torque"],
        Instant(twist, time=time, start=start),
    )
    return _fields_function(
        "acting", structure, names, drives if structure.has_actuator else list(through)
    )


def _fields_function(
    name: str, structure: Structure, names: Mapping[str, list[str]], results: Sequence[Any]
) -> str:
    """A function of a block that fills fields of ``out`` with expressions."""
    import sympy

    printer = _lane_printer()
    results = [sympy.sympify(result) for result in results]
    shared, values = sympy.cse(results, symbols=sympy.numbered_symbols("y"), order="none")
    used = {str(s) for result in results for s in result.free_symbols}
    body = [
        line
        for line in (
            _loads(names["state"], "x")
            + _loads(names["theta"], "x", len(names["state"]))
            + _loads(names["torque"], "w", TORQUE)
        )
        if line.split(" =")[0] in used
    ]
    body += [f"{part} = {printer.doprint(value)}" for part, value in shared]
    body += [f"out[{k * LANES} + i] = {printer.doprint(v)}" for k, v in enumerate(values)]
    lengths = [f"    {g} = lengths[{k}]" for k, g in enumerate(names["lengths"]) if g in used]
    return "\n".join(
        [
            CALLED,
            f"def {name}(x, w, out, lanes, substeps, lengths):",
            *lengths,
            "    for i in range(lanes):",
            *(f"        {line}" for line in body),
            "    return 0",
        ]
    )


def geometry_names(structure: Structure) -> tuple[str, ...]:
    """Names of all numbers of a mechanism's geometry, in the order that ``internal`` takes."""
    from dataclasses import fields, is_dataclass

    known = structure.mechanism.geometry
    if not is_dataclass(known):
        return ()
    return tuple(f.name for f in fields(known) if isinstance(getattr(known, f.name), float))


def _draw(
    structure: Structure,
    names: Mapping[str, list[str]],
    symbol: Mapping[str, Any],
    geometry: Any,
    dynamics: Dynamics,
) -> str:
    return "\n".join(
        [
            CALLED,
            "def drawn(stated, geometry, lengths, theta):",
            *_conversion(structure),
            *_mass_check(structure, names, symbol, geometry, dynamics),
        ]
    )


def _conversion(structure: Structure) -> list[str]:
    """Lines that fill ``theta`` from ``stated`` and ``geometry``."""
    known = geometry_names(structure)
    stated = list(public_parameters(structure, structure.mechanism.geometry))
    values = dict(zip(stated, real_symbols([f"v{i}" for i in range(len(stated))]), strict=True))
    geometry = SimpleNamespace(
        **dict(zip(known, real_symbols([f"g_{name}" for name in known]), strict=True))
    )
    found = internal_values(symbols(), structure, geometry, values)
    printer = _lane_printer()
    import sympy

    lines = [f"    v{i} = stated[{i}]" for i in range(len(stated))]
    lines += [f"    g_{name} = geometry[{i}]" for i, name in enumerate(known)]
    lines += [f"    theta[{i}] = {printer.doprint(sympy.sympify(v))}" for i, v in enumerate(found)]
    return lines


def _mass_check(
    structure: Structure,
    names: Mapping[str, list[str]],
    symbol: Mapping[str, Any],
    geometry: Any,
    dynamics: Any,
) -> list[str]:
    """Sylvester's criterion: the mass matrix at rest is positive definite."""
    import sympy

    size = len(structure.mechanism.axes)
    at = Instant((0.0,) * size, (0.0,) * size, pose=(0.0,) * len(structure.mechanism.pose_state))
    rows = dynamics.mass_matrix(symbols(), structure, geometry, symbol["theta"], at)
    matrix = sympy.Matrix([[sympy.sympify(value) for value in row] for row in rows])
    shared, values = sympy.cse(
        [matrix[i, j] for i in range(size) for j in range(size)],
        symbols=sympy.numbered_symbols("y"),
        order="none",
    )
    entries = real_symbols([f"m{i}{j}" for i in range(size) for j in range(size)])
    small: Any = sympy.Matrix(size, size, entries)
    minors = [small[:k, :k].det() for k in range(1, size + 1)]
    printer = _lane_printer()
    lines = [f"    {name} = theta[{i}]" for i, name in enumerate(names["theta"])]
    lines += [f"    {name} = lengths[{i}]" for i, name in enumerate(names["lengths"])]
    lines += [f"    {name} = {printer.doprint(value)}" for name, value in shared]
    lines += [
        f"    {name} = {printer.doprint(value)}"
        for name, value in zip(entries, values, strict=True)
    ]
    tests = " and ".join(f"({printer.doprint(minor)}) > 0.0" for minor in minors)
    return [*lines, f"    return 1 if {tests} else 0"]
