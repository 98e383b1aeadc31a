"""A mechanism as its logs show it: all that the engine ever knows of the robot at hand.

Residuals, columns, fits, free runs, candidates and reports work on :class:`Mechanism`: a kind of
mechanism with its lengths and effects, and the :class:`Conventions` by which that kind is
identified. N samples, P parameters, F of them free, A axes, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log, starts_on_shared_clock
from identification.mechanisms.quantities import Quantities
from identification.mechanisms.samples import (
    AddedNoise,
    DemandedForce,
    Part,
    Samples,
    passed_torque,
    rolled,
)
from identification.mechanisms.settings import MechanismSettings
from identification.signals.filters import FilterSettings, filter_samples, integral_of
from identification.signals.noise import differenced_noise
from identification.threads import cached_property
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import Parameter, Registry, effect_of
from youbot_env.physics.geometry import least_squares_of
from youbot_env.physics.mechanism import Instant, MechanismKind, ModelStructure

Array = NDArray[np.float64]
Known = TypeVar("Known")
"""What is known of a mechanism beforehand: of a platform its geometry."""


class ParameterLabel(NamedTuple):
    """A parameter's component, name and declaration; group: those it is relative to, if any."""

    component: str
    name: str
    parameter: Parameter
    group: str | None


class HeldDirections(NamedTuple):
    """Directions (k, p) of one effect's parameters that other evidence than forces has settled.

    A fit of forces leaves them as they are. They are orthonormal, in the effect's own order.
    """

    effect: str
    directions: tuple[tuple[float, ...], ...]


class FitResult(Protocol):
    """What a model is made of: theta (P,), the fitted ones' indices (F,), covariance and std."""

    @property
    def theta(self) -> Array: ...
    @property
    def free(self) -> NDArray[np.intp]: ...
    @property
    def covariance(self) -> Array: ...
    @property
    def std(self) -> Array: ...


class Experiment(NamedTuple):
    """A motion that could be recorded.

    name, content : of the motion, as its file holds it
    samples(theta) : what a log of it would hold at parameters theta (P,), without noise
    """

    name: str
    content: Mapping[str, object]
    samples: Callable[[Array], Samples]


class Variables(NamedTuple):
    """What a residual may depend on in a log of N samples; what a mechanism lacks is None.

    axes, places, joints : names of accelerations, of coordinates (N, D) and of joints, as variables
        end on them
    twist : (N, A) as people state it; rates (N, K): where surfaces slide
    heading : (N,) [rad]; angle, speed : (N, J) of the joints
    departure : (N, J) what no rigid motion explains in the speeds
    turns : of one axis, whether it turns (rad, N m) or slides (m, N)
    """

    axes: tuple[str, ...]
    joints: tuple[str, ...]
    places: tuple[str, ...]
    twist: Array
    rates: Array
    position: Array
    heading: Array | None = None
    angle: Array | None = None
    speed: Array | None = None
    departure: Array | None = None
    turns: bool | None = None


def pass_over(rng: np.random.Generator, count: int) -> None:
    """Draw normal numbers and forget them, some at a time: those after them stay what they are."""
    for start in range(0, count, 1 << 20):
        rng.standard_normal(min(1 << 20, count - start))


def _whole(samples: Samples, settings: MechanismSettings) -> list[Part]:
    return [Part("run", samples)]


def _nothing(*_: object) -> tuple[()]:
    return ()


def _no_scale(known: object) -> dict[str, float]:
    return {}


def _no_limits(known: object, theta: Array, settings: MechanismSettings) -> dict[str, float]:
    return {}


def _no_doubt(known: object, theta: Array, settings: MechanismSettings) -> str:
    return ""


def _as_it_is(known: object, theta: Array, settings: MechanismSettings) -> Array:
    return theta


def _no_combinations(known: object) -> dict[str, dict[str, float]]:
    return {}


def _usual_rate(known: object) -> float:
    return FilterSettings.rate


def _behind(signal: Array, lag: float, first: float, dt: float) -> Array:
    """A signal (N,) through a first-order filter of a time constant [s], from a first value on."""
    if not 0.0 < lag < np.inf:
        return signal
    return first + filter_samples(signal - first, 1.0 / lag, dt)


