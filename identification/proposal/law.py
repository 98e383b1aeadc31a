"""A law of the grammar: the text of an effect's function, what it takes, and the effect it makes.

The text is the only statement of a law: what the search tries, what a proposal's file holds, and
what is simulated are the same function.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from textwrap import wrap

from youbot_env.physics.effect import Effect, Effort, Parameter, Place

Shapes = tuple[float, ...]
"""Values of a law's shape constants, in their order."""


@dataclass(frozen=True)
class Constant:
    """A number of a law's function.

    Attributes
    ----------
    name, unit, lower, upper : as of an effect's parameter
    size : about how large it is where it matters
    values : of a shape constant, those that the search tries; () for a strength, in which the
        force is linear
    fitted : whether a shape constant is sought between these values too
    whole : whether it counts something
    each_wheel : whether each wheel has its own
    step : how far from these values a search may begin; 0: the way from one to the next
    """

    name: str
    unit: str
    lower: float = -math.inf
    upper: float = math.inf
    size: float = 1.0
    values: tuple[float, ...] = ()
    fitted: bool = True
    whole: bool = False
    each_wheel: bool = False
    step: float = 0.0

    @property
    def is_shape(self) -> bool:
        """Whether it is a shape constant."""
        return bool(self.values)

    @property
    def names(self) -> tuple[str, ...]:
        """The scalar numbers that it stands for."""
        return Parameter(self.name, self.unit, each_wheel=self.each_wheel).names


@dataclass(frozen=True)
class Law:
    """One law of the grammar.

    Attributes
    ----------
    name : of the function
    place : where it acts
    variables : what it depends on, in the words of the residual map
    constants : strengths and shape constants, in the order of the function's arguments
    lines, result : statements of the function and what it returns
    meaning : one sentence: what it is; formula : how people write it; latex : for a paper
    recognise : how a user sees it in measurements; confirm : what experiment would confirm it
    dissipative : whether it only takes energy
    terms : how many factors are multiplied, and other pieces that make it longer than its constants
    typical : by unit what is typical for the mechanism, where its effects are declared in multiples
        of that
    own_clock : the name of its period, where it repeats itself in time whenever a log began
    """

    name: str
    place: Place
    variables: tuple[str, ...]
    constants: tuple[Constant, ...]
    lines: tuple[str, ...]
    result: str
    meaning: str
    formula: str
    latex: str
    recognise: str
    confirm: str
    dissipative: bool = False
    terms: int = 1
    typical: tuple[tuple[str, float], ...] = ()
    own_clock: str = ""

    @property
    def strengths(self) -> tuple[Constant, ...]:
        """The constants in which the force is linear."""
        return tuple(item for item in self.constants if not item.is_shape)

    @property
    def shapes(self) -> tuple[Constant, ...]:
        """The other ones."""
        return tuple(item for item in self.constants if item.is_shape)

    @property
    def length(self) -> int:
        """How long the law is: constants that are fitted, and factors."""
        return sum(len(c.names) for c in self.constants if not c.is_shape or c.fitted) + self.terms

    @property
    def point(self) -> str:
        """What its function calls the point at which it acts."""
        return self.place.name.split()[0] if self.place.name != "axis" else "joint"

    def function_text(self) -> str:
        """The function that states the law."""
        takes = ", ".join(["xp", self.point, *(item.name for item in self.constants)])
        head = f"def {self.name}({takes}):"
        if len(head) > LINE:
            head = f"def {self.name}(\n    {takes}\n):"
        rows = self._docstring()
        for line in self.lines:
            rows += _statement(*line.partition(" = "))
        rows += _statement("return", " ", self.result)
        return "\n".join([head, *(f"    {row}".rstrip() for row in rows)]) + "\n"

    def _docstring(self) -> list[str]:
        line = f'"""{self.meaning} [{self.unit}]: {self.formula}."""'
        if len(line) + 4 <= LINE:
            return [line]
        first, *more = wrap(f'"""{self.meaning} [{self.unit}].', LINE - 4)
        return [first, *more, "", f"{self.formula}.", '"""']

    @property
    def unit(self) -> str:
        """Of what the function returns."""
        return "N m" if self.place.each_wheel else "N"

    def function(self) -> Callable[..., Effort]:
        """The function, compiled."""
        # The text is this package's own, made of its own grammar and of numbers: no file and no
        # log has a part in it.
        spec = importlib.util.spec_from_loader(f"law_{self.name}", _OwnText(self.function_text()))
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return getattr(module, self.name)


