"""Adaptive computed torque: it identifies its model's base parameters while it drives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.feedback_design import FeedbackSettings
from controllers.computed_torque.online_estimator import EstimatorSettings, OnlineEstimator
from controllers.computed_torque.online_regression import BASE_COUNT, OnlineRows, RowSettings
from controllers.computed_torque.prediction import TWIST
from controllers.interface import Array, Loop, Observation, Reference
from identification.mechanisms.mecanum import Mecanum
from youbot_env.errors import check_settings, finite
from youbot_env.model.model import Model
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.stated_parameters import to_public


@dataclass(frozen=True)
class AdaptiveSettings:
    """What is believed beforehand, how long it is remembered, and what a platform can be."""

    memory_time: float = field(
        default=20.0,
        metadata={
            "unit": "s",
            "reason": "a row counts 1/e after it: what wears or warms is followed, noise is "
            "averaged",
        },
    )
    parameter_deviation_share: float = field(
        default=0.3,
        metadata={
            "unit": "of a parameter's value or catalogue size",
            "reason": "standard deviation beforehand: a load or a worn wheel, not another robot",
        },
    )
    constant_force_deviation: float = field(
        default=3.0,
        metadata={
            "unit": "N m",
            "reason": "of a constant force (L F_X, L F_Y, M_W) that is learnt beside the "
            "parameters, so that a slope or a cable does not pass for one; the feedback "
            "answers it",
        },
    )
    max_parameter_ratio: float = field(
        default=3.0,
        metadata={
            "unit": "1",
            "reason": "largest ratio between a mass, inertia or friction and what it was at the "
            "start",
        },
    )
    min_mass_ratio: float = field(
        default=4.01,
        metadata={
            "unit": "of a wheel's mass",
            "reason": "the mass stays above that of the four wheels",
        },
    )
    max_centre_share: float = field(
        default=0.5,
        metadata={
            "unit": "of the half wheel base and the half track",
            "reason": "the centre of mass stays under their middle half",
        },
    )
    rows: RowSettings = field(default_factory=RowSettings)
    estimator: EstimatorSettings = field(default_factory=EstimatorSettings)
    feedback: FeedbackSettings = field(default_factory=FeedbackSettings)

    def __post_init__(self) -> None:
        check_settings(self)


class AdaptiveComputedTorque(ComputedTorque):
    """:class:`ComputedTorque` whose base parameters follow the platform.

    Each ``settings.rows.row_time`` the filtered speeds and the torques that acted make a row for
    recursive least squares with guards (:mod:`controllers.computed_torque.online_estimator`). The
    feedback keeps the gains of the first model, with margins that bear a platform twice as heavy.
    It is worse than the fixed controller where the model lacks an effect that is neither a change
    of its parameters nor a constant force (a tether, for example).

    Parameters
    ----------
    model, loop, bandwidth : as for :class:`ComputedTorque`; effects stay as the model has them
    memory : [s] after which a row counts 1/e; None is ``settings.memory_time``
    settings : of what is believed beforehand, of the rows, their estimator and the feedback

    Attributes
    ----------
    estimate : (7,) base parameters in the order of ``theta``, as they are believed now
    estimator : the recursion, with what it knows of noise and changes
    """

    def __init__(
        self,
        model: Model,
        loop: Loop | None = None,
        bandwidth: float | None = None,
        memory: float | None = None,
        settings: AdaptiveSettings = AdaptiveSettings(),
    ) -> None:
        self._settings = settings
        remembered = settings.memory_time if memory is None else memory
        self._memory = finite("memory [s]", remembered, positive=True)
        self._rows = OnlineRows(
            model, loop or Loop(torque_limit=model.geometry.max_wheel_torque), settings.rows
        )
        mechanism = Mecanum(model.geometry, model.structure)
        self._scale = mechanism.scale[:BASE_COUNT]
        self._start = model.theta[:BASE_COUNT].copy()
        sizes = np.array([label.parameter.size for label in mechanism.labels[:BASE_COUNT]])
        # The error of a large value is a share of it; a value near 0 may be wrong by a share of the
        # usual size.
        spread = (
            settings.parameter_deviation_share
            * np.maximum(np.abs(self._start), sizes)
            * self._scale
        )
        self._spread = np.append(spread, np.full(3, settings.constant_force_deviation))
        # Last, because it calls ``reset``, which needs all of the above.
        super().__init__(model, loop, bandwidth, settings.feedback)

    @property
    def estimate(self) -> Array:
        """(7,) m0, I0, m_aX, m_aY, I1, mu1, mu2 [SI units]."""
        return self._theta[:BASE_COUNT].copy()

    @property
    def believed(self) -> Model:
        """The model with the parameters as they are believed now."""
        return self.model.with_values(
            to_public(self.model.structure, self.model.geometry, self._theta)
        )

    def reset(self) -> None:
        """Forgets what was learnt, too."""
        super().reset()
        self._rows.reset()
        self._believe(self._start)
        # Three constant forces beside the parameters, none to begin with.
        start = np.append(self._start * self._scale, np.zeros(3))
        how = self._settings
        self.estimator = OnlineEstimator(
            start, self._spread, how.rows.row_time, self._memory, how.estimator
        )

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """As :class:`ComputedTorque`; new parameters are used from the next call on."""
        torque = super().__call__(observation, reference)
        rows, estimator = self._rows, self.estimator
        acted = self._drives["mean_torque"][0]
        if rows.take(self._inputs[TWIST], self._place[:8], acted, self.loop.sample_time):
            columns = np.hstack([rows.columns / self._scale, np.eye(3)])
            if estimator.learn(columns, rows.measured, rows.demand):
                found = estimator.estimate[:BASE_COUNT] / self._scale
                physical = physical_parameters(
                    found, self._start, self.model.geometry, self._settings
                )
                # Written back: a recursion that continues from impossible values drifts away.
                estimator.estimate[:BASE_COUNT] = physical * self._scale
                self._believe(physical)
        return torque

    def _believe(self, parameters: Array) -> None:
        self._theta[:BASE_COUNT] = parameters
        self._rows.linearise(self._theta)


def physical_parameters(
    theta: Array,
    start: Array,
    geometry: Geometry,
    settings: AdaptiveSettings = AdaptiveSettings(),
) -> Array:
    """The closest base parameters (7,) that a platform can have.

    Masses, inertias and frictions stay positive and within
    ``settings.max_parameter_ratio`` of their start, the mass above
    that of the wheels. The centre of mass stays under the middle half of the wheel base and the
    track, and where the mass matrix is positive definite.
    """
    found = np.clip(
        theta, start / settings.max_parameter_ratio, start * settings.max_parameter_ratio
    )
    found[0] = max(found[0], settings.min_mass_ratio * geometry.m1)
    reach = settings.max_centre_share * found[0] * np.array([geometry.h, geometry.l])
    # The mass matrix is positive definite where (m aX)^2 + (m aY)^2 < m0 I0; half the root for
    # each component leaves at most half of that.
    reach = np.minimum(reach, 0.5 * np.sqrt(found[0] * found[1]))
    found[2:4] = np.clip(theta[2:4], -reach, reach)
    return found
