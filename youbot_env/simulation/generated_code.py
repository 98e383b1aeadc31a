"""Turns the one definition of physics into straight-line source for a compiler.

The equations are evaluated once on sympy symbols, common subexpressions are shared, and the result
is printed as Python that numba compiles. No equation of motion is written in this file.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Protocol

from youbot_env.physics.mechanism import Components, Instant, ModelStructure
from youbot_env.physics.namespaces import Number, symbols
from youbot_env.simulation.printing import python_printer

SOURCES = tuple(
    f"youbot_env.{name}"
    for name in (
        "simulation.generated_code",
        "simulation.printing",
        "physics.effect",
        "physics.geometry",
        "physics.mechanism",
        "physics.namespaces",
    )
)
"""Modules that generated code follows from, beside the dynamics and the mechanism's own: for the
cache's key."""


Structure = ModelStructure[Any]
"""Of any mechanism: here symbols stand for its lengths, whatever object holds these elsewhere."""


class Dynamics(Protocol):
    """The functions that code is generated from, as `physics.inverse_dynamics` has them."""

    __name__: str

    @property
    def wrench(self) -> Callable[..., Components[Number]]: ...
    @property
    def interface_torque(self) -> Callable[..., Components[Number]]: ...
    @property
    def state_derivative(self) -> Callable[..., Components[Number]]: ...
    @property
    def rolling_geometry(self) -> Callable[..., Any]: ...
    @property
    def channel_torque(self) -> Callable[..., Components[Number]]: ...
    @property
    def torque_delay(self) -> Callable[..., Number | float]: ...
    @property
    def mass_matrix(self) -> Callable[..., tuple[Components[Number], ...]]: ...


@dataclass(frozen=True)
class _OfDynamics:
    """What is generated from functions that state the physics, and from nothing else."""

    dynamics: Dynamics

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that it follows from."""
        return (self.dynamics.__name__,)

    @property
    def variant(self) -> str:
        """It depends on nothing else."""
        return ""


@dataclass(frozen=True)
class System(_OfDynamics):
    """What a stepper is generated from: the state's derivative, of any mechanism."""

    prefix: ClassVar[str] = "kernel"

    def source(self, structure: Structure) -> str:
        """See :func:`kernel_source`."""
        return kernel_source(structure, self.dynamics)


def kernel_source(structure: Structure, dynamics: Dynamics) -> str:
    """Python source of a module with ``known`` and ``rates``, see ``simulation.runge_kutta``.

    KNOWN is how many numbers ``known`` fills.
    """
    names = {
        "state": [f"s{i}" for i in range(len(structure.state_names))],
        "torque": [f"u{i + 1}" for i in range(len(structure.mechanism.joints))],
        "lengths": length_names(structure),
        "theta": theta_names(structure),
    }
    shared, results = _printed(derivative_formulas(structure, dynamics, names))
    fixed = {f"{name}[{{0}}]": names[name] for name in ("lengths", "theta")}
    split = _Fixed({name for group in fixed.values() for name in group})
    lines = [line for name, code in shared if (line := split.assigned(name, code))]
    results = [split.varying(code) for code in results]
    known = split.known([*lines, *results])
    lines += [f"out[{i}] = {code}" for i, code in enumerate(results)]
    once = split.lines + [f"out[{i}] = {name}" for i, name in enumerate(known)]
    varying = {
        "state[{0}] + factor * slope[{0}]": names["state"],
        "torque[{0}]": names["torque"],
        "known[{0}]": known,
    }
    return "\n\n".join(
        [
            HEADER,
            _pointer_function("known", "lengths, theta", fixed, once),
            _pointer_function("rates", "state, factor, slope, torque, known", varying, lines),
            f"KNOWN = {len(known)}\n",
        ]
    )


class _Fixed(ast.NodeTransformer):
    """Takes out of code what follows from given names alone, to be computed once.

    The rest is computed in the order in which it stands, so results keep their bits.

    Attributes
    ----------
    lines : assignments of what is computed once
    """

    def __init__(self, names: set[str]) -> None:
        self._fixed, self._parts = set(names), dict[str, str]()
        self.lines: list[str] = []

    def assigned(self, name: str, code: str) -> str:
        """The assignment as far as it varies; empty if it is computed once."""
        if _names(code) <= self._fixed:
            self._fixed.add(name)
            self.lines.append(f"{name} = {code}")
            return ""
        return f"{name} = {self.varying(code)}"

    def varying(self, code: str) -> str:
        """Code with names in place of its largest parts that do not vary."""
        return ast.unparse(self.visit(ast.parse(code, mode="eval").body))

    def known(self, lines: Sequence[str]) -> list[str]:
        """What such code needs of all that is computed once."""
        used = set().union(*(_names(line) for line in lines))
        return sorted(used & self._fixed)

    def visit(self, node: ast.AST) -> ast.AST:
        """See ``ast.NodeTransformer``."""
        if not isinstance(node, (ast.BinOp, ast.UnaryOp, ast.Call, ast.IfExp)):
            return self.generic_visit(node)
        code = ast.unparse(node)
        if not (found := _names(code)) or not found <= self._fixed:
            return self.generic_visit(node)
        if code not in self._parts:
            name = self._parts[code] = f"k{len(self._parts)}"
            self._fixed.add(name)
            self.lines.append(f"{name} = {code}")
        return ast.Name(self._parts[code], ast.Load())


