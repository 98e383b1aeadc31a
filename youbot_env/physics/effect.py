"""What a physical effect is, where it can act, and the registry that holds them all.

An effect is one plain function, registered with its parameters, units, bounds, source and one
sentence on how to recognise it. Its first argument ``xp`` is the namespace that does the
arithmetic (`numpy`, :data:`youbot_env.physics.namespaces.floats`, tensors, or sympy symbols); its
second is the point at which it acts; the rest are its parameters, by name::

    @effect(
        acts_at=WHEEL,
        parameters=[Parameter("torque", "N m", lower=0.0, size=0.25),
                    Parameter("smoothing", "rad/s", default=0.03)],
        source="Armstrong-Helouvry 1994", recognise="The residual jumps where a wheel reverses.")
    def wheel_coulomb_friction(xp, wheel, torque, smoothing):
        return torque * xp.tanh(wheel.rate / smoothing)

*Wrench* effects say what a motion demands (so resistance is positive with the speed); an
*actuator* says which command a torque and its rate demand; a *channel* says which torque was truly
there when the interface (the log, the command) said ``torque``; a *shift* says how much later [s]
than that it was there; a *rolling* effect says how a wheel rolls other than its nominal geometry;
a *speed* says at which rate a wheel truly rolled when the log said ``speed``. Simulation,
regression and feed-forward are all derived from these statements.

A function takes its parameters in the form in which it is linear, or nearly so, since that is how
they are identified. Where people state them in another form (an anchor's place, not its pull), the
effect has a :class:`Public` form, and models, files and tables hold that one.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from typing import NamedTuple, Protocol, TypeVar, cast

from youbot_env.errors import InputError
from youbot_env.physics.hardware import WHEELS
from youbot_env.physics.namespaces import N, Namespace, Number, Values

Effort = Number | tuple[Number, ...]
"""What an effect returns: one number, or the components of a generalised force."""

EffectFunction = TypeVar("EffectFunction", bound=Callable[..., Effort])


V = TypeVar("V")


class BaseParameters(Protocol):
    """The base parameters, as effects may refer to them: ``base.m0``.

    Which names there are is the affair of each mechanism.
    """

    def __getattr__(self, name: str, /) -> Number: ...


# ``time`` counts from the start of each log; ``start`` is that start on the clock that the logs
# share, 0 where there is none.


class Body(NamedTuple):
    """The platform at O, body frame. An effect here returns (F_X, F_Y, M_W) [N, N, N m]."""

    twist: tuple[Number, ...]
    acceleration: tuple[Number, ...]
    time: Number
    base: BaseParameters
    start: Number | float = 0.0


class Spot(Protocol):
    """A place on the floor, in the world."""

    @property
    def x(self) -> Number | float:
        """Along world X [m]."""
        ...

    @property
    def y(self) -> Number | float:
        """Along world Y [m]."""
        ...


class FloorPoint(NamedTuple):
    """A place on the floor that is known: world ``x`` and ``y`` [m]."""

    x: Number | float = 0.0
    y: Number | float = 0.0


class Wheel(NamedTuple):
    """One wheel joint. An effect here returns the joint torque [N m] that the motion demands.

    ``total_torque`` [N m]: the absolute torques of all wheels, added up. ``contact``: where the
    wheel touches the floor.
    """

    rate: Number
    acceleration: Number
    angle: Number
    torque: Number
    time: Number
    base: BaseParameters
    start: Number | float = 0.0
    total_torque: Number | float = 0.0
    contact: Spot = FloorPoint()


class Roller(NamedTuple):
    """The roller on the floor of one wheel. An effect here returns its axle's torque [N m].

    ``wheel_angle`` [rad] of its wheel tells which roller stands on the floor, and where on it;
    ``contact``: where that is on the floor.
    """

    rate: Number
    acceleration: Number
    time: Number
    base: BaseParameters
    start: Number | float = 0.0
    wheel_angle: Number | float = 0.0
    contact: Spot = FloorPoint()


class World(NamedTuple):
    """The platform seen from the world frame.

    ``com_x``, ``com_y`` [m] lead from O to the centre of mass, along world axes. An effect here
    returns (force along world X, along world Y, moment about O) [N, N, N m] that the drives must
    overcome: a spring that pulls to x = 0 returns + k x.
    """

    x: Number
    y: Number
    yaw: Number
    velocity_x: Number
    velocity_y: Number
    com_x: Number
    com_y: Number
    time: Number
    base: BaseParameters
    start: Number | float = 0.0
    yaw_rate: Number | float = 0.0


class Actuator(NamedTuple):
    """One drive. An effect here returns the command [N m] that ``torque`` and its rates demand.

    A drive whose command depends on ``torque_second_rate``, the second derivative [N m/s^2], has
    the torque's rate as a state beside the torque.
    """

    torque: Number
    torque_rate: Number
    time: Number
    torque_second_rate: Number | float = 0.0


class Channel(NamedTuple):
    """One torque channel. An effect here returns the true torque [N m] behind ``torque``.

    ``rate``: of the wheel joint [rad/s].
    """

    torque: Number
    rate: Number
    time: Number
    start: Number | float = 0.0


class Clock(NamedTuple):
    """The clock of all torque channels. An effect here returns a constant delay d [s].

    The true torque at t is the interface torque of t - d.
    """


class Contact(NamedTuple):
    """The contact of one wheel with the floor. An effect here returns three factors.

    They say how a wheel that does not slip turns, relative to its nominal geometry: on what it
    turns for the speed of its centre ahead, on what it turns for that speed sideways, and on the
    rate of its roller. They do not depend on the motion, so that rates stay linear in the twist
    and forces are their transpose. Those of several effects are multiplied.

    ``tangent`` [-] is that of the roller's nominal angle to X, to the wheel's own side: 1 at 45
    degrees in X, -1 in O.
    """

    tangent: Number = 1.0


class SpeedChannel(NamedTuple):
    """One speed channel. An effect here returns the rate [rad/s] at which the wheel truly rolled.

    It is affine in ``speed`` and ``speed_rate``, which are the channel's; ``torque`` [N m] acts at
    the joint. What several effects add to ``speed`` is added up.
    """

    speed: Number
    speed_rate: Number
    torque: Number
    time: Number


@dataclass(frozen=True)
class Place:
    """Where an effect acts: its kind, its words for a table, and whether it acts at each wheel."""

    name: str
    kind: str
    point: type
    each_wheel: bool


BODY = Place("body", "wrench", Body, False)
WHEEL = Place("wheel joint", "wrench", Wheel, True)
ROLLER = Place("roller axle", "wrench", Roller, True)
WORLD = Place("world", "wrench", World, False)
ACTUATOR = Place("drive", "actuator", Actuator, True)
CHANNEL = Place("log channel", "channel", Channel, True)
CLOCK = Place("log clock", "shift", Clock, False)
CONTACT = Place("wheel contact", "rolling", Contact, True)
SPEED = Place("speed channel", "speed", SpeedChannel, True)


INSTANT_STEP = 0.25
"""Half step [s] of the central difference in a time parameter: some samples of any log, and about
as wide as the uncertainty that a search over instants leaves."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : its name (an argument of the effect's function) and SI unit
    default : a shape constant's value; None for a parameter that is identified linearly
    lower, upper : physical bounds
    size : the size at which the effect matters ("catalogue size"), also the scale of its column
    each_wheel : one value a joint, called ``<name>_fl`` ... ``<name>_br``
    joints : names of the joints that ``each_wheel`` speaks of, where they are not the four wheels
    relative_to : "mean" or "least" for values of which only differences can be seen; the common
        part belongs to ``absorbed_by``, a base parameter (None: it cannot be known). "internal" for
        torques of which the part that exerts no force on the mechanism cannot be seen
    grid : values of a shape constant that a search should try; of a parameter that is identified,
        where its search begins: some show nothing where they have no strength
    of_peak : whether ``grid`` holds shares of the largest torque in the logs: a platform of 10 kg
        and one of 300 kg have limits of their own
    without : value at which a parameter that is identified has no strength
    instant : whether a shape constant is a time in the log, so that a search goes to its end
    whole : whether a shape constant counts something, so that nothing lies between two values and
        a search has the last word; others are fitted with the rest in the end
    """

    name: str
    unit: str
    default: float | None = None
    lower: float = float("-inf")
    upper: float = float("inf")
    size: float = 1.0
    each_wheel: bool = False
    relative_to: str | None = None
    absorbed_by: str | None = None
    grid: tuple[float, ...] = ()
    of_peak: bool = False
    instant: bool = False
    whole: bool = False
    without: float = 0.0
    joints: tuple[str, ...] = WHEELS

    @property
    def names(self) -> tuple[str, ...]:
        """The scalar parameters that this one stands for."""
        if self.each_wheel:
            return tuple(f"{self.name}_{wheel}" for wheel in self.joints)
        return (self.name,)

    @property
    def is_shape(self) -> bool:
        """Whether it is a shape constant (it has a default) and is not identified linearly."""
        return self.default is not None

    @property
    def difference(self) -> float:
        """Half step of the central difference of the force in this parameter.

        The force jumps at an instant, and a sampled jump moves only by whole samples. So the step
        of an instant must span several samples.
        """
        return INSTANT_STEP if self.instant else 1e-3 * self.size

    def fault(self, value: float) -> str:
        """What is wrong with a value, as "3 kg is outside [0, 2]"; "" within the bounds."""
        # A fit that ends at a bound may lie outside it by rounding.
        slack = 1e-9 * self.size
        if isfinite(value) and self.lower - slack <= value <= self.upper + slack:
            return ""
        return f"{with_unit(f'{value:g}', self.unit)} is outside [{self.lower:g}, {self.upper:g}]"


@dataclass(frozen=True)
class Public:
    """How people state an effect's parameters, where its function takes them in another form.

    Attributes
    ----------
    parameters : as models, files and tables hold them
    forward : ``forward(geometry, *internal)`` returns their values, from the function's own ones;
        plain numbers. At zero strength it must stay finite (a place that nothing shows is zero).
    inverse : ``inverse(xp, geometry, *public)`` returns the function's own values; in the
        arithmetic of ``xp``, since printed formulas use it
    """

    parameters: tuple[Parameter, ...]
    forward: Callable[..., tuple[float, ...]]
    inverse: Callable[..., tuple[Number, ...]]


@dataclass(frozen=True)
class Effect:
    """A registered effect: one function and what a person must know to use it.

    ``own_clock``: of what repeats itself in time on a clock of its own, such as a deck that swings,
    the name of the parameter that is its period [s]; "" for all others. No log shows when it began
    on that clock, so it is read from the log's forces (see `identification.fitting.clocks`).
    """

    name: str
    acts_at: Place
    function: Callable[..., Effort]
    parameters: tuple[Parameter, ...]
    source: str
    recognise: str
    dissipative: bool = False
    public: Public | None = None
    carries: Callable[..., tuple[Number, ...]] | None = None
    inverse: Callable[..., Number] | None = None
    own_clock: str = ""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Scalar parameter names, in the order in which ``evaluate`` takes their values."""
        return _names(self.parameters)

    def parameter(self, name: str) -> Parameter:
        """The declaration behind a scalar parameter name of the function."""
        return self._declared(name, self.parameters)

    @property
    def public_parameters(self) -> tuple[Parameter, ...]:
        """The parameters as people state them; the function's own without a public form."""
        return self.public.parameters if self.public else self.parameters

    @property
    def public_names(self) -> tuple[str, ...]:
        """Scalar names of the parameters as people state them."""
        return _names(self.public_parameters)

    @property
    def defaults(self) -> dict[str, float]:
        """A value for each parameter name: shape constants at their default, others at none."""
        return _defaults(self.parameters)

    @property
    def public_defaults(self) -> dict[str, float]:
        """The same for each public name."""
        return _defaults(self.public_parameters)

    def public_parameter(self, name: str) -> Parameter:
        """The declaration behind a scalar public name."""
        return self._declared(name, self.public_parameters)

    def for_each_wheel(self, values: Mapping[str, V]) -> dict[str, V]:
        """Public values by name, where the bare name of what each wheel has stands for all four."""
        found = dict(values)
        for parameter in self.public_parameters:
            if parameter.each_wheel and parameter.name in found:
                common = found.pop(parameter.name)
                found = {**dict.fromkeys(parameter.names, common), **found}
        return found

    def _declared(self, name: str, parameters: Iterable[Parameter]) -> Parameter:
        for parameter in parameters:
            if name in parameter.names:
                return parameter
        known = ", ".join(_names(parameters))
        raise InputError(f"effect {self.name}: no parameter {name!r}; it has {known}")

    def to_public(self, geometry: object, values: Iterable[float]) -> tuple[float, ...]:
        """Values as people state them, from those that ``evaluate`` takes."""
        values = tuple(float(value) for value in values)
        return self.public.forward(geometry, *values) if self.public else values

    def to_internal(self, xp: Namespace, geometry: object, values: Iterable[N]) -> tuple[N, ...]:
        """Values that ``evaluate`` takes, from those that people state."""
        if self.public is None:
            return tuple(values)
        return cast("tuple[N, ...]", self.public.inverse(xp, geometry, *values))

    def evaluate(
        self, xp: Namespace, point: object, values: Values[Number], wheel: int = 0
    ) -> Effort:
        """Call the function at ``point`` (of wheel number ``wheel``) with scalar ``values``."""
        return self.function(xp, point, *self._arguments(values, wheel))

    def undo(self, xp: Namespace, point: object, values: Values[Number], wheel: int = 0) -> Number:
        """The same of the function that takes a channel's true torque back."""
        assert self.inverse is not None
        return self.inverse(xp, point, *self._arguments(values, wheel))

    def _arguments(self, values: Values[Number], wheel: int) -> list[Number]:
        return [values[start + wheel if each else start] for start, each in self._places]

    @cached_property
    def _places(self) -> tuple[tuple[int, bool], ...]:
        """Of each parameter, where its values begin, and whether they are one for each joint."""
        sizes = [len(parameter.names) for parameter in self.parameters]
        starts = itertools.accumulate(sizes, initial=0)
        return tuple(
            (start, one.each_wheel) for start, one in zip(starts, self.parameters, strict=False)
        )


