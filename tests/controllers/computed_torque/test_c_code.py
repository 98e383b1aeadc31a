"""The exported controller is the one of Python, in closed loop and where all goes wrong."""

from __future__ import annotations

import ctypes
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.computed_torque.c_code import (
    computed_torque_to_c,
    example_motion,
    example_run,
)
from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.feedback_design import velocity_map
from controllers.interface import Loop, Observation, Reference
from controllers.loop import Trace
from tests.youbot_env.exports.c_compiler import C_COMPILERS, CXX_OF, compiled, library, run, write
from tests.youbot_env.exports.test_c_code import SIX, with_six
from tests.youbot_env.structures import CASES, EVERYTHING, model
from youbot_env import load_model
from youbot_env.model.model import Model
from youbot_scripts.evaluation.metrics import judge

SHARED = r"""
#include "youbot_controller.h"

void begin(void);
double update(const youbot_observation *seen, const youbot_reference *wanted, double *command);

static youbot_controller only;

void begin(void)
{
    youbot_controller_init(&only, 0, 0);
}

double update(const youbot_observation *seen, const youbot_reference *wanted, double *command)
{
    return youbot_controller_update(&only, seen, wanted, command);
}
"""

FAST = Loop(0.001, 0.001, 0.0005)
BROKEN = Loop(0.01, 0.0137, 0.005)
"""A loop at 1 kHz, and one whose delay is no whole number of samples."""


class ControllerOfC:
    """The exported controller, called as the one in Python is."""

    def __init__(self, m: Model, loop: Loop, folder: Path) -> None:
        write(folder, {**computed_torque_to_c(m, loop), "shared.c": SHARED})
        sources = ["youbot_model.c", "youbot_controller.c", "shared.c"]
        self.code = ctypes.CDLL(str(library("gcc", folder, sources)))
        self.code.update.restype = ctypes.c_double
        (preview,) = re.findall(r"PREVIEW = (\d+)", (folder / "youbot_controller.h").read_text())
        rows = int(preview) * 3

        class Seen(ctypes.Structure):
            _fields_ = [
                ("time", ctypes.c_double),
                ("velocity", ctypes.c_double * 3),
                ("pose", ctypes.c_double * 3),
                ("torque", ctypes.c_double * 4),
            ]

        class Wanted(ctypes.Structure):
            _fields_ = [
                ("velocity", ctypes.c_double * 3),
                ("acceleration", ctypes.c_double * 3),
                ("preview_count", ctypes.c_int),
                ("has_preview_acceleration", ctypes.c_int),
                ("preview", ctypes.c_double * rows),
                ("preview_acceleration", ctypes.c_double * rows),
            ]

        self.seen, self.wanted = Seen, Wanted
        self.to_twist: np.ndarray | None = None
        self.reset()

    def reset(self) -> None:
        self.code.begin()

    def __call__(self, observation: Observation, reference: Reference) -> np.ndarray:
        unknown = np.full(4, np.nan)
        pose = unknown[:3] if observation.pose is None else observation.pose
        torque = unknown if observation.wheel_torque is None else observation.wheel_torque
        seen = self.seen(observation.time)
        twist = observation.body_twist
        if self.to_twist is not None:  # of wheels that do not roll as the geometry has them
            with np.errstate(invalid="ignore"):
                twist = observation.wheel_speed @ self.to_twist
        seen.velocity[:], seen.pose[:] = list(twist), list(pose)
        seen.torque[:] = list(torque)
        wanted: Any = self.wanted()
        wanted.velocity[:] = list(reference.twist)
        wanted.acceleration[:] = list(reference.acceleration)
        if reference.preview is not None:
            rows = np.ravel(reference.preview)[: len(wanted.preview)]
            wanted.preview_count = len(rows) // 3
            wanted.preview[: len(rows)] = list(rows)
        if reference.preview_acceleration is not None:
            rows = np.ravel(reference.preview_acceleration)[: len(wanted.preview)]
            wanted.has_preview_acceleration = 1
            wanted.preview_acceleration[: len(rows)] = list(rows)
        command = (ctypes.c_double * 4)()
        self.share = self.code.update(ctypes.byref(seen), ctypes.byref(wanted), command)
        return np.array(command)


