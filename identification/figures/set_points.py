"""The picture of set points: the floor that a motion takes, and what it asks of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from identification.figures.style import GREY, MEASURED, PREDICTED, REFERENCE, new_figure, styled
from youbot_env.motions.set_points import SetPoints
from youbot_env.physics.geometry import SIGN_X, SIGN_Y, WHEELS, Geometry

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled
def set_points_figure(points: SetPoints, geometry: Geometry) -> Figure:
    """Floor plan on the left; twist and wheel speeds over time on the right."""
    figure = new_figure(6.0)
    plan, twist, turn, wheels = (
        figure.add_subplot(3, 2, (1, 5)),
        figure.add_subplot(3, 2, 2),
        figure.add_subplot(3, 2, 4),
        figure.add_subplot(3, 2, 6),
    )
    _draw_plan(plan, points, geometry)
    twist.plot(points.time, points.twist[:, 0], label="VX", **REFERENCE)
    twist.plot(points.time, points.twist[:, 1], label="VY", **PREDICTED)
    twist.set_ylabel("m/s")
    turn.plot(points.time, points.twist[:, 2], label="W", **REFERENCE)
    turn.set_ylabel("rad/s")
    for k, wheel in enumerate(WHEELS):
        wheels.plot(points.time, points.wheel_speed[:, k], linewidth=0.8, label=wheel)
    wheels.set_ylabel("wheels, rad/s")
    wheels.set_xlabel("s")
    for axes in (twist, turn, wheels):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)
    return figure


def _draw_plan(axes: Axes, points: SetPoints, geometry: Geometry) -> None:
    from matplotlib.patches import Rectangle

    floor, x, y = points.floor, points.pose[:, 0], points.pose[:, 1]
    width, depth = floor.most[0] - floor.least[0], floor.most[1] - floor.least[1]
    axes.add_patch(Rectangle(floor.least, width, depth, fill=False, edgecolor=GREY))
    axes.plot(x, y, label="path of O", **REFERENCE)
    corners = _corners(geometry)
    axes.fill(corners[:, 0], corners[:, 1], alpha=0.3, color=MEASURED["color"], label="start")
    axes.annotate("", (corners[:, 0].max(), 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "->"})
    along, aside = floor.size
    axes.set_title(f"{points.name}: {along:.1f} m by {aside:.1f} m with margin")
    axes.set_xlabel("m, ahead of the start")
    axes.set_ylabel("m, to its left")
    axes.margins(0.08)
    axes.set_aspect("equal")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.1), ncols=2)


def _corners(geometry: Geometry) -> np.ndarray:
    order = [0, 1, 3, 2]  # around the robot
    x = np.array(SIGN_X)[order] * (geometry.h + geometry.R)
    y = np.array(SIGN_Y)[order] * (geometry.l + geometry.R)
    return np.column_stack([x, y])
