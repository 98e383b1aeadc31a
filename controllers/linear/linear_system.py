"""The loop as a linear system: platform, drives, delay, hold and measurement.

The input is the body force (F_X, F_Y, M_W) [N, N, N m] of all wheels together, because least-norm
wheel torques follow from it and it from them. A linear system behind a hold is again linear from
sample to sample, so the sampled model is exact for delays of any length.

Here are also the quantities of a model that a design needs: the lag of its drives, the delay of its
commands, and the effective mass and friction.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from controllers.interface import Array, Loop
from controllers.linear.margins import Complex, python_control
from youbot_env.errors import check_settings
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mecanum import DRIVE_STATE, STATE
from youbot_env.physics.mechanism import Instant
from youbot_env.simulation.free_run import initial_state

TWIST = slice(0, 3)
DRIVES = slice(len(STATE), len(STATE) + len(DRIVE_STATE))

ROUNDING = 1e-9
"""Share of a sample below which a piece of a delay is rounding."""


@dataclass(frozen=True)
class LinearisationSettings:
    """Where a platform is taken for a linear system."""

    working_twist: tuple[float, float, float] = field(
        default=(0.25, 0.1, 0.1),
        metadata={
            "unit": "m/s, m/s, rad/s",
            "reason": "every wheel and every roller turns, past the kink that dry friction has at "
            "standstill",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class DriveSettings:
    """When a measured torque is believed instead of the commanded one."""

    contradiction_share: float = field(
        default=0.05,
        metadata={
            "unit": "of the torque limit",
            "reason": "smaller differences may be noise of the measurement; larger ones are "
            "drives that do not do what they are told",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """x(k+1) = a x(k) + b u(k), y(k) = c x(k) + d u(k), or x' = a x + b u where ``period`` is None.

    Attributes
    ----------
    a, b, c, d : (S, S), (S, m), (p, S), (p, m)
    period : sample time [s], None in continuous time
    """

    a: Array
    b: Array
    c: Array
    d: Array
    period: float | None = None

    def response(self, frequency: ArrayLike) -> Complex:
        """Frequency response (w, p, m) at (w,) [rad/s]: at z = exp(j w T), or at s = j w."""
        s = 1j * np.asarray(frequency, float)
        point = s if self.period is None else np.exp(s * self.period)
        resolvent = point[:, None, None] * np.eye(len(self.a)) - self.a
        return self.c @ np.linalg.solve(resolvent, self.b[None] + 0j) + self.d

    @property
    def poles(self) -> Complex:
        """(S,) in the s plane [1/s], the slowest first; a pole at z = 0 (pure delay) is -inf."""
        found: Complex = np.linalg.eigvals(self.a).astype(np.complex128)
        if self.period is not None:
            # log(0) = -inf is the pole of a pure delay.
            with np.errstate(divide="ignore"):
                found = np.asarray(np.log(found) / self.period, np.complex128)
        return found[np.lexsort((found.imag, -found.real))]

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays."""
        found = np.linalg.eigvals(self.a)
        return bool(found.real.max() < 0 if self.period is None else np.abs(found).max() < 1)

    def to_control(self) -> Any:
        """The same system as a ``control.StateSpace`` (extra: control)."""
        return python_control().ss(self.a, self.b, self.c, self.d, self.period or 0)


def twist_dynamics(model: Model, twist: ArrayLike | None = None) -> LinearSystem:
    """Body twist (3,) under the commanded body force (3,), linear about a twist; no delay.

    States are the twist and, in a model with an actuator, the body force that acts. The heading,
    wheel angles and time stand still: forces that depend on them are disturbances here.

    Parameters
    ----------
    twist : VX, VY, W [m/s, m/s, rad/s]. None is the platform about rest, but with the slope that
        friction has once everything turns: the mean of the systems at plus and minus
        ``LinearisationSettings.working_twist``, in which all that is odd in the twist (Coriolis
        forces) cancels.
    """
    if twist is None:
        working = np.array(LinearisationSettings.working_twist)
        about = [working, -working]
    else:
        about = [np.asarray(twist, float)]
    parts = [_about(model, point) for point in about]
    a, b = (np.mean(matrices, axis=0) for matrices in zip(*parts, strict=True))
    return LinearSystem(a, b, np.eye(3, len(a)), np.zeros((3, 3)))


