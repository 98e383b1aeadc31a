"""LQI: state feedback on twist, drives and the commands on their way, with integral action."""

from __future__ import annotations

import numpy as np

from controllers.allocation import within_limits
from controllers.interface import Array, Loop, Observation, Reference
from controllers.linear.drives import CommandTracker
from controllers.lqi.design import Weights, fastest, lqi
from youbot_env.model.model import Model


class LQI:
    """Linear quadratic control of the body twist with the loop's delays in its state.

    It simulates the sampled linear model with the commands that were really given. So it knows the
    drives' torques, the commands on their way, and the change of the twist since the measurement;
    the measured twist plus that change replaces the model's. The reference's steady state and force
    (N_x, N_u) are fed forward, its acceleration is not: that is computed torque.

    Where the limit cuts the force, or measured torques contradict the commands (drives off), the
    integral is set so that the law demands the force that is exerted. Where the twist is not
    measured, the model's twist is used and the integral is held.

    Parameters
    ----------
    model : linearised (see :func:`controllers.linear.linear_system.twist_dynamics`)
    loop : times and limit of the loop that it runs in
    weights : of the cost; None is :func:`controllers.lqi.design.fastest`: 6 dB and 45 degrees

    Attributes
    ----------
    weights, design : as used
    preview_needed : 0, it reads no coming reference

    Raises
    ------
    InputError
        If python-control (extra: control) is missing, or no weights keep the margins.
    """

    preview_needed = 0

    def __init__(self, model: Model, loop: Loop, weights: Weights | None = None) -> None:
        self.weights = weights or fastest(model, loop)
        self.design = lqi(model, loop, self.weights)
        self._a, self._b, self._c = self.design.plant.a, self.design.plant.b, self.design.plant.c
        self._to_wheels = model.geometry.wheel_torque(np.eye(3)).T.copy()
        self._to_force = model.geometry.wheel_jacobian.T
        self._forward = self.design.force + self.design.gain @ self.design.state
        # In u = ... - integral q: the change of q that changes u by a force.
        self._back = np.linalg.inv(self.design.integral)
        self._limits = np.full(4, loop.torque_limit), np.array(model.geometry.internal)
        self._period = loop.sample_time
        self._exerted = CommandTracker(model, loop)
        self.reset()

    def reset(self) -> None:
        """Forgets everything: at rest, nothing on its way."""
        self._state = np.zeros(len(self._a))
        self._shift = np.zeros(3)
        self._integral = np.zeros(3)
        self._exerted.reset()

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) [N m]; uses body twist and, where it is known, wheel torque."""
        apart = self._exerted.contradiction(observation.wheel_torque)
        gap = observation.body_twist - self._c @ self._state
        known = bool(np.isfinite(gap).all())
        if known:
            self._shift = gap
        error = reference.twist - self._state[:3] - self._shift
        # The model's state, with its twist shifted to the measured one.
        wanted = self._forward @ reference.twist - self.design.gain @ self._state
        wanted -= self.design.gain[:, :3] @ self._shift + self.design.integral @ self._integral
        torque = np.empty(4)
        share = within_limits(self._to_wheels @ wanted, *self._limits, torque)
        if apart is not None:
            exerted = self._to_force @ (self._exerted.acting + apart)
            self._integral += self._back @ (wanted - exerted)
        elif share < 1.0:
            self._integral += self._back @ ((1.0 - share) * wanted)
        elif known:
            self._integral += self._period * error
        # With the force that the limit leaves, not the wanted one: the model follows the platform.
        self._state = self._a @ self._state + self._b @ (share * wanted)
        self._exerted.command(torque)
        return torque
