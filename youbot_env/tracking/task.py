"""The tracking task: reference, observation and reward. It knows no physics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from youbot_env.caching import njit
from youbot_env.errors import InputError, finite
from youbot_env.motions.base import Motion
from youbot_env.motions.multisine import multisine
from youbot_env.physics.geometry import Geometry
from youbot_env.tracking.actuation import whole_number

Array = NDArray[np.float64]


class RewardTerm(NamedTuple):
    """One bounded term of the reward.

    Attributes
    ----------
    weight : how much of the reward it makes up; only the ratios of the weights count
    margin : of its error, at which a tenth of the term is left
    unit : of the margin
    reason : for both numbers
    """

    weight: float
    margin: float
    unit: str
    reason: str


TRACKING_REASON = (
    "tracking is the task, on each axis alike; half the reference's peak is no tracking"
)
EFFORT_REASON = "decides between policies that track alike; full torque leaves a tenth"

REWARD_TERMS = {
    "velocity_x": RewardTerm(0.3, 0.1, "m/s", TRACKING_REASON),
    "velocity_y": RewardTerm(0.3, 0.1, "m/s", TRACKING_REASON),
    "yaw_rate": RewardTerm(0.3, 0.3, "rad/s", TRACKING_REASON),
    "effort": RewardTerm(0.05, 1.0, "rms of the action", EFFORT_REASON),
    "smoothness": RewardTerm(0.05, 1.0, "rms of the action's change", EFFORT_REASON),
}
"""The reward's terms by name, in the order in which ``terms`` fills them."""

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
TERMS = slice(TERMS_START, TERMS_START + len(REWARD_TERMS))
REWARD = TERMS.stop
ENDED = REWARD + 1
REPORT_WIDTH = ENDED + 1
"""Last columns of a report row: the terms, the reward, and whether the episode has ended."""

SCALES, WEIGHTS, MARGINS, TWIST_LIMIT = slice(0, 3), slice(3, 8), slice(8, 13), 13
"""Places in the numbers of a task that compiled code gets, see ``TrackingTask.numbers``."""


@dataclass(frozen=True)
class TrackingTask:
    """Follow a multisine body twist: all numbers of the task.

    Attributes
    ----------
    band, tones, amplitude, ramp : of the reference, see ``motions.multisine``
    preview : how many coming reference samples are observed beside the present one
    action_history : how many past actions are observed
    reward_weights, reward_margins : by term, see ``REWARD_TERMS``; those left out keep theirs
    twist_limit : twist, over its scale, beyond which an episode ends and observations are cut

    Raises
    ------
    InputError
        If a number or name cannot be.
    """

    band: tuple[float, float] = field(
        default=(0.5, 3.0),
        metadata={"unit": "rad/s", "reason": "wheel-speed control lags from some 0.5 rad/s on"},
    )
    tones: int = field(
        default=7,
        metadata={"unit": "per axis", "reason": "chosen, as for the motions that logs are made of"},
    )
    amplitude: Sequence[float] = field(
        default=(0.22, 0.18, 0.6),
        metadata={
            "unit": "m/s, m/s, rad/s",
            "reason": "chosen, as for the motions that logs are made of: a quarter of top speed",
        },
    )
    ramp: float = field(
        default=1.5,
        metadata={"unit": "s", "reason": "a start from rest without a jump in acceleration"},
    )
    preview: int = field(
        default=5,
        metadata={"unit": "samples", "reason": "chosen: sees beyond three samples of delay"},
    )
    action_history: int = field(
        default=1, metadata={"unit": "samples", "reason": "what smoothness compares with"}
    )
    reward_weights: Mapping[str, float] = field(default_factory=dict)
    reward_margins: Mapping[str, float] = field(default_factory=dict)
    twist_limit: float = field(
        default=5.0,
        metadata={
            "unit": "of the twist's scale",
            "reason": "4 m/s, 13 rad/s: no platform moves like that, the simulation has diverged",
        },
    )

    def __post_init__(self) -> None:
        _check_numbers("band", self.band, 2)
        _check_numbers("amplitude", self.amplitude, 3)
        whole_number("tones", self.tones, least=1)
        whole_number("preview", self.preview, least=0)
        whole_number("action_history", self.action_history, least=1)
        finite("twist_limit", self.twist_limit, positive=True)
        margins, weights = self._margins, self._weights
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
            # Longer than asked, so that the ramp to rest begins after the episode.
            duration=duration + 2 * finite("ramp", self.ramp, positive=True),
            ramp=self.ramp,
            geometry=geometry,
        )

    def numbers(self, geometry: Geometry) -> Array:
        """Scales (3,), weights (5,) of sum 1, margins (5,), twist limit: packed for ``assess``."""
        shares = np.array(list(self._weights.values())) / sum(self._weights.values())
        margins = list(self._margins.values())
        return np.concatenate([twist_scale(geometry), shares, margins, [self.twist_limit]])

    def largest_twist(self, geometry: Geometry) -> Array:
        """(3,) [m/s, m/s, rad/s] beyond which a platform has diverged."""
        return self.twist_limit * twist_scale(geometry)

    @property
    def _weights(self) -> dict[str, float]:
        defaults = {name: term.weight for name, term in REWARD_TERMS.items()}
        return _merged("reward_weights", defaults, self.reward_weights)

    @property
    def _margins(self) -> dict[str, float]:
        defaults = {name: term.margin for name, term in REWARD_TERMS.items()}
        return _merged("reward_margins", defaults, self.reward_margins)


