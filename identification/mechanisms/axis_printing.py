"""One axis in print: its symbols, and its equation from its effects' own functions.

Position x, speed v (a prime is the time derivative), force F that acts, time t. Of an axis that
turns the same letters are an angle, its rate and a torque. M is a drive's effort.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal, cast

import sympy

from identification.mechanisms.axis import AXIS
from identification.mechanisms.axis_effects import AXIS_BASE, JOINT, TURNING, Base, Joint
from youbot_env.equations import equations as symbolic
from youbot_env.equations.equations import PLATFORM, Notation, real_symbols
from youbot_env.equations.printing import collected, join, latex, text
from youbot_env.physics.effect import BaseParameters, Effect
from youbot_env.physics.mechanism import ModelStructure
from youbot_env.physics.namespaces import symbols

Form = Literal["text", "latex"]

FORCE = "F"


_BASE = Base(*real_symbols(name for item in AXIS_BASE for name in item.parameter_names))
_JOINT = Joint(*real_symbols(("v", "v'", "x", FORCE, "t")), base=cast(BaseParameters, _BASE))

NOTATION = Notation(
    # Drives and clocks act on the effort alone, as those of the platform do.
    points={**PLATFORM.points, JOINT: _JOINT, TURNING: _JOINT},
    words={**PLATFORM.words, JOINT: (f"d{FORCE}",), TURNING: (f"d{FORCE}",)},
    base=tuple(_BASE),
)
"""Symbols of one axis."""

formula = partial(symbolic.formula, notation=NOTATION)
"""One line: what an effect adds to the force that a motion demands."""


try_out = partial(symbolic.try_out, notation=NOTATION)
"""Evaluate an effect of an axis on numbers and on symbols."""


def equation(effects: Sequence[str] = (), form: Form = "text") -> str:
    """The equation of motion with effects, and below it what drives and clocks do.

    Raises
    ------
    InputError
        If an effect is unknown or named twice.
    """
    structure, show = ModelStructure(tuple(effects), AXIS), latex if form == "latex" else text
    groups = [group for item, _ in structure.wrenches for group in _groups(item)]
    first = f"{show(sympy.Symbol(FORCE))} = {join(groups, show)}"
    others = [item for item in structure.components if item.acts_at.kind != "wrench"]
    return "\n".join([first, *(formula(item, form) for item in others)])


def _groups(item: Effect) -> list[symbolic.Group]:
    term = item.function(symbols(), _JOINT, *real_symbols(item.parameter_names))
    return collected(term, NOTATION.motion(JOINT))
