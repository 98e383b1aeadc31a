"""What coarse channels leave by themselves: logs of a fitted model, measured like the given ones.

Counted speeds hide how slowly a wheel creeps, and while it creeps dry friction may hold any force
up to its own. Torques in steps that are larger than their noise are off by what the motion decides.
So even the true model leaves something that the motion predicts, and effects imitate it. How much,
the model itself tells: its free run, measured like the logs, is a log on which nothing is missing
(a parametric bootstrap: Efron and Tibshirani 1993, chapter 6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import PredictabilitySettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.signals.filters import integral_of
from identification.signals.noise import white_noise
from identification.signals.resampling import low_passed
from youbot_env.errors import InputError

Array = NDArray[np.float64]


def are_counted(samples: Sequence[Samples]) -> bool:
    """Whether the speeds of some log are differences of counted angles."""
    return any(item.angle_noise is not None for item in samples)


def are_coarse(samples: Sequence[Samples], settings: PredictabilitySettings) -> bool:
    """Whether speeds or torques of some log come in steps that no noise makes harmless."""
    return are_counted(samples) or any(
        step_beyond_noise(channel, settings) > 0
        for item in samples
        for channel in (item.wheel_speed, item.torque)
    )


def step_beyond_noise(channel: Array, settings: PredictabilitySettings) -> float:
    """Step in which a channel (N, J) comes; 0 where it has none, or noise well above it."""
    values = np.unique(channel)
    if not 2 < len(values) < settings.max_share_of_values * channel.size:
        return 0.0
    # A file's last decimal: steps that differ by rounding are one.
    step = float(np.median(np.diff(values)))
    noise = float(np.median(white_noise(channel)))
    return step if noise < settings.max_noise_of_step * step else 0.0


def measured_again(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    seed: int,
    settings: PredictabilitySettings,
) -> list[Samples] | None:
    """The free runs of a model, driven by the logged torques, measured like the logs.

    Nothing but the measuring is missing from the model at theta (P,) on these: speeds are counted
    where the logs' are, and speeds and torques rounded where theirs are. None where a run diverges.

    Parameters
    ----------
    seed : of the angles at which the wheels stand in a count at first
    """
    rng, found = np.random.default_rng(seed), []
    for item in samples:
        step = step_beyond_noise(item.torque, settings)
        driven = _before_rounding(mechanism, theta, item, settings) if step else item
        try:
            speed = mechanism.joint_speed(mechanism.free_run(theta, driven))
        except InputError:
            return None
        if not np.isfinite(speed).all():
            return None
        seen = _measured(speed, item, settings, rng)
        torque = rounded(driven.torque, step)
        twist = seen @ mechanism.least_squares
        found.append(replace(item, wheel_speed=seen, twist=twist, torque=torque))
    return found


def _before_rounding(
    mechanism: Mechanism, theta: Array, samples: Samples, settings: PredictabilitySettings
) -> Samples:
    """The samples with the torques that the model demands in the place of rounded ones."""
    ends = mechanism.demand(theta, samples.for_fit).force
    # An acceleration jumps at a sample, and so does the force: the mean of both sides.
    inner = 0.5 * (ends[1, :-1] + ends[0, 1:])
    force = np.concatenate([ends[0, :1], inner, ends[1, -1:]])
    demanded = mechanism.joint_torque(force - mechanism.measured_force(samples))
    # What the torques do against each other moves nothing, and stays as it was logged.
    torque = low_passed(samples.torque + demanded, settings.rounded_bandwidth, samples.dt)
    return replace(samples, torque=torque)


def rounded(signal: Array, step: float) -> Array:
    """A signal in whole steps; as it is where there is none."""
    return step * np.round(signal / step) if step else signal


def _measured(
    speed: Array, samples: Samples, settings: PredictabilitySettings, rng: np.random.Generator
) -> Array:
    """(N, J) speeds as a log has them: counted, rounded, or as they are."""
    if samples.angle_noise is None:
        return rounded(speed, step_beyond_noise(samples.wheel_speed, settings))
    # A count's error is uniform: its deviation is a count over the root of 12. Of a wheel that
    # rests for long it looks smaller; the joints have the same encoders.
    count = np.sqrt(12.0) * max(samples.angle_noise)
    start = rng.random(speed.shape[1])
    angle = np.floor(integral_of(speed, samples.dt) / count + start) * count
    difference = np.diff(angle, axis=0) / samples.dt
    # As in `Mechanism.samples`: the mean of two neighbours is the speed at the sample between.
    centred = 0.5 * (difference[1:] + difference[:-1])
    return np.concatenate([speed[:1], centred, speed[-1:]])
