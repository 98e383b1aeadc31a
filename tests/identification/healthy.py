"""A healthy log of a made-up platform, for tests of reading and of what must not be read."""

from __future__ import annotations

import numpy as np

from identification.logs.log import Log
from youbot_env.physics.geometry import WHEELS, Geometry

SPEED_NOISE, EFFORT_NOISE = 0.01, 0.03


def healthy_log(
    rate: float = 100.0, duration: float = 20.0, *, extras: bool = False, seed: int = 0
) -> Log:
    """Multisine of all three velocities with white noise; extras are the optional columns."""
    rng = np.random.default_rng(seed)
    time = np.arange(1, round(rate * duration) + 1) / rate
    geometry = Geometry()
    tones = np.array([[0.7, 1.9], [0.9, 2.3], [1.3, 2.9]])
    sizes = np.array([0.3, 0.25, 0.7])
    phases = tones[None] * time[:, None, None]
    twist = (np.sin(phases) + 0.5 * np.cos(phases)).sum(axis=-1) / 2 * sizes
    rates = ((np.cos(phases) - 0.5 * np.sin(phases)) * tones).sum(axis=-1) / 2 * sizes
    speed = geometry.wheel_speeds(twist)
    effort = 0.11 * speed + 0.03 * geometry.wheel_speeds(rates)
    noisy_speed = speed + SPEED_NOISE * rng.normal(size=speed.shape)
    noisy_effort = effort + EFFORT_NOISE * rng.normal(size=speed.shape)
    more = {}
    if extras:
        yaw = 3.0 + np.cumsum(twist[:, 2]) / rate
        c, s = np.cos(yaw), np.sin(yaw)
        world = np.stack([c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]], 1)
        more = {
            "position": np.cumsum(speed, axis=0) / rate,
            "command": effort,
            "pose": np.column_stack([np.cumsum(world, axis=0) / rate, yaw]),
            "gyro_z": twist[:, 2] + 0.005 * rng.normal(size=len(time)),
        }
    return Log("healthy", WHEELS, time, noisy_speed, noisy_effort, **more)
