"""Turns the one definition of physics into straight-line source for a compiler.

The equations are evaluated once on sympy symbols, common subexpressions are shared, and the result
is printed as Python that numba compiles. No equation of motion is written in this file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Protocol

from youbot_env.physics.mechanism import Components, Instant, ModelStructure
from youbot_env.physics.namespaces import Number, symbols

SOURCES = tuple(
    f"youbot_env.{name}"
    for name in (
        "simulation.generated_code",
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
class System:
    """What a stepper is generated from: the state's derivative, of any mechanism."""

    prefix: ClassVar[str] = "kernel"
    sources: ClassVar[tuple[str, ...]] = ()

    dynamics: Dynamics

    @property
    def variant(self) -> str:
        """It depends on nothing else."""
        return ""

    def source(self, structure: Structure) -> str:
        """See :func:`kernel_source`."""
        return kernel_source(structure, self.dynamics)


def kernel_source(structure: Structure, dynamics: Dynamics) -> str:
    """Python source of a module with ``derivative``, ``advance`` and ``rollout``."""
    mechanism = structure.mechanism
    size = len(structure.state_names)
    names = {
        "state": [f"s{i}" for i in range(size)],
        "torque": [f"u{i + 1}" for i in range(len(mechanism.joints))],
        "lengths": _lengths(structure),
        "theta": [f"p{i}" for i in range(len(structure.parameter_names))],
    }
    derivative = function_source(derivative_formulas(structure, dynamics, names))
    return "\n\n".join([HEADER, derivative, _step(size, names), _loops(size, names)])


HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import cos, exp, sin, sqrt, tanh

