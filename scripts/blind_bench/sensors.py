"""How a blind case is measured where the noise is not white: each kind of noise, and counts.

Each kind draws its numbers (rng, rate) -> values and applies them to true rows. Nothing is missing
from a model because of them: a name for one of them is a false alarm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from youbot_scripts.blind_bench.second_simulator import SPEED_NOISE, TORQUE_NOISE, measured

Array = NDArray[np.float64]
Values = dict[str, float]

COUNTS = (500.0, 2000.0, 4096.0)
"""Encoder counts in a turn of a wheel: of a cheap drive, a usual one, and a magnetic encoder."""

OUTLIERS = 0.003
"""Share of the values of each channel that are outliers."""

MAINS = (50.0, 60.0)
"""[Hz] of hum."""

SLOWEST_HUM = 2.0
"""[Hz] Hum that appears slower than this after sampling is a motion's own band, and not drawn."""


class Rows(NamedTuple):
    """n rows of a log: time (n,) [s], speeds and efforts (n, 4), wheel angles (n, 4) [rad].

    The wheels stand at angle zero one row before the first.
    """

    time: Array
    velocity: Array
    effort: Array
    angle: Array

    @property
    def dt(self) -> float:
        """Time [s] between rows."""
        return float(self.time[1] - self.time[0])


@dataclass(frozen=True)
class Sensing:
    """How a case is measured: the name of a kind and what was drawn for it."""

    name: str
    values: Values


