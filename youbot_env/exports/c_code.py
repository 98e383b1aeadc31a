"""The model as C99 source: forward and inverse dynamics, and a plant, without dependencies.

Formulas come from the one inverse dynamics, as those of the compiled kernels do
(:mod:`youbot_env.simulation.generated_code`); what does not depend on the model (integration, the
delay line, the search for torques under load) stands in the templates of the folder ``c``. The code
allocates nothing, keeps no state of its own, and may be called from several threads.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import numpy as np

import youbot_env
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant
from youbot_env.physics.namespaces import symbols
from youbot_env.simulation.generated_code import (
    Formulas,
    command_formulas,
    demand_formulas,
    derivative_formulas,
    real_symbols,
)
from youbot_env.simulation.inverse_loops import ROUNDS, SANE
from youbot_env.simulation.plant import plant_substeps

NAME = "youbot"
"""Prefix of all names and files in the templates, and the default of what is exported."""

SHORTEST_STEP = 1e-3
"""[s] Commands held for at least that long have room in the exported plant's delay line."""

SAMPLES = 24
"""Motions with Python's results that the test driver carries."""

_UNITS = {
    **dict.fromkeys(("velocity_x", "velocity_y"), "m/s"),
    "yaw_rate": "rad/s",
    **dict.fromkeys(("x", "y"), "m in the world"),
    "yaw": "rad, does not wrap",
    **dict.fromkeys(("time", "start"), "s"),
}
_PREFIX_UNITS = {"angle_": "rad", "torque_": "N m, acts at the joint"}


@dataclass(frozen=True)
class Check:
    """A further check of the test driver.

    headers : files that it includes; functions : its source; call : an expression that returns how
    many checks failed; tolerances : declarations before it
    """

    headers: tuple[str, ...]
    functions: str
    call: str
    tolerances: str = ""


def to_c(
    model: str | os.PathLike[str] | Model,
    *,
    name: str = NAME,
    period: float = 0.001,
    checks: Sequence[Check] = (),
) -> dict[str, str]:
    """The model as C99: text of ``NAME_model.h``, ``NAME_model.c`` and the driver ``NAME_test.c``.

    Parameters
    ----------
    model : of any mechanism; a model file, or a shipped model's name
    name : begins all names in the code, and those of the files
    period : [s] for which the steps that the plant needs are stated
    checks : further ones of the driver

    Raises
    ------
    InputError
        If the model cannot be read, or the name is none of C.
    """
    model = load_model(model)
    name = checked_name(name)
    period = finite("period [s]", period, positive=True)
    parts = _Parts(model)
    marks = {
        "about": about(model),
        "axes": str(len(parts.mechanism.axes)),
        "axis_names": ", ".join(parts.mechanism.axes),
        "joints": str(len(parts.mechanism.joints)),
        "joint_names": ", ".join(parts.mechanism.joints),
        "positions": str(len(parts.mechanism.pose_state)),
        "states": str(len(model.structure.state_names)),
        "state_index": parts.state_index(),
        "parameter_fields": parts.fields(),
        "stated_values": parts.stated_values(),
        "velocity_note": _note(parts.mechanism.velocity_state),
        "pose_note": _note(parts.mechanism.pose_state),
        "delay_slots": str(_delay_slots(model)),
        "period": f"{period:g}",
        "plant_steps": str(plant_substeps(model, period)),
        "parameter_values": parts.values(),
        "rounds": str(ROUNDS if model.structure.depends_on_load else 1),
        "sane": number(SANE),
        **parts.functions(),
        "samples": _samples(model),
        "includes": "\n".join(
            f'#include "{NAME}_{file}"'
            for file in dict.fromkeys(("model.h", *(h for check in checks for h in check.headers)))
        ),
        "tolerances": "\n".join(check.tolerances for check in checks),
        "more_checks": "\n".join(check.functions for check in checks),
        "more_calls": "\n".join(f"    failed += {check.call};" for check in checks),
    }
    files = ("model.h", "model.c", "test.c")
    return {f"{name}_{file}": filled(template(file), marks, name) for file in files}


# --- templates -------------------------------------------------------------------------------


def template(file: str, package: str = "youbot_env.exports") -> str:
    """Text of a template that stands in the folder ``c`` of a package."""
    return resources.files(package).joinpath("c", file).read_text("utf-8")


