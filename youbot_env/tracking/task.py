"""The tracking task: reference, observation and reward. It knows no physics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from youbot_env.errors import InputError, finite
from youbot_env.motions.base import Motion
from youbot_env.motions.multisine import multisine
from youbot_env.physics import hardware
from youbot_env.physics.geometry import Geometry
from youbot_env.tracking.actuation import whole_number

Array = NDArray[np.float64]

REWARD_WEIGHTS = {
    "velocity_x": 0.3,
    "velocity_y": 0.3,
    "yaw_rate": 0.3,
    "effort": 0.05,
    "smoothness": 0.05,
}
"""The reward's terms and how much of it each makes up; only their ratios count."""

REWARD_MARGINS = {
    "velocity_x": 0.1,
    "velocity_y": 0.1,
    "yaw_rate": 0.3,
    "effort": 1.0,
    "smoothness": 1.0,
}
"""What leaves a tenth of a term: velocity errors [m/s, m/s, rad/s], the root mean square of the
action, and that of its change."""

DIVERGED = 5.0
"""A twist beyond this many times its scale (4 m/s, 13 rad/s) is no platform's any more."""

REPORT = {
    "tracking_error": slice(0, 3),
    "twist": slice(3, 6),
    "pose": slice(6, 9),
    "wheel_angle": slice(9, 13),
    "reference_twist": slice(13, 16),
    "reference_acceleration": slice(16, 19),
}
"""The columns of a report row that ``info`` shows as they are; see ``assess``."""

TERMS_START = 19
TERMS = slice(TERMS_START, TERMS_START + len(REWARD_WEIGHTS))
REWARD = TERMS.stop
ENDED = REWARD + 1
REPORT_WIDTH = ENDED + 1


@dataclass(frozen=True)
class TrackingTask:
    """Follow a multisine body twist.

    Attributes
    ----------
    band, tones, amplitude, ramp : of the reference, see ``motions.multisine``
    preview : how many coming reference samples are observed beside the present one
    action_history : how many past actions are observed
    reward_weights, reward_margins : see ``REWARD_WEIGHTS``, ``REWARD_MARGINS``; names left out
        keep their default

    Raises
    ------
    InputError
        If a number or name cannot be.
    """

    band: tuple[float, float] = (0.5, 3.0)
    tones: int = 7
    amplitude: Sequence[float] = (0.22, 0.18, 0.6)
    ramp: float = 1.5
    preview: int = 5
    action_history: int = 1
    reward_weights: Mapping[str, float] = field(default_factory=dict)
    reward_margins: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_numbers("band", self.band, 2)
        _check_numbers("amplitude", self.amplitude, 3)
        whole_number("tones", self.tones, least=1)
        whole_number("preview", self.preview, least=0)
        whole_number("action_history", self.action_history, least=1)
        margins = _merged("reward_margins", REWARD_MARGINS, self.reward_margins)
        weights = _merged("reward_weights", REWARD_WEIGHTS, self.reward_weights)
        if min(margins.values()) <= 0:
            raise InputError("reward_margins: every margin must be positive")
        if min(weights.values()) < 0 or sum(weights.values()) <= 0:
            raise InputError("reward_weights: must not be negative, and not all zero")

    @property
    def observation_size(self) -> int:
        """Measured twist, present and coming reference twists, past actions."""
        return 3 + 3 * (1 + self.preview) + 4 * self.action_history

    def reference(self, rng: np.random.Generator, duration: float, geometry: Geometry) -> Motion:
        """A random multisine that starts from rest and is still moving after ``duration`` [s]."""
        return multisine(
            rng,
            band=self.band,
            tones=self.tones,
            amplitude=self.amplitude,
            duration=duration + 2 * finite("ramp", self.ramp, positive=True),
            ramp=self.ramp,
            geometry=geometry,
        )

    def numbers(self, geometry: Geometry) -> Array:
        """Scales (3,), weights (5,) of sum 1 and margins (5,), packed for ``assess``."""
        weights = _merged("reward_weights", REWARD_WEIGHTS, self.reward_weights)
        margins = _merged("reward_margins", REWARD_MARGINS, self.reward_margins)
        shares = np.array(list(weights.values())) / sum(weights.values())
        return np.concatenate([twist_scale(geometry), shares, list(margins.values())])


