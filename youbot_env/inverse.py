"""Inverse dynamics as compiled source: what a controller asks of a model many times a second.

Traced from :mod:`youbot_env.dynamics` like the steppers; nothing here knows an equation of motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from youbot_env import dynamics
from youbot_env.backends import symbols
from youbot_env.codegen import HEADER, MECANUM, function_source, real_symbols
from youbot_env.geometry import allocate
from youbot_env.points import Instant

MOTION = (
    *("vx", "vy", "wz", "ax", "ay", "alpha", "x", "y", "yaw"),
    *("q1", "q2", "q3", "q4", "time"),
)
"""Columns of a motion's row: twist, acceleration, pose, wheel angles, time."""

TORQUES = ("u1", "u2", "u3", "u4")

RATES = ("w1", "w2", "w3", "w4")

LENGTHS = MECANUM.lengths

ROUNDS = 400
"""Rounds in which torques that depend on themselves come to rest: 0.9 is the largest share, and
0.9^400 is below rounding. A share of 0.3 takes 30."""

SANE = 1e6
"""Sum of torques [N m] beyond which, or at NaN, a first guess is thrown away."""


@dataclass(frozen=True)
class Inverse:
    """What the inverse dynamics of the platform is generated from, for the cache of kernels."""

    prefix: ClassVar[str] = "inverse"
    sources: tuple[str, ...] = (*MECANUM.sources, "youbot_env.inverse")

    def source(self, structure: Any) -> str:
        """Python source of a module with what ``kernels.InverseKernel`` holds."""
        return "\n\n".join([HEADER, _demand(structure), _command(structure), _loops(structure)])


INVERSE = Inverse()


def _theta(structure: Any) -> list[str]:
    return [f"p{i}" for i in range(len(structure.parameter_names))]


def _demand(structure: Any) -> str:
    """Least-norm torques that a motion demands while given torques act."""
    motion, torque = real_symbols(MOTION), real_symbols(TORQUES)
    lengths, theta = (
        real_symbols([f"g_{name}" for name in LENGTHS]),
        real_symbols(_theta(structure)),
    )
    geometry = SimpleNamespace(**dict(zip(LENGTHS, lengths, strict=True)))
    at = Instant(
        twist=tuple(motion[0:3]),
        acceleration=tuple(motion[3:6]),
        pose=tuple(motion[6:9]),
        wheel_angle=tuple(motion[9:13]),
        torque=tuple(torque),
        time=motion[13],
    )
    force = dynamics.wrench(symbols(), structure, geometry, theta, at)
    arguments = [str(symbol) for symbol in (*motion, *torque, *lengths, *theta)]
    return function_source("demand", arguments, allocate(geometry, force))


def _command(structure: Any) -> str:
    """Interface torques behind which given torques act and change at given rates."""
    torque, rate, theta = (real_symbols(n) for n in (TORQUES, RATES, _theta(structure)))
    (time,) = real_symbols(["time"])
    still = (0.0, 0.0, 0.0)
    at = Instant(still, torque=tuple(torque), torque_rate=tuple(rate), time=time)
    results = dynamics.interface_torque(symbols(), structure, theta, at)
    arguments = [str(symbol) for symbol in (*torque, *rate, time, *theta)]
    return function_source("command", arguments, results)


def _loops(structure: Any) -> str:
    theta = ", ".join(f"theta[{i}]" for i in range(len(structure.parameter_names)))
    lengths = ", ".join(f"lengths[{i}]" for i in range(len(LENGTHS)))
    row = ", ".join(f"motion[k, {i}]" for i in range(len(MOTION)))
    rounds = ROUNDS if structure.depends_on_load else 1
    return f"""@njit(cache=True, error_model='numpy')
def acting(motion, lengths, theta, tolerance, torque):
    for k in range(motion.shape[0]):
        a, b, c, d = torque[k, 0], torque[k, 1], torque[k, 2], torque[k, 3]
        if not abs(a) + abs(b) + abs(c) + abs(d) < {SANE}:
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for _ in range({rounds}):
            u1, u2, u3, u4 = demand({row}, a, b, c, d, {lengths}, {theta})
            moved = abs(u1 - a) + abs(u2 - b) + abs(u3 - c) + abs(u4 - d)
            a, b, c, d = u1, u2, u3, u4
            if moved <= tolerance:
                break
        torque[k, 0], torque[k, 1], torque[k, 2], torque[k, 3] = a, b, c, d


@njit(cache=True, error_model='numpy')
def several(motion, lengths, thetas, tolerance, torque):
    for j in range(thetas.shape[0]):
        acting(motion, lengths, thetas[j], tolerance, torque[j])


@njit(cache=True, error_model='numpy')
def interface(torque, rate, time, theta, out):
    out[0], out[1], out[2], out[3] = command(
        torque[0], torque[1], torque[2], torque[3],
        rate[0], rate[1], rate[2], rate[3], time, {theta}
    )


@njit(cache=True, error_model='numpy')
def held(motion, hold, lengths, theta, tolerance, torque, mean, out):
    acting(motion, lengths, theta, tolerance, torque)
    for i in range(4):
        mean[i] = (torque[0, i] + 4.0 * torque[1, i] + torque[2, i]) / 6.0
        out[i] = (torque[2, i] - torque[0, i]) / hold
    interface(mean, out, motion[1, 13], theta, out)
"""
