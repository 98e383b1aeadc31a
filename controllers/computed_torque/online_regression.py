"""Rows of the regression y = H x, built while driving: one sample at a time, filtered.

The columns are those of the model's inverse dynamics. The filter is that of the identification,
a_f/(p + a_f), for signals that are linear between samples: then a filtered acceleration is
a_f (s - s_f), and no signal is differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controllers.interface import Array, Loop
from identification.mechanisms.mecanum import Mecanum
from identification.signals.filters import FilterSettings, hold_weights
from youbot_env.caching import njit
from youbot_env.errors import check_settings
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import BASE
from youbot_env.simulation.compiled import inverse_kernel
from youbot_env.simulation.generated_code import MOTION

BASE_COUNT = sum(len(item.parameter_names) for item in BASE)
"""Base parameters, which lead theta: those that are identified while driving."""


@dataclass(frozen=True)
class RowSettings:
    """How filtered samples become rows of the regression."""

    row_time: float = field(
        default=0.05,
        metadata={
            "unit": "s",
            "reason": "filtered samples are averaged into a row: half the filter's time constant",
        },
    )
    column_step_share: float = field(
        default=1e-3,
        metadata={
            "unit": "of a parameter's size",
            "reason": "it is moved by so much for its column; columns are linear, so no step is "
            "too large",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


class OnlineRows:
    """Turns speeds and acting torques into rows of the regression.

    Effects beside the base model are taken as the model has them and moved to the measured side.

    Parameters
    ----------
    model : structure and geometry; its parameters are the point at which columns are taken
    loop : sample time, age of the measured speeds
    settings : length of a row, and the step of a column

    Attributes
    ----------
    columns : (3, 7) of the last row, for (L F_X, L F_Y, M_W) [N m], per base parameter in SI units
    measured : (3,) [N m] of the last row, less what the effects beside the base model demand
    demand : (3,) [N m] the last row's force as measured, nothing taken off
    """

    def __init__(self, model: Model, loop: Loop, settings: RowSettings = RowSettings()) -> None:
        self._kernel, self._lengths = inverse_kernel(model.structure, dynamics), model.lengths
        mechanism = Mecanum(model.geometry, model.structure)
        self._jacobian = np.ascontiguousarray(model.geometry.wheel_jacobian)
        self._force_scale = mechanism.force_scale
        sizes = [abs(label.parameter.size) for label in mechanism.labels[:BASE_COUNT]]
        self._steps = settings.column_step_share * np.array(sizes)
        self._weights = np.array(hold_weights(FilterSettings.rate, loop.sample_time))
        # Speeds are older than torques by this much; both sides of a row must be of one instant.
        self._age = loop.measurement_delay / loop.sample_time
        self._settled = int(
            np.ceil(FilterSettings.settling_time_constants / FilterSettings.rate / loop.sample_time)
        )
        self._in_row = max(1, round(settings.row_time / loop.sample_time))
        self.linearise(model.theta)
        self.reset()

    def linearise(self, theta: Array) -> None:
        """Take columns at other parameters ``theta`` (P,) from now on."""
        self._thetas = np.tile(theta, (1 + BASE_COUNT, 1))
        self._thetas[1:, :BASE_COUNT] += np.diag(self._steps)

    def reset(self) -> None:
        """Forgets all signals."""
        self._motion = np.zeros((2, len(MOTION)))
        self._torque = np.zeros((1 + BASE_COUNT, 2, 4))
        # Columns, what else is demanded, and the measured force now and at the last samples.
        self._filtered = np.zeros((BASE_COUNT + 3 + int(self._age), 3))
        self._sums = np.zeros((BASE_COUNT + 2, 3))
        self._count = self._gathered = 0
        self.columns, self.measured = np.zeros((3, BASE_COUNT)), np.zeros(3)
        self.demand = np.zeros(3)

    def take(self, twist: Array, place: Array, acted: Array, period: float) -> bool:
        """One sample; returns whether a row has become ready.

        Parameters
        ----------
        twist : (3,) as measured now; NaN starts the filters anew
        place : (8,) time, pose and wheel angles now
        acted : (4,) [N m] torques of the wheels, means over the last sample
        """
        if not np.isfinite(twist).all():
            # A recursive filter would keep the NaN for ever.
            self._count = 0
            return False
        move_on(self._motion, twist, place, period)
        self._count += 1
        if self._count == 1:
            return False
        if self._count == 2:
            self._filtered[:], self._sums[:], self._gathered = 0.0, 0.0, 0
        self._kernel.several(self._motion, self._lengths, self._thetas, 1e-9, self._torque)
        filter_rows(
            self._torque,
            self._thetas[0],
            self._steps,
            acted,
            (self._jacobian, self._force_scale),
            self._weights,
            self._age,
            self._filtered,
            self._sums,
        )
        if self._count < self._settled:
            # The filters start from zero and need this time to forget it.
            self._sums[:] = 0.0
            return False
        self._gathered += 1
        if self._gathered < self._in_row:
            return False
        mean = self._sums / self._gathered
        self.columns = mean[:BASE_COUNT].T
        self.demand = mean[BASE_COUNT + 1]
        self.measured = self.demand - mean[BASE_COUNT]
        self._sums[:], self._gathered = 0.0, 0
        return True


@njit(cache=True, error_model="numpy")
def move_on(motion, twist, place, period):
    """The last interval's end (row 1) becomes the next one's start (row 0)."""
    motion[0] = motion[1]
    motion[1, :3] = twist
    motion[1, 6:13] = place[1:8]
    motion[1, 13] = place[0]
    for axis in range(3):
        slope = (motion[1, axis] - motion[0, axis]) / period
        motion[0, 3 + axis] = slope
        motion[1, 3 + axis] = slope


@njit(cache=True, error_model="numpy")
def filter_rows(torque, theta, steps, acted, maps, weights, age, filtered, sums):
    """Filter columns, remainder and measured force of one interval, and add them to ``sums``.

    ``torque`` (1 + c, 2, 4): acting torques at both ends, at theta and with one base parameter
    moved by its step. The speeds are ``age`` samples old, so the force is taken of that instant.
    """
    jacobian, scale = maps
    decay, at_start, at_end = weights
    count = steps.size
    whole = int(age)
    for row in range(filtered.shape[0] - 1, count + 1, -1):
        filtered[row] = filtered[row - 1]
    for axis in range(3):
        force, rest_start, rest_end = 0.0, 0.0, 0.0
        for wheel in range(4):
            unit = scale[axis] * jacobian[wheel, axis]
            force += unit * acted[wheel]
            rest_start += unit * torque[0, 0, wheel]
            rest_end += unit * torque[0, 1, wheel]
        for i in range(count):
            start, end = 0.0, 0.0
            for wheel in range(4):
                unit = scale[axis] * jacobian[wheel, axis] / steps[i]
                start += unit * (torque[1 + i, 0, wheel] - torque[0, 0, wheel])
                end += unit * (torque[1 + i, 1, wheel] - torque[0, 1, wheel])
            # The remainder is the demand without the part of the base parameters.
            rest_start -= theta[i] * start
            rest_end -= theta[i] * end
            filtered[i, axis] = decay * filtered[i, axis] + at_start * start + at_end * end
            sums[i, axis] += filtered[i, axis]
        rest = decay * filtered[count, axis] + at_start * rest_start + at_end * rest_end
        filtered[count, axis] = rest
        # The torque is held between samples, so its filter is that of a held signal.
        filtered[count + 1, axis] = decay * filtered[count + 2, axis] + (1.0 - decay) * force
        part = age - whole
        aligned = (1.0 - part) * filtered[count + 1 + whole, axis]
        aligned += part * filtered[count + 2 + whole, axis]
        sums[count, axis] += rest
        sums[count + 1, axis] += aligned
