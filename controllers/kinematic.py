"""The stock control of the platform: inverse kinematics and a speed loop at each wheel."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from controllers.interface import Array, Observation, Reference
from youbot_env.errors import InputError, finite
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.hardware import STOCK_INTEGRAL, STOCK_PROPORTIONAL


@dataclass(frozen=True)
class Gains:
    """PI gains of a wheel's speed loop. The defaults behave like the stock ones.

    Attributes
    ----------
    proportional : [N m s/rad]
    integral : [N m/rad]
    lead : [s] by which the reference twist is read ahead; the stock control takes it as it comes

    Raises
    ------
    InputError
        If a gain is negative or not finite.
    """

    proportional: float = STOCK_PROPORTIONAL
    integral: float = STOCK_INTEGRAL
    lead: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            finite(f"gain {field.name}", getattr(self, field.name), least=0.0)


class KinematicControl:
    """Wheel-speed PI towards the no-slip wheel speeds of the reference twist.

    It knows no mass, so above some 0.5 rad/s the platform lags its reference. The torque is limited
    at each wheel, and a wheel's integral is held while it would drive the torque further into its
    limit (conditional integration).

    Parameters
    ----------
    geometry : lengths of the platform
    gains : of each wheel's loop
    torque_limit : [N m] at each wheel; None for the geometry's
    sample_time : [s] between calls

    Attributes
    ----------
    preview_needed : coming reference samples that it reads; 0 without a lead
    held : (4,) which wheels' last speed was no number, so that their torque is the one before;
        ``env.unwrapped.to_action(torque, controller.held)`` puts it into the environment's ``info``

    Raises
    ------
    InputError
        If the limit or the sample time is not positive and finite.
    """

    def __init__(
        self,
        geometry: Geometry | None = None,
        gains: Gains | None = None,
        torque_limit: float | None = None,
        sample_time: float = 0.002,
    ) -> None:
        self.geometry = geometry or Geometry()
        self.gains = gains or Gains()
        most = self.geometry.max_wheel_torque if torque_limit is None else torque_limit
        self.torque_limit = finite("torque limit [N m]", most, positive=True)
        self.sample_time = finite("sample time [s]", sample_time, positive=True)
        self._integral_step = self.gains.integral * self.sample_time
        self._to_wheels = self.geometry.wheel_jacobian
        ahead = self.gains.lead / self.sample_time
        # 1e-9: a lead of whole samples must not need one sample more by rounding.
        self.preview_needed = math.ceil(ahead - 1e-9)
        self._share = 1.0 + ahead - self.preview_needed  # between the last two samples needed
        self.reset()

    def reset(self) -> None:
        """Empties the integrals."""
        self._integral = [0.0, 0.0, 0.0, 0.0]
        self._torque = [0.0, 0.0, 0.0, 0.0]
        self.held = (False, False, False, False)

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) [N m]; uses the wheel speeds and the reference twist alone.

        Where a wheel's speed is NaN or infinite its torque and integral stay as they were, and
        ``held`` says so: one lost measurement must not reach the drives.

        Raises
        ------
        InputError
            If there is a lead and the reference shows too few of its coming samples.
        """
        twist = self._ahead(reference) if self.preview_needed else reference.twist
        errors = (self._to_wheels @ twist - observation.wheel_speed).tolist()
        # Python floats: numpy takes three times as long for four numbers.
        self.held = tuple(not math.isfinite(error) for error in errors)
        for wheel, error in enumerate(errors):
            if not self.held[wheel]:
                self._torque[wheel] = self._loop(wheel, error)
        return np.array(self._torque)

    def _ahead(self, reference: Reference) -> Array:
        """The twist a lead from now, linear between samples."""
        count, preview = self.preview_needed, reference.preview
        if preview is None or len(preview) < count:
            raise InputError(
                f"kinematic control with a lead of {self.gains.lead:g} s needs {count} coming "
                "reference samples: give it a preview, or gains without lead"
            )
        # preview[0] is one sample ahead, so the sample before it is the present twist.
        before = preview[count - 2] if count > 1 else reference.twist
        return before + self._share * (preview[count - 1] - before)

    def _loop(self, wheel: int, error: float) -> float:
        step = self._integral_step * error
        wanted = self.gains.proportional * error + self._integral[wheel] + step
        torque = min(max(wanted, -self.torque_limit), self.torque_limit)
        # Conditional integration: not while the limit holds and the error would push further.
        if (wanted - torque) * error <= 0.0:
            self._integral[wheel] += step
        return torque