@dataclass(frozen=True)
class Conventions(Generic[Known]):
    """How mechanisms of one kind are identified: what the physics leaves open.

    kind : the physics; ``known`` below is what is known beforehand of the mechanism at hand
    axes : names of the axes of force and speed in reports
    force_scale(known) : (A,) factors by which all axes weigh alike; speeds are divided by them
    samples(log, known, settings) : motion and torque of a log
    variables(samples, known) : what the residual may depend on
    quantities(known) : symbols and units of forces and speeds, for figures
    advice(known, direction) : what to record where ``direction`` (F,) of the parameters is not seen
    base_scale(known) : factors of base parameters, by name, to numbers of one size; others are
        scaled by their catalogue size
    scaling : how that scales the parameters, in words
    order : indices of base parameters in the order in which they are shown; () for theta's
    filter_rate(known) : of the filter through which forces are fitted [rad/s]
    parts(samples, settings) : stretches of a log that are judged apart
    motions(known, seed) : motions that could be recorded next
    least(known) : lower bounds of base parameters by name, beyond those that are declared
    limits(known, theta, settings) : how far base parameters theta are within what can be, beyond
        the bounds that they declare, by the name of the parameter that is at its limit: negative
        where they cannot be; of numbers of one size
    inside(known, theta, settings) : base parameters near theta that are within these limits
    doubt_of_unit(known, theta, settings) : what parameters (P,) say of a wrong unit; "" if nothing
    combinations(known) : sums of base parameters that a motion shows better than their members: by
        how people write them, each member's factor
    motion_that_shows(known, direction) : name of the motion that does, where motions have names
    """

    kind: MechanismKind[Known]
    axes: tuple[str, ...]
    force_scale: Callable[[Known], Array]
    samples: Callable[[Log, Known, MechanismSettings], Samples]
    variables: Callable[[Samples, Known], Variables]
    quantities: Callable[[Known], Quantities]
    advice: Callable[[Known, Array], str]
    base_scale: Callable[[Known], Mapping[str, float]] = _no_scale
    scaling: str = "by catalogue size"
    order: tuple[int, ...] = ()
    filter_rate: Callable[[Known], float] = _usual_rate
    parts: Callable[[Samples, MechanismSettings], list[Part]] = _whole
    motions: Callable[[Known, int], Sequence[Experiment]] = _nothing
    least: Callable[[Known], Mapping[str, float]] = _no_scale
    limits: Callable[[Known, Array, MechanismSettings], Mapping[str, float]] = _no_limits
    inside: Callable[[Known, Array, MechanismSettings], Array] = _as_it_is
    doubt_of_unit: Callable[[Known, Array, MechanismSettings], str] = _no_doubt
    combinations: Callable[[Known], Mapping[str, Mapping[str, float]]] = _no_combinations
    motion_that_shows: Callable[[Known, Array], str] | None = None