def _names(parameters: Iterable[Parameter]) -> tuple[str, ...]:
    return tuple(name for parameter in parameters for name in parameter.names)


def _defaults(parameters: Iterable[Parameter]) -> dict[str, float]:
    return {
        name: item.without if item.default is None else item.default
        for item in parameters
        for name in item.names
    }


INSTANCE = "@"
"""Between an effect's name and what tells its instances in a model apart: floor_tilt@2."""


def shown_unit(unit: str) -> str:
    """A unit as a table has it: "1" is the unit of a plain number, and nobody reads it."""
    return "" if unit == "1" else unit


def with_unit(number: str, unit: str) -> str:
    """A number as a sentence has it, with its unit; without one that is a plain number."""
    return f"{number} {shown_unit(unit)}".rstrip()


def in_brackets(name: str, unit: str) -> str:
    """A name as the head of a column, such as "torque [N m]"; alone for plain numbers."""
    return f"{name} [{unit}]" if shown_unit(unit) else name


def effect_of(name: str) -> str:
    """The registered name of an effect, of which ``name`` may be an instance."""
    return name.partition(INSTANCE)[0]


OPEN: list[Registry] = []
"""To which a user's file may add."""


class Registry:
    """Effects by name, in the order of registration.

    An instance (``floor_tilt@2``) is its effect under its own name: a floor may slope otherwise in
    another log, so a model may hold one effect twice, at different values.

    Some effects are made of their name (``make``, by the prefix of these names): they can be had,
    and are not listed.

    Others may be added by a user's file where it has a ``trial``: "module:function", which tries
    out one of these.
    """

    def __init__(
        self, make: Mapping[str, Callable[[str], Effect]] | None = None, trial: str = ""
    ) -> None:
        self._effects: dict[str, Effect] = {}
        self.make = dict(make or {})
        self.trial = trial
        if trial:
            OPEN.append(self)

    def add(self, new: Effect) -> None:
        """Register an effect.

        Raises
        ------
        InputError
            If the name is taken by another effect.
        """
        known = self._effects.get(new.name)
        # The same code may come again: a user's file that is loaded a second time.
        if known is not None and known.function.__code__ != new.function.__code__:
            raise InputError(f"effect {new.name!r} is already registered: choose another name")
        self._effects[new.name] = new

    def __getitem__(self, name: str) -> Effect:
        plain = effect_of(name)
        for prefix, make in self.make.items():
            if plain not in self._effects and plain.startswith(prefix):
                return replace(make(plain), name=name)
        try:
            found = self._effects[plain]
            return found if name == found.name else replace(found, name=name)
        except KeyError:
            raise InputError(
                f"unknown effect {name!r}: one of your own needs --effects FILE.py (in Python "
                "youbot_env.load_effects); known are "
                f"{', '.join(self._effects) or 'none'} (`youbot effects` explains them)"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._effects

    def __iter__(self):
        return iter(self._effects.values())

    def __len__(self) -> int:
        return len(self._effects)

    def names(self) -> tuple[str, ...]:
        """All registered names."""
        return tuple(self._effects)

    @contextmanager
    def restored_on_error(self) -> Generator[None, None, None]:
        """Take back what was registered in this block if it ends in an exception."""
        before = dict(self._effects)
        try:
            yield
        except BaseException:  # KeyboardInterrupt too
            self._effects = before
            raise


CATALOGUE = Registry(trial="youbot_env.equations.equations:try_out")
"""Effects that can be added to the base model."""

BASE = Registry()
"""The components that make up the base model of the paper."""


def effect(
    *,
    acts_at: Place,
    parameters: Iterable[Parameter],
    source: str,
    recognise: str,
    dissipative: bool = False,
    public: Public | None = None,
    carries: Callable[..., tuple[Number, ...]] | None = None,
    inverse: Callable[..., Number] | None = None,
    own_clock: str = "",
    registry: Registry = CATALOGUE,
) -> Callable[[EffectFunction], EffectFunction]:
    """Register the decorated function as an effect under its own name.

    Parameters
    ----------
    acts_at : BODY, WHEEL, ROLLER, WORLD, ACTUATOR, CHANNEL, CLOCK, CONTACT or SPEED
    parameters : what it takes after ``xp`` and the point, by name and in this order
    source : where the formula comes from
    recognise : one sentence on how a user sees it in measurements
    dissipative : True for what takes energy only, whatever its parameters: friction, not a spring
        or a slope, which give it back (tested for the catalogue)
    public : how people state the parameters, if not as the function takes them
    carries : for a load, ``carries(xp, time, *parameters)``: the m0, I0, m aX, m aY that other
        effects (a slope) must reckon with beyond the platform's own
    inverse : of a channel that is not affine in the torque: ``inverse(xp, channel, *parameters)``,
        an interface torque behind which ``channel.torque`` is true, or as near as the channel comes
    own_clock : of what repeats itself in time, whenever a log began: the parameter that is its
        period [s]

    Raises
    ------
    InputError
        If the function's arguments are not ``xp``, the point and the declared parameters, or its
        own clock is none of them.
    """
    declared = tuple(parameters)
    known = [parameter.name for parameter in declared]

    def register(function: EffectFunction) -> EffectFunction:
        name = getattr(function, "__name__", "effect")
        # The first two are xp and the point. Values are passed by position, so order matters.
        takes = list(inspect.signature(function).parameters)[2:]
        if takes != known:
            raise InputError(
                f"effect {name!r}: the function takes {takes} after (xp, point), "
                f"but declares {known}"
            )
        if own_clock and own_clock not in known:
            raise InputError(
                f"effect {name!r}: own_clock is {own_clock!r}, which is none of its parameters "
                f"{known}"
            )
        registry.add(
            Effect(
                *(
                    name,
                    acts_at,
                    function,
                    declared,
                    source,
                    recognise,
                    dissipative,
                    public,
                    carries,
                    inverse,
                    own_clock,
                )
            )
        )
        return function

    return register