def _about(model: Model, twist: Array) -> tuple[Array, Array]:
    """a (S, S) and b (S, 3) of twist and drives in the coordinates of the body force."""
    # The torques that hold the twist: the linearisation is about a steady motion.
    torque = model.inverse_dynamics(twist, np.zeros(3))
    a, b = model.linearise(initial_state(model, twist=twist, torque=torque), torque)
    # Four torques, three forces: the drives' states are mapped to forces, and back by least norm.
    to_force = model.geometry.wheel_jacobian.T
    to_wheels = model.geometry.wheel_torque(np.eye(3)).T
    if not model.structure.has_actuator:
        return a[TWIST, TWIST], b[TWIST] @ to_wheels
    order = model.structure.drive_order
    states = slice(DRIVES.start, DRIVES.start + 4 * order)
    # The torques and, in drives of second order, their rates alike.
    forces, wheels = np.kron(np.eye(order), to_force), np.kron(np.eye(order), to_wheels)
    drives = np.block(
        [
            [a[TWIST, TWIST], a[TWIST, states] @ wheels],
            [forces @ a[states, TWIST], forces @ a[states, states] @ wheels],
        ]
    )
    return drives, np.vstack([b[TWIST], forces @ b[states]]) @ to_wheels


def drive_lag(model: Model) -> float:
    """Time constant T [s] of the drives, T M' + M = M_command; 0 where torques act at once.

    Drives of second order are taken for such a lag, which is their slope at low frequency.

    Read from the actuator's own function, so that no rounding of a linearisation is in it.
    """
    if not model.structure.has_actuator:
        return 0.0
    rows = []
    for torque, rate in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        at = Instant((0.0, 0.0, 0.0), torque=(torque,) * 4, torque_rate=(rate,) * 4)
        rows.append(dynamics.actuator_command(np, model.structure, model.theta, at)[0])
    still, torque, rate = (float(value) for value in rows)
    # The command is affine: its slope in the rate over its slope in the torque is T.
    return max(0.0, (rate - still) / (torque - still))


def acting_delay(model: Model, loop: Loop) -> float:
    """[s] from a command to the start of its hold at the drives.

    A model's own delay may be negative, where it was fitted on a log whose torques are late; what
    a loop commands never acts before.
    """
    return loop.delay + max(model.delay, 0.0)


class Inertia(NamedTuple):
    """Mass (3, 3) and viscous friction (3, 3) of F = mass v' + friction v."""

    mass: Array
    friction: Array


def effective_mass(model: Model) -> Inertia:
    """Mass and viscous friction that the commanded body force (3,) moves, with all wheels turning.

    They include the wheels' spin inertia and a gain between commanded and acting torque.
    """
    plant = twist_dynamics(model)
    push = plant.b[TWIST]
    if len(plant.a) > 3:
        # The drives in their steady state: the effect of a command after their lag.
        push = push - plant.a[:3, 3:] @ np.linalg.solve(plant.a[3:, 3:], plant.b[3:])
    mass = np.asarray(np.linalg.inv(push), float)
    return Inertia(mass, -mass @ plant.a[TWIST, TWIST])


def held(a: Array, b: Array, duration: float) -> tuple[Array, Array]:
    """exp(a t) (S, S) and its integral over [0, t] times b (S, m): a held input's effect."""
    # The same as scipy.signal.cont2discrete, to the bit; importing that takes longer than a design.
    size, inputs = b.shape
    block = np.zeros((size + inputs, size + inputs))
    block[:size, :size], block[:size, size:] = a, b
    found = expm(block * duration)
    return np.asarray(found[:size, :size], float), np.asarray(found[:size, size:], float)


def split_delay(delay: float, period: float) -> tuple[int, float]:
    """Number of whole periods in a delay [s], and the rest [s], in [0, period)."""
    whole = int(np.floor(delay / period + ROUNDING))
    rest = delay - whole * period
    return whole, rest if rest > ROUNDING * period else 0.0


