"""Random-phase multisines: velocity references with chosen tones and a low crest factor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from youbot_env.errors import InputError, count, finite
from youbot_env.motions.base import Array, Motion, check_length, window
from youbot_env.motions.limits import MotionLimits
from youbot_env.physics.geometry import Geometry

SAMPLES_PER_PERIOD = 16
"""Grid points per period of the highest frequency of the band, when a peak is searched."""

PEAK_BOUND = 1.0 / float(np.cos(np.pi / SAMPLES_PER_PERIOD))
"""A trigonometric polynomial exceeds its largest sample on that grid by this factor at most
(Ehlich and Zeller 1964), so limits hold between the samples too."""


class Tone(NamedTuple):
    """amplitude * sin(frequency * t + phase) on one axis.

    ``axis`` is 0 (VX), 1 (VY) or 2 (W); frequency [rad/s], amplitude [m/s or rad/s], phase [rad].
    """

    axis: int
    frequency: float
    amplitude: float
    phase: float


@dataclass(frozen=True, kw_only=True)
class Multisine(Motion):
    """A sum of tones on each axis under one window.

    Raises
    ------
    InputError
        If a number cannot be, or the two ramps do not fit into the duration.
    """

    kind: ClassVar[str] = "multisine"

    ramp: float
    tones: tuple[Tone, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("ramp", positive=True)
        if 2 * self.ramp > self.duration:
            raise InputError(f"motion '{self.name}': two ramps are longer than its duration")
        object.__setattr__(self, "tones", tuple(self._tone(tone) for tone in self.tones))

    def _tone(self, tone: Tone) -> Tone:
        what = f"motion '{self.name}' tone"
        tone = Tone(*tone)
        if tone.axis not in (0, 1, 2):
            raise InputError(f"{what} axis: {tone.axis!r} is none of 0 (VX), 1 (VY), 2 (W)")
        frequency = finite(f"{what} frequency", tone.frequency, positive=True)
        numbers = (finite(f"{what} {n}", getattr(tone, n)) for n in ("amplitude", "phase"))
        return Tone(int(tone.axis), frequency, *numbers)

    @property
    def plateau(self) -> tuple[float, float]:
        """Start and end [s] of the part between the ramps."""
        return self.ramp, self.duration - self.ramp

    def _curves(self, t: Array) -> tuple[Array, Array]:
        axis, frequency, amplitude, phase = np.array(self.tones, float).reshape(-1, 4).T
        mix = amplitude[:, None] * (axis[:, None] == np.arange(3))
        angle = np.multiply.outer(t, frequency) + phase
        # einsum, not matmul: the order of its sums never depends on the BLAS at hand
        value = np.einsum("nk,ka->na", np.sin(angle), mix)
        slope = np.einsum("nk,ka->na", np.cos(angle), frequency[:, None] * mix)
        s, s1, _ = (part[:, None] for part in window(t, self.duration, self.ramp))
        return s * value, s1 * value + s * slope

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "tones": [tone._asdict() for tone in self.tones]}

    @classmethod
    def _from_fields(cls, values: Mapping[str, Any]) -> Motion:
        try:
            tones = tuple(Tone(**tone) for tone in values["tones"])
        except TypeError:
            raise InputError(
                f"motion tones: a list of objects with {', '.join(Tone._fields)} is needed"
            ) from None
        return cls(**{**values, "tones": tones})


def multisine(
    rng: np.random.Generator,
    *,
    band: tuple[float, float] = (0.5, 3.0),
    tones: int = 7,
    amplitude: Sequence[float] = (0.22, 0.18, 0.6),
    duration: float = 60.0,
    ramp: float = 1.5,
    periods: int = 1,
    geometry: Geometry | None = None,
    limits: MotionLimits | None = None,
    draws: int = 16,
    name: str = "multisine",
) -> Multisine:
    """A random multisine whose axes share no tone.

    Tones are harmonics of the plateau's length (the duration less two ramps) over ``periods``, so
    that over the plateau all tones are orthogonal, its spectrum has lines only inside the band, and
    the motion repeats. A period too short to hold 3 * tones harmonics in the band gets the closest
    spacing that does; its tones still differ, but are only roughly orthogonal over the plateau.
    Neighbouring harmonics are dealt out over the axes, so each axis covers the band. The phases are
    the best of ``draws``.

    Parameters
    ----------
    band : lowest and highest frequency [rad/s]
    tones : number of tones per axis, all of one amplitude
    amplitude : peak of VX, VY [m/s] and W [rad/s]; 0 leaves an axis at rest
    duration, ramp : [s]
    periods : the plateau holds so many; with two or more, what does not repeat in a log is noise
    geometry, limits : all axes shrink together until wheel speed and body speed respect the
        limits; the default is the youBot and ``MotionLimits.of(geometry)``
    draws : sets of phases tried; the one of the lowest peak is kept, for each axis

    Raises
    ------
    InputError
        If an argument cannot be.
    """
    low, high = (finite("multisine band", edge, positive=True) for edge in band)
    peak = np.array([finite("multisine amplitude", value) for value in amplitude])
    tones, draws = count("multisine tones", tones), count("multisine draws", draws)
    periods = count("multisine periods", periods)
    plateau = finite("multisine duration", duration) - 2 * finite("multisine ramp", ramp)
    check_length("multisine duration", duration)
    if not low < high:
        raise InputError(f"multisine band: {low:g} to {high:g} rad/s is empty")
    if len(peak) != 3 or (peak < 0).any():
        raise InputError("multisine amplitude: three numbers of at least 0 are needed")
    if plateau <= 0:
        raise InputError("multisine duration: must be longer than two ramps")

    # The order of the draws from ``rng`` decides what a seed gives: tones first, then phases.
    frequency, period = _harmonics(rng, low, high, tones, plateau / periods)
    steps = int(np.ceil(SAMPLES_PER_PERIOD * period * high / (2 * np.pi)))
    time = np.linspace(0.0, period, steps, endpoint=False)
    phase, values = zip(*(_low_crest(rng, time, w, draws) for w in frequency), strict=True)
    bound = PEAK_BOUND * np.column_stack(values)
    gain = peak / np.abs(bound).max(axis=0)
    # One factor for all axes keeps their proportions.
    geometry = geometry or Geometry()
    gain *= (limits or MotionLimits.of(geometry)).room(gain * bound, geometry)
    drawn = [
        Tone(axis, float(w), float(gain[axis]), float(phi))
        for axis in np.flatnonzero(gain).tolist()
        for w, phi in zip(frequency[axis], phase[axis], strict=True)
    ]
    return Multisine(name=name, duration=duration, ramp=ramp, tones=tuple(drawn))


def _harmonics(
    rng: np.random.Generator, low: float, high: float, tones: int, wanted: float
) -> tuple[Array, float]:
    """Tones (3, tones) [rad/s] without a common one, and the period [s] that they share.

    The period is the wanted one [s] if it holds enough harmonics."""
    needed = 3 * tones
    period = max(wanted, 2 * np.pi * needed / (high - low))
    base = 2 * np.pi / period
    # 1e-9: an edge of the band that is a harmonic itself must not be lost by rounding.
    first, last = int(np.ceil(low / base - 1e-9)), int(np.floor(high / base + 1e-9))
    chosen = np.sort(rng.choice(np.arange(first, last + 1), needed, replace=False))
    # Each row holds three neighbours; one goes to each axis, so every axis covers the band.
    dealt = rng.permuted(chosen.reshape(tones, 3), axis=1)
    return base * dealt.T, period


def _low_crest(
    rng: np.random.Generator, time: Array, frequency: Array, draws: int
) -> tuple[Array, Array]:
    """Phases (tones,) [rad] of the flattest of ``draws`` sums of unit tones, and that sum."""
    phase = rng.uniform(0.0, 2 * np.pi, (draws, len(frequency)))
    # sin(w t + phi) = Im(exp(j w t) exp(j phi)): one product serves all draws.
    carrier = np.exp(1j * np.multiply.outer(time, frequency))
    values = np.einsum("nk,dk->dn", carrier, np.exp(1j * phase)).imag
    best = int(np.abs(values).max(axis=1).argmin())
    return phase[best], values[best]