def filled(text: str, marks: Mapping[str, str], name: str) -> str:
    """A template with its marks ``/*@mark@*/`` replaced, under a prefix of the user's."""
    text = re.sub(r"/\*@(\w+)@\*/\n?", lambda found: _mark(found, marks), text)
    return text.replace(f"{NAME}_", f"{name}_").replace(
        f"{NAME.upper()}_", f"{re.sub('[^A-Z0-9]', '_', name.upper())}_"
    )


def _mark(found: re.Match[str], marks: Mapping[str, str]) -> str:
    value = marks[found[1]]
    # A mark that stands for nothing takes its line with it.
    return value + ("\n" if found[0].endswith("\n") and value else "")


def checked_name(name: str) -> str:
    """A prefix of C names.

    Raises
    ------
    InputError
        If C has no such names.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        raise InputError(
            f"name {printable(name)!r}: must be a name of C: a letter, then letters, digits or _, "
            "31 at most"
        )
    return name


def about(model: Model) -> str:
    """The comment that heads a file: where it comes from."""
    return (
        f"/* Generated by youbot {youbot_env.__version__} from the model "
        f'"{printable(model.name)}". Do not edit: export it again. */'
    )


def printable(text: str, most: int = 60) -> str:
    """Text of a user as a comment may hold it: without a star nothing ends or begins one."""
    return re.sub(r"[^A-Za-z0-9 .,:;()=+_/^-]", "_", text)[:most]


def identifier(text: str) -> str:
    """A name of C for a parameter's or a state's name."""
    # Python allows letters in its names that C compilers do not.
    return re.sub("[^A-Za-z0-9_]", lambda sign: f"_u{ord(sign[0]):x}", text.replace(".", "_"))


def number(value: float) -> str:
    """A literal of C that is exactly this number."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def initialiser(values: Iterable[Any]) -> str:
    """The initialiser of an array or a structure; nested ones, one inside the other."""
    items = (initialiser(value) if np.ndim(value) else number(value) for value in values)
    return "{" + ", ".join(items) + "}"


# --- printing of formulas --------------------------------------------------------------------


def c_function(head: str, formulas: Formulas, places: Mapping[str, str], out: Sequence[str]) -> str:
    """A function that computes formulas.

    Parameters
    ----------
    head : its declaration; names of arrays that no formula reads are silenced
    places : where each argument of the formulas stands, ``p->m0`` or ``state[YOUBOT_STATE_YAW]``
    out : where the results go; () returns the one that there is
    """
    return c_lines(head, *_shared(formulas), places, out)


def c_lines(
    head: str,
    parts: Sequence[tuple[Any, Any]],
    values: Sequence[Any],
    places: Mapping[str, str],
    out: Sequence[str],
) -> str:
    """:func:`c_function` of values in terms of parts that are computed first, in their order."""
    import sympy

    expressions = [*(expression for _, expression in parts), *values]
    read = {symbol for expression in expressions for symbol in expression.free_symbols}
    # Parameters are read where they stand; of the rest a local name reads better than an index.
    locals_ = {
        name: place
        for name, place in places.items()
        if not place.startswith("p->") and sympy.Symbol(name, real=True) in read
    }
    printer = _printer({name: place for name, place in places.items() if name not in locals_})
    lines = [f"const double {name} = {place};" for name, place in locals_.items()]
    lines += [f"const double {symbol} = {printer.doprint(value)};" for symbol, value in parts]
    text = [printer.doprint(value) for value in values]
    body = [f"{place} = {value};" for place, value in zip(out, text, strict=False)]
    if not out:
        body = [f"return {text[0]};"]
    written = "\n".join((*lines, *body))
    arguments = re.findall(r"(\w+)(?:\[\w+\])?[,)]", head)
    silenced = [f"(void){name};" for name in arguments if not re.search(rf"\b{name}\b", written)]
    inside = [f"    {line}" for line in (*lines, *silenced, *body)]
    return "\n".join([head, "{", *inside, "}"])


