"""The equations of motion in print: the effects' own functions, evaluated on sympy symbols.

Nothing here states physics. Wheel and roller rates stay symbols of their own (``phi1'``,
``gamma1'``) where an effect is not linear in them; elsewhere no slip turns them into the twist.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, Literal, cast

import sympy

from youbot_env.equations.printing import Group, collected, join, latex, text, tidy, with_values
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics.effect import (
    ACTUATOR,
    BASE,
    BODY,
    CHANNEL,
    CLOCK,
    CONTACT,
    ROLLER,
    SPEED,
    WHEEL,
    WORLD,
    Actuator,
    BaseParameters,
    Body,
    Channel,
    Clock,
    Contact,
    Effect,
    FloorPoint,
    Place,
    Roller,
    SpeedChannel,
    Wheel,
    World,
)
from youbot_env.physics.geometry import (
    SLANTS,
    TANGENTS,
    Geometry,
    body_force,
    roller_rates,
    wheel_rates,
)
from youbot_env.physics.inverse_dynamics import rolling_geometry
from youbot_env.physics.mecanum import MECANUM, Base
from youbot_env.physics.mechanism import EffectPoints, Instant, ModelStructure, component_force
from youbot_env.physics.namespaces import floats, symbols

Form = Literal["text", "latex", "numeric"]

SIDES = ("F_X", "F_Y", "M_W")
"""Right-hand sides of the three equations of motion."""

WORDS: dict[Place, tuple[str, ...]] = {
    BODY: ("dF_X", "dF_Y", "dM_W"),
    WORLD: ("dF_x", "dF_y", "dM"),
    WHEEL: ("dM",),
    ROLLER: ("dM_roller",),
    ACTUATOR: ("M_command",),
    CHANNEL: ("M_true",),
    CLOCK: ("T_late",),
    CONTACT: ("k_ahead", "k_sideways", "k_roller"),
    SPEED: ("w_true",),
}
"""What an effect's function returns, by the place where it acts."""


def equation(what: ModelStructure | Model, form: Form = "text") -> str:
    """The three equations of motion, one a line, and below them what their symbols stand for.

    Parameters
    ----------
    what : a structure, or a model
    form : "text" and "latex" print parameters by name, "numeric" a model's values (6 digits, SI)

    Raises
    ------
    InputError
        If the form is unknown, or numbers are asked of a structure.
    """
    structure = what.structure if isinstance(what, Model) else what
    if form not in ("text", "latex", "numeric"):
        raise InputError(f"form {form!r}: choose text, latex or numeric")
    if form == "numeric" and not isinstance(what, Model):
        raise InputError("numbers need a model: a structure holds no values")
    motion = Equations(structure, what.geometry if isinstance(what, Model) else Geometry())
    values = motion.values(what) if form == "numeric" and isinstance(what, Model) else {}
    show = latex if form == "latex" else text
    lines = [
        f"{join(groups, show)} = {show(sympy.Symbol(side))}"
        for groups, side in zip(motion.groups(values), SIDES, strict=True)
    ]
    return "\n".join(lines + motion.legend(show, values))


@dataclass(frozen=True)
class Notation:
    """Symbols in which the effects of one kind of mechanism are printed.

    points : where an effect is evaluated, by place; words : what its function returns there
    base : symbols of the base parameters that effects may refer to
    """

    points: Mapping[Place, Any]
    words: Mapping[Place, tuple[str, ...]]
    base: tuple[object, ...]

    def motion(self, place: Place) -> set[sympy.Symbol]:
        """Symbols of the motion at a place, as opposed to parameters."""
        parts = (sympy.sympify(part).free_symbols for part in _flat(self.points[place]))
        return set().union(*parts) - set(self.base)


