"""Adaptive computed torque: goes on identifying its model while it drives."""

from __future__ import annotations

import numpy as np

from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.learner import Learner
from controllers.computed_torque.online_regression import BASE_COUNT, ROW_TIME, OnlineRows
from controllers.computed_torque.prediction import TWIST
from controllers.interface import Array, Loop, Observation, Reference
from identification.mechanisms.mecanum import Mecanum
from youbot_env.errors import finite
from youbot_env.model.model import Model
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.stated_parameters import to_public

MEMORY = 20.0
"""[s] after which a row counts 1/e: what wears or warms is followed, noise is averaged."""

UNCERTAINTY = 0.3
"""Standard deviation of a parameter beforehand, as a share of its own or its catalogue size."""

PUSH = 3.0
"""[N m] standard deviation, beforehand, of a constant force (L F_X, L F_Y, M_W) that is learnt
beside the parameters, so that a slope or a cable does not pass for one. The feedback answers it."""

RANGE = 3.0
"""Largest ratio between a mass, inertia or friction and what it was at the start."""


class AdaptiveComputedTorque(ComputedTorque):
    """:class:`ComputedTorque` whose base parameters follow the platform.

    Each ``ROW_TIME`` the filtered speeds and the torques that acted make a row for recursive least
    squares with guards (:mod:`controllers.computed_torque.learner`). The feedback keeps the gains
    of the first model, with margins that bear a platform twice as heavy. An effect that the model
    lacks and that is neither a parameter's nor a constant force (a tether) makes it worse than the
    fixed one.

    Parameters
    ----------
    model, loop, bandwidth : as for :class:`ComputedTorque`; effects stay as the model has them
    memory : [s] after which a row counts 1/e

    Attributes
    ----------
    estimate : (7,) base parameters in the order of ``theta``, as they are believed now
    learner : the estimator, with what it knows of noise and changes
    """

    def __init__(
        self,
        model: Model,
        loop: Loop | None = None,
        bandwidth: float | None = None,
        memory: float = MEMORY,
    ) -> None:
        self._memory = finite("memory [s]", memory, positive=True)
        self._rows = OnlineRows(model, loop or Loop())
        mechanism = Mecanum(model.geometry, model.structure)
        self._scale = mechanism.scale[:BASE_COUNT]
        self._start = model.theta[:BASE_COUNT].copy()
        sizes = np.array([label.parameter.size for label in mechanism.labels[:BASE_COUNT]])
        # A small start may be wrong by more than its own size, a large one by its share.
        spread = UNCERTAINTY * np.maximum(np.abs(self._start), sizes) * self._scale
        self._spread = np.append(spread, np.full(3, PUSH))
        super().__init__(model, loop, bandwidth)

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
        start = np.append(self._start * self._scale, np.zeros(3))
        self.learner = Learner(start, self._spread, ROW_TIME, self._memory)

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """As :class:`ComputedTorque`; what is learnt counts from the next call on."""
        torque = super().__call__(observation, reference)
        rows, learner = self._rows, self.learner
        if rows.take(self._inputs[TWIST], self._place[:8], self._acted, self.loop.sample_time):
            columns = np.hstack([rows.columns / self._scale, np.eye(3)])
            if learner.learn(columns, rows.measured, rows.demand):
                found = learner.estimate[:BASE_COUNT] / self._scale
                physical = physical_parameters(found, self._start, self.model.geometry)
                learner.estimate[:BASE_COUNT] = physical * self._scale
                self._believe(physical)
        return torque

    def _believe(self, parameters: Array) -> None:
        self._theta[:BASE_COUNT] = parameters
        self._rows.linearise(self._theta)


def physical_parameters(theta: Array, start: Array, geometry: Geometry) -> Array:
    """The closest base parameters (7,) that a platform can have.

    Masses, inertias and frictions stay positive and within ``RANGE`` of their start, the mass above
    that of the wheels. The centre of mass stays under the middle half of the wheel base and the
    track, and where the mass matrix is positive definite.
    """
    found = np.clip(theta, start / RANGE, start * RANGE)
    found[0] = max(found[0], 4.01 * geometry.m1)
    reach = 0.5 * found[0] * np.array([geometry.h, geometry.l])
    reach = np.minimum(reach, 0.5 * np.sqrt(found[0] * found[1]))
    found[2:4] = np.clip(theta[2:4], -reach, reach)
    return found
