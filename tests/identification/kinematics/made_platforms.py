"""Made motions of platforms with a pose: wheels that slip, a late speed channel, a turned frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from identification.kinematics import Motion
from identification.signals.filters import integral_of
from youbot_env.physics.geometry import SIGN_X, SIGN_Y, Geometry


@dataclass(frozen=True)
class Made:
    """What a made motion has; see the fields of `identification.kinematics.Kinematics`."""

    geometry: Geometry = field(default_factory=Geometry)
    seconds: float = 60.0
    rate: float = 100.0
    speed: float = 0.25
    turning: float = 0.4
    slip: float = 0.0
    slip_time: float = 0.5
    pose_noise: float = 0.002
    yaw_noise: float = 0.004
    outliers: float = 0.0
    delay: float = 0.0
    frame_yaw: float = 0.0
    lever: tuple[float, float] = (0.0, 0.0)
    radii: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    roller_angle: tuple[float, float, float, float] = (np.pi / 4, np.pi / 4, np.pi / 4, np.pi / 4)
    speed_noise: float = 0.01


def multisine(rng: np.random.Generator, time: np.ndarray, size: float) -> np.ndarray:
    """(n,) a sum of sines of 0.05 to 0.5 Hz with random phases and this root mean square."""
    frequencies = np.linspace(0.05, 0.5, 10)
    phases = rng.uniform(0, 2 * np.pi, 10)
    wave = np.sin(2 * np.pi * frequencies * time[:, None] + phases).sum(axis=1)
    return size * wave / np.sqrt(np.mean(wave**2))


def coloured(rng: np.random.Generator, count: int, dt: float, time_constant: float) -> np.ndarray:
    """(count,) noise with variance 1 that fades over a time constant."""
    decay = np.exp(-dt / time_constant)
    noise = rng.standard_normal(count)
    out = np.empty(count)
    out[0] = noise[0]
    for k in range(1, count):
        out[k] = decay * out[k - 1] + np.sqrt(1 - decay**2) * noise[k]
    return out


def made(what: Made, seed: int = 0, name: str = "made") -> Motion:
    """A motion of a platform."""
    rng = np.random.default_rng(seed)
    dt = 1 / what.rate
    # Ten times finer than the log, so that the way is exact beside its noise.
    fine = np.arange(0, what.seconds + 1.0, dt / 4)
    twist = np.column_stack(
        [multisine(rng, fine, size) for size in (what.speed, what.speed, what.turning)]
    )
    yaw = integral_of(twist[:, 2], dt / 4)
    heading = np.exp(1j * yaw)
    velocity = heading * (twist[:, 0] + 1j * twist[:, 1])
    place = integral_of(velocity.real, dt / 4) + 1j * integral_of(velocity.imag, dt / 4)
    g = what.geometry
    lateral = np.sign(g.tangents) * np.tan(what.roller_angle)
    arm = -(np.array(SIGN_Y) * g.l) + lateral * np.array(SIGN_X) * g.h
    wheels = (twist[:, :1] + twist[:, 1:2] * lateral + twist[:, 2:] * arm) / (
        g.R * np.array(what.radii)
    )
    time = np.arange(0, what.seconds, dt)
    late = np.column_stack([np.interp(time + 0.5 - what.delay, fine, w) for w in wheels.T])
    if what.slip:
        slips = [coloured(rng, len(time), dt, what.slip_time) for _ in range(4)]
        late = late * (1 + what.slip * np.column_stack(slips))
    late = late + what.speed_noise * rng.standard_normal(late.shape)
    tracked = place + heading * complex(*what.lever)
    at = [np.interp(time + 0.5, fine, c) for c in (tracked.real, tracked.imag, yaw)]
    pose = np.column_stack([at[0], at[1], at[2] - what.frame_yaw])
    pose += rng.standard_normal(pose.shape) * (what.pose_noise, what.pose_noise, what.yaw_noise)
    if what.outliers:
        wrong = rng.random(len(time)) < what.outliers
        pose[wrong] += rng.standard_normal((wrong.sum(), 3)) * (0.3, 0.3, 0.5)
    return Motion(name, time, late, pose)


def scaled(motion: Motion, factor: float) -> Motion:
    """The motion with its wheel speeds in another unit."""
    return replace(motion, velocity=motion.velocity * factor)
