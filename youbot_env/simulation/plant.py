"""The plant: one platform, or several side by side, moved on by an identified model."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import ACTUATOR, CATALOGUE, CHANNEL, CLOCK
from youbot_env.physics.mecanum import STATE
from youbot_env.physics.mechanism import Instant
from youbot_env.simulation.free_run import initial_state, places_of, substeps
from youbot_env.simulation.lane_kernel import stepper
from youbot_env.simulation.platforms import (
    DRIVES,
    TWIST,
    StateRows,
    checked_duration,
    checked_torque,
    drive_delay,
)

Array = NDArray[np.float64]

SMOOTH_FINENESS = 1.5
"""How many times finer the base model and its drives are resolved than the step of dry friction.
They act at all speeds; the step of dry friction matters only at the last mm/s. Torques that jump to
their limits then leave at most 1e-6 m/s, a five hundredth of the usual noise of a measured speed;
with the paper's model one step in 10 ms is enough, and leaves 1e-7 m/s."""


class Plant(StateRows):
    """A mecanum platform that integrates its model under wheel torques.

    Where the model has a delay, a torque acts that much after its step, and none after a reset.
    This is what ``YouBotTracking-v0`` runs on, and the way to put an identified model into an
    environment of one's own::

        plant = Plant(load_model("model.json").with_effect("floor_tilt", tilt_x=0.02))
        plant.reset(twist=(0.1, 0.0, 0.0))
        plant.step((0.5, 0.5, 0.5, 0.5), 0.01)
        plant.twist  # VX, VY, W

    Parameters
    ----------
    model : a model, a model file, or a shipped model's name
    platforms : number of platforms; every array then has a leading axis of that length. None is
        one platform without such an axis. A platform's motion does not depend on its neighbours.
    substeps : Runge-Kutta steps per ``step``; None chooses as many as the model and the duration
        need for an error in velocity below 1e-6 m/s (1e-5 m/s beside the kink of a dry friction).

    Attributes
    ----------
    states : (n, S) in the order of ``model.structure.state_names``, live, not a copy
    wheel_rates : (n, 4) [rad/s], live: the speeds that are shown, where an effect says that wheels
        roll or are measured otherwise than the geometry has it. Else (0, 4): they follow from the
        twist
    models : the model of each platform

    Raises
    ------
    InputError
        If the model cannot be read or is too stiff to simulate.
    """

    def __init__(
        self,
        model: str | os.PathLike[str] | Model = "paper",
        *,
        platforms: int | None = None,
        substeps: int | None = None,
    ) -> None:
        model = load_model(model)
        self._single = platforms is None
        count = 1 if platforms is None else platforms
        if count < 1 or (substeps is not None and substeps < 1):
            raise InputError("plant: platforms and substeps must be at least 1")
        self.structure = model.structure
        self.geometry = model.geometry
        self.models = [model] * count
        self.states: Array = np.tile(initial_state(model), (count, 1))
        own = count if self.structure.changes_kinematics else 0
        self.wheel_rates: Array = np.zeros((own, 4))
        self._followed: Array = np.zeros((own, 4))
        self._theta: Array = np.tile(model.theta, (count, 1))
        self._lengths = model.lengths
        self._has_maps = bool(model.map_limits)
        self._substeps = substeps
        self._needed: dict[float, int] = {}
        late = count if self.structure.at(CLOCK) else 0
        self._lines = [drive_delay(model) for _ in range(late)]
        self._advance: Any = stepper(self.structure)

    def reset(
        self, model: Model | None = None, *, row: int | Sequence[int] | None = None, **start: Any
    ) -> Array:
        """Put platforms at a start and return the state.

        Parameters
        ----------
        model : from now on theirs; it must have the first one's effects and geometry. None keeps.
        row : the platforms, None for all
        start : twist, pose, wheel_angle, torque, time, as for ``initial_state``; zero by default
        """
        rows = np.arange(len(self.states)) if row is None else np.atleast_1d(row)
        for index in rows.tolist():
            if model is not None and model is not self.models[index]:
                self._use(model, index)
            self.states[index] = initial_state(self.models[index], **start)
            if self._lines:
                self._lines[index] = drive_delay(self.models[index])
        if len(self.wheel_rates):
            # As if it had always moved like that: no speed is on its way through a filter.
            speeds, _ = self._logged_speeds(np.zeros((len(self.states), 4)))
            self._followed[rows] = self.wheel_rates[rows] = speeds[rows]
        return self.state

    def _use(self, model: Model, row: int) -> None:
        if model.structure != self.structure or model.geometry != self.geometry:
            raise InputError(
                f"plant: model {model.name} has other effects or another geometry than the plant "
                f"was built with ({', '.join(self.structure.effects) or 'no effects'})"
            )
        self.models[row] = model
        self._theta[row] = model.theta
        # A stiffer model may need more steps.
        self._needed.clear()

    def step(self, torque: ArrayLike, duration: float) -> Array:
        """Move on by ``duration`` [s] under interface torques (4,) or (n, 4) [N m], held constant.

        Returns the new state, (S,) or (n, S).
        """
        held = checked_torque(torque, len(self.states), single=self._single)
        self.advance(held, checked_duration(duration))
        return self.state

    def advance(self, torque: Array, duration: float) -> None:
        """``step`` for C-contiguous rows (n, 4), unchecked and without a result.

        Raises
        ------
        InputError
            If a platform comes to where a map of the residual in its model knows nothing.
        """
        self._move(torque, duration)
        if len(self.wheel_rates):
            self._show_speeds(torque, duration)
        if self._has_maps:
            for model, state in zip(self.models, self.states, strict=True):
                model.refuse_unseen(places_of(state), "the plant")

    def _move(self, torque: Array, duration: float) -> None:
        count = self._needed.get(duration) or self._count(duration)
        if not self._lines:
            self._advance(self.states, torque, self._lengths, self._theta, duration, count)
            return
        # Each platform's model has its own delay, so its torque changes at its own instants. The
        # line keeps the array, and the caller may write to it: a copy.
        for row, line in enumerate(self._lines):
            here = slice(row, row + 1)
            for acting, piece in line.passed(torque[here].copy(), duration):
                steps = math.ceil(count * piece / duration)
                self._advance(
                    self.states[here], acting, self._lengths, self._theta[here], piece, steps
                )

    def _logged_speeds(self, command: Array) -> tuple[Array, Array]:
        """(n, 4) speeds that are measured now, and the time constants [s] of their filters."""
        structure, theta = self.structure, self._theta.T
        twist, time = tuple(self.states[:, TWIST].T), self.states[:, len(STATE) - 1]
        rates = dynamics.joint_rates(np, structure, self.geometry, theta, twist)
        torque = tuple(self.acting_torque(command).T)
        found = dynamics.logged_speed(np, structure, theta, rates, torque, time)
        speeds, lags = (np.stack(np.broadcast_arrays(*part), axis=-1) for part in found)
        return speeds, lags

    def _show_speeds(self, command: Array, duration: float) -> None:
        """Move the measured speeds on by ``duration`` [s], in which the true ones went straight."""
        now, lags = self._logged_speeds(command)
        if self.structure.filters_speed:
            decay, start, end = _hold_weights(lags, duration)
            self.wheel_rates *= decay
            self.wheel_rates += start * self._followed + end * now
        else:
            self.wheel_rates[:] = now
        self._followed[:] = now

    def _count(self, duration: float) -> int:
        # Platforms mostly share one model, whose stiffness is then found once.
        distinct = {id(model): model for model in self.models}.values()
        needed = self._substeps or max(plant_substeps(model, duration) for model in distinct)
        self._needed[duration] = needed
        return needed

    def acting_torque(self, command: Array) -> Array:
        """Torques (n, 4) [N m] that act at the wheels now, under the commands (n, 4)."""
        # With drives the acting torques are states; without them they are the command itself, late
        # and through the channels.
        if self.structure.has_actuator:
            return self.states[:, DRIVES].copy()
        if self._lines:
            command = np.concatenate([line.acting for line in self._lines])
        if not self.structure.at(CHANNEL):
            return command
        twist, time = tuple(self.states[:, TWIST].T), self.states[:, len(STATE) - 1]
        start = self.states[:, -1] if self.structure.reads_start else 0.0
        at = Instant(twist, time=time, start=start)
        found = dynamics.channel_torque(
            np, self.structure, self.geometry, self._theta.T, list(command.T), at
        )
        return np.stack(np.broadcast_arrays(*found), axis=-1)

    @property
    def wheel_speed(self) -> Array:
        """(4,) or (n, 4) [rad/s]: fl, fr, bl, br."""
        if len(self.wheel_rates):
            return (self.wheel_rates[0] if self._single else self.wheel_rates).copy()
        return self.geometry.wheel_speeds(self.twist)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_advance": None}  # compiled code is found again, not carried

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._advance = stepper(self.structure)


def _hold_weights(lags: Array, duration: float) -> tuple[Array, Array, Array]:
    """Factors on the old value, and on what it follows at the start and at the end of a time.

    Exact for a first-order lag behind what goes straight; a lag of zero shows the end.
    """
    share = duration / np.maximum(lags, 1e-9 * duration)
    decay = np.exp(-share)
    end = 1.0 - (1.0 - decay) / share
    return decay, (1.0 - decay) - end, end


def plant_substeps(model: Model, duration: float) -> int:
    """Runge-Kutta steps per ``duration`` [s] that keep what ``Plant`` promises."""
    drives = {
        name: values
        for name, values in model.effects.items()
        if CATALOGUE[name].acts_at is ACTUATOR
    }
    # The whole model at the usual fineness; what is smooth SMOOTH_FINENESS times finer.
    smooth = replace(model, effects=drives, covariance=None, covariance_names=())
    return max(substeps(smooth, SMOOTH_FINENESS * duration), substeps(model, duration))