def of_case(case: str) -> Model:
    return with_six() if case == "six" else model(case)


def assert_same_commands(ours: ComputedTorque, theirs: ControllerOfC, seed: int, count: int):
    """At random observations, references and gaps: no loop is closed, so all of it is reached."""
    rng = np.random.default_rng(seed)
    ahead = ours.preview_needed
    twist = 0.3 * rng.standard_normal((count + ahead, 3)).cumsum(0) / 3
    slope = rng.standard_normal((count + ahead, 3))
    ours.reset()
    theirs.reset()
    theirs.to_twist = ours._to_twist
    to_speed = np.linalg.pinv(velocity_map(ours.model))
    command = np.zeros(4)
    for k in range(count):
        measured = twist[k] + 0.1 * rng.standard_normal(3)
        pose = rng.uniform(-2, 2, 3) if rng.random() < 0.1 else None
        torque = (None, command, rng.uniform(-2, 2, 4))[rng.choice(3, p=(0.2, 0.6, 0.2))]
        if rng.random() < 0.05:
            measured = measured * np.array([1.0, np.nan, np.inf])
        with np.errstate(invalid="ignore"):
            speed = measured @ to_speed
        seen = Observation(
            k * ours.loop.sample_time if rng.random() < 0.9 else np.nan,
            speed,
            measured,
            pose,
            torque,
        )
        shown = int(rng.integers(0, ahead + 1)) if rng.random() < 0.3 else ahead
        coming = twist[k + 1 : k + 1 + shown].copy(), slope[k + 1 : k + 1 + shown].copy()
        if rng.random() < 0.05 and shown:
            coming[0][shown // 2] = np.nan
        now = twist[k].copy()
        if rng.random() < 0.05:
            now[1] = np.nan
        known = coming if rng.random() < 0.8 else (coming[0], None)
        wanted = Reference(now, slope[k], *(known if shown else (None, None)))
        command = ours(seen, wanted)
        found = theirs(seen, wanted)
        np.testing.assert_allclose(found, command, rtol=0, atol=1e-12, err_msg=f"call {k}")
        assert theirs.share == pytest.approx(ours.share, abs=1e-12)


@pytest.mark.filterwarnings("ignore:computed torque")
@pytest.mark.parametrize("loop", (FAST, BROKEN), ids=("fast", "broken"))
@pytest.mark.parametrize("case", ("base", "floor_tilt", "six"))
def test_commands_are_pythons_whatever_is_seen(case: str, loop: Loop, tmp_path: Path):
    m = of_case(case)
    assert_same_commands(ComputedTorque(m, loop), ControllerOfC(m, loop, tmp_path), 1, 1000)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:computed torque")
@pytest.mark.parametrize("case", (*CASES, "six"))
def test_commands_are_pythons_at_many_calls(case: str, tmp_path: Path):
    m = of_case(case)
    ours, theirs = ComputedTorque(m, BROKEN), ControllerOfC(m, BROKEN, tmp_path)
    for seed in range(10):
        assert_same_commands(ours, theirs, seed, 10_000)


def test_a_closed_loop_of_ten_seconds_is_pythons(tmp_path: Path):
    m = load_model("paper").with_effect("wheel_coulomb_friction", torque=0.1)
    controller = ComputedTorque(m, FAST)
    motion = example_motion(m)
    count = round(motion.duration / FAST.sample_time)
    reference, ours = example_run(controller, motion, count)
    other: Any = ControllerOfC(m, FAST, tmp_path)
    other.model, other.loop, other.preview_needed = m, FAST, controller.preview_needed
    _, theirs = example_run(other, motion, count)
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-12)
    assert np.abs(ours - reference).max() < 0.01


