"""A controller in the environment's loop, with what a test needs to break in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controllers.interface import Controller, Loop, Observation, Reference
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import Motion
from youbot_env.physics.hardware import ENCODER_TICKS
from youbot_env.tracking.env import YouBotTrackingEnv

Array = np.ndarray
PAPER = load_model("paper")
LAGGED = PAPER.with_effect("actuator_lag", time_constant=0.03)


@dataclass(frozen=True)
class Condition:
    """A loop: rate [Hz], delay in samples, drives' lag [s], and noise [rad/s]."""

    rate: float = 100.0
    delay: int = 1
    lag: float | None = None
    noise: float = 0.01

    @property
    def loop(self) -> Loop:
        period = 1.0 / self.rate
        return Loop(period, self.delay * period, 0.5 * period, speed_noise=self.noise)

    @property
    def model(self) -> Model:
        """What a controller that knows all believes."""
        return (
            PAPER if self.lag is None else PAPER.with_effect("actuator_lag", time_constant=self.lag)
        )

    def environment(self, seconds: float, **changes: Any) -> YouBotTrackingEnv:
        settings = {
            "control_rate": self.rate,
            "delay": self.delay,
            "lag": self.lag,
            "wheel_speed_noise": self.noise,
            "encoder_ticks": ENCODER_TICKS,
            "episode_length": seconds,
        }
        return YouBotTrackingEnv(**{**settings, **changes})


ONE_SAMPLE = Condition()
LATE = Condition(delay=3, lag=0.03)
"""Conditions of the project's figures: one sample of delay; three and a lag of 30 ms."""


@dataclass(frozen=True)
class Drive:
    """What happened: reference and true twist (n, 3) after each command, commands (n, 4)."""

    period: float
    reference: Array
    twist: Array
    command: Array
    seen: list[tuple[Observation, Reference]]

    @property
    def error(self) -> Array:
        return self.reference - self.twist

    def normalised(self, start: float = 0.0, end: float = np.inf) -> Array:
        """(3,) rms error over rms reference, between two times [s]."""
        time = self.period * np.arange(1, len(self.twist) + 1)
        rows = (time > start) & (time <= end)
        return np.sqrt((self.error[rows] ** 2).mean(0) / (self.reference**2).mean(0))


def track(
    controller: Controller,
    condition: Condition = ONE_SAMPLE,
    seconds: float = 10.0,
    *,
    seed: int = 0,
    motion: Motion | None = None,
    see: Callable[[int, Observation], Observation] | None = None,
    apply: Callable[[int, Array], Array] | None = None,
    preview: int | None = None,
    **changes: Any,
) -> Drive:
    """Drive along a motion, the environment's own by default.

    ``see`` changes what the controller observes at a step, ``apply`` what its command becomes.
    """
    env = condition.environment(seconds, **changes)
    options = {} if motion is None else {"reference": motion}
    _, info = env.reset(seed=seed, options=options)
    assert env.reference is not None
    ahead = getattr(controller, "preview_needed", 0) if preview is None else preview
    steps = round(seconds / env.period)
    twist, slope = env.reference.evaluate(env.period * np.arange(steps + 1 + ahead))
    controller.reset()
    true, commands, seen = [], [], []
    for k in range(steps):
        observation = Observation(
            info["time"], info["wheel_speed"], info["measured_twist"], None, info["applied_torque"]
        )
        if see is not None:
            observation = see(k, observation)
        coming = slice(k + 1, k + 1 + ahead)
        known = (twist[coming], slope[coming]) if ahead else (None, None)
        seen.append((observation, Reference(twist[k], slope[k], *known)))
        command = controller(*seen[-1])
        assert np.isfinite(command).all(), f"step {k}"
        torque = command if apply is None else apply(k, command)
        _, _, ended, _, info = env.step(env.to_action(torque))
        assert not ended, f"diverged at step {k}"
        true.append(info["twist"])
        commands.append(command)
    return Drive(env.period, twist[1 : steps + 1], np.array(true), np.array(commands), seen)


class Silent:
    """Notes what it is shown, commands nothing, and NaN from a given call on."""

    preview_needed = 3

    def __init__(self, nan_from: int = 10**9, torque: float = 0.0) -> None:
        self.nan_from, self.torque = nan_from, torque
        self.seen: list[tuple[Observation, Reference]] = []

    def reset(self) -> None:
        self.seen = []

    def __call__(self, observation: Observation, reference: Reference) -> np.ndarray:
        self.seen.append((observation, reference))
        value = np.nan if len(self.seen) > self.nan_from else self.torque
        return np.full(4, value)


def blind(k: int, observation: Observation) -> Observation:
    """Without the wheels' torque."""
    return observation._replace(wheel_torque=None)


def off(start: float, end: float, period: float = 0.01) -> Callable[[int, Array], Array]:
    """Drives that are without power between two times [s]."""
    return lambda k, torque: 0.0 * torque if start <= k * period < end else torque


def scaled(model: Model, share: float, *names: str) -> Model:
    """A model whose parameters named are ``share`` times theirs."""
    return replace(model, name="scaled").with_values({n: share * model.values[n] for n in names})