@dataclass(frozen=True)
class Mechanism(Generic[Known]):
    """A mechanism with given effects: what it measures, demands and simulates.

    geometry : what is known of it beforehand; structure : which effects it holds
    settings : numbers that its samples, parts and demanded force depend on
    held : what a fit of forces must leave as it is, also of effects that are not in the structure
    acts_in : of effects that act in some logs only, by their name in the structure, the names of
        these logs: elsewhere their strength is zero, and so are their columns
    """

    geometry: Known
    structure: ModelStructure[Known]
    conventions: Conventions[Known]
    settings: MechanismSettings = MechanismSettings()
    held: tuple[HeldDirections, ...] = ()
    acts_in: Mapping[str, frozenset[str]] = field(
        default_factory=dict[str, frozenset[str]], hash=False
    )

    @property
    def kind(self) -> MechanismKind[Known]:
        """Its physics."""
        return self.structure.mechanism

    @cached_property
    def internal(self) -> tuple[float, ...]:
        """(J,) torques that exert no force; () if there are none."""
        return self.kind.internal(self.geometry)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes of force and speed."""
        return self.conventions.axes

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in its logs."""
        return self.kind.joints

    @property
    def scaling(self) -> str:
        """How ``scale`` scales the parameters, in words."""
        return self.conventions.scaling

    @cached_property
    def filter_rate(self) -> float:
        """Of the filter through which forces are fitted [rad/s]."""
        return self.conventions.filter_rate(self.geometry)

    @cached_property
    def catalogue(self) -> Registry:
        """The effects that it can have, with units and sizes of the mechanism at hand."""
        found = Registry(self.kind.catalogue.make)
        for item in self.kind.catalogue:
            if self.kind.holds(item, self.geometry):
                found.add(self.kind.declared(item, self.geometry))
        return found

    def with_effects(self, effects: Sequence[str]) -> Mechanism[Known]:
        """The same mechanism with other effects beside the base model."""
        structure = self.structure.with_effects(effects)
        acts_in = {name: logs for name, logs in self.acts_in.items() if name in effects}
        return self._with(structure=structure, acts_in=acts_in)

    def _with(
        self,
        *,
        structure: ModelStructure[Known] | None = None,
        held: tuple[HeldDirections, ...] | None = None,
        acts_in: Mapping[str, frozenset[str]] | None = None,
    ) -> Mechanism[Known]:
        """The same mechanism with some of its parts changed."""
        # Not `replace`: a subclass may be made of fewer arguments.
        return Mechanism(
            self.geometry,
            structure or self.structure,
            self.conventions,
            self.settings,
            self.held if held is None else held,
            self.acts_in if acts_in is None else acts_in,
        )

    def holding(self, held: Sequence[HeldDirections]) -> Mechanism[Known]:
        """The same mechanism, of which a fit of forces leaves these directions as they are."""
        return self._with(held=tuple(held))

    def extended(self, name: str, logs: Iterable[str] = ()) -> Mechanism[Known]:
        """The same mechanism with one effect more, which acts in these logs; () for all."""
        more = self.with_effects((*self.structure.effects, name))
        chosen = frozenset(logs)
        return more._with(acts_in={**more.acts_in, name: chosen}) if chosen else more

    @cached_property
    def plain_names(self) -> dict[str, str]:
        """Names of its effects in a model: an instance is called as its effect where it can be."""
        found: dict[str, str] = {}
        for name in self.structure.effects:
            plain = effect_of(name)
            free = plain not in self.structure.effects and plain not in found.values()
            found[name] = plain if free else name
        return found

    def plainly_named(self) -> Mechanism[Known]:
        """The same mechanism, whose effects have the names that a model gives them."""
        names = self.plain_names
        structure = self.structure.with_effects(tuple(names.values()))
        acts_in = {names[name]: logs for name, logs in self.acts_in.items()}
        return self._with(structure=structure, acts_in=acts_in)

    def everywhere(self) -> Mechanism[Known]:
        """The same mechanism with all effects in all logs."""
        return self._with(acts_in={})

    def _silent(self, log: str) -> frozenset[int]:
        """Indices of the parameters of effects that do not act in a log."""
        silent = {name for name, logs in self.acts_in.items() if log not in logs}
        return frozenset(k for k, label in enumerate(self.labels) if label.component in silent)

    def _theta_in(self, theta: Array, silent: frozenset[int]) -> Array:
        """theta (P,) with what is silent at no strength; shape constants stay."""
        found = np.array(theta, float)
        found[[k for k in silent if not self.labels[k].parameter.is_shape]] = 0.0
        return found

    # Parameters ---------------------------------------------------------------------------------

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of theta."""
        return self.structure.parameter_names

    @cached_property
    def labels(self) -> tuple[ParameterLabel, ...]:
        """(P,) what is known of each parameter beforehand."""
        found: list[ParameterLabel] = []
        for item in self.structure.components:
            declared = self.kind.declared(item, self.geometry)
            for name in item.parameter_names:
                parameter = declared.parameter(name)
                relative = parameter.relative_to
                if relative == "internal" and not self.internal:
                    relative = None  # each torque exerts a force
                group = f"{item.name}.{parameter.name}" if relative else None
                found.append(ParameterLabel(item.name, name, parameter, group))
        return tuple(found)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(P,) whether a parameter is identified linearly (shape constants stay as they are)."""
        return np.array([not label.parameter.is_shape for label in self.labels])

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """(F,) indices of the free parameters, in the order in which they are shown."""
        first = self.conventions.order
        return np.array([*first, *np.flatnonzero(self.free)[len(first) :]], dtype=np.intp)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) and (P,): physical bounds; none on values relative to each other."""
        free = Parameter("", "")
        declared = [free if label.group else label.parameter for label in self.labels]
        least = self.conventions.least(self.geometry)
        lower = [
            max(p.lower, least.get(label.name, -np.inf))
            for p, label in zip(declared, self.labels, strict=True)
        ]
        return np.array(lower), np.array([p.upper for p in declared])

    @cached_property
    def scale(self) -> Array:
        """(P,) factors from theta to numbers of one size."""
        base = self.conventions.base_scale(self.geometry)
        return np.array([base.get(label.name, 1.0 / label.parameter.size) for label in self.labels])

    @property
    def is_linear(self) -> bool:
        """Whether the demanded force is linear in the free parameters."""
        return self.structure.is_linear and not self.structure.nonlinear

    def extend_theta(self, theta: Array, name: str, shapes: Mapping[str, float]) -> Array:
        """theta (P,) followed by those of effect ``name``: no strength, shapes as given."""
        effect = self.catalogue[name]
        values = {**effect.defaults, **shapes}
        return np.concatenate([theta, [values[key] for key in effect.parameter_names]])

    # Logs ---------------------------------------------------------------------------------------

    @cached_property
    def force_scale(self) -> Array:
        """(A,) factors that turn generalised forces into those of the engine."""
        return self.conventions.force_scale(self.geometry)

    @cached_property
    def speed_scale(self) -> Array:
        """(A,) factors that turn a twist into the engine's speeds."""
        return 1.0 / self.force_scale

    @cached_property
    def jacobian(self) -> Array:
        """(J, A): rates of the joints per twist."""
        units = np.eye(len(self.kind.axes))
        return np.array([self.kind.joint_rates(self.geometry, tuple(row)) for row in units]).T

    @cached_property
    def least_squares(self) -> Array:
        """(J, A): makes a twist of joint rates; its transpose makes torques of a force."""
        return least_squares_of(self.jacobian)

    def samples(self, log: Log) -> Samples:
        """Motion and torque of a log; speeds that are differences of angles are centred."""
        angle_noise = differenced_noise(log.velocity, log.dt, log.noise_settings)
        if angle_noise is None:
            return self.conventions.samples(log, self.geometry, self.settings)
        # A difference is the speed half a sample ago, and half a sample between speeds and torques
        # biases inertias. The mean with the next one is the speed at the sample.
        velocity = np.concatenate([0.5 * (log.velocity[1:] + log.velocity[:-1]), log.velocity[-1:]])
        centred = replace(log, velocity=velocity)
        return replace(
            self.conventions.samples(centred, self.geometry, self.settings),
            angle_noise=tuple(angle_noise.tolist()),
            bandwidth=self._bandwidth(velocity, angle_noise, log.dt),
        )

    def samples_of(
        self,
        logs: Sequence[Log],
        clock: Mapping[str, float] | None = None,
        of_clock: Collection[str] = (),
    ) -> list[Samples]:
        """Motion and torque of logs that belong together, each with its start on their clock.

        ``clock``, ``of_clock`` : see `starts_on_shared_clock`.
        """
        starts = starts_on_shared_clock(logs, clock, of_clock)
        return [
            replace(self.samples(log), start=start) for log, start in zip(logs, starts, strict=True)
        ]

    def _bandwidth(self, velocity: Array, angle_noise: Array, dt: float) -> float:
        """[Hz] up to which the noise of differenced angles is a given share of the speeds."""
        size = float(np.sqrt(np.mean(velocity**2)))
        allowed = self.settings.max_difference_noise_share * size
        # Speeds hold the power 2 dt (2 pi f)^2 sigma^2 a hertz of it; its integral up to f.
        noise = float(np.sqrt(np.mean(angle_noise**2)))
        found = float(np.cbrt(3 * allowed**2 / (8 * np.pi**2 * dt * noise**2)))
        least, most = self.settings.min_bandwidth, 0.25 / dt
        return max(found, least) if found < most else float("inf")

    def parts(self, samples: Samples) -> list[Part]:
        """Stretches of a log that are judged apart."""
        return self.conventions.parts(samples, self.settings)

    def variables(self, samples: Samples) -> Variables:
        """What the residual may depend on."""
        return self.conventions.variables(samples, self.geometry)

    def measured_force(self, samples: Samples) -> Array:
        """(N, A) generalised force of the logged torques."""
        return (samples.torque @ self.jacobian) * self.force_scale

    def passed_force(self, theta: Array, samples: Samples) -> Array:
        """(N, A) of the measured force what channels that are not affine let pass.

        A limit of the torque, for instance, takes what is above it. Zero where a fit makes no rows.
        """
        theta = self._theta_in(theta, self._silent(samples.name))
        torque = passed_torque(self.structure, self.geometry, theta, samples)
        force = self.measured_force(replace(samples, torque=torque))
        return force if samples.moves is None else force * samples.moves[:, None]

    def measured_speed(self, samples: Samples) -> Array:
        """(N, A) measured speeds."""
        return samples.twist * self.speed_scale

    def joint_speed(self, speed: Array) -> Array:
        """(N, J) rates of the joints at speeds (N, A)."""
        return (speed / self.speed_scale) @ self.jacobian.T

    def joint_torque(self, force: Array) -> Array:
        """(N, J) least-norm torques of the joints that exert forces (N, A)."""
        return (force / self.force_scale) @ self.least_squares.T

    def noisy(
        self, samples: Samples, speed: Array, torque: Array, rng: np.random.Generator
    ) -> Samples:
        """The samples with noise of these standard deviations (J,) put on.

        It is white, but on speeds that are differences of angles it is such a difference too.
        """
        found = self.speed_noise(samples, speed, rng).on(samples, 0)
        if not torque.any():
            pass_over(rng, samples.torque.size)
            return found
        more = torque * rng.standard_normal(samples.torque.shape)
        return replace(found, torque=found.torque + more)

    def speed_noise(self, samples: Samples, speed: Array, rng: np.random.Generator) -> AddedNoise:
        """Noise of these standard deviations (J,) for the speeds of samples."""
        extra = rng.standard_normal(samples.torque.shape)
        if samples.angle_noise is not None:
            # Noise of angles, differenced over two samples as in `samples`.
            extra = (np.roll(extra, -1, axis=0) - np.roll(extra, 1, axis=0)) / np.sqrt(2.0)
        extra *= speed
        return self.added_noise(samples, extra)

    def added_noise(self, samples: Samples, extra: Array) -> AddedNoise:
        """Noise (N, J) for the speeds of samples."""
        # Angles that are integrated from the speeds drift with their noise; a ripple sees it.
        drifts = samples.wheel_angle.size and not samples.angle_measured
        reads = drifts and self.structure.depends_on_angle
        drift = integral_of(extra, samples.dt) if reads else None
        return AddedNoise(extra, drift, self.least_squares)

    def demand(
        self, theta: Array, samples: Samples, like: DemandedForce[Known] | None = None
    ) -> DemandedForce[Known]:
        """Generalised force that the logged motion demands at parameters theta (P,).

        ``like``: that of the same samples at a structure which this one extends by what has no
        strength at theta; what it has found out is taken over.
        """
        declared = tuple(label.parameter for label in self.labels)
        silent = self._silent(samples.name)
        return DemandedForce(
            self.structure,
            self.geometry,
            self.force_scale,
            declared,
            self._theta_in(theta, silent),
            samples,
            self.settings,
            like,
            silent,
        )

    def free_run(self, theta: Array, samples: Samples) -> Array:
        """(N, A) speeds from the log's first sample, driven by its torques alone.

        A run that diverges holds inf or NaN from there on.

        Raises
        ------
        InputError
            If the parameters are too stiff to simulate.
        """
        if self.structure.changes_kinematics:
            return (self.free_run_of_joints(theta, samples) @ self.least_squares) * self.speed_scale
        found = self._twists_of_free_run(theta, samples)
        found *= self.speed_scale
        return found

    def free_run_of_joints(self, theta: Array, samples: Samples) -> Array:
        """(N, J) the same as the joints' speeds would be logged, which start as they were."""
        twist = self._twists_of_free_run(theta, samples)
        structure = self.structure
        if not structure.changes_kinematics:
            return twist @ self.jacobian.T
        rates = dynamics.joint_rates(np, structure, self.geometry, theta, tuple(twist.T))
        at = Instant(tuple(twist.T), time=samples.time, start=samples.start)
        torque = dynamics.channel_torque(
            np, structure, self.geometry, theta, tuple(samples.torque.T), at
        )
        found = dynamics.logged_speed(np, structure, theta, rates, torque, samples.time)
        speed, lag = np.stack(found[0], axis=1), [float(np.max(part)) for part in found[1]]
        if not structure.filters_speed:
            return speed
        rows = zip(speed.T, lag, samples.wheel_speed[0].tolist(), strict=True)
        return np.stack([_behind(*row, samples.dt) for row in rows], axis=1)

    def _twists_of_free_run(self, theta: Array, samples: Samples) -> Array:
        """(N, A) twists of the free run."""
        found = np.empty((len(samples), len(self.kind.axes)))
        for rows, twist in self.pieces_of_free_run(theta, samples):
            found[rows] = twist
        return found

    def pieces_of_free_run(
        self,
        theta: Array,
        samples: Samples,
        torque: Callable[[slice], Array] | None = None,
        start: Samples | None = None,
    ) -> Iterator[tuple[slice, Array]]:
        """Rows and twists (n, A) of a free run, piece after piece.

        Parameters
        ----------
        torque : (n, J) of some rows, that drives it; the logged one by default
        start : samples whose first row it starts from; the log's own by default
        """
        # numba, which a force fit does without
        from youbot_env.simulation.free_run import simulate_theta

        rows_of_pieces = self.rows_of_free_run(theta, samples)
        structure, theta = self._structure_in(samples.name, theta)
        driving = torque or samples.torque.__getitem__
        s = rolled(structure, self.geometry, theta, start or samples, self.settings)
        state = [*s.twist[0], *s.pose[0], *s.wheel_angle[0], s.time[0]]
        if structure.has_actuator:
            at = Instant(tuple(s.twist[0]), time=s.time[0], start=s.start)
            first = tuple(driving(slice(0, 1))[0])
            state += dynamics.channel_torque(np, structure, self.geometry, theta, first, at)
            state += [0.0] * (len(first) * (structure.drive_order - 1))
        if structure.reads_start:
            state.append(s.start)
        # Each piece of a long run goes on from the last state of the one before.
        for rows in rows_of_pieces:
            begin = max(rows.start - 1, 0)
            args = (np.full(rows.stop - 1 - begin, s.dt), driving(slice(begin, rows.stop)), state)
            states = simulate_theta(structure, self.geometry, theta, *args)
            yield rows, states[rows.start - begin :, : len(self.kind.axes)]
            state = states[-1]

    def rows_of_free_run(self, theta: Array, samples: Samples) -> list[slice]:
        """The rows of each piece of a free run."""
        structure, theta = self._structure_in(samples.name, theta)
        # A delay reaches behind the start of a piece, so such a run is simulated as a whole.
        delayed = float(dynamics.torque_delay(np, structure, theta)) > 0
        count = len(samples)
        most = count if delayed else self.settings.max_run_samples
        starts = range(0, max(count - 1, 1), most)
        return [slice(a + (a > 0), min(a + most, count - 1) + 1) for a in starts]

    def _structure_in(self, log: str, theta: Array) -> tuple[ModelStructure[Known], Array]:
        """The structure and theta with which a log is simulated.

        Of two instances of an effect the silent one is left out, and what is left has the effects'
        own names: each set of names is compiled once, which takes seconds.
        """
        silent, effects = self._silent(log), self.structure.effects
        values = self._theta_in(theta, silent)
        names = [effect_of(name) for name in effects]
        quiet = {self.labels[k].component for k in silent}
        twice = {name for name in effects if names.count(effect_of(name)) > 1}
        kept = [name for name in effects if name not in quiet & twice]
        plain = [effect_of(name) for name in kept]
        if len(set(plain)) < len(plain):
            return self.structure, values
        stays = [label.component not in quiet & twice for label in self.labels]
        return self.structure.with_effects(plain), values[stays]

    # What to do next ----------------------------------------------------------------------------

    def motions(self, seed: int) -> Sequence[Experiment]:
        """Motions that could be recorded next, for a diagnosis to choose from; () if none is known.

        ``seed``: of those that are random.
        """
        return self.conventions.motions(self.geometry, seed)

    def advice(self, direction: Array) -> str:
        """What to record where the parameters' ``direction`` (F,) cannot be seen."""
        return self.conventions.advice(self.geometry, direction)