@dataclass(frozen=True)
class Kind:
    """A way to measure.

    Attributes
    ----------
    draw : (rng, log rate [Hz]) -> values
    apply : (true rows, values, factor on the base noise, rng) -> rows as they are logged
    """

    draw: Callable[[np.random.Generator, float], Values]
    apply: Callable[[Rows, Values, float, np.random.Generator], Rows]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def white(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """White noise on speeds and efforts."""
    velocity, effort = measured(rows.velocity, rows.effort, factor, rng)
    return rows._replace(velocity=velocity, effort=effort)


def first_order(
    shape: tuple[int, ...], dt: float, time_constant: float, rng: np.random.Generator
) -> Array:
    """Noise of unit variance whose correlation falls as exp(-t / time_constant); axis 0 is time.

    Zero: white.
    """
    drive = rng.standard_normal(shape)
    keep = np.exp(-dt / time_constant) if time_constant > 0.0 else 0.0
    # So that the first sample has unit variance as well: the noise is stationary from there on.
    drive[1:] *= np.sqrt(1.0 - keep * keep)
    return np.asarray(lfilter([1.0], [1.0, -keep], drive, axis=0))


# --- noise that is not white -----------------------------------------------------------------


def _draw_coloured(speeds: bool, torques: bool) -> Callable[[np.random.Generator, float], Values]:
    def drawn(rng: np.random.Generator, rate: float) -> Values:
        time_constant = _log_uniform(rng, 0.005, 0.3)
        return {
            "speed_time_constant": time_constant * speeds,
            "torque_time_constant": time_constant * torques,
        }

    return drawn


def _coloured(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Noise of the usual size, correlated on speeds, torques or both."""
    shape, dt = rows.velocity.shape, rows.dt
    speed = first_order(shape, dt, values["speed_time_constant"], rng)
    torque = first_order(shape, dt, values["torque_time_constant"], rng)
    return rows._replace(
        velocity=rows.velocity + factor * SPEED_NOISE * speed,
        effort=rows.effort + factor * TORQUE_NOISE * torque,
    )


def _draw_wander(rng: np.random.Generator, rate: float) -> Values:
    return {"rms": rng.uniform(0.01, 0.03), "time_constant": _log_uniform(rng, 1.0, 10.0)}


def _torque_wander(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Torques that wander slowly, beside white noise."""
    rows = white(rows, values, factor, rng)
    wander = first_order(rows.effort.shape, rows.dt, values["time_constant"], rng)
    return rows._replace(effort=rows.effort + values["rms"] * wander)


def _draw_offset_wander(rng: np.random.Generator, rate: float) -> Values:
    return {"rms": rng.uniform(0.01, 0.03), "periods": float(rng.integers(2, 7))}


def _offset_wander(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Torque offsets that wander: waves of up to ``periods`` in a log, of mean zero over it."""
    rows = white(rows, values, factor, rng)
    n, wheels = rows.effort.shape
    turns = np.arange(1, int(values["periods"]) + 1)
    phase = rng.uniform(0.0, 2 * np.pi, (len(turns), wheels))
    angle = 2 * np.pi * np.multiply.outer(np.arange(n) / n, turns)
    waves = np.sin(angle[:, :, None] + phase).sum(axis=1)
    return rows._replace(effort=rows.effort + values["rms"] * waves * np.sqrt(2.0 / len(turns)))


def appears_at(frequency: float, rate: float) -> float:
    """Frequency [Hz] that a tone has after sampling at ``rate`` [Hz]."""
    return abs(frequency - rate * round(frequency / rate))


def _draw_hum(rng: np.random.Generator, rate: float) -> Values:
    drift = rng.uniform(-0.05, 0.05)  # of a real grid
    tones = [*(tone + drift for tone in MAINS), 0.5 * rate * rng.uniform(0.94, 0.999)]
    heard = [tone for tone in tones if appears_at(tone, rate) > SLOWEST_HUM]
    on_torque = bool(rng.random() < 0.7)
    return {
        "frequency": float(rng.choice(heard)),
        "torque": _log_uniform(rng, 0.03, 0.15) * on_torque,
        "speed": _log_uniform(rng, 0.01, 0.05) * (not on_torque),
    }


def _hum(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """A tone on torques or speeds, in a phase of its own on each wheel, beside white noise."""
    rows = white(rows, values, factor, rng)
    phase = rng.uniform(0.0, 2 * np.pi, 4)
    tone = np.sin(2 * np.pi * values["frequency"] * rows.time[:, None] + phase)
    return rows._replace(
        velocity=rows.velocity + values["speed"] * tone,
        effort=rows.effort + values["torque"] * tone,
    )


def _draw_outliers(rng: np.random.Generator, rate: float) -> Values:
    return {"share": OUTLIERS, "size": _log_uniform(rng, 10.0, 50.0)}


def _outliers(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Single wild values, ``size`` times the base noise, beside white noise."""
    rows = white(rows, values, factor, rng)
    hit, sign = rng.random((2, *rows.effort.shape)), rng.choice([-1.0, 1.0], (2, 4))
    jump = values["size"] * sign[:, None] * (hit < values["share"])
    return rows._replace(
        velocity=rows.velocity + SPEED_NOISE * jump[0], effort=rows.effort + TORQUE_NOISE * jump[1]
    )


def _draw_tails(rng: np.random.Generator, rate: float) -> Values:
    return {"freedom": rng.uniform(2.5, 5.0)}


def _heavy_tails(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """White noise of the usual variance by Student's t: many small values and some large."""
    freedom = values["freedom"]
    noise = rng.standard_t(freedom, (2, *rows.effort.shape)) * np.sqrt((freedom - 2.0) / freedom)
    return rows._replace(
        velocity=rows.velocity + factor * SPEED_NOISE * noise[0],
        effort=rows.effort + factor * TORQUE_NOISE * noise[1],
    )


def _draw_steps(rng: np.random.Generator, rate: float) -> Values:
    return {
        "speed_step": _log_uniform(rng, 0.02, 0.1),
        "torque_step": _log_uniform(rng, 0.01, 0.05),
        "noise": rng.uniform(0.1, 1.0),
    }


def _quantised(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Speeds and torques in steps, with ``noise`` times the white noise before them."""
    rows = white(rows, values, factor * values["noise"], rng)
    speed, torque = values["speed_step"], values["torque_step"]
    return rows._replace(
        velocity=speed * np.round(rows.velocity / speed),
        effort=torque * np.round(rows.effort / torque),
    )


def _draw_jitter(rng: np.random.Generator, rate: float) -> Values:
    # Less than half a period, or stamps would change places.
    return {"largest": min(rng.uniform(2e-4, 1e-3), 0.4 / rate)}


def _jitter(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Rows at regular instants whose stamps are off by up to ``largest`` [s]; white noise."""
    off = values["largest"] * rng.uniform(-1.0, 1.0, len(rows.time))
    return white(rows, values, factor, rng)._replace(time=np.round(rows.time + off, 6))


# --- counts ----------------------------------------------------------------------------------


def _counted(rows: Rows, values: Values, factor: float, rng: np.random.Generator) -> Rows:
    """Speeds as counts since the row before, over the time between; white noise on the torques.

    Such a speed is the mean over the last period, as a drive computes it: half a row late.
    """
    count = 2 * np.pi / values["counts"]
    start = rng.random(4)  # where in a count a wheel stands at first
    seen = np.floor(np.vstack([np.zeros(4), rows.angle]) / count + start)
    _, effort = measured(rows.velocity, rows.effort, factor, rng)
    return rows._replace(velocity=np.diff(seen, axis=0) * count / rows.dt, effort=effort)


ENCODER = "encoder_counts"

NOISES = {
    "ar1_speeds": Kind(_draw_coloured(True, False), _coloured),
    "ar1_torques": Kind(_draw_coloured(False, True), _coloured),
    "ar1_both": Kind(_draw_coloured(True, True), _coloured),
    "torque_wander": Kind(_draw_wander, _torque_wander),
    "hum": Kind(_draw_hum, _hum),
    "outliers": Kind(_draw_outliers, _outliers),
    "heavy_tails": Kind(_draw_tails, _heavy_tails),
    "quantised": Kind(_draw_steps, _quantised),
    "jitter": Kind(_draw_jitter, _jitter),
    "offset_wander": Kind(_draw_offset_wander, _offset_wander),
}
"""Noise that is not white, by name. Ten of them and three log rates: 30 cases meet all pairs."""

ALL = NOISES | {
    ENCODER: Kind(lambda rng, rate: {"counts": float(rng.choice(COUNTS))}, _counted),
}


def draw(name: str, rng: np.random.Generator, rate: float) -> Sensing:
    """Draw the numbers of a way to measure, for logs of ``rate`` [Hz]."""
    values = ALL[name].draw(rng, rate)
    return Sensing(name, {key: float(value) for key, value in values.items()})


def sense(
    rows: Rows, sensing: Sensing | None, factor: float, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Time (n,), speeds and efforts (n, 4) as logged, with ``factor`` times the base noise.

    Without a kind the noise is white.
    """
    if sensing is None:
        logged = white(rows, {}, factor, rng)
    else:
        logged = ALL[sensing.name].apply(rows, sensing.values, factor, rng)
    return logged.time, logged.velocity, logged.effort
