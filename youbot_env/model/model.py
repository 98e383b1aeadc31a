"""A model: geometry, parameters with uncertainty, effects, and what they were fitted on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.model.covariance import check_covariance
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import Effect, Parameter
from youbot_env.physics.geometry import Geometry, least_squares_of, no_force_of
from youbot_env.physics.mecanum import MECANUM, mecanum_kind
from youbot_env.physics.mechanism import Instant, MechanismKind, ModelStructure
from youbot_env.physics.residual_maps import Places, map_limits, refuse_unseen
from youbot_env.physics.stated_parameters import to_public, to_theta

Array = NDArray[np.float64]

Known = TypeVar("Known")
"""Type of a mechanism's geometry, which is known and not identified."""

BASE_UNITS = {
    "m0": "kg",
    "I0": "kg m^2",
    "I1": "kg m^2",
    "aX": "m",
    "aY": "m",
    "mu1": "N m s",
    "mu2": "N m s",
}
"""The paper's seven parameters, in its order, with their SI units."""


@dataclass(frozen=True)
class Estimate:
    """A parameter's value, SI unit and standard deviation (None: not known)."""

    value: float
    unit: str
    std: float | None = None


@dataclass(frozen=True)
class Model(Generic[Known]):
    """Dynamic model of one mechanism, a mecanum platform unless another is named. Immutable; every
    change returns a new model.

    Attributes
    ----------
    geometry : what is known and not identified; for a platform its lengths and wheel mass
    parameters : of the base model by name: of a platform the paper's seven, m0, I0, I1, aX, aY,
        mu1, mu2
    effects : for each added effect its parameters by name
    covariance : (k, k) of the parameters named in ``covariance_names``, SI units, or None
    logs : name and sha256 of each log that it was fitted on
    errors : its errors on those logs
    provenance : seed, versions, settings of the fit
    mechanism : the kind of mechanism
    effect_logs : of effects that act in some logs only, the names of these logs. Where a model is
        compared with logs they act there alone; whatever else the model is used for, they act

    Raises
    ------
    InputError
        If a parameter is missing, not finite or not physical.
    """

    geometry: Known
    parameters: Mapping[str, Estimate]
    effects: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    covariance: Array | None = None
    covariance_names: tuple[str, ...] = ()
    logs: tuple[Mapping[str, str], ...] = ()
    errors: Mapping[str, Any] = field(default_factory=dict)
    name: str = "model"
    provenance: Mapping[str, Any] = field(default_factory=dict)
    mechanism: MechanismKind[Any] = MECANUM
    effect_logs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.geometry, Geometry):
            # The rollers decide which formulas hold: a model of other rollers is of another kind.
            object.__setattr__(self, "mechanism", mecanum_kind(self.geometry))
        missing = [name for name in self.base_parameters if name not in self.parameters]
        if missing:
            raise InputError(f"model {self.name}: parameter {missing[0]!r} is missing")
        for name, value in self.values.items():
            if not np.isfinite(value):
                raise InputError(f"model {self.name}: {name} = {value!r} is not a finite number")
        self._check_bounds()
        self._check_physical()
        where = f"model {self.name}: covariance"
        check_covariance(self.covariance, self.covariance_names, self.values, where)

    def _check_bounds(self) -> None:
        for effect in self.effects:
            item = self.effect(effect)
            for key in item.public_names:
                known = item.public_parameter(key)
                if fault := known.fault(self.values[f"{effect}.{key}"]):
                    raise InputError(f"model {self.name}: effect {effect}: {key} = {fault}")

    def _check_physical(self) -> None:
        base = {name: self.parameters[name].value for name in self.base_parameters}
        if fault := self.mechanism.fault(self.geometry, base):
            raise InputError(f"model {self.name}: {fault}")
        for name, known in self.base_parameters.items():
            if fault := known.fault(base[name]):
                raise InputError(f"model {self.name}: {name} = {fault}")
        # Numbers that are each possible may overflow together: an error, not numpy's warning.
        with np.errstate(all="ignore"):
            mass = self.mass_matrix()
        if not np.isfinite(mass).all():
            raise InputError(f"model {self.name}: {self._why_no_number()}")
        if np.linalg.eigvalsh(mass).min() <= 0:
            raise InputError(
                f"model {self.name}: the mass matrix is not positive definite "
                "(a centre of mass that far out needs a larger I0)"
            )

    def _why_no_number(self) -> str:
        """Why its mass matrix at rest is no number: an effect that has none there, or its sizes."""
        lost = [name for name in self.effects if not self._is_number_at_rest((name,))]
        if not lost:
            return "its numbers overflow together; check their units"
        names, many = " and ".join(lost), len(lost) > 1
        return (
            f"effect{'s' if many else ''} {names} {'are' if many else 'is'} no number where the "
            "robot rests (a division by a speed that is 0?); write it so that it is one there: "
            "v / xp.sqrt(v**2 + 1e-6) or xp.tanh(v / 0.001) in the place of v / xp.abs(v)"
        )

    def _is_number_at_rest(self, effects: tuple[str, ...]) -> bool:
        """Whether a usual base model with some of its effects alone has finite forces at rest."""
        structure = ModelStructure(effects, self.mechanism)
        usual = {name: known.size for name, known in self.base_parameters.items()}
        theta = to_theta(structure, self.geometry, self.values | usual)
        with np.errstate(all="ignore"):
            rows = dynamics.mass_matrix(np, structure, self.geometry, theta, self._at_rest)
        return bool(np.isfinite(np.array(rows, float)).all())

    @cached_property
    def base_parameters(self) -> dict[str, Parameter]:
        """Declarations of the base parameters, by name."""
        return self.mechanism.base_parameters(self.geometry)

    def effect(self, name: str) -> Effect:
        """An effect of the mechanism's catalogue, with units and bounds of the one at hand."""
        return self.mechanism.effect(name, self.geometry)

    @cached_property
    def structure(self) -> ModelStructure[Known]:
        """Which effects it holds, and so the order of ``theta``."""
        return ModelStructure(tuple(self.effects), self.mechanism)

    @cached_property
    def values(self) -> dict[str, float]:
        """All parameters by full name: m0 ... mu2, then ``effect.parameter``."""
        found = {name: float(self.parameters[name].value) for name in self.base_parameters}
        for effect, parameters in self.effects.items():
            for name in self.effect(effect).public_names:
                if name not in parameters:
                    raise InputError(f"model {self.name}: effect {effect} lacks {name!r}")
                found[f"{effect}.{name}"] = float(parameters[name].value)
        return found

    @cached_property
    def theta(self) -> Array:
        """(P,) parameters in the order and form of ``structure.parameter_names`` (m_aX = m aX)."""
        return to_theta(self.structure, self.geometry, self.values)

    @cached_property
    def map_limits(self) -> dict[str, tuple[float, float]]:
        """What its maps of the residual have seen: low and high of each, by its effect's name."""
        return map_limits(tuple(self.effects), self.values)

    def refuse_unseen(self, at: Places, where: str = "the motion") -> None:
        """Refuse a motion that goes where a map of the residual in this model knows nothing.

        Raises
        ------
        InputError
            See :func:`youbot_env.physics.residual_maps.refuse_unseen`.
        """
        if not self.map_limits:
            return
        if at.wheel_speed is None and at.twist is not None and isinstance(self.geometry, Geometry):
            at = at._replace(wheel_speed=self.geometry.wheel_speeds(at.twist))
        refuse_unseen(self.map_limits, at, where)

    @cached_property
    def lengths(self) -> Array:
        """Lengths of the geometry that compiled code reads; for a platform l, h, R, r [m]."""
        return np.array([getattr(self.geometry, name) for name in self.mechanism.lengths], float)

    @cached_property
    def delay(self) -> float:
        """[s] by which torques act later than the interface says so; 0 without such an effect."""
        return float(dynamics.torque_delay(np, self.structure, self.theta))

    @cached_property
    def joint_jacobian(self) -> Array:
        """(J, A): rates at which the joints truly roll per twist; its transpose maps torques."""
        units = tuple(np.eye(len(self.mechanism.axes)))
        rates = dynamics.joint_rates(np, self.structure, self.geometry, self.theta, units)
        return np.stack(np.broadcast_arrays(*rates))

    @cached_property
    def twist_map(self) -> Array:
        """(J, A): makes the nearest twist of rates at which the joints truly roll."""
        return least_squares_of(self.joint_jacobian)

    @cached_property
    def internal(self) -> tuple[float, ...]:
        """(4,) torques of a platform's wheels that exert no force as the wheels truly roll."""
        return no_force_of(self.joint_jacobian)

    def with_theta(self, theta: Sequence[float] | Array) -> Model:
        """The same model at other parameters (P,), without the old ones' uncertainty."""
        return self.with_values(to_public(self.structure, self.geometry, theta))

    def with_values(self, values: Mapping[str, float]) -> Model:
        """The same model with the parameters named (full names) replaced and no covariance.

        Raises
        ------
        InputError
            If a name is unknown or a result is not physical.
        """
        unknown = [name for name in values if name not in self.values]
        if unknown:
            raise InputError(
                f"model {self.name}: no parameter {unknown[0]!r}; it has {', '.join(self.values)}"
            )
        merged = self.values | {name: float(value) for name, value in values.items()}
        parameters = {
            name: Estimate(merged[name], known.unit) for name, known in self.base_parameters.items()
        }
        effects = {
            effect: {
                name: Estimate(
                    merged[f"{effect}.{name}"], self.effect(effect).public_parameter(name).unit
                )
                for name in self.effect(effect).public_names
            }
            for effect in self.effects
        }
        # The covariance belongs to the fit of the old values.
        return replace(
            self, parameters=parameters, effects=effects, covariance=None, covariance_names=()
        )

    def with_effect(self, name: str, **values: float) -> Model:
        """The model plus (or with other values of) one effect of the catalogue.

        Parameters that are not named keep their default: no strength, or the shape constant's. Of
        what each wheel has its own the bare name ("phase") stands for all four.

        Raises
        ------
        InputError
            If the effect or a parameter is unknown or a value is out of its bounds.
        """
        effect = self.effect(name)
        estimates = {
            key: Estimate(float(value), effect.public_parameter(key).unit)
            for key, value in (effect.public_defaults | effect.for_each_wheel(values)).items()
        }
        effects = dict(self.effects) | {name: estimates}
        return replace(self, effects=effects, covariance=None, covariance_names=())

    def without_effects(self) -> Model:
        """The base model alone, at the same parameters."""
        return replace(self, effects={}, effect_logs={}, covariance=None, covariance_names=())

    def sample(self, rng: np.random.Generator) -> Model:
        """A model drawn from this one's covariance; draws that are not physical are drawn again.

        Raises
        ------
        InputError
            If the model has no covariance, or hardly a draw is physical.
        """
        if self.covariance is None:
            raise InputError(f"model {self.name}: it holds no covariance to draw from")
        mean = np.array([self.values[name] for name in self.covariance_names])
        for _ in range(1000):
            # numpy's own check would compare parameters of different units; the model has checked
            # the covariance with correlations.
            draw = rng.multivariate_normal(mean, self.covariance, check_valid="ignore")
            try:
                return self.with_values(dict(zip(self.covariance_names, draw, strict=True)))
            except InputError:
                continue
        raise InputError(f"model {self.name}: its uncertainty reaches far past physical values")

    # Evaluation on arrays -----------------------------------------------------------------------

    def wrench(self, twist: ArrayLike, acceleration: ArrayLike, **at: ArrayLike) -> Array:
        """Generalised force (..., 3) [N, N, N m] that a motion demands.

        Parameters
        ----------
        twist, acceleration : (..., 3) body twist and its time derivative
        at : pose (..., 3), wheel_angle (..., 4), torque (..., 4) that acts, time (...)
        """
        instant = _instant(twist, acceleration, at)
        self.refuse_unseen(_places(twist, at))
        return _stack(dynamics.wrench(np, self.structure, self.geometry, self.theta, instant))

    def inverse_dynamics(self, twist: ArrayLike, acceleration: ArrayLike, **at: ArrayLike) -> Array:
        """Interface torques (..., 4) [N m] that drive a motion (see :meth:`wrench`).

        A model with an actuator reads ``torque_rate`` (..., 4) [N m/s], the rate of the torques
        that act at the wheels, one of second order also
        ``torque_second_rate`` [N m/s^2]. Where torques act late they must be commanded ``delay``
        before the motion: feed forward from the reference that much ahead.
        """
        instant = _instant(twist, acceleration, at)
        self.refuse_unseen(_places(twist, at))
        return _stack(
            dynamics.inverse_dynamics(np, self.structure, self.geometry, self.theta, instant)
        )

    def forward_dynamics(self, twist: ArrayLike, torque: ArrayLike, **at: ArrayLike) -> Array:
        """Acceleration (..., 3) of the body twist under acting wheel torques (..., 4) [N m]."""
        instant = _instant(twist, np.zeros(3), {**at, "torque": torque})
        self.refuse_unseen(_places(twist, at))
        return _stack(
            dynamics.forward_dynamics(np, self.structure, self.geometry, self.theta, instant)
        )

    def state_derivative(self, state: ArrayLike, torque: ArrayLike) -> Array:
        """Time derivative (..., S) of the state (``structure.state_names``) under torques (..., 4).

        ``torque`` [N m] is what the interface commands or logs (``delay`` earlier, with a delay).
        """
        return _stack(
            dynamics.state_derivative(
                np, self.structure, self.geometry, self.theta, _parts(state), _parts(torque)
            )
        )

    def mass_matrix(self) -> Array:
        """(A, A) mass matrix at rest: of (VX', VY', W') [kg, kg m, kg m^2]."""
        rows = dynamics.mass_matrix(np, self.structure, self.geometry, self.theta, self._at_rest)
        return np.array(rows, dtype=float)

    @property
    def _at_rest(self) -> Instant[float]:
        mechanism = self.mechanism
        still = (0.0,) * len(mechanism.axes)
        return Instant(still, still, pose=(0.0,) * len(mechanism.pose_state))

    def linearise(
        self, state: ArrayLike, torque: ArrayLike, *, step: float = 1e-6
    ) -> tuple[Array, Array]:
        """A (S, S) and B (S, 4) of the state's derivative at a state (S,) and torques (4,).

        Central differences of the model itself: exact to about 1e-9 of the largest entry, to 1e-6
        where a wheel with dry friction stands still.
        """
        # All differences in one call: the model takes arrays of states and torques.
        x = np.concatenate([np.asarray(state, float), np.asarray(torque, float)])
        size = len(self.structure.state_names)
        shifts = step * np.eye(len(x))
        ahead = self.state_derivative((x + shifts)[:, :size], (x + shifts)[:, size:])
        behind = self.state_derivative((x - shifts)[:, :size], (x - shifts)[:, size:])
        jacobian = (ahead - behind).T / (2 * step)
        return jacobian[:, :size], jacobian[:, size:]