def _names(code: str) -> set[str]:
    """Names of numbers that code reads."""
    nodes = list(ast.walk(ast.parse(code)))
    called = {id(node.func) for node in nodes if isinstance(node, ast.Call)}
    return {
        node.id
        for node in nodes
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and id(node) not in called
    }


HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import cos, exp, sin, sqrt, tanh

from youbot_env.caching import njit'''


CALLED = '@njit(cache=True, error_model="numpy", no_cpython_wrapper=True)'
"""Of a function that compiled code calls by its address, see ``lane_calls``."""


@dataclass(frozen=True)
class Formulas:
    """What a generated function computes: expressions in its arguments, for a printer of any
    language. It returns the values of ``results`` at ``arguments``, names of numbers."""

    name: str
    arguments: tuple[str, ...]
    results: tuple[object, ...]

    def shared(self, prefix: str = "x") -> tuple[list[tuple[Any, Any]], list[Any]]:
        """Common subexpressions, each with the symbol that stands for it, in the order in which
        they are computed, and the results in terms of them."""
        import sympy

        results = [sympy.sympify(result) for result in self.results]
        names = sympy.numbered_symbols(prefix, real=True)
        parts, values = sympy.cse(results, symbols=names, order="none")
        return list(parts), list(values)


def derivative_formulas(
    structure: Structure, dynamics: Dynamics, names: Mapping[str, Sequence[str]]
) -> Formulas:
    """Rates of the state; ``names`` are those of the state, torque, lengths and theta."""
    symbol = {key: real_symbols(group) for key, group in names.items()}
    geometry = symbolic_geometry(structure, symbol["lengths"])
    rates = dynamics.state_derivative(
        symbols(), structure, geometry, symbol["theta"], symbol["state"], symbol["torque"]
    )
    arguments = (name for group in names.values() for name in group)
    return Formulas("derivative", tuple(arguments), tuple(rates))


def real_symbols(names: Sequence[str]) -> list[Any]:
    """Sympy symbols that stand for the arguments of a generated function."""
    import sympy

    # Real, so that sympy simplifies Abs and sign as for real numbers.
    return [sympy.Symbol(name, real=True) for name in names]


def symbolic_geometry(structure: Structure, symbol: Sequence[Any]) -> SimpleNamespace:
    """A geometry that has symbols for a mechanism's lengths, in their order."""
    return SimpleNamespace(**dict(zip(structure.mechanism.lengths, symbol, strict=True)))


def pointer_source(name: str, formulas: Formulas, arrays: Mapping[str, Sequence[str]]) -> str:
    """A compiled function of pointers that fills ``out`` with expressions in what they hold."""
    shared, results = _printed(formulas)
    lines = [f"{part} = {code}" for part, code in shared]
    lines += [f"out[{i}] = {code}" for i, code in enumerate(results)]
    places = {f"{array}[{{0}}]": numbers for array, numbers in arrays.items()}
    return _pointer_function(name, ", ".join(arrays), places, lines)


def _printed(formulas: Formulas) -> tuple[list[tuple[str, str]], list[str]]:
    """Common subexpressions by name, and the results, as code."""
    shared, values = formulas.shared()
    printer = python_printer()
    parts = [(str(part), printer.doprint(value)) for part, value in shared]
    return parts, [printer.doprint(value) for value in values]


def _pointer_function(
    name: str, arguments: str, places: Mapping[str, Sequence[str]], lines: Sequence[str]
) -> str:
    """A compiled function with C's arguments, the last a pointer to ``out``.

    ``places``: code for number {0} of an array -> the names of its numbers.

    Compiling a function for Python as well, or one of some fifty scalars and each of its calls,
    takes several times as long.
    """
    read = set().union(*(_names(line) for line in lines))
    loads = [
        f"{number} = {place.format(i)}"
        for place, numbers in places.items()
        for i, number in enumerate(numbers)
        if number in read
    ]
    head = f"def {name}({arguments}, out):"
    # The error model "numpy" divides to inf or NaN where Python would raise ZeroDivisionError: a
    # run that diverges holds such values instead of ending in an exception.
    return "\n    ".join([f"{CALLED}\n{head}", *loads, *lines, "return 0\n"])


MOTION = (
    *("vx", "vy", "wz", "ax", "ay", "alpha", "x", "y", "yaw"),
    *("q1", "q2", "q3", "q4", "time"),
)
"""Columns of a motion's row: twist, acceleration, pose, wheel angles, time."""

TORQUES = ("u1", "u2", "u3", "u4")

RATES = ("w1", "w2", "w3", "w4")

SECOND_RATES = ("z1", "z2", "z3", "z4")


@dataclass(frozen=True)
class Inverse(_OfDynamics):
    """What the inverse dynamics of the platform is generated from, for the cache of kernels."""

    prefix: ClassVar[str] = "inverse"

    def source(self, structure: Structure) -> str:
        """Python source of a module with ``demand`` and ``command``, see ``inverse_loops``."""
        known = {"lengths": length_names(structure), "theta": theta_names(structure)}
        motion = {"motion": MOTION, "torque": TORQUES}
        torque = {"torque": TORQUES, "rate": RATES, "second": SECOND_RATES, "motion": MOTION}
        return "\n\n".join(
            [
                HEADER,
                pointer_source(
                    "demand", demand_formulas(structure, self.dynamics), {**motion, **known}
                ),
                pointer_source(
                    "command", command_formulas(structure, self.dynamics), {**torque, **known}
                ),
            ]
        )


def length_names(structure: Structure) -> list[str]:
    """Names of a mechanism's lengths in generated code."""
    return [f"g_{name}" for name in structure.mechanism.lengths]


def theta_names(structure: Structure) -> list[str]:
    """The same of the parameters."""
    return [f"p{i}" for i in range(len(structure.parameter_names))]


def demand_formulas(
    structure: Structure,
    dynamics: Dynamics,
    lengths: Sequence[str] | None = None,
    theta: Sequence[str] | None = None,
    motion: Sequence[str] = MOTION,
    torque: Sequence[str] = TORQUES,
) -> Formulas:
    """Least-norm torques that a motion demands while given torques act.

    The arguments are named: ``motion`` (twist, acceleration, pose, joint angles, time), ``torque``,
    ``lengths``, ``theta``; by default as the platform's compiled code takes them.
    """
    mechanism = structure.mechanism
    lengths = length_names(structure) if lengths is None else lengths
    names = motion, torque, lengths, theta_names(structure) if theta is None else theta
    moving, acting, length, parameter = (real_symbols(group) for group in names)
    geometry = symbolic_geometry(structure, length)
    pose = 2 * len(mechanism.axes)
    angle = pose + len(mechanism.pose_state)
    at = Instant(
        twist=tuple(moving[: pose // 2]),
        acceleration=tuple(moving[pose // 2 : pose]),
        pose=tuple(moving[pose:angle]),
        wheel_angle=tuple(moving[angle:-1]),
        torque=tuple(acting),
        time=moving[-1],
    )
    force = dynamics.wrench(symbols(), structure, geometry, parameter, at)
    rolling = dynamics.rolling_geometry(symbols(), structure, geometry, parameter)
    torques = mechanism.torque_of(rolling, force)
    return Formulas("demand", tuple(name for group in names for name in group), tuple(torques))


def command_formulas(
    structure: Structure,
    dynamics: Dynamics,
    lengths: Sequence[str] | None = None,
    theta: Sequence[str] | None = None,
    motion: Sequence[str] = MOTION,
    torque: Sequence[str] = TORQUES,
    rate: Sequence[str] = RATES,
    second: Sequence[str] = SECOND_RATES,
) -> Formulas:
    """Interface torques behind which given torques act and change at given rates in a motion.

    The arguments are named as those of `demand_formulas`.
    """
    mechanism = structure.mechanism
    lengths = length_names(structure) if lengths is None else lengths
    names = (
        torque,
        rate,
        second,
        motion,
        lengths,
        theta_names(structure) if theta is None else theta,
    )
    acting, changing, bending, moving, length, parameter = (real_symbols(group) for group in names)
    geometry = symbolic_geometry(structure, length)
    # Drives and channels read no acceleration, pose or angle.
    twist = tuple(moving[: len(mechanism.axes)])
    at = Instant(
        twist,
        torque=tuple(acting),
        torque_rate=tuple(changing),
        torque_second_rate=tuple(bending),
        time=moving[-1],
    )
    results = dynamics.interface_torque(symbols(), structure, geometry, parameter, at)
    return Formulas("command", tuple(name for group in names for name in group), tuple(results))
