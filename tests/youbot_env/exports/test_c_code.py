"""Exported C compiles without a warning and computes what Python does."""

from __future__ import annotations

import ctypes
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy

from tests.youbot_env.exports.c_compiler import C_COMPILERS, compiled, library, run, write
from tests.youbot_env.structures import (
    CASES,
    EVERYTHING,
    catalogue_values,
    drive,
    model,
    random_instant,
    state_of,
)
from youbot_env import InputError, Plant, load_model, to_c
from youbot_env.exports.c_code import printable, split
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant
from youbot_env.simulation.generated_code import Formulas

SIX = (
    "wheel_coulomb_friction",
    "floor_tilt",
    "actuator_lag",
    "torque_gain_error",
    "payload_change",
    "torque_delay",
)
"""Effects of every kind at once."""

FEW, MANY = 1000, 100_000
"""States that are compared in the fast and in the slow test."""

BATCH = r"""
#include "youbot_model.h"

/* Loops, because a call from Python takes longer than the function. */
void forward_rows(const double *state, const double *torque, double *rates, int rows);
void inverse_rows(const double *motion, const double *rate, const double *second, double *command,
                  int rows);

void forward_rows(const double *state, const double *torque, double *rates, int rows)
{
    int k;

    for (k = 0; k < rows; k++)
        youbot_forward_dynamics(&youbot_identified, state + k * YOUBOT_STATES,
                                torque + k * YOUBOT_JOINTS, rates + k * YOUBOT_STATES);
}

void inverse_rows(const double *motion, const double *rate, const double *second, double *command,
                  int rows)
{
    const youbot_motion *motions = (const youbot_motion *)motion;
    int k;

    for (k = 0; k < rows; k++)
        youbot_inverse_dynamics(&youbot_identified, motions + k, rate + k * YOUBOT_JOINTS,
                                second + k * YOUBOT_JOINTS, command + k * YOUBOT_JOINTS);
}
"""


def with_six() -> Model:
    made = load_model("paper")
    for name in SIX:
        made = made.with_effect(name, **catalogue_values(name))
    return made


def of_case(case: str) -> Model:
    return with_six() if case == "six" else model(case)


def pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def exported(m: Model, folder: Path, compiler: str = "gcc") -> ctypes.CDLL:
    write(folder, {**to_c(m), "batch.c": BATCH})
    return ctypes.CDLL(str(library(compiler, folder, ["youbot_model.c", "batch.c"])))


def columns(instant: Instant) -> np.ndarray:
    """Rows as the structure of a motion in C has them."""
    groups = (instant.twist, instant.acceleration, instant.pose, instant.wheel_angle)
    return np.column_stack([*(part for group in groups for part in group), instant.time])