class _OwnText(importlib.abc.InspectLoader):
    """Loads a module from a text of this package."""

    def __init__(self, text: str) -> None:
        self._text = text

    def get_source(self, fullname: str) -> str:
        """The text, whatever the module is called."""
        return self._text


def _statement(head: str, between: str, value: str) -> list[str]:
    """A statement, over several lines where it is long: at its commas, or at its factors."""
    if len(head + between + value) + 4 <= LINE:
        return [head + between + value]
    parts, sign = _split(value, ", "), ","
    if len(parts) > 1:
        return [f"{head}{between}(", *(f"    {part}{sign}" for part in parts), ")"]
    first, *rest = _split(value, " * ")
    return [f"{head}{between}(", f"    {first}", *(f"    * {part}" for part in rest), ")"]


def _split(text: str, sign: str) -> list[str]:
    """Parts of an expression between signs that stand in no bracket."""
    parts, depth, start = [], 0, 0
    for place, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        if depth == 0 and text.startswith(sign, place):
            parts.append(text[start:place])
            start = place + len(sign)
    return [*parts, text[start:]]


LINE = 100
"""Longest line of a file."""

DIGITS = 6
"""Of a number in a file: a period of 0.1 m over metres of floor needs them."""


@dataclass(frozen=True)
class FoundLaw:
    """A law with values of its constants.

    Attributes
    ----------
    values : by name
    """

    law: Law
    values: Mapping[str, float] = field(hash=False)

    def parameters(self) -> tuple[Parameter, ...]:
        """The declarations of an effect's parameters, with shape constants as they were found."""
        typical = dict(self.law.typical)
        declared = (self._declared(item) for item in self.law.constants)
        return tuple(_in_multiples(item, typical.get(item.unit, 1.0)) for item in declared)

    def _declared(self, item: Constant) -> Parameter:
        found = [self.values.get(name, 0.0) for name in item.names]
        value = rounded(max(found, key=abs), DIGITS)
        size = min(rounded(abs(value) or item.size, 2), item.upper)
        if not item.is_shape:
            return Parameter(
                *(item.name, item.unit),
                lower=max(item.lower, 0.0) if self.law.dissipative else item.lower,
                upper=item.upper,
                size=size,
                each_wheel=item.each_wheel,
            )
        grid = (value,) if item.fitted else ()
        return Parameter(
            *(item.name, item.unit, value, item.lower, item.upper, size),
            grid=grid,
            whole=item.whole,
        )

    def effect(self, function: Callable[..., Effort] | None = None) -> Effect:
        """The effect that the law is."""
        law = self.law
        return Effect(
            *(law.name, law.place, function or law.function(), self.parameters()),
            *(SOURCE, law.recognise, law.dissipative),
            own_clock=law.own_clock,
        )

    def file_text(self, about: str) -> str:
        """A file for ``--effects``, as a person would write it; ``about``: its first line."""
        law = self.law
        place, of_axis = PLACES[law.place.name], law.place.name == "axis"
        places = [f"from youbot_env import {place}, Parameter, effect"]
        if of_axis:
            places = [
                "from identification.mechanisms.axis_effects import AXIS_CATALOGUE, JOINT",
                "from youbot_env import Parameter, effect",
                "",
                "# Numbers are multiples of what is typical for the axis, as in the catalogue.",
            ]
        rows = [line for item in self.parameters() for line in _written(item)]
        out = [
            f'"""{about}"""',
            "",
            *places,
            "",
            "",
            "@effect(",
            f"    acts_at={place},",
            *(["    registry=AXIS_CATALOGUE,"] if of_axis else []),
            "    parameters=[",
            *rows,
            "    ],",
            f'    source="{SOURCE}",',
            *_keyword("recognise", law.recognise),
            *(["    dissipative=True,"] if law.dissipative else []),
            *([f'    own_clock="{law.own_clock}",'] if law.own_clock else []),
            ")",
            law.function_text(),
        ]
        return "\n".join(out)


