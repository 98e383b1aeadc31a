"""A controller in the environment's loop, along one motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Controller, Observation, Reference
from youbot_env.motions.base import Motion
from youbot_env.physics import hardware
from youbot_env.tracking.env import YouBotTrackingEnv

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trace:
    """What happened in one closed loop, at n control instants.

    Attributes
    ----------
    time : (n,) [s]
    reference, twist : (n, 3) VX, VY, W [m/s, m/s, rad/s], asked for and true
    pose : (n, 3) true x, y, yaw [m, m, rad]
    command : (n, 4) torques commanded from here to the next instant [N m], within the limit
    saturated : (n,) whether a wheel's command is at its limit
    diverged : [s] when the loop left every sane set, or its controller asked for no number; None
        if it never did. A diverged trace ends there.
    """

    time: Array
    reference: Array
    twist: Array
    pose: Array
    command: Array
    saturated: NDArray[np.bool_]
    diverged: float | None


def drive(
    env: YouBotTrackingEnv,
    controller: Controller,
    motion: Motion,
    *,
    seed: int = 0,
    steps: int | None = None,
    show_pose: bool = False,
) -> Trace:
    """Drive the environment's platform along a motion.

    Parameters
    ----------
    env : the plant, its actuation and its sensors; is reset
    controller : is reset; knows of the plant only what it was built with
    seed : of the measurement noise
    steps : control periods; to the motion's end by default
    show_pose : whether the controller sees the true pose
    """
    steps = steps or round(motion.duration / env.period)
    ahead = int(getattr(controller, "preview_needed", 0))
    time = env.period * np.arange(steps + 1 + ahead)
    twist, acceleration = motion.evaluate(time)
    rows = np.zeros((steps, 13))
    saturated = np.zeros(steps, np.bool_)
    _, info = env.reset(seed=seed, options={"reference": motion})
    controller.reset()
    diverged, done = None, steps
    for k in range(steps):
        coming = slice(k + 1, k + 1 + ahead)
        wanted = Reference(twist[k], acceleration[k], twist[coming], acceleration[coming])
        torque = controller(_observation(info, show_pose), wanted)
        rows[k, :3], rows[k, 3:6] = info["twist"], info["pose"]
        if not np.isfinite(torque).all():
            diverged, done = float(time[k]), k
            break
        _, _, ended, _, info = env.step(env.to_action(torque))
        rows[k, 6:10] = info["commanded_torque"]
        saturated[k] = info["saturated"].any()
        if ended:
            diverged, done = float(time[k + 1]), k + 1
            break
    kept = rows[:done]
    return Trace(
        np.asarray(time[:done], np.float64),
        twist[:done],
        kept[:, :3],
        kept[:, 3:6],
        kept[:, 6:10],
        saturated[:done],
        diverged,
    )


def _observation(info: dict[str, Any], show_pose: bool) -> Observation:
    """Torques are those that were commanded until now; what the drives make of them is hidden."""
    return Observation(
        info["time"],
        info["wheel_speed"],
        info["measured_twist"],
        info["pose"] if show_pose else None,
        info["commanded_torque"],
    )


ENCODER_TICKS = hardware.ENCODER_TICKS
"""Counts per wheel turn in every evaluation: the youBot's."""
