"""Force error, velocity error and noise floor of a model on a log: their only definition."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.parts import reduced_by_parts
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, cut
from identification.signals.filters import RowFilter, settled
from identification.signals.noise import white_noise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Traces:
    """Measured and predicted signals (n, A) of one log and the times (n,) [s] they belong to."""

    time: Array
    measured: Array
    predicted: Array

    @property
    def residual(self) -> Array:
        """measured - predicted (n, A)."""
        return self.measured - self.predicted


def force_traces(
    mechanism: Mechanism, theta: Array, samples: Samples, settings: FitSettings = FitSettings()
) -> Traces:
    """Filtered generalised forces (L F_X, L F_Y, M_W) [N m], the filter's start left out."""
    first = settled(settings.filter.rate, samples.dt, settings.filter.settling_time_constants)
    if len(samples) - first < 1:
        none = np.zeros((0, len(mechanism.axes)))
        return Traces(samples.time[first:], none, none)

    def ends_of(part: Samples) -> Array:
        measured = mechanism.measured_force(part)
        # At both ends of each interval: an acceleration from differences jumps at a sample, and so
        # does the force.
        demanded = mechanism.demand(theta, part).force
        return np.stack([np.stack([measured[:-1], measured[1:]]), demanded], axis=-1)

    # Each sample is a row, also where the mechanism rests.
    reduce = RowFilter(
        settings.filter.rate, settings.filter.settling_time_constants, samples.dt, size=1
    )
    moving, whole = replace(samples, moves=None), mechanism.structure.changes_kinematics
    both = reduced_by_parts(ends_of, moving, reduce, settings, whole=whole)
    return Traces(samples.time[first:], both[..., 0], both[..., 1])


def velocity_traces(mechanism: Mechanism, theta: Array, samples: Samples) -> Traces:
    """Speeds (VX/L, VY/L, W) [rad/s] of the free run, driven by the measured torques alone."""
    predicted = mechanism.free_run(theta, samples)
    return Traces(samples.time, mechanism.measured_speed(samples), predicted)


@dataclass(frozen=True)
class SumsOfSquares:
    """Sums of squares (A,) of residual and measured signal; those of several logs can be added."""

    residual: Array
    measured: Array

    @classmethod
    def of(cls, traces: Traces, residual: Array | None = None) -> SumsOfSquares:
        """Of one log; ``residual`` replaces the traces' own (for a noise floor)."""
        if residual is None:
            # Column by column, as below.
            pairs = zip(traces.measured.T, traces.predicted.T, strict=True)
            columns = (a - b for a, b in pairs)
            left = np.array([float(np.square(c, out=c).sum()) for c in columns])
        else:
            left = squares_of(residual)
        return cls(left, squares_of(traces.measured))

    def __add__(self, other: SumsOfSquares) -> SumsOfSquares:
        return SumsOfSquares(self.residual + other.residual, self.measured + other.measured)

    @property
    def ratio(self) -> float:
        """rms(residual) / rms(measured), all axes in one."""
        return float(np.sqrt(self.residual.sum() / self.measured.sum()))

    @property
    def by_axis(self) -> Array:
        """(A,) the same for each axis alone; NaN for an axis that never moved."""
        # 0 / 0 gives NaN on purpose: the error of an axis that never moved is not defined.
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.sqrt(self.residual / self.measured)


def squares_of(signal: Array) -> Array:
    """(A,) sums of the squares of (n, A), column by column: those of an hour take memory."""
    return np.array([float(np.square(column).sum()) for column in signal.T])


def add_up(parts: Iterable[SumsOfSquares]) -> SumsOfSquares:
    """All logs in one."""
    first, *rest = parts
    return sum(rest, start=first)


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations (k,) of the noise on the joints' speeds and torques.

    White, but that of speeds that are differences of angles: see :meth:`Mechanism.noisy`.
    """

    speed: Array
    torque: Array

    @classmethod
    def of(cls, samples: Samples, settings: FitSettings = FitSettings()) -> NoiseLevel:
        """Measured from the high-frequency part of a log's channels."""
        speed, torque = samples.channels
        noise = settings.noise
        white = white_noise(torque, settings=noise)
        if samples.angle_noise is not None:
            # Over two samples: (e[k + 1] - e[k - 1]) / (2 dt).
            return cls(np.array(samples.angle_noise) / (np.sqrt(2.0) * samples.dt), white)
        return cls(white_noise(speed, settings=noise), white)


def white_force_floor(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    clean: Traces,
    noise: NoiseLevel,
    seed: int,
    settings: FitSettings = FitSettings(),
) -> SumsOfSquares:
    """What white measurement noise leaves in the force residual, whose ``clean`` traces are known.

    Noise of the same size is added to the measurements a second time; the change of the residual
    is the floor. This holds for every effect, since the noise passes through the model itself.
    """
    part, known = samples, clean
    if len(samples) > settings.max_floor_samples:
        part = cut(samples, 0, settings.max_floor_samples)
        known = force_traces(mechanism, theta, part, settings)
    rng = np.random.default_rng(seed)
    noisy = mechanism.noisy(part, noise.speed, noise.torque, rng)
    again = force_traces(mechanism, theta, noisy, settings)
    # Sums of squares grow with the number of samples: scale from the part to the whole log.
    share = len(clean.time) / len(known.time)
    left = SumsOfSquares.of(known, again.residual - known.residual).residual * share
    return SumsOfSquares(left, SumsOfSquares.of(clean).measured)