def formula(
    item: Effect, form: Literal["text", "latex"] = "text", notation: Notation | None = None
) -> str:
    """One line: what an effect adds to the motion's demand (``d...``), from its own function.

    Printed in its public form; that of the base model as in the paper, with m = m0 - 4 m1.
    ``[...]`` is one where it is true and zero elsewhere; ``T_late`` is how late torques act;
    ``k_ahead``, ``k_sideways`` are factors on what a wheel turns for the speed of its centre ahead
    and sideways, ``k_roller`` on its roller's rate; ``w`` is a logged speed, ``w_true`` the rate.
    Parameters and points are those of one wheel: ``phi'`` its rate, ``phi''`` its acceleration,
    ``M`` the torque that acts on it, ``gamma'`` its roller's rate, ``xW``, ``yW`` where it touches
    the floor, ``sum |M|`` the absolute torques of all wheels; ``xC``, ``yC`` lead from O to
    the centre of mass along world axes. Another ``notation`` is that of another mechanism.
    """
    notation = notation or PLATFORM
    if item.public is not None and item.name not in BASE:
        # A parameter that each wheel has of its own is printed for one: each gets its symbol.
        stated = real_symbols(p.name for p in item.public_parameters for _ in p.names)
        of_all = iter(item.public.inverse(symbols(), _LENGTHS, *stated))
        values = [[next(of_all) for _ in p.names][0] for p in item.parameters]
    else:
        values = real_symbols(
            _SPACED.get(parameter.name, parameter.name) for parameter in item.parameters
        )
    found = item.function(symbols(), notation.points[item.acts_at], *values)
    returned = found if isinstance(found, tuple) else (found,)
    motion = notation.motion(item.acts_at)
    show = latex if form == "latex" else text
    return ";  ".join(
        f"{show(sympy.Symbol(word))} = {join(collected(value, motion), show)}"
        for word, value in zip(notation.words[item.acts_at], returned, strict=True)
    )


def try_out(item: Effect, notation: Notation | None = None) -> None:
    """Evaluate an effect on numbers and on symbols.

    ``notation``: of its mechanism; that of a platform where none is given.

    Raises
    ------
    InputError
        If it does not return what its place asks for: one value, or three at the body, in the
        world and at a wheel's contact.
    """
    known = notation or PLATFORM
    if item.acts_at not in known.points:
        raise InputError(f"effect {item.name}: nothing acts at {item.acts_at.name!r} there")
    point, count = known.points[item.acts_at], len(known.words[item.acts_at])
    # All different and not zero, so that exchanged or lost values show.
    plain = [0.3 + 0.1 * k for k in range(len(item.parameter_names))]
    _try_public(item, plain)
    # On symbols too, as code is generated from them: an `if` in the function works on floats only.
    trials = (
        ("numbers", floats, _numeric(point), plain),
        ("symbols", symbols(), point, real_symbols(item.parameter_names)),
    )
    for kind, xp, where, values in trials:
        try:
            found = item.evaluate(xp, where, values)
        except Exception as error:
            hint = ""
            if isinstance(error, AttributeError):
                fields = ", ".join(getattr(point, "_fields", ()))
                hint = f": the point has {fields} (a contact x, y), `youbot effects --points` tells"
            elif kind == "symbols":
                hint = ": use the functions of xp, such as xp.tanh, and xp.where instead of if"
            raise InputError(
                f"effect {item.name}: fails on {kind} ({type(error).__name__}: {error}){hint}"
            ) from None
        parts = found if isinstance(found, tuple) else (found,)
        is_value = all(isinstance(part, (int, float, sympy.Expr)) for part in parts)
        if len(parts) != count or not is_value:
            wanted = "one number" if count == 1 else "three numbers (a tuple)"
            raise InputError(f"effect {item.name}: returns {found!r}, not {wanted}")


def _try_public(item: Effect, values: list[float]) -> None:
    """Check that ``inverse`` undoes ``forward``, and that zero strength raises no error."""
    if item.public is None:
        return
    geometry = Geometry()
    try:
        there = item.to_public(geometry, values)
        back = item.to_internal(floats, geometry, there)
        nothing = item.to_public(geometry, item.defaults.values())
        item.to_internal(symbols(), _LENGTHS, real_symbols(item.public_names))
    except Exception as error:
        raise InputError(
            f"effect {item.name}: its public form fails ({type(error).__name__}: {error})"
        ) from None
    if len(there) != len(item.public_names) or len(nothing) != len(there):
        raise InputError(f"effect {item.name}: forward must return one value a public parameter")
    if len(back) != len(values) or any(
        not abs(a - b) <= 1e-9 for a, b in zip(back, values, strict=True)
    ):
        raise InputError(f"effect {item.name}: inverse does not undo forward: {values} -> {back}")


