"""One axis in print: its equation and its effects, from their own functions on sympy symbols.

Position x, speed v (a prime is the time derivative), force F that acts, time t. Of an axis that
turns the same letters are an angle, its rate and a torque. M is a drive's effort.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import sympy

from identification.mechanisms.axis import AXIS
from identification.mechanisms.axis_effects import AXIS_BASE, JOINT, TURNING, Base, Joint
from youbot_env.equations import equations as symbolic
from youbot_env.equations.printing import collected, join, latex, text
from youbot_env.physics.effect import Effect
from youbot_env.physics.namespaces import symbols
from youbot_env.physics.structure import ModelStructure

Form = Literal["text", "latex"]

FORCE = "F"


def _real(names: Iterable[str]) -> list[sympy.Symbol]:
    return [sympy.Symbol(name, real=True) for name in names]


_BASE = Base(*_real(name for item in AXIS_BASE for name in item.parameter_names))
_JOINT = Joint(*_real(("v", "v'", "x", FORCE, "t")), base=_BASE)
_MOTION = set(_JOINT[:-1])


def formula(item: Effect, form: Form = "text") -> str:
    """One line: what an effect adds to the force that a motion demands."""
    if item.acts_at not in (JOINT, TURNING):
        return symbolic.formula(item, form)
    added = item.function(symbols(), _JOINT, *_real(item.parameter_names))
    return _sum(f"d{FORCE}", [added], form)


def equation(effects: Sequence[str] = (), form: Form = "text") -> str:
    """The equation of motion with effects, and below it what drives and clocks do.

    Raises
    ------
    InputError
        If an effect is unknown or named twice.
    """
    structure = ModelStructure(tuple(effects), AXIS)
    terms = [
        item.function(symbols(), _JOINT, *_real(item.parameter_names))
        for item, _ in structure.wrenches
    ]
    others = [item for item in structure.components if item.acts_at.kind != "wrench"]
    return "\n".join([_sum(FORCE, terms, form), *(formula(item, form) for item in others)])


def _sum(name: str, terms: Iterable[Any], form: Form) -> str:
    show = latex if form == "latex" else text
    groups = [group for term in terms for group in collected(_turns(term), _MOTION)]
    return f"{show(sympy.Symbol(name))} = {join(groups, show)}"


def _turns(term: Any) -> Any:
    """A full turn, a number in an effect's function, as 2 pi."""
    numbers = sympy.sympify(term).atoms(sympy.Float)
    turn = {n: 2 * sympy.pi for n in numbers if abs(float(n) / (2 * sympy.pi) - 1) < 1e-12}
    return sympy.sympify(term).xreplace(turn)
