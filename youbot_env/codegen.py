"""Turns the one definition of physics into straight-line source for a compiler.

The equations are traced once on sympy symbols, common subexpressions are shared, and the result is
printed as Python that numba compiles. Nothing here knows an equation of motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from youbot_env.backends import symbols
from youbot_env.dynamics import state_derivative


@dataclass(frozen=True)
class System:
    """What a stepper is generated from, for any mechanism.

    derivative(xp, structure, lengths, theta, state, torque) : time derivative of the state;
    inputs : how many torques it takes; lengths : names of the geometry that it reads;
    sources : names of the modules that it is written in, for the cache's key
    """

    prefix: ClassVar[str] = "kernel"

    derivative: Callable[..., tuple[Any, ...]]
    inputs: int
    lengths: tuple[str, ...]
    sources: tuple[str, ...]

    def source(self, structure: Any) -> str:
        """See :func:`kernel_source`."""
        return kernel_source(structure, self)


MECANUM = System(
    state_derivative,
    inputs=4,
    lengths=("l", "h", "R", "r"),
    sources=tuple(
        f"youbot_env.{name}"
        for name in (
            *("backends", "codegen", "composition", "dynamics", "effects", "geometry"),
            *("points", "structure"),
        )
    ),
)
"""The platform."""


def kernel_source(structure: Any, system: System = MECANUM) -> str:
    """Python source of a module with ``derivative``, ``advance`` and ``rollout``.

    ``structure`` tells ``state_names`` and ``parameter_names``.
    """
    size = len(structure.state_names)
    names = {
        "state": [f"s{i}" for i in range(size)],
        "torque": [f"u{i + 1}" for i in range(system.inputs)],
        "lengths": [f"g_{name}" for name in system.lengths],
        "theta": [f"p{i}" for i in range(len(structure.parameter_names))],
    }
    derivative = _derivative(structure, system, names)
    return "\n\n".join([HEADER, derivative, _step(size, names), _loops(size, names)])


HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import cos, exp, sin, sqrt, tanh

from numba import njit'''


def _derivative(structure: Any, system: System, names: dict[str, list[str]]) -> str:
    symbol = {key: real_symbols(group) for key, group in names.items()}
    geometry = SimpleNamespace(**dict(zip(system.lengths, symbol["lengths"], strict=True)))
    rates = system.derivative(
        symbols(), structure, geometry, symbol["theta"], symbol["state"], symbol["torque"]
    )
    return function_source(
        "derivative", [name for group in names.values() for name in group], rates
    )


def real_symbols(names: Sequence[str]) -> list[Any]:
    """Sympy symbols that stand for the arguments of a generated function."""
    import sympy

    return [sympy.Symbol(name, real=True) for name in names]


def function_source(name: str, arguments: Sequence[str], results: Sequence[Any]) -> str:
    """A compiled function of scalars that returns a tuple of expressions in its arguments."""
    import sympy

    shared, values = sympy.cse([sympy.sympify(result) for result in results], order="none")
    printer = _printer()
    lines = [f"    {part} = {printer.doprint(value)}" for part, value in shared]
    returned = ",\n        ".join(printer.doprint(value) for value in values)
    return (
        f"@njit(cache=True, error_model='numpy')\ndef {name}({', '.join(arguments)}):\n"
        + "\n".join(lines)
        + f"\n    return (\n        {returned},\n    )"
    )


def _printer() -> Any:
    from sympy.printing.pycode import PythonCodePrinter

    class Printer(PythonCodePrinter):
        def _print_sign(self, expr: Any) -> str:
            # Sympy's copysign(1, x) is not zero at zero.
            x = self._print(expr.args[0])
            return f"(1.0 if {x} > 0 else -1.0 if {x} < 0 else 0.0)"

    return Printer({"fully_qualified_modules": False})


def _step(size: int, names: dict[str, list[str]]) -> str:
    """One classical Runge-Kutta step with the torque going linearly from u to w."""
    state, torque = names["state"], names["torque"]
    ends = [f"w{i + 1}" for i in range(len(torque))]
    rest = ", ".join(names["lengths"] + names["theta"])

    def call(stage: str, point: list[str], drive: list[str]) -> str:
        results = ", ".join(f"{stage}{i}" for i in range(size))
        return f"    {results} = derivative({', '.join(point + drive)}, {rest})"

    def shifted(stage: str, factor: str) -> list[str]:
        return [f"{state[i]} + {factor} * {stage}{i}" for i in range(size)]

    middle = [f"0.5 * ({a} + {b})" for a, b in zip(torque, ends, strict=True)]
    results = ",\n        ".join(
        f"{state[i]} + dt / 6.0 * (a{i} + 2.0 * (b{i} + c{i}) + d{i})" for i in range(size)
    )
    return "\n".join(
        [
            "@njit(cache=True, error_model='numpy')",
            f"def step({', '.join(state + torque + ends)}, dt, {rest}):",
            call("a", state, torque),
            call("b", shifted("a", "0.5 * dt"), middle),
            call("c", shifted("b", "0.5 * dt"), middle),
            call("d", shifted("c", "dt"), ends),
            f"    return (\n        {results},\n    )",
        ]
    )


def _loops(size: int, names: dict[str, list[str]]) -> str:
    state, torque = names["state"], names["torque"]
    inputs = len(torque)
    ends = [f"w{i + 1}" for i in range(inputs)]
    group = {name: ", ".join(names[name]) for name in names}
    lengths = ", ".join(f"lengths[{i}]" for i in range(len(names["lengths"])))
    unpacked = f"{group['lengths']} = {lengths}" if lengths else "pass"

    def theta(row: str) -> str:
        return ", ".join(f"theta[{row}{i}]" for i in range(len(names["theta"])))

    def at(array: str, row: str, count: int) -> str:
        return ", ".join(f"{array}[{row}, {i}]" for i in range(count))

    def store(array: str, row: str, indent: str) -> str:
        return "\n".join(f"{indent}{array}[{row}, {i}] = {state[i]}" for i in range(size))

    rest = ", ".join(names["lengths"] + names["theta"])
    now = [f"v{i + 1}" for i in range(inputs)]
    then = [f"x{i + 1}" for i in range(inputs)]
    ramp = "\n".join(
        f"            {now[i]} = {torque[i]} + ({ends[i]} - {torque[i]}) * (j * part)\n"
        f"            {then[i]} = {torque[i]} + ({ends[i]} - {torque[i]}) * ((j + 1) * part)"
        for i in range(inputs)
    )
    return f"""@njit(cache=True, error_model='numpy')
def advance(state, torque, lengths, theta, duration, substeps):
    {unpacked}
    dt = duration / substeps
    for row in range(state.shape[0]):
        {group["state"]} = {at("state", "row", size)}
        {group["torque"]} = {at("torque", "row", inputs)}
        {group["theta"]} = {theta("row, ")}
        for j in range(substeps):
            {group["state"]} = step(
                {group["state"]}, {group["torque"]}, {group["torque"]}, dt, {rest}
            )
{store("state", "row", "        ")}


@njit(cache=True, error_model='numpy')
def rollout(start, torque, duration, lengths, theta, substeps, out):
    {unpacked}
    {group["theta"]} = {theta("")}
    {group["state"]} = {", ".join(f"start[{i}]" for i in range(size))}
{store("out", "0", "    ")}
    part = 1.0 / substeps
    for k in range(torque.shape[0] - 1):
        {group["torque"]} = {at("torque", "k", inputs)}
        {", ".join(ends)} = {at("torque", "k + 1", inputs)}
        dt = duration[k] * part
        for j in range(substeps):
{ramp}
            {group["state"]} = step(
                {group["state"]}, {", ".join(now + then)}, dt, {rest}
            )
{store("out", "k + 1", "        ")}
"""