def _numeric(point: Any) -> Any:
    """The same point with numbers in place of symbols."""
    parts = (_numeric(part) if isinstance(part, tuple) else 0.7 for part in point)
    return type(point)(*parts) if hasattr(point, "_fields") else tuple(parts)


def _flat(point: Any) -> Iterable[Any]:
    for part in point:
        yield from _flat(part) if isinstance(part, tuple) else (part,)


def real_symbols(names: str | Iterable[str]) -> list[sympy.Expr]:
    """A symbol for each name; in one string, names stand apart by spaces."""
    names = names.split() if isinstance(names, str) else names
    return [sympy.Symbol(name, real=True) for name in names]


_SPACED = {"m_aX": "m aX", "m_aY": "m aY"}

_LENGTHS = SimpleNamespace(**{name: real_symbols(name)[0] for name in ("l", "h", "R", "r", "m1")})
"""The geometry of a public form, as symbols."""

_BASE = Base(*real_symbols(["m0", "I0", "m aX", "m aY", "I1", "mu1", "mu2"]))
_NAMED = cast(BaseParameters, _BASE)
_TWIST, _ACCELERATION = real_symbols("VX VY W"), real_symbols("VX' VY' W'")
_POSE = real_symbols("x y psi")
_TIME, _START = real_symbols("t t0")
(_TOTAL,) = real_symbols(["sum |M|"])
_CONTACT = FloorPoint(*real_symbols("xW yW"))

_POINTS: dict[Place, Any] = {
    BODY: Body(tuple(_TWIST), tuple(_ACCELERATION), _TIME, _NAMED, _START),
    WHEEL: Wheel(
        *real_symbols("phi' phi'' phi M t"),
        base=_NAMED,
        start=_START,
        total_torque=_TOTAL,
        contact=_CONTACT,
    ),
    ROLLER: Roller(
        *real_symbols("gamma' gamma'' t"),
        base=_NAMED,
        start=_START,
        wheel_angle=real_symbols("phi")[0],
        contact=_CONTACT,
    ),
    WORLD: World(
        *real_symbols("x y psi x' y' xC yC t"), base=_NAMED, start=_START, yaw_rate=_TWIST[2]
    ),
    ACTUATOR: Actuator(*real_symbols("M M' t M''")),
    CHANNEL: Channel(*real_symbols("M phi' t"), start=_START),
    CLOCK: Clock(),
    CONTACT: Contact(),
    SPEED: SpeedChannel(*real_symbols("w w' M t")),
}


PLATFORM = Notation(_POINTS, WORDS, tuple(_BASE))
"""Notation of the mecanum platform."""


class _OpenPoints(EffectPoints[Any, sympy.Expr]):
    """Points whose wheel and roller rates are symbols, so that each component can be read."""

    @cached_property
    def wheels(self) -> list[Wheel]:
        return [
            Wheel(
                *real_symbols(f"phi{i}' phi{i}'' phi{i} M{i} t"),
                base=self.base,
                start=_START,
                total_torque=_TOTAL,
                contact=FloorPoint(*real_symbols(f"xW{i} yW{i}")),
            )
            for i in range(1, 5)
        ]

    @cached_property
    def rollers(self) -> list[Roller]:
        return [
            Roller(
                *real_symbols(f"gamma{i}' gamma{i}'' t"),
                base=self.base,
                start=_START,
                wheel_angle=real_symbols(f"phi{i}")[0],
                contact=FloorPoint(*real_symbols(f"xW{i} yW{i}")),
            )
            for i in range(1, 5)
        ]

    def of(self, place: Place) -> Sequence[Any]:
        open_points = {WHEEL: self.wheels, ROLLER: self.rollers}
        return open_points.get(place) or super().of(place)


