"""The model as systems of python-control: nonlinear, and linearised (extra: control)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError, optional_library
from youbot_env.exports.step_function import refuse_delay
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import WORLD
from youbot_env.physics.geometry import WHEELS
from youbot_env.physics.mecanum import STATE
from youbot_env.physics.mechanism import Instant
from youbot_env.physics.stated_parameters import to_theta
from youbot_env.simulation.compiled import derivative
from youbot_env.simulation.free_run import initial_state

Array = NDArray[np.float64]

TORQUES = tuple(f"effort_{wheel}" for wheel in WHEELS)
"""Inputs: the interface torques [N m], named as in a log."""

WHEEL_SPEEDS = tuple(f"velocity_{wheel}" for wheel in WHEELS)
"""Outputs beside the states: wheel speeds [rad/s], named as in a log."""

NEEDS_CONTROL = "this export needs python-control"

TWIST = STATE[:3]
TIME = STATE.index("time")


def to_control(
    model: str | os.PathLike[str] | Model,
    *,
    twist_only: bool = False,
    outputs: Sequence[str] | None = None,
    pade: int | None = None,
    name: str = "platform",
) -> Any:
    """The model as a ``control.NonlinearIOSystem`` in continuous time.

    States are those of ``model.structure.state_names`` in their order, but for time, which is
    python-control's own; a delay's states come last. Inputs are ``effort_fl`` ... ``effort_br``
    [N m]. The system's ``params`` are ``model.values``, so that
    ``input_output_response(..., params={"m0": 40.0})`` moves a heavier platform.

    Parameters
    ----------
    model : a model, a model file, or a shipped model's name
    twist_only : leave pose and wheel angles out: the twist, and an actuator's torques
    outputs : names of states, or ``velocity_fl`` ... ``velocity_br`` (wheel speeds); None is all
        the platform's states
    pade : order of the Padé approximation of a model's delay; it adds that many states a wheel
    name : of the system

    Raises
    ------
    InputError
        If python-control is missing, an output is unknown, a model with a delay is given without
        ``pade``, or ``twist_only`` with forces that depend on pose or wheel angles.
    """
    control = optional_library("control", "control", NEEDS_CONTROL)
    signals = Signals(load_model(model), twist_only, outputs)
    late = _late(control, signals.model, pade)
    platform = Platform(signals)
    return control.nlsys(
        late.behind(platform.derivative, len(signals.states)),
        lambda t, x, u, params: signals.output @ x[: len(signals.states)],
        states=[*signals.states, *late.states],
        inputs=list(TORQUES),
        outputs=list(signals.outputs),
        params=dict(signals.model.values),
        name=name,
    )


def linear_control(
    model: str | os.PathLike[str] | Model,
    twist: ArrayLike = (0.0, 0.0, 0.0),
    *,
    twist_only: bool = False,
    outputs: Sequence[str] | None = None,
    pade: int | None = None,
    name: str = "platform",
    **at: ArrayLike,
) -> Any:
    """:func:`to_control`'s linearisation at a steady twist, as a ``control.StateSpace``.

    States, inputs and outputs are departures from the steady motion, in which the torques are
    those that hold the twist: ``model.inverse_dynamics(twist, (0, 0, 0))``. Matrices are
    :meth:`Model.linearise`'s. At rest dry friction has its steepest slope; about a motion, hardly
    any: linearise where you drive.

    Parameters
    ----------
    twist : VX, VY, W [m/s, m/s, rad/s]
    at : pose (3,), wheel_angle (4,), time of the motion, for models whose forces depend on them
    """
    control = optional_library("control", "control", NEEDS_CONTROL)
    signals = Signals(load_model(model), twist_only, outputs)
    late = _late(control, signals.model, pade)
    state, torque = steady(signals.model, twist, **at)
    a, b = signals.model.linearise(state, torque)
    # Time, and with ``twist_only`` pose and angles, are no states of the system.
    a, b = a[np.ix_(signals.places, signals.places)], b[signals.places]
    return control.ss(
        np.block([[a, b @ late.c], [np.zeros((len(late.a), len(a))), late.a]]),
        np.vstack([b @ late.d, late.b]),
        np.hstack([signals.output, np.zeros((len(signals.output), len(late.a)))]),
        np.zeros((len(signals.output), len(TORQUES))),
        states=[*signals.states, *late.states],
        inputs=list(TORQUES),
        outputs=list(signals.outputs),
        name=name,
    )


def steady(model: Model, twist: ArrayLike, **at: ArrayLike) -> tuple[Array, Array]:
    """State (S,) of a motion at constant twist and the interface torques (4,) that hold it.

    ``at`` names pose (3,), wheel_angle (4,) and time, zero by default.
    """
    # The drives are steady (torque_rate is 0), so the acting torque is the true command.
    torque = model.inverse_dynamics(twist, np.zeros(3), **at)
    motion = Instant(tuple(np.asarray(twist, float)), time=at.get("time", 0.0))
    acting = dynamics.channel_torque(
        np, model.structure, model.geometry, model.theta, list(torque), motion
    )
    return initial_state(model, twist=twist, torque=np.array(acting), **at), torque  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Signals:
    """Which states a system has and which signals it shows."""

    model: Model
    twist_only: bool
    wanted: Sequence[str] | None

    def __post_init__(self) -> None:
        structure = self.model.structure
        if self.twist_only and (structure.at(WORLD) or structure.depends_on_angle):
            raise InputError(
                f"model {self.model.name}: forces depend on the pose or the wheels' angles, which "
                "twist_only leaves out: take all states"
            )
        known = (*self.states, *WHEEL_SPEEDS)
        for name in self.outputs:
            if name not in known:
                raise InputError(f"outputs: unknown signal {name!r}; known are {', '.join(known)}")

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the platform's states in the system."""
        structure = self.model.structure
        kept = (*TWIST, *structure.drive_states) if self.twist_only else structure.state_names
        # Both times go on, or stay, by themselves.
        return tuple(name for name in kept if name not in ("time", "start"))

    @cached_property
    def places(self) -> list[int]:
        """Where they stand in the model's own state."""
        return [self.model.structure.state_names.index(name) for name in self.states]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.states if self.wanted is None else tuple(self.wanted)

    @cached_property
    def output(self) -> Array:
        """(p, k): outputs per state; wheels turn as they roll without slip at the twist."""
        rows = np.zeros((len(self.states) + len(WHEEL_SPEEDS), len(self.states)))
        rows[: len(self.states)] = np.eye(len(self.states))
        rows[len(self.states) :, : len(TWIST)] = self.model.joint_jacobian
        names = (*self.states, *WHEEL_SPEEDS)
        return rows[[names.index(name) for name in self.outputs]]


