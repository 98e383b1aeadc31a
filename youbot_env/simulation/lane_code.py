"""Turns the one definition of physics into loops over rows that a compiler vectorises.

The state's derivative is evaluated once on sympy symbols, as for the other kernels, put in order
(``lane_program``) and written as loops over the rows of a block (``lane_layout``). No equation of
motion is written in this file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from youbot_env.physics.mechanism import Instant
from youbot_env.physics.namespaces import symbols
from youbot_env.simulation.generated_code import (
    CALLED,
    Dynamics,
    Structure,
    length_names,
    real_symbols,
    symbolic_geometry,
    theta_names,
)
from youbot_env.simulation.lane_layout import COEFFICIENTS, DURATION, LANES, TOGETHER, TORQUE
from youbot_env.simulation.lane_program import (
    LaneProgram,
    is_weighted_sum,
    number,
    words,
)
from youbot_env.simulation.printing import lane_printer

STAGES = ("ka", "kb", "kc", "kd")
"""Names of the four slopes of a step in generated code."""


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
    """
    mechanism = structure.mechanism
    size = len(structure.state_names)
    names = {
        "state": [f"s{i}" for i in range(size)],
        "torque": [f"u{i}" for i in range(len(mechanism.joints))],
        "lengths": length_names(structure),
        "theta": theta_names(structure),
    }
    symbol = {key: real_symbols(group) for key, group in names.items()}
    geometry = symbolic_geometry(structure, symbol["lengths"])
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
    read = program.read_states(polynomials)
    # Such a state is the integral of others with fixed weights and nobody reads it: it needs their
    # mean over a step, not four evaluations.
    integral = [
        index
        for index, (state, found) in enumerate(zip(states, polynomials, strict=True))
        if state not in read and is_weighted_sum(found, set(states))
    ]
    direct = [index for index in range(len(states)) if index not in integral]
    code = {index: program.text(polynomials[index]) for index in direct}
    weights = {
        index: [
            (number(program.constant(c)), monomial[0][0].name if monomial else "")
            for monomial, c in polynomials[index].items()
        ]
        for index in integral
    }
    opaque = {name.name: program.code(value) for name, value in program.opaque.items()}
    still = [name for name in opaque if not program.moves(program.symbol(name))]
    inputs = sorted({states.index(state) for state in read})
    turned = program.turned_states()
    moving = [name for name in opaque if name not in still and name not in turned]
    formulas = [*code.values(), *(opaque[name] for name in moving)]
    formulas += [weight for rows in weights.values() for weight, _ in rows]
    used = {word for formula in formulas for word in words(formula)}
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

    printer = lane_printer()
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
    for place, (letter, step) in enumerate(zip(STAGES, ("half", "half", "dt", ""), strict=True)):
        points.append(dict(stage))
        arguments = ", ".join([*(stage[index] for index in inputs), *turns, *kept])
        results = ", ".join(f"{letter}{index}" for index in direct)
        body.append(f"{results}{',' if len(direct) == 1 else ''} = lane_derivative({arguments})")
        if place < 3:
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

    printer = lane_printer()
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
