"""What compiled code needs to begin episodes: how models and references are drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.motions.limits import MotionLimits
from youbot_env.motions.multisine import SAMPLES_PER_PERIOD, Multisine, Tone
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.stated_parameters import public_parameters
from youbot_env.tracking.episode_draws import COARSE, FIXED, NORMAL, PHASES, UNIFORM
from youbot_env.tracking.randomisation import Posterior, Same, Source, Uniform, with_effects
from youbot_env.tracking.task import TrackingTask

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ModelDraws:
    """How parameters (Q,) as people state them are drawn; see ``episode_draws``.

    Attributes
    ----------
    model : the one that draws vary, with its effects
    kind : FIXED, UNIFORM or NORMAL
    mean, spread : (Q,), (Q, Q)
    lower, upper : (Q,) between which a draw is physical
    """

    model: Model
    kind: int
    mean: Array
    spread: Array
    lower: Array
    upper: Array


def model_draws(source: Source) -> ModelDraws:
    """From a source of models to numbers."""
    if isinstance(source, Posterior):
        model = with_effects(source.model, source.effects)
    else:
        assert isinstance(source, (Same, Uniform))
        model = source.model
    # In the order of the components, as compiled code takes them; files and tables have another.
    names = list(public_parameters(model.structure, model.geometry))
    mean = np.array([model.values[name] for name in names])
    spread = np.zeros((len(names), len(names)))
    kind = FIXED
    if isinstance(source, Uniform):
        kind = UNIFORM
        for name, (low, high) in source.ranges.items():
            mean[names.index(name)] = low
            spread[names.index(name), 0] = high - low
    elif isinstance(source, Posterior):
        kind = NORMAL
        covariance = source.model.covariance
        assert covariance is not None
        # Of a matrix that is positive only up to rounding a Cholesky factor need not exist.
        values, vectors = np.linalg.eigh(covariance)
        factor = vectors * np.sqrt(values.clip(min=0.0))
        rows = [names.index(name) for name in source.model.covariance_names]
        spread[np.ix_(rows, range(len(rows)))] = factor
    lower, upper = _bounds(model)
    return ModelDraws(model, kind, mean, spread, lower, upper)


def _bounds(model: Model) -> tuple[Array, Array]:
    known = public_parameters(model.structure, model.geometry)
    lower, upper = [], []
    for name, parameter in known.items():
        slack = 1e-9 * parameter.size  # as ``Parameter.fault`` has it
        low, high = parameter.lower - slack, parameter.upper + slack
        if name in model.base_parameters:
            low, high = max(low, _edge(model, name, -1.0)), min(high, _edge(model, name, 1.0))
        lower.append(low)
        upper.append(high)
    return np.array(lower), np.array(upper)


def _edge(model: Model, name: str, sign: float) -> float:
    """How far a base parameter can go up or down until the mechanism finds fault with it."""
    base = {key: model.values[key] for key in model.base_parameters}

    def fault(value: float) -> bool:
        return bool(model.mechanism.fault(model.geometry, {**base, name: value}))

    inside, step = base[name], max(abs(base[name]), 1e-3)
    outside = inside
    for _ in range(40):
        outside = inside + sign * step
        if fault(outside):
            break
        step *= 2.0
    else:
        return sign * math.inf
    # The last number without a fault, to the last bit.
    for _ in range(200):
        middle = 0.5 * (inside + outside)
        if middle in (inside, outside):
            break
        inside, outside = (inside, middle) if fault(middle) else (middle, outside)
    return inside


def geometry_numbers(geometry: Any) -> Array:
    """All numbers of a geometry, in the order of its fields."""
    if not is_dataclass(geometry):
        raise InputError("an environment needs a geometry that is a dataclass of numbers")
    numbers = (getattr(geometry, f.name) for f in fields(geometry))
    # Names, limits and angles are no part of what converts parameters.
    return np.array([number for number in numbers if isinstance(number, float)])


@dataclass(frozen=True)
class ReferenceDraws:
    """How random multisines are drawn; see ``motions.multisine``.

    Attributes
    ----------
    period : of the lowest harmonic [s]
    first, last : harmonics of the band
    peaks (3,), limits (2,) : see ``episode_draws.draw_reference``
    steps : points on which its peak is sought
    duration, ramp : of the motion [s]
    """

    tones: int
    period: float
    first: int
    last: int
    peaks: Array
    limits: Array
    steps: int
    duration: float
    ramp: float


def reference_draws(task: TrackingTask, duration: float, geometry: Geometry) -> ReferenceDraws:
    """For episodes of a platform that see ``duration`` [s] of a reference."""
    (low, high), needed = task.band, 3 * task.tones
    period = max(duration, 2 * math.pi * needed / (high - low))
    base = 2 * math.pi / period
    # 1e-9: an edge of the band that is a harmonic itself must not be lost by rounding.
    first, last = math.ceil(low / base - 1e-9), math.floor(high / base + 1e-9)
    steps = math.ceil(SAMPLES_PER_PERIOD * period * high / (2 * math.pi) / COARSE) * COARSE
    if last >= PHASES:
        raise InputError(
            f"episode_length: {duration:g} s hold {last} periods of the band's lowest harmonic, "
            f"{PHASES - 1} at most; make it shorter"
        )
    limits = MotionLimits.of(geometry)
    return ReferenceDraws(
        tones=task.tones,
        period=period,
        first=first,
        last=last,
        peaks=np.array(task.amplitude, float),
        limits=np.array([limits.wheel_speed, limits.body_speed]),
        steps=steps,
        duration=duration + 2 * task.ramp,
        ramp=task.ramp,
    )


def drawn_motion(draws: ReferenceDraws, tones: Array, gain: Array) -> Multisine:
    """The motion of phases [turns / PHASES] and harmonics (6 tones,), in turn, and gains (3,)."""
    phase, harmonic = np.asarray(tones, float).reshape(-1, 2).T
    phase = phase / PHASES
    rate = 2 * math.pi / draws.period
    found = [
        Tone(axis, float(rate * h), float(gain[axis]), float(2 * math.pi * turns))
        for axis in range(3)
        if gain[axis]
        for turns, h in zip(phase.reshape(3, -1)[axis], harmonic.reshape(3, -1)[axis], strict=True)
    ]
    return Multisine(name="multisine", duration=draws.duration, ramp=draws.ramp, tones=tuple(found))