from youbot_env.caching import njit'''


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
    geometry = SimpleNamespace(
        **dict(zip(structure.mechanism.lengths, symbol["lengths"], strict=True))
    )
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


def function_source(formulas: Formulas) -> str:
    """A compiled function of scalars that returns a tuple of expressions in its arguments."""
    shared, values = formulas.shared()
    printer = _printer()
    # The error model "numpy" divides to inf or NaN where Python would raise ZeroDivisionError: a
    # run that diverges holds such values instead of ending in an exception.
    lines = [f"    {part} = {printer.doprint(value)}" for part, value in shared]
    returned = ",\n        ".join(printer.doprint(value) for value in values)
    head = f"def {formulas.name}({', '.join(formulas.arguments)}):"
    return (
        f"@njit(cache=True, error_model='numpy')\n{head}\n"
        + "\n".join(lines)
        + f"\n    return (\n        {returned},\n    )"
    )


def _printer() -> Any:
    from sympy.printing.pycode import PythonCodePrinter

    class Printer(PythonCodePrinter):
        def _print_sign(self, expr: Any) -> str:
            # Sympy prints sign as copysign(1, x), which is not 0 at 0. NaN gives 0 here.
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

    # The torque is linear in the step, so its middle is the mean of its ends.
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
    # Torque at the start and end of each substep: from j / n to (j + 1) / n of the interval.
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


MOTION = (
    *("vx", "vy", "wz", "ax", "ay", "alpha", "x", "y", "yaw"),
    *("q1", "q2", "q3", "q4", "time"),
)
"""Columns of a motion's row: twist, acceleration, pose, wheel angles, time."""

TORQUES = ("u1", "u2", "u3", "u4")

RATES = ("w1", "w2", "w3", "w4")

SECOND_RATES = ("z1", "z2", "z3", "z4")

ROUNDS = 400
"""Most iterations for torques that depend on themselves. Each reduces the error by the share of the
loss: the largest share is 0.9, and 0.9^400 is below rounding. A share of 0.3 takes 30."""

SANE = 1e6
"""Sum of torques [N m] above which a first guess is replaced by 0, as is NaN: an iteration from NaN
would stay there."""


@dataclass(frozen=True)
class Inverse:
    """What the inverse dynamics of the platform is generated from, for the cache of kernels."""

    prefix: ClassVar[str] = "inverse"
    sources: ClassVar[tuple[str, ...]] = ()

    dynamics: Dynamics

    @property
    def variant(self) -> str:
        """It depends on nothing else."""
        return ""

    def source(self, structure: Structure) -> str:
        """Python source of a module with what ``kernels.InverseKernel`` holds."""
        return "\n\n".join(
            [
                HEADER,
                function_source(demand_formulas(structure, self.dynamics)),
                function_source(command_formulas(structure, self.dynamics)),
                _inverse_loops(structure),
            ]
        )


def _lengths(structure: Structure) -> list[str]:
    return [f"g_{name}" for name in structure.mechanism.lengths]


def _theta(structure: Structure) -> list[str]:
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
    lengths = _lengths(structure) if lengths is None else lengths
    names = motion, torque, lengths, _theta(structure) if theta is None else theta
    moving, acting, length, parameter = (real_symbols(group) for group in names)
    geometry = SimpleNamespace(**dict(zip(mechanism.lengths, length, strict=True)))
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
    lengths = _lengths(structure) if lengths is None else lengths
    names = torque, rate, second, motion, lengths, _theta(structure) if theta is None else theta
    acting, changing, bending, moving, length, parameter = (real_symbols(group) for group in names)
    geometry = SimpleNamespace(**dict(zip(mechanism.lengths, length, strict=True)))
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


def _inverse_loops(structure: Structure) -> str:
    theta = ", ".join(f"theta[{i}]" for i in range(len(structure.parameter_names)))
    lengths = ", ".join(f"lengths[{i}]" for i in range(len(structure.mechanism.lengths)))
    row = ", ".join(f"motion[k, {i}]" for i in range(len(MOTION)))
    place = ", ".join(f"motion[{i}]" for i in range(len(MOTION)))
    # Without losses under load the demand does not read the torque: the first round is exact.
    rounds = ROUNDS if structure.depends_on_load else 1
    return f"""@njit(cache=True, error_model='numpy')
def acting(motion, lengths, theta, tolerance, torque):
    for k in range(motion.shape[0]):
        a, b, c, d = torque[k, 0], torque[k, 1], torque[k, 2], torque[k, 3]
        if not abs(a) + abs(b) + abs(c) + abs(d) < {SANE}:
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for _ in range({rounds}):
            u1, u2, u3, u4 = demand({row}, a, b, c, d, {lengths}, {theta})
            moved = abs(u1 - a) + abs(u2 - b) + abs(u3 - c) + abs(u4 - d)
            a, b, c, d = u1, u2, u3, u4
            if moved <= tolerance:
                break
        torque[k, 0], torque[k, 1], torque[k, 2], torque[k, 3] = a, b, c, d


@njit(cache=True, error_model='numpy')
def several(motion, lengths, thetas, tolerance, torque):
    for j in range(thetas.shape[0]):
        acting(motion, lengths, thetas[j], tolerance, torque[j])


@njit(cache=True, error_model='numpy')
def interface(torque, rate, second, motion, lengths, theta, out):
    out[0], out[1], out[2], out[3] = command(
        torque[0], torque[1], torque[2], torque[3],
        rate[0], rate[1], rate[2], rate[3],
        second[0], second[1], second[2], second[3],
        {place}, {lengths}, {theta}
    )


@njit(cache=True, error_model='numpy')
def held(motion, hold, lengths, theta, tolerance, torque, mean, out):
    acting(motion, lengths, theta, tolerance, torque)
    second = torque[0].copy()
    for i in range(4):
        second[i] = 4.0 * (torque[0, i] - 2.0 * torque[1, i] + torque[2, i]) / hold**2
        mean[i] = (torque[0, i] + 4.0 * torque[1, i] + torque[2, i]) / 6.0
        out[i] = (torque[2, i] - torque[0, i]) / hold
    interface(mean, out, second, motion[1], lengths, theta, out)
"""
