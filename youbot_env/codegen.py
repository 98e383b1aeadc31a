"""Turns the one definition of physics into straight-line source for a compiler.

The equations are traced once on sympy symbols, common subexpressions are shared, and the result is
printed as Python that numba compiles. Nothing here knows an equation of motion.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from youbot_env.backends import symbols
from youbot_env.dynamics import Structure, state_derivative

LENGTHS = ("l", "h", "R", "r")
TORQUE = ("u1", "u2", "u3", "u4")


def kernel_source(structure: Structure) -> str:
    """Python source of a module with ``derivative``, ``advance`` and ``rollout``."""
    size = len(structure.state_names)
    names = {
        "state": [f"s{i}" for i in range(size)],
        "torque": list(TORQUE),
        "lengths": [f"g_{name}" for name in LENGTHS],
        "theta": [f"p{i}" for i in range(len(structure.parameter_names))],
    }
    parts = [_HEADER, _derivative(structure, names), _step(size, names), _loops(size, names)]
    return "\n\n".join(parts)


_HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import cos, exp, sin, sqrt, tanh

from numba import njit'''


def _derivative(structure: Structure, names: dict[str, list[str]]) -> str:
    import sympy

    symbol: dict[str, Any] = {
        key: [sympy.Symbol(name, real=True) for name in group] for key, group in names.items()
    }
    geometry = SimpleNamespace(**dict(zip(LENGTHS, symbol["lengths"], strict=True)))
    rates = state_derivative(
        symbols(), structure, geometry, symbol["theta"], symbol["state"], symbol["torque"]
    )
    shared, results = sympy.cse([sympy.sympify(rate) for rate in rates], order="none")
    printer = _printer()
    lines = [f"    {name} = {printer.doprint(value)}" for name, value in shared]
    returned = ",\n        ".join(printer.doprint(value) for value in results)
    return (
        f"@njit(cache=True, error_model='numpy')\ndef derivative({_arguments(names)}):\n"
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


def _arguments(names: dict[str, list[str]]) -> str:
    return ", ".join(name for group in names.values() for name in group)


def _step(size: int, names: dict[str, list[str]]) -> str:
    """One classical Runge-Kutta step with the torque going linearly from u to w."""
    state, torque = names["state"], names["torque"]
    ends = [f"w{i + 1}" for i in range(4)]
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
    ends = [f"w{i + 1}" for i in range(4)]
    group = {name: ", ".join(names[name]) for name in names}
    lengths = ", ".join(f"lengths[{i}]" for i in range(len(names["lengths"])))

    def theta(row: str) -> str:
        return ", ".join(f"theta[{row}{i}]" for i in range(len(names["theta"])))

    def at(array: str, row: str, count: int) -> str:
        return ", ".join(f"{array}[{row}, {i}]" for i in range(count))

    def store(array: str, row: str, indent: str) -> str:
        return "\n".join(f"{indent}{array}[{row}, {i}] = {state[i]}" for i in range(size))

    rest = f"{group['lengths']}, {group['theta']}"
    now = [f"v{i + 1}" for i in range(4)]
    then = [f"x{i + 1}" for i in range(4)]
    ramp = "\n".join(
        f"            {now[i]} = {torque[i]} + ({ends[i]} - {torque[i]}) * (j * part)\n"
        f"            {then[i]} = {torque[i]} + ({ends[i]} - {torque[i]}) * ((j + 1) * part)"
        for i in range(4)
    )
    return f"""@njit(cache=True, error_model='numpy')
def advance(state, torque, lengths, theta, duration, substeps):
    {group["lengths"]} = {lengths}
    dt = duration / substeps
    for row in range(state.shape[0]):
        {group["state"]} = {at("state", "row", size)}
        {group["torque"]} = {at("torque", "row", 4)}
        {group["theta"]} = {theta("row, ")}
        for j in range(substeps):
            {group["state"]} = step(
                {group["state"]}, {group["torque"]}, {group["torque"]}, dt, {rest}
            )
{store("state", "row", "        ")}


@njit(cache=True, error_model='numpy')
def rollout(start, torque, duration, lengths, theta, substeps, out):
    {group["lengths"]} = {lengths}
    {group["theta"]} = {theta("")}
    {group["state"]} = {", ".join(f"start[{i}]" for i in range(size))}
{store("out", "0", "    ")}
    part = 1.0 / substeps
    for k in range(torque.shape[0] - 1):
        {group["torque"]} = {at("torque", "k", 4)}
        {", ".join(ends)} = {at("torque", "k + 1", 4)}
        dt = duration[k] * part
        for j in range(substeps):
{ramp}
            {group["state"]} = step(
                {group["state"]}, {", ".join(now + then)}, dt, {rest}
            )
{store("out", "k + 1", "        ")}
"""