def build(m: Model, loop: Loop, folder: Path, compiler: str) -> tuple[Path, Path]:
    """The test driver, and the example in C++."""
    files = computed_torque_to_c(m, loop, name="base")
    write(folder, files)
    sources = [name for name in files if name.endswith(".c")]
    driver = compiled(compiler, folder, sources, "driver")
    objects = [f"{part}.o" for part in ("base_model", "base_controller")]
    for name in objects:
        compiled(compiler, folder, [name.replace(".o", ".c")], name, "-c")
    return driver, compiled(CXX_OF[compiler], folder, ["base_example.cpp", *objects], "example")


@pytest.mark.parametrize("compiler", C_COMPILERS)
def test_driver_and_class_leave_the_errors_that_evaluate_measures(compiler: str, tmp_path: Path):
    m = with_six()
    controller = ComputedTorque(m, FAST)
    motion = example_motion(m)
    count = round(motion.duration / FAST.sample_time)
    reference, twist = example_run(controller, motion, count)
    states = np.zeros((count, len(m.structure.state_names)))
    states[:, :3] = twist
    trace = Trace(0.001, reference, states, np.zeros((count, 4)), np.zeros((count, 4)), 2.0)
    wanted = np.array(judge(trace)["nrmse"])
    driver, example = build(m, FAST, tmp_path, compiler)
    printed = run(driver)
    assert printed.endswith("passed\n")
    shown = re.findall(r"([\d.]+) %", run(example).splitlines()[0])
    np.testing.assert_allclose([float(v) / 100 for v in shown], wanted, atol=1e-8)


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_that_the_torque_limit_makes_the_errors_is_said_where_it_does(limit: float, tmp_path: Path):
    loop = replace(FAST, torque_limit=limit)
    controller = ComputedTorque(load_model("paper"), loop)
    motion = example_motion(controller.model)
    reference, twist = example_run(controller, motion, round(motion.duration / loop.sample_time))
    error = np.sqrt(((twist - reference) ** 2).sum() / (reference**2).sum())
    driver, example = build(load_model("paper"), loop, tmp_path, "gcc")
    for printed in map(run, (driver, example)):
        assert (f"the torque limit of {limit:g} N m cuts the force" in printed) == (error > 0.05)
    assert (error > 0.05) == (limit < 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("compiler", C_COMPILERS)
@pytest.mark.parametrize("case", (*CASES, "six"))
def test_every_model_compiles_and_drives_as_in_python(case: str, compiler: str, tmp_path: Path):
    for loop in (FAST, BROKEN):
        driver, example = build(of_case(case), loop, tmp_path, compiler)
        # Its error in Python's loop stands in its source: the driver compares its own with it.
        assert run(driver).endswith("passed\n")
        run(example)


def test_a_step_takes_less_than_five_microseconds(tmp_path: Path):
    m = load_model("paper").with_effect("wheel_coulomb_friction", torque=0.1)
    m = m.with_effect("floor_tilt", tilt_x=0.01, tilt_y=0.0).with_effect("torque_delay", delay=0.01)
    driver, _ = build(m, FAST, tmp_path, "gcc")
    # The least of several: other programs run on the machine, too.
    times = [[float(v) for v in re.findall(r"([\d.]+) us", run(driver))] for _ in range(3)]
    assert len(times[0]) == 3
    assert np.min(times, axis=0).max() < 5.0


def test_the_driver_notices_another_gain(tmp_path: Path):
    files = computed_torque_to_c("paper", FAST)
    source = files["youbot_controller.c"]
    files["youbot_controller.c"] = re.sub(r"\.error_feedback = \{", ".error_feedback = {9", source)
    write(tmp_path, files)
    sources = [name for name in files if name.endswith(".c")]
    with pytest.raises(AssertionError, match="FAILED"):
        run(compiled("gcc", tmp_path, sources, "driver"))


def test_nothing_is_allocated_or_called_beyond_mathematics():
    files = computed_torque_to_c(with_six(), FAST)
    called = set(
        re.findall(r"#include <(\w+)", files["youbot_model.c"] + files["youbot_controller.c"])
    )
    assert called == {"math", "stddef", "string"}
    assert len(SIX) == 6 and EVERYTHING in CASES