def _parts(array: ArrayLike) -> tuple[Any, ...]:
    return tuple(np.moveaxis(np.asarray(array, float), -1, 0))


def _instant(twist: ArrayLike, acceleration: ArrayLike, at: Mapping[str, ArrayLike]) -> Instant:
    known = {"pose", "wheel_angle", "torque", "torque_rate", "torque_second_rate", "time", "start"}
    for key in at:
        if key not in known:
            raise InputError(f"unknown argument {key!r}; known are {', '.join(sorted(known))}")
        if at[key] is None:
            raise InputError(f"{key} is None: it is not measured; leave it out, or reckon it")
    parts = {
        key: np.asarray(value, float) if key in ("time", "start") else _parts(value)
        for key, value in at.items()
    }
    return Instant(_parts(twist), _parts(acceleration), **parts)  # type: ignore[arg-type]


def _places(twist: ArrayLike, at: Mapping[str, ArrayLike]) -> Places:
    """Where a motion is, as far as it is said."""
    said = {key: np.asarray(at[key], float) for key in ("pose", "wheel_angle", "time") if key in at}
    return Places(twist=np.asarray(twist, float), **said)


def _stack(components: Sequence[Any]) -> Array:
    # Some components may be plain numbers: a force that an effect leaves at 0.
    return np.stack(np.broadcast_arrays(*components), axis=-1).astype(float)