def apart(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference of a component as a share of the largest that it is, or of 1."""
    size = np.abs(wanted).max(axis=0).clip(min=1.0)
    return float((np.abs(found - wanted).max(axis=0) / size).max())


def assert_equal_to_python(m: Model, code: ctypes.CDLL, rows: int) -> None:
    at = random_instant(np.random.default_rng(7), rows)
    state = np.column_stack(state_of(m.structure, at))
    torque = np.column_stack(at.torque)
    rates = np.empty_like(state)
    code.forward_rows(pointer(state), pointer(torque), pointer(rates), rows)
    assert apart(rates, m.state_derivative(state, torque)) < 1e-12

    motion, command = columns(at), np.empty((rows, 4))
    rate, second = map(np.column_stack, (at.torque_rate, at.torque_second_rate))
    code.inverse_rows(pointer(motion), pointer(rate), pointer(second), pointer(command), rows)
    # A motion in C belongs to a run that starts at 0.
    at = replace(at, start=0.0)
    wanted = dynamics.inverse_dynamics(np, m.structure, m.geometry, m.theta, at)
    assert apart(command, np.column_stack(np.broadcast_arrays(*wanted))) < 1e-12


@pytest.mark.parametrize("case", (*CASES, "six"))
def test_it_computes_what_python_does(case: str, tmp_path: Path):
    assert_equal_to_python(of_case(case), exported(of_case(case), tmp_path), FEW)


@pytest.mark.slow
@pytest.mark.parametrize("case", (*CASES, "six"))
def test_it_computes_what_python_does_at_many_states(case: str, tmp_path: Path):
    assert_equal_to_python(of_case(case), exported(of_case(case), tmp_path), MANY)


@pytest.mark.parametrize("compiler", C_COMPILERS)
@pytest.mark.parametrize("case", ("base", EVERYTHING))
def test_the_driver_passes_and_is_fast(case: str, compiler: str, tmp_path: Path):
    files = to_c(of_case(case), name="robot_2")
    write(tmp_path, files)
    sources = [name for name in files if name.endswith(".c")]
    printed = run(compiled(compiler, tmp_path, sources, "test"))
    assert printed.endswith("passed\n")
    times = [float(found) for found in re.findall(r"([\d.]+) us", printed)]
    assert len(times) == 2 and max(times) < 5.0


def test_what_does_not_change_with_the_torques_is_computed_once():
    """The search for torques under load repeats a few sums, and no function of the motion."""
    x, y, p, torque = (sympy.Symbol(name, real=True) for name in ("x", "y", "p->a", "torque"))
    result = sympy.sin(x) * sympy.cos(y) * abs(torque) + p * torque + sympy.exp(x * y) + p
    formulas = Formulas("f", ("x", "y", "p->a", "torque"), (result, result * sympy.tanh(y)))
    fixed, left, values = split(formulas, ["torque"])
    assert all(torque not in expression.free_symbols for _, expression in fixed)
    again = [*(expression for _, expression in left), *values]
    functions = {type(part) for one in again for part in one.atoms(sympy.Function)}
    assert functions <= {sympy.Abs}
    assert not {x, y, p} & {symbol for one in again for symbol in one.free_symbols}
    for symbol, expression in reversed([*fixed, *left]):
        values = [value.subs(symbol, expression) for value in values]
    wanted = (result, result * sympy.tanh(y))
    assert [sympy.simplify(a - b) for a, b in zip(values, wanted, strict=True)] == [0, 0]


def test_the_driver_notices_a_wrong_parameter(tmp_path: Path):
    files = to_c("paper")
    files["youbot_model.c"] = files["youbot_model.c"].replace(".mu1 = 0.11,", ".mu1 = 0.12,")
    write(tmp_path, files)
    program = compiled("gcc", tmp_path, ["youbot_model.c", "youbot_test.c"], "test")
    with pytest.raises(AssertionError, match="FAILED"):
        run(program)


class PlantOfC:
    """The exported plant, called from Python."""

    def __init__(self, m: Model, folder: Path) -> None:
        text = """
#include "youbot_model.h"
void *plant(double extra_delay);
int move(const double *torque, double duration, int steps, double *state);
static youbot_plant only;
void *plant(double extra_delay)
{
    youbot_plant_reset(&only, &youbot_identified, extra_delay);
    return &only;
}
int move(const double *torque, double duration, int steps, double *state)
{
    const int failed = youbot_plant_step(&only, torque, duration, steps);
    int i;

    for (i = 0; i < YOUBOT_STATES; i++)
        state[i] = only.state[i];
    return failed;
}
"""
        write(folder, {**to_c(m, period=0.01), "plant.c": text})
        self.code = ctypes.CDLL(str(library("gcc", folder, ["youbot_model.c", "plant.c"])))
        self.state = np.zeros(len(m.structure.state_names))
        self.header = (folder / "youbot_model.h").read_text()

    def reset(self, delay: float = 0.0) -> None:
        self.code.plant(ctypes.c_double(delay))

    def step(self, torque: np.ndarray, duration: float, steps: int) -> int:
        where = pointer(np.ascontiguousarray(torque))
        return self.code.move(where, ctypes.c_double(duration), steps, pointer(self.state))


@pytest.mark.parametrize("case", ("base", "actuator_lag", "torque_delay", EVERYTHING))
def test_the_plant_moves_as_ours_does(case: str, tmp_path: Path):
    m = of_case(case)
    ours, theirs = Plant(m), PlantOfC(m, tmp_path)
    ours.reset()
    theirs.reset()
    (steps,) = re.findall(r"PLANT_STEPS (\d+)", theirs.header)
    for torque in drive(0.01 * np.arange(300)):
        ours.step(torque, 0.01)
        assert theirs.step(torque, 0.01, int(steps)) == 0
        np.testing.assert_allclose(theirs.state, ours.state, rtol=1e-12, atol=1e-12)


def test_a_delay_of_broken_periods_and_steps_of_any_length(tmp_path: Path):
    m = load_model("paper").with_effect("torque_delay", delay=0.0373)
    ours, theirs = Plant(m, substeps=7), PlantOfC(m, tmp_path)
    ours.reset()
    theirs.reset()
    rng = np.random.default_rng(3)
    for torque in drive(0.01 * np.arange(200)):
        duration = float(rng.uniform(0.001, 0.02))
        ours.step(torque, duration)
        assert theirs.step(torque, duration, 7) == 0
        np.testing.assert_allclose(theirs.state, ours.state, rtol=1e-9, atol=1e-12)


def test_a_delay_line_that_is_too_short_says_so(tmp_path: Path):
    plant = PlantOfC(load_model("paper"), tmp_path)
    plant.reset(delay=0.5)
    found = [plant.step(np.zeros(4), 0.001, 1) for _ in range(60)]
    assert found[0] == 0 and found[-1] == -1


@pytest.mark.parametrize("name", ("", "2robot", "a b", "x" * 32, "a-b", "ä"))
def test_a_name_that_is_none_of_c_is_refused(name: str):
    with pytest.raises(InputError, match="a name of C"):
        to_c("paper", name=name)


def test_a_models_name_cannot_leave_its_comment(tmp_path: Path):
    wicked = replace(load_model("paper"), name='*/ int main; /* "\\\n??/ \x1b[31m')
    write(tmp_path, to_c(wicked))
    compiled("gcc", tmp_path, ["youbot_model.c", "youbot_test.c"], "test")
    assert set("*\\\n\x1b?") & set(printable(wicked.name)) == set()