def twist_scale(geometry: Geometry) -> Array:
    """(3,): the platform's top speed [m/s] twice, and the yaw rate [rad/s] of its wheels' top
    speed; those of the youBot, where the geometry says none."""
    yaw_rate = geometry.max_wheel_speed * geometry.R / geometry.L
    return np.array([geometry.max_body_speed, geometry.max_body_speed, yaw_rate])


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
    # 9, so that a ratio of 1 gives 0.1.
    value = 1.0 / (1.0 + 9.0 * ratio * ratio)
    return value if value == value else 0.0


@njit(cache=True)
def terms(error, action, last_action, margin, out):
    """Fill the reward's five terms, each in [0, 1], in the order of ``REWARD_TERMS``.

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
    to observe. A value beyond the twist's limit is cut there.
    """
    scale, weight, margin = numbers[SCALES], numbers[WEIGHTS], numbers[MARGINS]
    limit = numbers[TWIST_LIMIT]
    preview, history = shape
    for row in range(rows[0], rows[1]):
        now, line, seen = clock[row], report[row], observation[row]
        reward, ended = 0.0, False
        for axis in range(3):
            line[axis] = table[row, now, axis] - states[row, axis]
            seen[axis] = measured[row, axis] / scale[axis]
            ended |= not abs(states[row, axis]) <= limit * scale[axis]  # so that NaN ends it
            for ahead in range(1 + preview):
                seen[3 + 3 * ahead + axis] = table[row, now + ahead, axis] / scale[axis]
        for k in range(history):
            for wheel in range(4):
                seen[6 + 3 * preview + 4 * k + wheel] = queue[row, k, wheel]
        for i in range(seen.size):
            # NaN, which is not equal to itself, is no number that a policy could use.
            value = seen[i] if seen[i] == seen[i] else 0.0
            seen[i] = min(max(value, -limit), limit)
        # Twist, pose and wheel angles, see ``REPORT``.
        for i in range(10):
            line[3 + i] = states[row, i]
        for i in range(6):
            line[13 + i] = table[row, now, i]
        terms(line[0:3], queue[row, 0], queue[row, 1], margin, line[TERMS_START:REWARD])
        for i in range(weight.size):
            reward += weight[i] * line[TERMS_START + i]
        line[REWARD] = reward
        line[ENDED] = 1.0 if ended else 0.0
