"""Turns the conversion of a model's stated parameters, and the check of its masses, into source.

It runs once an episode, for a model that is drawn: one row at a time, in double precision.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from youbot_env.physics.mechanism import Instant
from youbot_env.physics.namespaces import symbols
from youbot_env.physics.stated_parameters import internal_values, public_parameters
from youbot_env.simulation.generated_code import (
    CALLED,
    Dynamics,
    Structure,
    length_names,
    real_symbols,
    symbolic_geometry,
    theta_names,
)
from youbot_env.simulation.printing import lane_printer

DRAWS = ("drawn",)
"""Generated functions that serve the draw of an episode's model: always in double precision."""


def geometry_names(structure: Structure) -> tuple[str, ...]:
    """Names of all numbers of a mechanism's geometry, in the order that ``internal`` takes."""
    from dataclasses import fields, is_dataclass

    known = structure.mechanism.geometry
    if not is_dataclass(known):
        return ()
    return tuple(f.name for f in fields(known) if isinstance(getattr(known, f.name), float))


def draw_source(structure: Structure, dynamics: Dynamics) -> str:
    """Source of a compiled function of a model, which is called by address.

    drawn(stated, geometry, lengths, theta)
        Fills parameters (P,) from those as people state them (Q,); 1 if the mass matrix is then
        positive definite, else 0.
    """
    return "\n".join(
        [
            CALLED,
            "def drawn(stated, geometry, lengths, theta):",
            *_conversion(structure),
            *_mass_check(structure, dynamics),
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
    printer = lane_printer()
    import sympy

    lines = [f"    v{i} = stated[{i}]" for i in range(len(stated))]
    lines += [f"    g_{name} = geometry[{i}]" for i, name in enumerate(known)]
    lines += [f"    theta[{i}] = {printer.doprint(sympy.sympify(v))}" for i, v in enumerate(found)]
    return lines


def _mass_check(structure: Structure, dynamics: Dynamics) -> list[str]:
    """Sylvester's criterion: the mass matrix at rest is positive definite."""
    import sympy

    lengths, theta = length_names(structure), theta_names(structure)
    geometry = symbolic_geometry(structure, real_symbols(lengths))
    size = len(structure.mechanism.axes)
    at = Instant((0.0,) * size, (0.0,) * size, pose=(0.0,) * len(structure.mechanism.pose_state))
    rows = dynamics.mass_matrix(symbols(), structure, geometry, real_symbols(theta), at)
    matrix = sympy.Matrix([[sympy.sympify(value) for value in row] for row in rows])
    shared, values = sympy.cse(
        [matrix[i, j] for i in range(size) for j in range(size)],
        symbols=sympy.numbered_symbols("y"),
        order="none",
    )
    entries = real_symbols([f"m{i}{j}" for i in range(size) for j in range(size)])
    small: Any = sympy.Matrix(size, size, entries)
    minors = [small[:k, :k].det() for k in range(1, size + 1)]
    printer = lane_printer()
    lines = [f"    {name} = theta[{i}]" for i, name in enumerate(theta)]
    lines += [f"    {name} = lengths[{i}]" for i, name in enumerate(lengths)]
    lines += [f"    {name} = {printer.doprint(value)}" for name, value in shared]
    lines += [
        f"    {name} = {printer.doprint(value)}"
        for name, value in zip(entries, values, strict=True)
    ]
    tests = " and ".join(f"({printer.doprint(minor)}) > 0.0" for minor in minors)
    return [*lines, f"    return 1 if {tests} else 0"]
