"""The model as a plain function from a state to the next, for code that keeps the state."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.simulation.lane_kernel import stepper
from youbot_env.simulation.plant import plant_substeps

Array = NDArray[np.float64]


class StepFunction:
    """``function(state, torque)`` returns the state one period later; it has no state of its own.

    Made by :func:`step_function`. It can be pickled, and called from many places at once.

    Attributes
    ----------
    model : what moves
    duration : period [s] for which the torques are held
    substeps : Runge-Kutta steps in it
    """

    def __init__(self, model: Model, duration: float, substeps: int | None = None) -> None:
        self.model = model
        self.duration = float(duration)
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise InputError(f"step function: duration {duration!r} must be positive")
        if substeps is not None and substeps < 1:
            raise InputError("step function: substeps must be at least 1")
        refuse_delay(model, "a step function", "youbot_env.Plant")
        self.substeps = substeps or plant_substeps(model, self.duration)
        self._advance: Any = stepper(model.structure)

    def __call__(self, state: ArrayLike, torque: ArrayLike) -> Array:
        """State (..., S) after ``duration`` under interface torques (..., 4) [N m], held constant.

        Leading axes broadcast: one state and (1000, 4) torques give (1000, S).
        """
        size = len(self.model.structure.state_names)
        state, torque = np.asarray(state, float), np.asarray(torque, float)
        if state.shape[-1:] != (size,) or torque.shape[-1:] != (4,):
            raise InputError(
                f"step function: needs states (..., {size}) and torques (..., 4), "
                f"not {state.shape} and {torque.shape}"
            )
        lead = np.broadcast_shapes(state.shape[:-1], torque.shape[:-1])
        # Copies: the kernel writes into the states, and takes rows side by side alone.
        rows = np.array(np.broadcast_to(state, (*lead, size)), order="C").reshape(-1, size)
        held = np.array(np.broadcast_to(torque, (*lead, 4)), order="C").reshape(-1, 4)
        theta = np.tile(self.model.theta, (len(rows), 1))
        self._advance(rows, held, self.model.lengths, theta, self.duration, self.substeps)
        return rows.reshape(*lead, size)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_advance": None}  # compiled code is found again, not carried

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._advance = stepper(self.model.structure)


def step_function(
    model: str | os.PathLike[str] | Model, duration: float, *, substeps: int | None = None
) -> StepFunction:
    """The model as a pure function ``state, torque -> state`` [SI], ``duration`` [s] later.

    For environments and planners that hold the states themselves; :class:`youbot_env.Plant` moves
    the same way and keeps them. ``youbot_env.initial_state(model, twist=...)`` makes a first state
    in the order of ``model.structure.state_names``.

    Parameters
    ----------
    model : a model, a model file, or a shipped model's name
    duration : [s], for which a torque is held
    substeps : Runge-Kutta steps in it; None chooses them as ``Plant`` does

    Raises
    ------
    InputError
        If the model cannot be read, has a delay (what is on its way is no part of the state), or
        is too stiff to simulate.
    """
    return StepFunction(load_model(model), duration, substeps)


def refuse_delay(model: Model, what: str, instead: str) -> None:
    """InputError if torques act later than they are commanded, which a state alone cannot hold."""
    if model.delay != 0.0:
        raise InputError(
            f"model {model.name}: {what} cannot hold a torque_delay of {model.delay:g} s; "
            f"use {instead}, or with_effect('torque_delay', delay=0) and delay the torques yourself"
        )