class Platform:
    """The derivative of a system's states, as python-control asks for it."""

    def __init__(self, signals: Signals) -> None:
        model = signals.model
        self._model, self._places = model, signals.places
        self._size = len(model.structure.state_names)
        self._derivative: Any = derivative(model.structure)
        # The last parameters and their theta: python-control passes them at every call.
        self._known: tuple[dict[str, float], Array] = (dict(model.values), model.theta)

    def derivative(self, t: float, x: Array, u: Array, params: Mapping[str, float]) -> Array:
        """(k,) at time t [s], states x (k,) and torques u (4,) [N m]; ``params`` by full name."""
        # States that are left out stay zero: with ``twist_only`` no force reads them.
        state = np.zeros(self._size)
        state[self._places], state[TIME] = x, t
        model = self._model
        rates = self._derivative(state, u, model.lengths, self._theta(params))
        return rates[self._places]

    def _theta(self, params: Mapping[str, float]) -> Array:
        # In an interconnection the parameters of all its systems arrive together.
        values = {name: float(params.get(name, v)) for name, v in self._model.values.items()}
        if values != self._known[0]:
            found = to_theta(self._model.structure, self._model.geometry, values)
            self._known = (values, found)
        return self._known[1]


@dataclass(frozen=True, eq=False)
class DelayModel:
    """Linear model of the delay: xd' = a xd + b u, and acting torques c xd + d u."""

    a: Array
    b: Array
    c: Array
    d: Array
    states: tuple[str, ...] = ()

    def behind(self, derivative: Any, count: int) -> Any:
        """``derivative`` of ``count`` states, with these states behind them, as one function."""

        def update(t: float, x: Array, u: Array, params: Mapping[str, float]) -> Array:
            inner, on_the_way = x[:count], x[count:]
            acting = self.c @ on_the_way + self.d @ u
            return np.concatenate(
                [derivative(t, inner, acting, params), self.a @ on_the_way + self.b @ u]
            )

        return update


def _late(control: Any, model: Model, order: int | None) -> DelayModel:
    if order is None or model.delay == 0.0:
        refuse_delay(model, "a system of differential equations", "pade=ORDER")
        return DelayModel(np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((4, 0)), np.eye(4))
    if model.delay < 0.0 or order < 1:
        raise InputError(
            f"pade: an order of at least 1 and a delay above zero, not {order} and {model.delay:g}"
        )
    # All four wheels have the same delay, so one approximation is repeated in blocks.
    one, each = control.ss(control.tf(*control.pade(model.delay, order))), np.eye(4)
    names = tuple(f"late_{wheel}_{k + 1}" for wheel in WHEELS for k in range(order))
    return DelayModel(*(np.kron(each, part) for part in (one.A, one.B, one.C, one.D)), states=names)
