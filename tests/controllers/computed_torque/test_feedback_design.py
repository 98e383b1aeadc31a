"""The margins that computed torque states are those of the code that runs."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.computed_torque.adaptive import AdaptiveComputedTorque
from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.feedback_design import closed_loop, feedback_system
from controllers.interface import Loop
from controllers.linear.linear_system import LinearSystem, closed, sampled_platform
from tests.controllers.driving import LAGGED, LATE, ONE_SAMPLE, PAPER, scaled
from youbot_env.model.model import Model

LOOPS = {
    "one sample": (PAPER, ONE_SAMPLE.loop),
    "late": (LAGGED, LATE.loop),
    "1 kHz": (LAGGED, Loop(0.001, 0.005, 0.0005)),
    "20 Hz": (PAPER, Loop(0.05, 0.05, 0.025)),
    "0.1 s": (LAGGED, Loop(0.01, 0.1, 0.005)),
    "parts of samples": (LAGGED, Loop(0.01, 0.013, 0.017)),
    "no delay": (PAPER, Loop(0.002)),
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_default_bandwidth_leaves_the_margins_it_promises(name: str) -> None:
    model, loop = LOOPS[name]
    control = ComputedTorque(model, loop)
    found = control.margins()
    assert closed_loop(control.design, model, loop).is_stable
    assert found.gain.min() > 10.0
    assert found.phase.min() > 45.0


def amplified(model: Model, loop: Loop, axis: int, gain: float) -> bool:
    """Whether the loop is stable with one axis' force command multiplied."""
    feedback = feedback_system(ComputedTorque(model, loop).design)
    share = np.eye(3)
    share[axis, axis] = gain
    louder = LinearSystem(
        feedback.a, feedback.b, share @ feedback.c, share @ feedback.d, feedback.period
    )
    return closed(sampled_platform(model, loop), louder).is_stable


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_gain_margin_is_where_the_loop_breaks(axis: int) -> None:
    model, loop = LOOPS["late"]
    limit = 10 ** (ComputedTorque(model, loop).margins().gain[axis] / 20)
    assert amplified(model, loop, axis, 0.97 * limit)
    assert not amplified(model, loop, axis, 1.03 * limit)


@pytest.mark.parametrize("name", ["one sample", "late", "1 kHz"])
@pytest.mark.parametrize("share", [0.5, 0.8, 1.25, 2.0])
def test_a_platform_half_or_twice_as_heavy_is_stable(name: str, share: float) -> None:
    model, loop = LOOPS[name]
    for parameters in (("m0", "I0", "I1"), ("m0",), ("I0",), ("mu1", "mu2")):
        plant = scaled(model, share, *parameters)
        assert closed_loop(ComputedTorque(model, loop).design, plant, loop).is_stable


def test_a_wider_bandwidth_costs_margin_and_adapting_none() -> None:
    wide = ComputedTorque(LAGGED, LATE.loop, bandwidth=30.0).margins()
    stock = ComputedTorque(LAGGED, LATE.loop).margins()
    assert (wide.gain < stock.gain).all()
    assert (wide.phase < stock.phase).all()
    adaptive = AdaptiveComputedTorque(LAGGED, LATE.loop).margins()
    np.testing.assert_array_equal(adaptive.gain, stock.gain)