def _shared(formulas: Formulas) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Common subexpressions and results of formulas."""
    return replace(formulas, results=_whole(formulas.results)).shared("e")


def split(
    formulas: Formulas, names: Sequence[str]
) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]], list[Any]]:
    """What of formulas stays when some arguments change: fixed parts, moving parts, results.

    Moving parts and results name fixed ones, and nothing but sums and products of them with what
    follows from the changing arguments is left to be computed again.
    """
    import sympy

    parts, values = _shared(formulas)
    moving = {sympy.Symbol(name, real=True) for name in names}
    fixed: list[tuple[Any, Any]] = []
    left: list[tuple[Any, Any]] = []
    computed: set[Any] = set()
    symbols_ = sympy.numbered_symbols("f", real=True)

    def moves(expression: Any) -> bool:
        return bool(expression.free_symbols & moving)

    def kept(expression: Any) -> Any:
        if not moves(expression):
            if expression.is_number or expression in computed:
                return expression
            fixed.append((next(symbols_), expression))
            computed.add(fixed[-1][0])
            return fixed[-1][0]
        if not (expression.is_Add or expression.is_Mul):
            return expression.func(*map(kept, expression.args)) if expression.args else expression
        still = [part for part in expression.args if not moves(part)]
        others = [kept(part) for part in expression.args if moves(part)]
        return expression.func(*([kept(expression.func(*still))] if still else []), *others)

    for symbol, expression in parts:
        if moves(expression):
            left.append((symbol, kept(expression)))
            moving.add(symbol)
        else:
            fixed.append((symbol, expression))
            computed.add(symbol)
    return fixed, left, [kept(value) for value in values]


def _whole(results: Sequence[object]) -> tuple[object, ...]:
    """The same expressions without factors of 1.0: signs and unit vectors are floats there."""
    import sympy

    found = [sympy.sympify(result) for result in results]
    floats = {value for result in found for value in result.atoms(sympy.Float)}
    whole = {value: sympy.Integer(value) for value in floats if float(value).is_integer()}
    return tuple(result.xreplace(whole) for result in found)


def _printer(places: Mapping[str, str]) -> Any:
    from sympy.printing.c import C99CodePrinter

    class Printer(C99CodePrinter):
        def _print_Symbol(self, expr: Any) -> str:
            return places.get(expr.name, expr.name)

        def _print_Pow(self, expr: Any) -> str:
            base, exponent = expr.as_base_exp()
            whole = int(exponent) if exponent.is_Integer else 0
            # A product is faster than pow and is what Python's compiler makes of it, too.
            if abs(whole) not in (2, 3):
                return super()._print_Pow(expr)
            power = f"{'square' if abs(whole) == 2 else 'cube'}({self._print(base)})"
            return power if whole > 0 else f"1.0 / {power}"

        def _print_Integer(self, expr: Any) -> str:
            return f"{int(expr)}.0"

        def _print_Piecewise(self, expr: Any) -> str:
            # On one line: sympy breaks it into five.
            return " ".join(super()._print_Piecewise(expr).split())

    return Printer()


HELPERS = {
    "square": "static double square(double x)\n{\n    return x * x;\n}\n",
    "cube": "static double cube(double x)\n{\n    return x * x * x;\n}\n",
}
"""What printed formulas may call; those that they do not call would make a warning."""


class _Parts:
    """The parts of a model's code that follow from its structure."""

    def __init__(self, model: Model) -> None:
        self.model, self.structure = model, model.structure
        self.mechanism = self.structure.mechanism
        self.states = [identifier(name) for name in self.structure.state_names]
        names = [*self.structure.parameter_names, *self.mechanism.lengths]
        self.field_names = [identifier(name) for name in names]
        self.field_values = [*model.theta, *model.lengths]
        if len(set(self.field_names)) < len(self.field_names):
            raise InputError(f"model {model.name}: two parameters would have one name in C")

    def state_index(self) -> str:
        """Members of the enumeration of a state's components."""
        names = [f"    YOUBOT_STATE_{identifier(state).upper()}" for state in self.states]
        ends = [","] * (len(names) - 1) + [""]  # C99's pedants allow no comma after the last
        units = [_unit(state) for state in self.structure.state_names]
        return "\n".join(
            f"{name}{end}".ljust(36) + f"/* [{unit}] */"
            for name, end, unit in zip(names, ends, units, strict=True)
        )

    def fields(self) -> str:
        """Fields of the structure of parameters, each with its unit."""
        units = [
            item.parameter(name).unit
            for item in self.structure.components
            for name in item.parameter_names
        ]
        units += ["m"] * len(self.mechanism.lengths)
        width = 13 + max(map(len, self.field_names))
        return "\n".join(
            f"    double {name};".ljust(width) + f"/* [{printable(unit)}] */"
            for name, unit in zip(self.field_names, units, strict=True)
        )

    def stated_values(self) -> str:
        """The parameters as people state them, as lines of a comment."""
        lengths = zip(self.mechanism.lengths, self.model.lengths, strict=True)
        stated = {**self.model.values, **dict(lengths)}
        return "\n".join(f"   {printable(name)} = {value:.9g}" for name, value in stated.items())

    def values(self) -> str:
        """Their initialiser."""
        return "\n".join(
            f"    .{name} = {number(value)},"
            for name, value in zip(self.field_names, self.field_values, strict=True)
        )

    def functions(self) -> dict[str, str]:
        """The functions that are generated from the physics, by the mark that they replace."""
        found = {
            "forward_dynamics": self._forward(),
            "demand": self._demand(),
            "interface_torque": self._interface(),
            "torque_delay": self._delay(),
        }
        called = [name for name in HELPERS if any(f"{name}(" in text for text in found.values())]
        return found | {"helpers": "\n".join(HELPERS[name] for name in called)}

    def _parameters(self) -> dict[str, str]:
        # Names that no local variable has.
        return {f"p->{name}": f"p->{name}" for name in self.field_names}

    def _theta(self) -> list[str]:
        count = len(self.structure.parameter_names)
        return list(self._parameters())[:count]

    def _lengths(self) -> list[str]:
        return list(self._parameters())[len(self.structure.parameter_names) :]

    def _forward(self) -> str:
        states = self.states
        efforts = [f"effort_{identifier(name)}" for name in self.mechanism.joints]
        formulas = derivative_formulas(
            self.structure,
            dynamics,
            {
                "state": states,
                "torque": efforts,
                "lengths": self._lengths(),
                "theta": self._theta(),
            },
        )
        places = {
            **{name: f"state[YOUBOT_STATE_{name.upper()}]" for name in states},
            **{name: f"torque[{k}]" for k, name in enumerate(efforts)},
            **self._parameters(),
        }
        head = (
            "void youbot_forward_dynamics(const youbot_parameters *p,\n"
            "                             const double state[YOUBOT_STATES],\n"
            "                             const double torque[YOUBOT_JOINTS],\n"
            "                             double rates[YOUBOT_STATES])"
        )
        return c_function(
            head, formulas, places, [f"rates[{places[name][6:-1]}]" for name in states]
        )

    def _demand(self) -> str:
        motion, places = self._motion()
        torques = [f"torque_{identifier(name)}" for name in self.mechanism.joints]
        places |= {name: f"torque[{k}]" for k, name in enumerate(torques)} | self._parameters()
        formulas = demand_formulas(
            self.structure, dynamics, self._lengths(), self._theta(), motion, torques
        )
        fixed, left, values = split(formulas, torques)
        expressions = [*(expression for _, expression in left), *values]
        own = {symbol for symbol, _ in left} | set(real_symbols(torques))
        read = {symbol for expression in expressions for symbol in expression.free_symbols}
        kept = sorted(read - own, key=str)
        at = {str(symbol): f"fixed[{k}]" for k, symbol in enumerate(kept)}
        preparing = c_lines(
            "static void fixed_demand(const youbot_parameters *p, const youbot_motion *motion,\n"
            "                         double fixed[FIXED])",
            fixed, kept, places, [*at.values()],
        )  # fmt: skip
        demanding = c_lines(
            "static void demanded_torque(const double fixed[FIXED],\n"
            "                            const double torque[YOUBOT_JOINTS],\n"
            "                            double demanded[YOUBOT_JOINTS])",
            left, values, {**places, **at}, _array("demanded", torques),
        )  # fmt: skip
        return f"enum {{ FIXED = {max(len(kept), 1)} }};\n\n{preparing}\n\n{demanding}"

    def _motion(self) -> tuple[list[str], dict[str, str]]:
        """Names of what a motion is at one instant, in order, and where each stands in C."""
        mechanism = self.mechanism
        velocity = [identifier(name) for name in mechanism.velocity_state]
        rates = [f"{name}_dot" for name in velocity]
        pose = [identifier(name) for name in mechanism.pose_state]
        angles = [f"angle_{identifier(name)}" for name in mechanism.joints]
        arrays = {"velocity": velocity, "acceleration": rates, "pose": pose, "joint_angle": angles}
        motion = [*(name for names in arrays.values() for name in names), "time"]
        places = {
            name: f"motion->{array}[{k}]"
            for array, names in arrays.items()
            for k, name in enumerate(names)
        }
        return motion, places | {"time": "motion->time"}

    def _interface(self) -> str:
        torques = [f"torque_{identifier(name)}" for name in self.mechanism.joints]
        rates = [f"rate_{identifier(name)}" for name in self.mechanism.joints]
        motion, places = self._motion()
        lengths, theta = self._lengths(), self._theta()
        second = [f"second_{identifier(name)}" for name in self.mechanism.joints]
        formulas = command_formulas(
            self.structure, dynamics, lengths, theta, motion, torques, rates, second
        )
        places |= {
            **{name: f"torque[{k}]" for k, name in enumerate(torques)},
            **{name: f"torque_rate[{k}]" for k, name in enumerate(rates)},
            **{name: f"torque_second_rate[{k}]" for k, name in enumerate(second)},
            **self._parameters(),
        }
        head = (
            "void youbot_interface_torque(const youbot_parameters *p,\n"
            "                             const youbot_motion *motion,\n"
            "                             const double torque[YOUBOT_JOINTS],\n"
            "                             const double torque_rate[YOUBOT_JOINTS],\n"
            "                             const double torque_second_rate[YOUBOT_JOINTS],\n"
            "                             double command[YOUBOT_JOINTS])"
        )
        return c_function(head, formulas, places, _array("command", torques))

    def _delay(self) -> str:
        theta = self._theta()
        delay = dynamics.torque_delay(symbols(), self.structure, real_symbols(theta))
        head = "double youbot_torque_delay(const youbot_parameters *p)"
        return c_function(head, Formulas("delay", tuple(theta), (delay,)), self._parameters(), ())


