"""A mechanism of one axis as the identification engine sees it: the same methods as `Mecanum`.

Units are those of the log: m, m/s, N of an axis that slides, rad, rad/s, N m of one that turns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import AXIS, Log
from identification.mechanisms import axis_dynamics as dynamics
from identification.mechanisms.axis_dynamics import SYSTEM, AxisStructure, Instant
from identification.mechanisms.axis_effects import AXIS_CATALOGUE, TURNING, Scales, fitted_to
from identification.mechanisms.axis_samples import AxisSamples, axis_samples
from identification.mechanisms.calibration_parts import Part
from identification.mechanisms.mechanism import Mechanism, ParameterLabel
from identification.signals.filters import slope_ends
from identification.signals.resampling import RATE_SMOOTHING, moved, smoothed
from youbot_env.errors import InputError
from youbot_env.physics.effect import Actuator, Registry

Array = NDArray[np.float64]

MAX_SUBSTEPS = 5000
STEP = 0.25
"""Share of the stiffest mode's time constant that the stepper takes at once."""


@dataclass(frozen=True)
class Axis(Mechanism):
    """One axis with given effects: what it measures, demands and simulates.

    Forces are (N, 1) as the effort's unit, speeds (N, 1).
    """

    scales: Scales
    structure: AxisStructure = AxisStructure()

    axes = ("axis",)
    joints = AXIS
    scaling = "by what is typical for the axis"

    @property
    def filter_rate(self) -> float:
        """Rate [rad/s] of the filter through which forces are fitted."""
        return self.scales.bandwidth

    @cached_property
    def catalogue(self) -> Registry:
        """The effects that this axis can have, with its units and sizes."""
        found = Registry()
        for item in AXIS_CATALOGUE:
            if self.scales.turns or item.acts_at is not TURNING:
                found.add(fitted_to(item, self.scales))
        return found

    def with_effects(self, effects: tuple[str, ...]) -> Axis:
        """The same axis with other effects beside the base model."""
        return replace(self, structure=AxisStructure(effects))

    @property
    def default_theta(self) -> Array:
        """(P,) typical inertia, no friction, no effect; shape constants at their defaults."""
        values = [label.parameter.default or 0.0 for label in self.labels]
        values[0] = self.labels[0].parameter.size
        return np.array(values)

    @cached_property
    def labels(self) -> tuple[ParameterLabel, ...]:
        """What is known of each parameter beforehand, in the order of theta."""
        components = [fitted_to(item, self.scales) for item in self.structure.components]
        return tuple(
            ParameterLabel(item.name, name, item.parameter(name), None)
            for item in components
            for name in item.parameter_names
        )

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) and (P,): physical bounds."""
        declared = [label.parameter for label in self.labels]
        return np.array([p.lower for p in declared]), np.array([p.upper for p in declared])

    @property
    def is_linear(self) -> bool:
        """Whether the demanded force is linear in the free parameters."""
        return self.structure.is_linear

    @cached_property
    def scale(self) -> Array:
        """(P,) factors from theta to numbers of the size one, where an effect matters."""
        return np.array([1.0 / label.parameter.size for label in self.labels])

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """Indices of the free parameters in the order of x1, x2, ..."""
        return np.flatnonzero(self.free)

    def parts(self, samples: AxisSamples) -> list[Part]:
        """Stretches that are judged apart: an axis has one motion."""
        return [Part("run", samples)]

    def advice(self, direction: Array) -> str:
        """What to record where the parameters' ``direction`` (F,) cannot be seen."""
        return (
            "record a motion both ways with several speeds and accelerations "
            "(trapezoids of different height, a multisine) and give it too"
        )

    def samples(self, log: Log) -> AxisSamples:
        """See :func:`axis_samples`."""
        return axis_samples(log)

    def measured_force(self, samples: AxisSamples) -> Array:
        """(N, 1) logged effort."""
        return samples.effort[:, None]

    def measured_speed(self, samples: AxisSamples) -> Array:
        """(N, 1) logged speed."""
        return samples.velocity[:, None]

    def joint_speed(self, speed: Array) -> Array:
        """(N, 1) speeds of the log's joint for ``measured_speed`` (N, 1)."""
        return speed

    def noisy(
        self, samples: AxisSamples, speed: Array, effort: Array, rng: np.random.Generator
    ) -> AxisSamples:
        """The samples with white noise of these standard deviations (1,) put on."""
        shape = samples.effort.shape
        return replace(
            samples,
            velocity=samples.velocity + speed[0] * rng.standard_normal(shape),
            effort=samples.effort + effort[0] * rng.standard_normal(shape),
        )

    def demand(
        self, theta: Array, samples: AxisSamples, like: AxisDemand | None = None
    ) -> AxisDemand:
        """Force that the logged motion demands at parameters theta (P,)."""
        return AxisDemand(self, np.asarray(theta, float), samples, like)

    def free_run(self, theta: Array, samples: AxisSamples) -> Array:
        """(N, 1) speed from the log's first sample, driven by its efforts alone.

        A run that diverges holds inf or NaN from there on.

        Raises
        ------
        InputError
            If a friction's smoothing or a drive's time constant is next to zero.
        """
        from youbot_env.simulation.compiled import rollout  # numba, which a force fit does without

        theta = np.ascontiguousarray(theta, float)
        effort = self._true_effort(theta, samples)
        start = [samples.velocity[0], samples.position[0], samples.time[0]]
        if self.structure.has_actuator:
            start.append(effort[0])
        out = np.empty((len(samples), len(start)))
        rollout(self.structure, SYSTEM)(
            np.array(start),
            np.ascontiguousarray(effort[:, None]),
            np.full(len(samples) - 1, samples.dt),
            np.empty(0),
            theta,
            self.substeps(theta, samples),
            out,
        )
        return out[:, :1]

    def _true_effort(self, theta: Array, samples: AxisSamples) -> Array:
        """(N,) effort (behind a drive: its command) that acts at the samples."""
        late = dynamics.delay(self.structure, theta)
        return np.interp(samples.time, samples.time + late, samples.effort)

    def substeps(self, theta: Array, samples: AxisSamples) -> int:
        """Runge-Kutta steps in a sample: the stiffest mode moves by ``STEP`` in each."""
        fast = self.scales.speed
        shift = 1e-2 * float(theta[self.parameter_names.index("smoothing")])
        at, top = np.array([-shift, shift, fast, 2 * fast]), self.scales.force
        rates = []
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for force in (-top, 0.0, top):
                rate = dynamics.acceleration(
                    np, self.structure, theta, Instant(at, force=force + 0 * at)
                )
                rates += [(rate[1] - rate[0]) / (2 * shift), (rate[3] - rate[2]) / fast]
            if self.structure.has_actuator:
                slow, quick = (
                    dynamics.drive_command(np, self.structure, theta, Actuator(0.0, r, 0.0))
                    for r in (0.0, 1.0)
                )
                rates.append(1.0 / (quick - slow))
            count = samples.dt * max(float(np.abs(rates).max()), 10.0) / STEP
        if not 0 <= count <= MAX_SUBSTEPS:
            raise InputError(
                f"too stiff to simulate in steps of {samples.dt:g} s "
                "(a friction's smoothing or a drive's time constant is next to zero)"
            )
        return max(int(np.ceil(count)), 1)


