"""Efforts and speeds that a log holds for some rows: which of two things they mean.

A logger that is slower than its file repeats the last value: what is held is late by half of the
hold, and the true channel goes on in between. Or the drive itself holds each command: then the log
is true, and the speeds ripple at the rate of the holds. The ripple tells which, whatever else the
model lacks, since the rest of a motion is slower. Where it does not, both stay possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.fitting.long_logs import averaged_to_most
from identification.fitting.regression import Indices, regression
from identification.fitting.settings import FitSettings
from identification.logs.findings import names_of
from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.signals.held import between_fresh, fresh_rows, half_a_row_later, ripple
from youbot_env.errors import InputError

Array = NDArray[np.float64]
Meaning = Literal["late", "held", "open"]


@dataclass(frozen=True)
class HeldChannels:
    """The samples of some logs as their held channels are to be read.

    samples : as logged, or with held channels led straight from one new value to the next
    notes : what was decided, a sentence for all logs; () where nothing is held
    """

    samples: tuple[Samples, ...]
    notes: tuple[str, ...] = ()


class LogsToFit(NamedTuple):
    """Logs as their channels are to be read, no more samples than are needed.

    notes : what was done, in sentences; is_averaged : whether there were more
    """

    samples: list[Samples]
    notes: tuple[str, ...]
    is_averaged: bool


def logs_to_fit(
    mechanism: Mechanism,
    logs: Sequence[Log],
    settings: FitSettings,
    *,
    most: int,
    least_rate: float,
    purpose: str,
) -> LogsToFit:
    """Samples of logs for a fit or a search; see ``long_logs.averaged_to_most``."""
    # Of an hour at 1 kHz the samples as logged take half a gigabyte: they end with this function.
    held = as_they_mean(mechanism, mechanism.samples_of(logs), settings)
    samples, averaged = averaged_to_most(held.samples, most, least_rate, purpose)
    return LogsToFit(samples, (*held.notes, *averaged), bool(averaged))


def as_they_mean(
    mechanism: Mechanism, samples: Sequence[Samples], settings: FitSettings = FitSettings()
) -> HeldChannels:
    """Lead late channels straight from one new value to the next; leave what a drive holds."""
    held = [item for item in samples if _holds(item, settings)]
    if not held:
        return HeldChannels(tuple(samples))
    # Speeds follow no steps: inertia forbids it.
    speeds = tuple(_straight_speed(item, settings) for item in samples)
    kinds = [
        kind
        for kind, of in (("efforts", _held_torque), ("speeds", _held_speed))
        if any(of(item, settings) for item in held)
    ]
    meaning = _meaning(mechanism, speeds, _theta_of(mechanism, speeds, settings), settings)
    read = speeds
    if meaning == "late":
        read = tuple(_straight_torque(item, settings) for item in speeds)
    return HeldChannels(read, (_note(held, kinds, meaning),))


def doubt_of_held(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    theta: Array,
    free: Indices,
    settings: FitSettings = FitSettings(),
) -> Array:
    """(F, F) what the covariance of a fit lacks where the samples still hold efforts.

    theta (P,) : the fit; free (F,) : the parameters that it has fitted

    If it is open what the holds mean, it is the square of what the fit differs by from that of
    efforts led straight. If the drive holds them, the instant of a step is known to half a row.
    """
    none = np.zeros((len(free), len(free)))
    if not any(_held_torque(item, settings) for item in samples):
        return none
    meaning = _meaning(mechanism, samples, theta, settings)
    change = _late_step if meaning == "held" else _straight_torque
    other = [change(item, settings) for item in samples]
    there = _step(mechanism, other, theta, free, settings)
    apart = there - _step(mechanism, samples, theta, free, settings)
    return none + np.outer(apart, apart) if np.isfinite(apart).all() else none


def _step(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    theta: Array,
    free: Indices,
    settings: FitSettings,
) -> Array:
    """(F,) from theta (P,) to the least squares of the forces; the shortest, where some are."""
    rows = [regression(mechanism, theta, item, free, settings) for item in samples]
    scale = mechanism.scale[free]
    columns = np.concatenate([row.columns.reshape(-1, len(free)) for row in rows]) / scale
    residual = np.concatenate([row.residual.ravel() for row in rows])
    rounding = settings.min_singular_value_share
    return np.linalg.lstsq(columns, residual, rcond=rounding)[0] / scale


def _held_torque(samples: Samples, settings: FitSettings) -> bool:
    return fresh_rows(samples.torque, settings.held) is not None


def _held_speed(samples: Samples, settings: FitSettings) -> bool:
    return fresh_rows(samples.wheel_speed, settings.held) is not None


def _holds(samples: Samples, settings: FitSettings) -> bool:
    return _held_torque(samples, settings) or _held_speed(samples, settings)


def _straight_torque(samples: Samples, settings: FitSettings) -> Samples:
    found = fresh_rows(samples.torque, settings.held)
    return replace(samples, torque=between_fresh(samples.torque, found[1])) if found else samples


def _late_step(samples: Samples, settings: FitSettings) -> Samples:
    found = fresh_rows(samples.torque, settings.held)
    return replace(samples, torque=half_a_row_later(samples.torque, found[1])) if found else samples


def _straight_speed(samples: Samples, settings: FitSettings) -> Samples:
    found = fresh_rows(samples.wheel_speed, settings.held)
    if found is None:
        return samples
    straight = [between_fresh(of, found[1]) for of in (samples.wheel_speed, samples.twist)]
    return replace(samples, wheel_speed=straight[0], twist=straight[1])


def _theta_of(mechanism: Mechanism, samples: Sequence[Samples], settings: FitSettings) -> Array:
    """theta (P,) that is good enough for a ripple, which is the work of inertia alone."""
    known = (label.parameter for label in mechanism.labels)
    start = np.array([p.default if p.default is not None else p.size for p in known], float)
    free = np.flatnonzero(mechanism.free)
    for _ in range(settings.max_start_steps):
        start[free] += _step(mechanism, samples, start, free, settings)
        start = np.clip(start, *mechanism.bounds)
    return start


def _meaning(
    mechanism: Mechanism, samples: Sequence[Samples], theta: Array, settings: FitSettings
) -> Meaning:
    """What the speeds' ripple within the holds says of the efforts."""
    along, size = 0.0, 0.0
    left: list[Array] = []
    for item in samples:
        found = fresh_rows(item.torque, settings.held)
        if found is None:
            continue
        try:
            steps = mechanism.free_run(theta, item)
            straight = mechanism.free_run(theta, _straight_torque(item, settings))
        except InputError:
            return "open"
        expected = ripple(steps - straight, found[0])
        seen = ripple(mechanism.measured_speed(item) - straight, found[0])
        along, size = along + float((expected * seen).sum()), size + float((expected**2).sum())
        left.append(seen.ravel())
    if not left or not np.isfinite(along) or size <= 0:
        return "open"
    share = along / size
    reach = settings.interval_deviations * float(np.std(np.concatenate(left)) / np.sqrt(size))
    if share + reach < settings.max_late_ripple:
        return "late"
    return "held" if share - reach > settings.min_held_ripple else "open"


def _note(held: Sequence[Samples], kinds: Sequence[str], meaning: Meaning) -> str:
    names = names_of([item.name for item in held])
    what = {
        "late": "the speeds do not ripple with the steps, so the values are late, not held by the "
        "drive: they are led straight from one new value to the next",
        "held": "the speeds ripple with the steps, so the drive holds them: they are taken as "
        "they are",
        "open": "the speeds do not tell whether the drive holds them: they are taken as they are, "
        "and the intervals hold what it would change if they were late",
    }[meaning]
    if "efforts" not in kinds:
        what = "they are led straight from one new value to the next"
    return f"{names}: {' and '.join(kinds)} stand for some rows; {what}"