def _array(name: str, components: Sequence[str]) -> list[str]:
    return [f"{name}[{k}]" for k in range(len(components))]


def _unit(state: str) -> str:
    """Unit of a state's component."""
    prefixed = (unit for start, unit in _PREFIX_UNITS.items() if state.startswith(start))
    return _UNITS.get(state) or next(prefixed, "SI")


def _note(names: Sequence[str]) -> str:
    """Names and units of the components of an array, as a comment."""
    return "/* " + ", ".join(f"{name} [{_unit(name)}]" for name in names) + " */"


def _delay_slots(model: Model) -> int:
    # Two more: the command that arrives and the one of which a part is left.
    return math.ceil(max(model.delay, 0.0) / SHORTEST_STEP) + 34


def _samples(model: Model) -> str:
    """Initialisers of the test driver's motions, with Python's results."""
    rng = np.random.default_rng(0)
    mechanism = model.structure.mechanism
    axes, poses, joints = (
        len(names) for names in (mechanism.axes, mechanism.pose_state, mechanism.joints)
    )
    full = np.asarray(mechanism.full_speed(model.geometry), float)
    most = float(mechanism.full_torque(model.geometry))
    rows: list[str] = []
    for _ in range(SAMPLES):
        state = rng.uniform(-1.0, 1.0, len(model.structure.state_names))
        state[:axes] *= full
        torque, rate, second = most * rng.uniform(-1.0, 1.0, (3, joints))
        motion = {
            "twist": state[:axes],
            "acceleration": 2.0 * rng.uniform(-1.0, 1.0, axes),
            "pose": rng.uniform(-3.0, 3.0, poses),
            "wheel_angle": rng.uniform(-9.0, 9.0, joints),
            "time": rng.uniform(0.0, 60.0),
        }
        at = Instant(
            **{key: v if key == "time" else tuple(v) for key, v in motion.items()},
            torque_rate=tuple(10.0 * rate),
            torque_second_rate=tuple(100.0 * second),
        )
        command = dynamics.inverse_dynamics(np, model.structure, model.geometry, model.theta, at)
        rates = model.state_derivative(state, torque)
        parts = (state, torque, rates, tuple(motion.values()), 10.0 * rate, 100.0 * second, command)
        rows.append("    {" + ",\n     ".join(map(initialiser, parts)) + "},")
    return "\n".join(rows)