def _in_multiples(item: Parameter, of: float) -> Parameter:
    """The declaration in multiples of what is typical."""
    if of == 1.0:
        return item
    return replace(
        item,
        default=None if item.default is None else rounded(item.default / of, DIGITS),
        lower=item.lower / of,
        upper=item.upper / of,
        size=rounded(item.size / of, 2),
        grid=tuple(rounded(value / of, DIGITS) for value in item.grid),
    )


@dataclass(frozen=True)
class Verdict:
    """The law that the search ended with, and what speaks for it.

    Attributes
    ----------
    fall, unseen_fall : share of the squares that it takes away, held out, where the search sees
        and where it does not
    p_value : family-wise over all that was tried; unseen_p_value : on unseen stretches
    tried : how many laws, and how many choices of their shape constants
    pareto : of each length the best law: law, share of the squares that it leaves
    alternatives : other laws that unseen stretches cannot tell from it, the same
    """

    found: FoundLaw
    fall: float
    unseen_fall: float
    p_value: float
    unseen_p_value: float
    tried: tuple[int, int]
    pareto: tuple[tuple[FoundLaw, float], ...]
    alternatives: tuple[tuple[FoundLaw, float], ...] = ()


SOURCE = "Proposed from logs by youbot diagnose"

PLACES = {
    "body": "BODY",
    "world": "WORLD",
    "wheel joint": "WHEEL",
    "roller axle": "ROLLER",
    "log channel": "CHANNEL",
    "axis": "JOINT",
}
"""How a file calls the places where laws act."""


def _keyword(name: str, text: str) -> list[str]:
    line = f'    {name}="{text}",'
    if len(line) <= LINE:
        return [line]
    parts = wrap(text, LINE - 12)
    return [
        f"    {name}=(",
        *(f'        "{part} "' for part in parts[:-1]),
        f'        "{parts[-1]}"',
        "    ),",
    ]


def _written(item: Parameter) -> list[str]:
    """The declaration of a parameter in a file, on one line or one argument a line."""
    out = [f'"{item.name}"', f'"{item.unit}"']
    if item.default is not None:
        out.append(f"default={_number(item.default)}")
    out += [f"{side}={_outward(getattr(item, side), side):g}" for side in _finite_sides(item)]
    if item.default is None:
        out.append(f"size={item.size:g}")
    if item.grid:
        out.append(f"grid=({', '.join(map(_number, item.grid))},)")
    out += [f"{flag}=True" for flag in ("whole", "each_wheel") if getattr(item, flag)]
    line = f"        Parameter({', '.join(out)}),"
    if len(line) <= LINE:
        return [line]
    return ["        Parameter(", *(f"            {part}," for part in out), "        ),"]


def _outward(bound: float, side: str) -> float:
    """A bound with three digits, which still holds all that it held."""
    if bound == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(bound))) - 2)
    whole = math.floor if side == "lower" else math.ceil
    return rounded(whole(bound / unit) * unit, DIGITS)


def _number(value: float) -> str:
    return f"{value:.{DIGITS}g}"


def _finite_sides(item: Parameter) -> list[str]:
    return [side for side in ("lower", "upper") if math.isfinite(getattr(item, side))]


def rounded(value: float, digits: int) -> float:
    """A number with so many digits."""
    return float(f"{value:.{digits}g}")