def twist_scale(geometry: Geometry) -> Array:
    """(3,): the youBot's top speed [m/s] twice, and the yaw rate [rad/s] of its top wheel speed."""
    yaw_rate = hardware.MAX_WHEEL_SPEED * geometry.R / geometry.L
    return np.array([hardware.MAX_BODY_SPEED, hardware.MAX_BODY_SPEED, yaw_rate])


def reference_table(motion: Motion, period: float, samples: int) -> Array:
    """Twist and acceleration (samples, 6) of a motion, one row a control period."""
    return np.hstack(motion.evaluate(period * np.arange(samples)))


def _check_numbers(name: str, values: object, count: int) -> None:
    if not isinstance(values, (Sequence, np.ndarray)) or len(values) != count:
        raise InputError(f"{name}: {values!r} is not {count} numbers")
    for value in values:
        finite(name, value)


def _merged(
    name: str, defaults: Mapping[str, float], changes: Mapping[str, float]
) -> dict[str, float]:
    for key, value in changes.items():
        if key not in defaults:
            raise InputError(f"{name}: unknown term {key!r}; known are {', '.join(defaults)}")
        finite(f"{name} {key}", value)
    return {**defaults, **changes}


@njit(cache=True)
def tolerance(error, margin):
    """1 where there is no error, a tenth where it is ``margin``, never below 0.

    The long-tailed tolerance of dm_control: it still pulls from far away. NaN gives 0.
    """
    ratio = error / margin
    value = 1.0 / (1.0 + 9.0 * ratio * ratio)
    return value if value == value else 0.0


@njit(cache=True)
def terms(error, action, last_action, margin, out):
    """Fill the reward's five terms, each in [0, 1], in the order of ``REWARD_WEIGHTS``.

    ``error`` (3,) of the true twist [m/s, m/s, rad/s]; actions (4,) in [-1, 1].
    """
    for axis in range(3):
        out[axis] = tolerance(error[axis], margin[axis])
    effort, change = 0.0, 0.0
    for wheel in range(4):
        effort += action[wheel] ** 2 / 4.0
        change += (action[wheel] - last_action[wheel]) ** 2 / 4.0
    out[3] = tolerance(math.sqrt(effort), margin[3])
    out[4] = tolerance(math.sqrt(change), margin[4])


@njit(cache=True)
def assess(rows, states, measured, queue, table, clock, numbers, shape, observation, report):
    """Fill observations (n, D) and report rows (n, REPORT_WIDTH) of states (n, S).

    ``rows`` (first, past the last) says of which platforms. ``measured`` (n, 3) is the twist as
    sensed, ``queue`` (n, k, 4) the past actions, newest first, ``table`` (n, N, 6) the references,
    ``clock`` (n,) the present sample, ``shape`` the number of coming references and of past actions
    to observe. A value beyond +-DIVERGED is cut there.
    """
    scale, weight, margin = numbers[0:3], numbers[3:8], numbers[8:13]
    preview, history = shape
    for row in range(rows[0], rows[1]):
        now, line, seen = clock[row], report[row], observation[row]
        reward, ended = 0.0, False
        for axis in range(3):
            line[axis] = table[row, now, axis] - states[row, axis]
            seen[axis] = measured[row, axis] / scale[axis]
            ended |= not abs(states[row, axis]) <= DIVERGED * scale[axis]  # so that NaN ends it
            for ahead in range(1 + preview):
                seen[3 + 3 * ahead + axis] = table[row, now + ahead, axis] / scale[axis]
        for k in range(history):
            for wheel in range(4):
                seen[6 + 3 * preview + 4 * k + wheel] = queue[row, k, wheel]
        for i in range(seen.size):
            value = seen[i] if seen[i] == seen[i] else 0.0
            seen[i] = min(max(value, -DIVERGED), DIVERGED)
        for i in range(10):
            line[3 + i] = states[row, i]
        for i in range(6):
            line[13 + i] = table[row, now, i]
        terms(line[0:3], queue[row, 0], queue[row, 1], margin, line[TERMS_START:REWARD])
        for i in range(weight.size):
            reward += weight[i] * line[TERMS_START + i]
        line[REWARD] = reward
        line[ENDED] = 1.0 if ended else 0.0
