"""PID on the body twist, with gains from the identified masses and frictions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controllers.allocation import within_limits
from controllers.interface import Array, Loop, Observation, Reference
from controllers.linear.drives import CommandTracker
from controllers.linear.linear_system import effective_mass
from controllers.linear.reference_window import extend_to_past, reference_at, take_sample
from controllers.pid.design import PIDGains, derivative_filter, design, matrices
from youbot_env.caching import njit
from youbot_env.model.model import Model


class BodyLoops:
    """The PID law for many platforms at once, each with its own gains; one is a batch of one."""

    def __init__(self, model: Model, loop: Loop, gains: Sequence[PIDGains]) -> None:
        geometry, inertia = model.geometry, effective_mass(model)
        count, period = len(gains), loop.sample_time
        self.lead = np.full(count, -loop.measurement_delay)
        self._gains = np.empty((count, 3, 3, 3))
        self._numbers = np.empty((count, 3))
        for row, one in enumerate(gains):
            proportional, integral = matrices(inertia, one)
            step = period * integral
            # With this gain of back-calculation a lasting error takes the integral to the force at
            # the limit and no further.
            back = step @ np.linalg.inv(proportional + step)
            self._gains[row] = proportional, step, back
            self._numbers[row] = (*derivative_filter(one, period), one.derivative_time)
        self._to_wheels = geometry.wheel_torque(np.eye(3)).T.copy()
        self._to_twist = geometry.body_twist(np.eye(4))
        self._limits = np.full(4, loop.torque_limit), np.array(geometry.internal)
        self.reset()

    def reset(self) -> None:
        """Empties integrals and slopes."""
        self.state = np.zeros((len(self.lead), 3, 3))
        # NaN stands for no last error: the first error has no slope.
        self.state[:, 2] = np.nan

    def __call__(self, wheel_speed: Array, reference: Array) -> Array:
        return self.torques(reference - wheel_speed @ self._to_twist)

    def torques(self, error: Array) -> Array:
        """Wheel torques (n, 4) [N m] at twist errors (n, 3); a new array."""
        out = np.empty((len(error), 4))
        _step(error, self.state, self._gains, self._numbers, self._to_wheels, *self._limits, out)
        return out

    def give_back(self, force: Array) -> None:
        """Back-calculation (3,) [N, N, N m]: force that the wheels exert beyond the command."""
        self.state[:, 0] += self._gains[:, 2] @ force


@njit(cache=True, error_model="numpy")
def _step(error, state, gains, numbers, to_wheels, limit, internal, out):
    """Fill ``out`` (n, 4). ``state`` (n, 3, 3): integral [N], filtered slope, last error.

    What the limit takes from the force goes back into the integral by ``gains[:, 2]``. An error
    that is no number counts as none: the integral holds the platform until the next.
    """
    wanted, torque = np.empty(3), np.empty(4)
    for row in range(error.shape[0]):
        integral, slope, last = state[row, 0], state[row, 1], state[row, 2]
        keep, rise, lead = numbers[row]
        known = True
        for axis in range(3):
            known &= abs(error[row, axis]) < np.inf  # False for NaN
        for axis in range(3):
            wanted[axis] = integral[axis]
        if known:
            for axis in range(3):
                change = error[row, axis] - last[axis]
                # After a reset or a gap the last error is NaN, and NaN is not equal to itself: the
                # slope then decays without a new change.
                slope[axis] = keep * slope[axis] + (rise * change if change == change else 0.0)
                last[axis] = error[row, axis]
            for axis in range(3):
                for other in range(3):
                    led = error[row, other] + lead * slope[other]
                    step = gains[row, 1, axis, other] * led
                    integral[axis] += step
                    wanted[axis] += step + gains[row, 0, axis, other] * led
        else:
            last[:] = np.nan
        for wheel in range(4):
            torque[wheel] = 0.0
            for axis in range(3):
                torque[wheel] += to_wheels[wheel, axis] * wanted[axis]
        share = within_limits(torque, limit, internal, out[row])
        for axis in range(3):
            for other in range(3):
                integral[axis] -= gains[row, 2, axis, other] * (1.0 - share) * wanted[other]


class PID:
    """PI (PID with a drive's lag) on the error of the measured body twist.

    The error compares with the reference of the instant that the measurement belongs to. Nothing is
    fed forward: that is computed torque. Forces go to the wheels with least norm; what the limit
    takes away, and torques that are measured but were never commanded (drives off), are calculated
    back into the integral.

    Parameters
    ----------
    model : masses and frictions that the gains are computed from
    loop : times and limit of the loop that it runs in
    gains : None is the fastest poles that keep the margins, :func:`controllers.pid.design.design`

    Attributes
    ----------
    gains : as used
    preview_needed : 0, it reads no coming reference

    Raises
    ------
    InputError
        If no gains keep the margins.
    """

    preview_needed = 0

    def __init__(self, model: Model, loop: Loop, gains: PIDGains | None = None) -> None:
        self.gains = gains or design(model, loop)
        self._law = BodyLoops(model, loop, [self.gains])
        self._exerted = CommandTracker(model, loop)
        self._to_force = model.geometry.wheel_jacobian.T
        self._age = loop.measurement_delay / loop.sample_time
        self._period = loop.sample_time
        # 1e-9: an age of whole samples must not need one sample more by rounding.
        self._past = int(np.ceil(self._age - 1e-9))
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        self._law.reset()
        self._exerted.reset()
        self._nodes = np.zeros((self._past + 2, 6))
        self._seen, self._wanted = np.empty(6), np.empty(6)
        self._is_new = True

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) [N m]; uses body twist and, where it is known, wheel torque."""
        apart = self._exerted.contradiction(observation.wheel_torque)
        if apart is not None:
            self._law.give_back(self._to_force @ apart)
        error = self._reference(reference) - observation.body_twist
        torque = self._law.torques(error[None])[0]
        self._exerted.command(torque)
        return torque

    def _reference(self, reference: Reference) -> Array:
        """The reference twist of the instant that was measured."""
        if not self._past:
            return reference.twist
        self._seen[:3], self._seen[3:] = reference.twist, reference.acceleration
        take_sample(self._nodes, self._past, self._seen, 0, True, self._period)
        if self._is_new:
            extend_to_past(self._nodes, self._past, self._period)
            self._is_new = False
        reference_at(self._nodes, self._past - self._age, self._period, self._wanted)
        return self._wanted[:3]