@dataclass(frozen=True)
class Equations:
    """The equations of motion of a structure as sympy expressions."""

    structure: ModelStructure
    known: Geometry = Geometry()

    @cached_property
    def geometry(self) -> Any:
        """Symbols of the lengths, with l + h = L as the paper abbreviates; of rollers in O
        |l - h| = L. Of rollers at other angles than 45 degrees the tangents stay symbols."""
        # l is written as L - h, so that l + h simplifies to L in every formula.
        l, h, R, r, L = real_symbols("l h R r L")  # noqa: E741 - the paper's name
        if self.structure.mechanism is MECANUM:
            return SimpleNamespace(l=L - h, h=h, R=R, r=r)
        if not self._all_45:
            return SimpleNamespace(l=l, h=h, R=R, r=r, **self._slanted)
        arm = L if self.known.l > self.known.h else -L
        tangents = map(sympy.Integer, self.known.tangents)
        return SimpleNamespace(
            **{"l": h + arm, "h": h, "R": R, "r": r},
            **dict(zip(TANGENTS, tangents, strict=True)),
            **dict.fromkeys(SLANTS, sympy.sqrt(2)),
        )

    @property
    def _all_45(self) -> bool:
        return all(abs(t) == 1.0 for t in self.known.tangents)

    @cached_property
    def _slanted(self) -> dict[str, Any]:
        names = [f"{part}{i}" for part in ("tan_d", "sec_d") for i in range(1, 5)]
        return dict(zip((*TANGENTS, *SLANTS), real_symbols(names), strict=True))

    @cached_property
    def theta(self) -> list[sympy.Expr]:
        """Symbols of the parameters: short where no other parameter has that name."""
        names = [name.split(".")[-1] for name in self.structure.parameter_names]
        found: list[str] = []
        for full, short in zip(self.structure.parameter_names, names, strict=True):
            effect = full.rpartition(".")[0]
            # Two effects may have a parameter of one name, such as "smoothing".
            found.append(short if names.count(short) == 1 else f"{short}_{effect}")
        return real_symbols(_SPACED.get(name, name) for name in found)

    @cached_property
    def points(self) -> _OpenPoints:
        """Where the components are evaluated."""
        at = Instant(tuple(_TWIST), tuple(_ACCELERATION), tuple(_POSE), time=_TIME, start=_START)
        return _OpenPoints(
            symbols(), MECANUM, self.rolling, self.theta, at, self.structure.carriers
        )

    @cached_property
    def rolling(self) -> Any:
        """The geometry as the wheels roll, where an effect changes that."""
        return rolling_geometry(symbols(), self.structure, self.geometry, self.theta)

    @cached_property
    def no_slip(self) -> dict[sympy.Symbol, Any]:
        """Wheel and roller rates and accelerations in terms of the twist."""
        g, p = self.rolling, self.points
        rows = [
            *zip((w.rate for w in p.wheels), wheel_rates(g, p.at.twist), strict=True),
            *zip((r.rate for r in p.rollers), roller_rates(g, p.at.twist), strict=True),
            *zip(
                (w.acceleration for w in p.wheels),
                wheel_rates(g, p.at.acceleration),
                strict=True,
            ),
            *zip(
                (r.acceleration for r in p.rollers),
                roller_rates(g, p.at.acceleration),
                strict=True,
            ),
        ]
        return {symbol: tidy(value) for symbol, value in rows}

    @cached_property
    def sides(self) -> tuple[Any, Any, Any]:
        """Demanded F_X, F_Y, M_W."""
        totals = [sympy.Integer(0)] * 3
        for item, where in self.structure.wrenches:
            force = component_force(item, self.theta[where], self.points)
            for axis in range(3):
                totals[axis] += self._readable(tidy(sympy.sympify(force[axis])))
        return tuple(sympy.expand(total) for total in totals)  # type: ignore[return-value]

    def _readable(self, part: Any) -> Any:
        rates = [symbol for symbol in self.no_slip if part.has(symbol)]
        # Rates are replaced by the twist only where they are linear; tanh(phi1') or phi1' |phi1'|
        # is easier to read with the rate, which the legend explains.
        # So is the friction of wheels that roll each in its own way.
        if not rates or self.structure.at(CONTACT) or not part.is_polynomial(*rates):
            return part
        is_linear = sympy.Poly(part, *rates).total_degree() == 1
        return part.subs(self.no_slip) if is_linear else part

    @cached_property
    def motion(self) -> list[object]:
        """Symbols of the motion, as opposed to parameters and lengths."""
        angles = [symbol for wheel in self.points.wheels for symbol in (wheel.angle, wheel.torque)]
        return [*_TWIST, *_ACCELERATION, *_POSE, _TIME, *self.no_slip, *angles]

    def values(self, model: Model) -> dict[sympy.Expr, float]:
        """A model's numbers for the parameters and lengths."""
        g = model.geometry
        lengths = zip(real_symbols("l h R r L"), (g.l, g.h, g.R, g.r, g.L), strict=True)
        slanted = {symbol: getattr(g, name) for name, symbol in self._slanted.items()}
        return dict(lengths) | slanted | dict(zip(self.theta, model.theta.tolist(), strict=True))

    def groups(self, values: dict[sympy.Expr, float]) -> list[list[Group]]:
        """Each side as groups (coefficient, motion): accelerations first, then by degree."""
        return [self._grouped(side, axis, values) for axis, side in enumerate(self.sides)]

    def _grouped(self, side: Any, axis: int, values: dict[sympy.Expr, float]) -> list[Group]:
        rows = collected(side, set(self.motion))
        rows.sort(key=lambda row: self._rank(row[1], axis))
        return [(with_values(c, values), with_values(m, values)) for c, m in rows]

    def _rank(self, motion: Any, axis: int) -> tuple[Any, ...]:
        # Order: accelerations (that of the side's own axis first), then products of
        # the twist by falling degree, then everything else.
        for i, symbol in enumerate(_ACCELERATION):
            if motion.has(symbol):
                return 0, i != axis, i, ""
        if motion.is_polynomial(*_TWIST):
            degree = sympy.Poly(motion, *_TWIST).total_degree() if motion.has(*_TWIST) else 0
            return 1, -degree, motion == _TWIST[2] ** 2, sympy.default_sort_key(motion)
        return 2, 0, 0, sympy.default_sort_key(motion)

    def legend(self, show: Any, values: dict[sympy.Expr, float]) -> list[str]:
        """What the forces are, what drives and channels do, and which rates stand in a line."""
        torque = [wheel.torque for wheel in self.points.wheels]
        force: tuple[Any, ...] = body_force(self.rolling, torque)
        lines = [
            f"{show(sympy.Symbol(side))} = {show(with_values(tidy(value), values))}"
            for side, value in zip(SIDES, map(sympy.factor_terms, force), strict=True)
        ]
        for symbol, value in self.no_slip.items():
            if any(side.has(symbol) for side in self.sides):
                lines.append(f"{show(symbol)} = {show(with_values(value, values))}")
        # What acts at a contact stands in the rates above.
        others = [
            i for i in self.structure.components if i.acts_at.kind not in ("wrench", "rolling")
        ]
        lines += self._stated(show)
        return lines + [formula(item, "latex" if show is latex else "text") for item in others]

    def _stated(self, show: Any) -> list[str]:
        """Parameters of the equations in terms of those that a model holds."""
        lines = []
        effects = self.structure.slices[len(BASE) :]
        names = [name for item, _ in effects for name in item.public_names]
        for item, where in effects:
            stated = real_symbols(
                name if names.count(name) == 1 else f"{name}_{item.name}"
                for name in item.public_names
            )
            inner = item.to_internal(symbols(), _LENGTHS, stated)
            for symbol, value in zip(self.theta[where], inner, strict=True):
                # A parameter that is stated as it is needs no line.
                if value not in stated:
                    lines.append(f"{show(symbol)} = {show(sympy.sympify(value))}")
        return lines