def _ends(signal: Array) -> Array:
    """(2, N - 1): a signal at the start and at the end of each interval."""
    return np.stack([signal[:-1], signal[1:]])


class AxisDemand:
    """Force (2, N - 1, 1) demanded at both ends of each interval, and its columns in theta.

    The acceleration's mean over an interval is the difference of the speed.
    """

    def __init__(
        self,
        mechanism: Axis,
        theta: Array,
        samples: AxisSamples,
        like: AxisDemand | None = None,
    ) -> None:
        self.mechanism, self.theta, self.samples = mechanism, theta, samples
        self.instant = like.instant if like else self._instant()

    def _instant(self) -> Instant:
        samples = self.samples
        return Instant(
            rate=_ends(samples.velocity),
            acceleration=slope_ends(samples.velocity, samples.dt),
            position=_ends(samples.position),
            time=_ends(samples.time),
        )

    @cached_property
    def force(self) -> Array:
        """(2, N - 1, 1) in units of the logged effort."""
        return self._at(self.theta)[..., None]

    def _at(self, theta: Array) -> Array:
        structure = self.mechanism.structure
        force = dynamics.acting_force(np, structure, theta, self.instant)
        if structure.has_actuator:
            drive = Actuator(force, self._rate(force), self.instant.time)
            force = dynamics.drive_command(np, structure, theta, drive)
        # What acts at t + delay was logged at t. The measured side stays as it is: to shift it
        # would change its noise.
        return moved(force, dynamics.delay(structure, theta) / self.samples.dt)

    def _rate(self, force: Array) -> Array:
        dt = self.samples.dt
        rate = np.diff(smoothed(_nodes(force), RATE_SMOOTHING / dt)) / dt
        return np.stack([rate, rate])

    def columns(self, indices: Iterable[int]) -> Array:
        """d force / d theta[i] for each index: (len(indices), 2, N - 1, 1).

        Central differences over a small part of each parameter's size: exact, up to rounding, for
        what enters linearly.
        """
        return np.stack([self._column(int(i)) for i in indices])[..., None]

    def _column(self, index: int) -> Array:
        step = self.mechanism.labels[index].parameter.difference
        # Not beyond the bounds: a period at its least would be tried at zero.
        room = self.theta[index] - self.mechanism.bounds[0][index]
        back = float(np.clip(room, 0.0, step))
        ahead, behind = self.theta.copy(), self.theta.copy()
        ahead[index] += step
        behind[index] -= back
        return (self._at(ahead) - self._at(behind)) / (step + back)


def _nodes(force: Array) -> Array:
    """(N,) force at the samples from (2, N - 1): the mean of the two ends that meet there."""
    return np.concatenate([force[0, :1], 0.5 * (force[1, :-1] + force[0, 1:]), force[1, -1:]])
