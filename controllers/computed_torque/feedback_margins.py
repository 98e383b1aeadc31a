"""What a feedback on the twist's error bears, from the code that runs and the exact sampled plant.

The estimator and the regulator of :mod:`controllers.computed_torque.feedback` are linear as long as
nothing saturates, so unit vectors through them give their matrices; nothing is written down twice.
"""

from __future__ import annotations

import numpy as np

from controllers.computed_torque.feedback import (
    CORRECTION,
    MOST,
    PERIOD,
    WIDTH,
    correction,
    estimate,
)
from controllers.computed_torque.feedback_design import FeedbackDesign
from controllers.interface import Array, Loop
from controllers.linear.linear_system import LinearSystem, closed, sampled_platform
from controllers.linear.margins import Margins, frequency_grid, margins
from youbot_env.model.model import Model


def feedback_system(design: FeedbackDesign) -> LinearSystem:
    """Body force (3,) [N, N, N m] per error (3,), reference minus measured twist."""
    axes = design.axes.copy()
    axes[:, MOST] = np.inf
    shapes = ((2 + design.past, 3), (design.slots, 3), (1, 3))
    sizes = [rows * columns for rows, columns in shapes]
    ends = np.cumsum(sizes)[:-1]

    def step(values: Array, error: Array) -> tuple[Array, Array]:
        state, commands, drive = (
            part.reshape(shape) for part, shape in zip(np.split(values, ends), shapes, strict=True)
        )
        state, out = state.copy(), np.empty(3)
        queue, drives = np.zeros((design.slots, WIDTH)), np.zeros(WIDTH)
        queue[:, CORRECTION], drives[CORRECTION] = commands, drive[0]
        smooth, unknown = np.zeros(3), np.full(4, np.nan)
        maps = design.to_acceleration
        estimate(
            *(state, queue, drives, np.zeros(WIDTH), axes, design.timing, maps),
            *(smooth, error, unknown),
        )
        correction(state, queue, drives, axes, design.timing, smooth, out)
        queue[1:, CORRECTION] = queue[:-1, CORRECTION].copy()
        queue[0, CORRECTION] = out
        parts = (state, queue[:, CORRECTION], drives[CORRECTION])
        return np.concatenate([np.ravel(part) for part in parts]), out

    columns = [step(unit, np.zeros(3)) for unit in np.eye(sum(sizes))]
    drives = [step(np.zeros(sum(sizes)), -unit) for unit in np.eye(3)]
    (a, c), (b, d) = (
        [np.stack(part, axis=1) for part in zip(*rows, strict=True)] for rows in (columns, drives)
    )
    period = float(design.timing[PERIOD])
    return LinearSystem(a, b, design.mass @ c, design.mass @ d, period)


def closed_loop(design: FeedbackDesign, plant: Model, loop: Loop) -> LinearSystem:
    """The loop on a plant that need not be the controller's model.

    From a change of the reference that the feed-forward does not know to the twist.
    """
    return closed(sampled_platform(plant, loop), feedback_system(design))


def feedback_margins(design: FeedbackDesign, plant: Model, loop: Loop) -> Margins:
    """Gain and phase margin at each axis' force command (the other axes closed)."""
    frequency = frequency_grid(loop.sample_time)
    platform = sampled_platform(plant, loop).response(frequency)
    return margins(feedback_system(design).response(frequency) @ platform)