def sampled(
    plant: LinearSystem, period: float, delay: float = 0.0, measurement_delay: float = 0.0
) -> LinearSystem:
    """A continuous system behind a hold, seen at its samples: exact for any delays.

    Inputs act ``delay`` [s] after their command and are held for ``period`` [s]; outputs are those
    of ``measurement_delay`` [s] ago. States are the plant's, then the commands on their way (the
    newest first), then the measurements on their way.
    """
    whole, rest = split_delay(delay, period)
    old, rest_old = split_delay(measurement_delay, period)
    size, inputs = plant.b.shape
    outputs = len(plant.c)
    queue = whole + (rest > 0)
    late = old + (rest_old > 0)
    total = size + queue * inputs + late * outputs
    a, b = np.zeros((total, total)), np.zeros((total, inputs))

    def commanded(age: int) -> tuple[Array, slice]:
        """Where the command of ``age`` periods ago stands: the input, or a state."""
        if age == 0:
            return b, slice(0, inputs)
        return a, slice(size + (age - 1) * inputs, size + age * inputs)

    def put(rows: slice, output: Array, since: float) -> None:
        """Rows: output of the plant's state ``since`` [s] after the present sample."""
        a[rows, :size] += output @ held(plant.a, plant.b, since)[0]
        first = min(rest, since)
        # until ``rest`` the older command still acts, then the newer one
        moved, early = held(plant.a, plant.b, since - first)[0], held(plant.a, plant.b, first)[1]
        for age, effect in (
            (whole + 1, moved @ early),
            (whole, held(plant.a, plant.b, since - first)[1]),
        ):
            # Without a rest of the delay the older command has no effect and no state of its own.
            if effect.any():
                matrix, where = commanded(age)
                matrix[rows, where] += output @ effect

    put(slice(0, size), np.eye(size), period)
    for age in range(1, queue + 1):
        rows = slice(size + (age - 1) * inputs, size + age * inputs)
        matrix, where = commanded(age - 1)
        matrix[rows, where] = np.eye(inputs)
    base = size + queue * inputs
    for age in range(late):
        rows = slice(base + age * outputs, base + (age + 1) * outputs)
        if age > 0:
            # A shift register: each measurement on its way is the younger one of a sample ago.
            a[rows, base + (age - 1) * outputs : base + age * outputs] = np.eye(outputs)
        elif rest_old > 0:
            put(rows, plant.c, period - rest_old)
        else:
            a[rows, :size] = plant.c
    c = np.zeros((outputs, total))
    if late:
        c[:, base + (late - 1) * outputs :] = np.eye(outputs)
    else:
        c[:, :size] = plant.c
    return LinearSystem(a, b, c, np.zeros((outputs, inputs)), period)


def sampled_platform(
    model: Model, loop: Loop, twist: ArrayLike | None = None, *, measured: bool = True
) -> LinearSystem:
    """Commanded body force (3,) to body twist (3,) as a controller of this loop sees them.

    ``measured=False`` leaves the measurement's delay out: the twist at the samples themselves.
    """
    age = loop.measurement_delay if measured else 0.0
    return sampled(twist_dynamics(model, twist), loop.sample_time, acting_delay(model, loop), age)


def continuous_response(model: Model, loop: Loop, frequency: ArrayLike) -> Complex:
    """(w, 3, 3): the same at s = j w, with hold and delays as factors and without aliasing."""
    s = 1j * np.asarray(frequency, float)
    hold = -np.expm1(-s * loop.sample_time) / (s * loop.sample_time)
    late = np.exp(-s * (acting_delay(model, loop) + loop.measurement_delay))
    return twist_dynamics(model).response(frequency) * (hold * late)[:, None, None]


def closed(plant: LinearSystem, controller: LinearSystem) -> LinearSystem:
    """Reference (p,) to output (p,) of the plant under u = controller (reference - output).

    The plant must not pass its input on at once (d = 0).
    """
    k = controller
    a = np.block([[plant.a - plant.b @ k.d @ plant.c, plant.b @ k.c], [-k.b @ plant.c, k.a]])
    c = np.hstack([plant.c, np.zeros((len(plant.c), len(k.a)))])
    b = np.vstack([plant.b @ k.d, k.b])
    return LinearSystem(a, b, c, np.zeros((len(plant.c), b.shape[1])), plant.period)
