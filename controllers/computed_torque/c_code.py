"""The computed-torque controller as C99 for a robot's loop, and as a class of C++.

The model's part is generated (:mod:`youbot_env.exports.c_code`); the law is the same for all models
and stands in the templates of the folder ``c``, function by function as in
:mod:`controllers.computed_torque.feedback` and ``prediction``. What is filled in are the sizes, the
gains of the design, and the lengths.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from controllers.computed_torque.computed_torque import LOAD_TOLERANCE, ComputedTorque
from controllers.computed_torque.feedback_design import velocity_map
from controllers.interface import Array, Loop, Observation, Reference
from youbot_env.exports.c_code import (
    NAME,
    Check,
    about,
    checked_name,
    filled,
    initialiser,
    number,
    template,
    to_c,
)
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import Multisine, multisine
from youbot_env.simulation.delay_line import DelayLine
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.lane_kernel import stepper
from youbot_env.simulation.plant import plant_substeps

EXAMPLE_SECONDS = 10.0
"""Length of the driver's closed loop."""

EXAMPLE_TOLERANCE = 1e-9
"""By which a normalised error of the driver's closed loop may differ from Python's: rounding is
different on each machine, and a loop that is at rest amplifies it where friction is steep."""

PACKAGE = "controllers.computed_torque"
"""Where the folder of the templates stands."""

FILES = ("controller.h", "controller.c", "controller.hpp", "example.h", "example.cpp")


def computed_torque_to_c(
    model: str | os.PathLike[str] | Model,
    loop: Loop | None = None,
    *,
    name: str = NAME,
    bandwidth: float | None = None,
) -> dict[str, str]:
    """The model and its computed-torque controller as C99 and C++: text by name of file.

    Beside the files of :func:`youbot_env.to_c`: ``NAME_controller.h``, ``.c`` and ``.hpp`` (a class
    of one header), and ``NAME_example.cpp``, which drives the plant in C by it. The test driver
    runs the same loop, with Python's errors beside its own.

    Parameters
    ----------
    model : a mecanum platform's
    loop : times, limit and noise of the loop that the controller will run in
    name : begins all names and files
    bandwidth : see :class:`ComputedTorque`

    Raises
    ------
    InputError
        If the model, the loop or the name cannot be used.
    """
    model = load_model(model)
    loop = loop or Loop(sample_time=0.001, torque_limit=model.geometry.max_wheel_torque)
    name = checked_name(name)
    controller = ComputedTorque(model, loop, bandwidth)
    marks = {"about": about(model), **_sizes(controller), **_numbers(controller)}
    marks |= _example(controller)
    files = {f"{name}_{file}": filled(template(file, PACKAGE), marks, name) for file in FILES}
    check = Check(
        headers=("controller.h", "example.h"),
        functions=template("check.c", PACKAGE),
        call="check_controller()",
        tolerances=f"static const double EXAMPLE_TOLERANCE = {number(EXAMPLE_TOLERANCE)};",
    )
    return to_c(model, name=name, period=loop.sample_time, checks=[check]) | files


def _sizes(controller: ComputedTorque) -> dict[str, str]:
    loop, design = controller.loop, controller.design
    words = {
        "period": f"{loop.sample_time:g} s",
        "delay of commands": f"{loop.delay:g} s, beside the model's {controller.model.delay:g} s",
        "age of measured speeds": f"{loop.measurement_delay:g} s",
        "noise of a wheel's speed": f"{loop.speed_noise:g} rad/s",
        "torque limit": f"{loop.torque_limit:g} N m",
        "bandwidth of the feedback": f"{design.bandwidth:.4g} rad/s",
    }
    timing = "but for losses under load, whose torque is sought in rounds"
    return {
        "loop": "\n".join(f"   {what}: {value}" for what, value in words.items()),
        "timing": timing if controller.model.structure.depends_on_load else "no loop is open-ended",
        "period": number(loop.sample_time),
        "queue": str(design.slots),
        "past": str(design.past),
        "preview": str(controller.preview_needed),
        "follows": str(int(controller.follows)),
    }


def _numbers(controller: ComputedTorque) -> dict[str, str]:
    design = controller.design.constants[0]
    lines = [f"    .{field} = {_value(design[field])}," for field in design.dtype.names]
    return {
        "design": "\n".join(lines),
        "load_tolerance": number(LOAD_TOLERANCE),
        "to_velocity": initialiser(velocity_map(controller.model).T),
    }


def _value(value: Any) -> str:
    if np.ndim(value):
        return initialiser(value)
    return str(int(value)) if isinstance(value, np.integer) else number(float(value))


# --- the closed loop of the driver -----------------------------------------------------------


def _example(controller: ComputedTorque) -> dict[str, str]:
    motion = example_motion(controller.model)
    steps = round(motion.duration / controller.loop.sample_time)
    reference, twist = example_run(controller, motion, steps)
    # A model that nothing can follow has errors that no literal of C can hold.
    with np.errstate(all="ignore"):
        error = np.sqrt(np.mean((twist - reference) ** 2, axis=0) / np.mean(reference**2, axis=0))
    rows = [
        f"    {{{tone.axis}, {number(tone.frequency)}, {number(tone.amplitude)}, "
        f"{number(tone.phase)}}},"
        for tone in motion.tones
    ]
    return {
        "steps": str(steps),
        "duration": number(motion.duration),
        "ramp": number(motion.ramp),
        "delay": number(controller.loop.delay),
        "errors": initialiser(error),
        "tones": "\n".join(rows)[:-1],
    }


def example_motion(model: Model) -> Multisine:
    """The reference of the driver's closed loop: the band of ``YouBotTracking-v0``."""
    return multisine(
        np.random.default_rng(0), duration=EXAMPLE_SECONDS, geometry=model.geometry, name="example"
    )


def example_run(controller: ComputedTorque, motion: Multisine, steps: int) -> tuple[Array, Array]:
    """Reference and true twist (steps, 3) of a closed loop of ``controller`` with its own model.

    As the driver in C runs it: wheel speeds are those of the instant, or, where the loop says that
    they have an age, means over the last period.
    """
    model, loop, ahead = controller.model, controller.loop, controller.preview_needed
    period = loop.sample_time
    wanted, slope = motion.evaluate(period * np.arange(steps + ahead))
    line = DelayLine(max(model.delay + loop.delay, 0.0))
    state = initial_state(model)[None]
    command, angle, twists = np.zeros(4), np.zeros(4), np.empty((steps, 3))
    advance = stepper(model.structure)
    substeps, to_velocity = plant_substeps(model, period), velocity_map(model)
    controller.reset()
    for k in range(steps):
        twists[k], turned = state[0, :3], state[0, 6:10].copy()
        speed = (turned - angle) / period
        if not loop.measurement_delay:
            speed = twists[k] @ model.joint_jacobian.T
        angle = turned
        seen = Observation(k * period, speed, speed @ to_velocity, None, command)
        coming = slice(k + 1, k + 1 + ahead)
        command = controller(seen, Reference(wanted[k], slope[k], wanted[coming], slope[coming]))
        for torque, piece in line.passed(command[None].copy(), period):
            count = int(np.ceil(substeps * piece / period))
            advance(state, torque, model.lengths, model.theta[None], piece, count)
    return wanted[:steps], twists
