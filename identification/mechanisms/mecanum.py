"""The mecanum platform as the identification engine sees it.

The engine knows a mechanism by a handful of methods: samples of a log, measured and demanded
generalised forces, columns of the regressor, a free run. Forces are (L F_X, L F_Y, M_W) [N m] and
speeds (VX/L, VY/L, W) [rad/s] as in the paper, so that all axes weigh alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.calibration_parts import Part, parts_of
from identification.mechanisms.mecanum_force import MecanumForce
from identification.mechanisms.mecanum_motions import expected_samples, library
from identification.mechanisms.mecanum_samples import MecanumSamples, integral_of, samples_of
from identification.mechanisms.mechanism import Experiment, Mechanism, ParameterLabel, labels_of
from identification.mechanisms.paper_regressor import (
    PAPER_ORDER,
    force_scale,
    motion_that_shows,
    paper_scale,
)
from identification.signals.filters import FilterSettings
from youbot_env.motions.base import Motion
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CATALOGUE, Parameter
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_env.physics.structure import ModelStructure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mecanum(Mechanism):
    """A mecanum platform with given effects: what it measures, demands and simulates."""

    geometry: Geometry
    structure: ModelStructure = ModelStructure()

    axes = ("VX", "VY", "W")
    joints = WHEELS
    filter_rate = FilterSettings.rate
    scaling = "as in the paper"
    catalogue = CATALOGUE

    def with_effects(self, effects: tuple[str, ...]) -> Mecanum:
        """The same mechanism with other effects beside the base model."""
        return replace(self, structure=ModelStructure(effects))

    @cached_property
    def force_scale(self) -> Array:
        """(3,) factors that turn (F_X, F_Y, M_W) into (L F_X, L F_Y, M_W)."""
        return force_scale(self.geometry)

    @cached_property
    def speed_scale(self) -> Array:
        """(3,) factors that turn (VX, VY, W) into (VX/L, VY/L, W)."""
        return 1.0 / self.force_scale

    @cached_property
    def labels(self) -> tuple[ParameterLabel, ...]:
        """What is known of each parameter beforehand, in the order of theta."""
        return labels_of(self.structure)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) and (P,): physical bounds; none on values relative to each other."""
        free = Parameter("", "")
        declared = [free if label.group else label.parameter for label in self.labels]
        return np.array([p.lower for p in declared]), np.array([p.upper for p in declared])

    @property
    def is_linear(self) -> bool:
        """Whether the demanded force is linear in the free parameters."""
        return self.structure.is_linear and not self.structure.nonlinear

    @cached_property
    def scale(self) -> Array:
        """(P,) factors from theta to the paper's x = (m0 L^2, I0, 4 I1 L^2/R^2, ...) [N m].

        Effects' parameters are scaled by their catalogue size.
        """
        paper = paper_scale(self.geometry)
        return np.array(
            [paper.get(label.name, 1.0 / label.parameter.size) for label in self.labels]
        )

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """Indices of the free parameters in the order of the paper's x1 ... x7, effects after."""
        rest = np.flatnonzero(self.free)[len(PAPER_ORDER) :]
        return np.array([*PAPER_ORDER, *rest], dtype=np.intp)

    def samples(self, log: Log) -> MecanumSamples:
        """See :func:`samples_of`."""
        return samples_of(log, self.geometry)

    def measured_force(self, samples: MecanumSamples) -> Array:
        """(N, 3) generalised force of the logged torques [N m]."""
        return self.geometry.body_force(samples.torque) * self.force_scale

    def measured_speed(self, samples: MecanumSamples) -> Array:
        """(N, 3) measured speeds (VX/L, VY/L, W) [rad/s]."""
        return samples.twist * self.speed_scale

    def joint_speed(self, speed: Array) -> Array:
        """(N, 4) wheel speeds [rad/s] for speeds (VX/L, VY/L, W) (N, 3)."""
        return self.geometry.wheel_speeds(speed / self.speed_scale)

    def noisy(
        self, samples: MecanumSamples, speed: Array, torque: Array, rng: np.random.Generator
    ) -> MecanumSamples:
        """The samples with white noise of these standard deviations (4,) put on."""
        shape = samples.torque.shape
        extra = speed * rng.standard_normal(shape)
        # Angles that are integrated from the speeds drift with their noise; a ripple sees it.
        drift = 0.0 if samples.angle_measured else integral_of(extra, samples.dt)
        return replace(
            samples,
            wheel_angle=samples.wheel_angle + drift,
            twist=samples.twist + self.geometry.body_twist(extra),
            wheel_speed=samples.wheel_speed + extra,
            torque=samples.torque + torque * rng.standard_normal(shape),
        )

    def parts(self, samples: MecanumSamples) -> list[Part]:
        """Stretches that are judged apart: the calibration motions in the log."""
        return parts_of(samples)

    def advice(self, direction: Array) -> str:
        """What to record where the parameters' ``direction`` (F,) in x cannot be seen."""
        return (
            f"record motion {motion_that_shows(self.geometry, direction)} too "
            f"(youbot record --motions, or drive it) and give both logs"
        )

    def motions(self, seed: int) -> list[Experiment]:
        """Calibration motions, multisines and steps within the platform's limits."""

        def expected(motion: Motion, theta: Array) -> MecanumSamples:
            values = dict(zip(self.parameter_names, theta, strict=True))
            return expected_samples(motion, self.geometry, values)

        return [
            Experiment(motion.name, motion.to_dict(), partial(expected, motion))
            for motion in library(self.geometry, seed)
        ]

    def free_run(self, theta: Array, samples: MecanumSamples) -> Array:
        """(N, 3) speeds (VX/L, VY/L, W) from the log's first sample, driven by its torques alone.

        A run that diverges holds inf or NaN from there on.
        """
        from youbot_env.simulation.free_run import (
            simulate_theta,
        )  # numba, which a force fit does without

        start = [*samples.twist[0], *samples.pose[0], *samples.wheel_angle[0], samples.time[0]]
        if self.structure.has_actuator:
            start += list(
                dynamics.channel_torque(np, self.structure, theta, samples.torque[0], 0.0)
            )
        duration = np.full(len(samples) - 1, samples.dt)
        states = simulate_theta(
            self.structure, self.geometry, theta, duration, samples.torque, start
        )
        return states[:, :3] * self.speed_scale

    def demand(
        self, theta: Array, samples: MecanumSamples, like: MecanumForce | None = None
    ) -> MecanumForce:
        """Generalised force that the logged motion demands at parameters theta (P,)."""
        return MecanumForce(self.structure, self.geometry, np.asarray(theta, float), samples, like)
