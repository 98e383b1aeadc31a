"""Charts of lengths that were found from wheels and pose: intervals, ways on the floor, speeds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.interval_charts import Spread, add_spreads, height_of, name_rows
from identification.figures.style import BAND
from identification.kinematics import Kinematics, Motion
from identification.kinematics.kinematics import Length
from identification.kinematics.motion import angles_at

Array = NDArray[np.float64]


def in_words(length: Length) -> str:
    """A number that is shown with half its 95 % interval, in a unit that people use."""
    assert length.value is not None and length.std is not None
    factor, unit = look.UNITS.get(length.unit, (1.0, length.unit))
    half = factor * BAND * length.std
    # To the digit of its uncertainty, and no further.
    digits = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 4
    return f"{factor * length.value:.{digits}f} ± {half:.{digits}f} {unit}".rstrip()


def charts_of_kinematics(found: Kinematics, motions: Sequence[Motion]) -> Iterator[Chart]:
    """lengths; wheels; way_K and speeds_K of each log with a pose, in seconds from its start."""
    if any(length.value is not None for length in found.parameters.values()):
        yield lengths_chart(found)
    if found.wheels:
        yield wheels_chart(found)
    for k, motion in enumerate(motions):
        if motion.pose is not None:
            begin = float(motion.time[0])
            # A bag's clock counts from 1970: single precision and an axis would lose the seconds.
            motion = replace(motion, time=motion.time - begin)
            rolled = _rolled(found, motion)
            yield way_chart(f"way_{k}", motion, rolled)
            places = [p for p in found.slip.where if p.log == motion.name]
            shaded = [(place.start - begin, place.end - begin) for place in places]
            yield speeds_chart(f"speeds_{k}", motion, rolled, shaded)


def lengths_chart(found: Kinematics) -> Chart:
    """Each number that is shown, with its 95 % interval, a panel each."""
    known = {n: p for n, p in found.parameters.items() if p.value is not None and p.std is not None}
    scales = {
        name: look.UNITS.get(length.unit, (1.0, length.unit)) for name, length in known.items()
    }
    titles = [f"{name} [{unit}]" for name, (_, unit) in scales.items()]
    height = height_of(1, len(known))
    figure = look.rows_figure(len(known), height, titles, shared=False)
    for row, (name, length) in enumerate(known.items(), start=1):
        factor, unit = scales[name]
        assert length.value is not None and length.std is not None
        value, half = factor * length.value, BAND * factor * length.std
        spread = Spread(name, value, value - half, value + half)
        add_spreads(figure, row, [spread], name, {"color": look.BEFORE["color"]}, unit=unit)
        name_rows(figure, row, [""])
        # Some room on both sides of the interval, so that its ends are seen.
        room = 1.6 * half or abs(value) or 1.0
        figure.update_xaxes(range=[value - room, value + room], row=row, col=1)
    figure.update_xaxes(matches=None, showticklabels=True)
    figure.update_yaxes(ticks="")
    return Chart("lengths", "What wheels and pose show, with 95 % intervals", figure, height)


def wheels_chart(found: Kinematics) -> Chart:
    """Radius and size of the roller angle of each wheel, with 95 % intervals."""
    names = list(found.wheels)
    radii = [Spread(name, *_ends(1000.0, *wheel.radius)) for name, wheel in found.wheels.items()]
    angles = [
        Spread(name, *_ends(180 / np.pi, abs(wheel.roller_angle[0]), wheel.roller_angle[1]))
        for name, wheel in found.wheels.items()
        if wheel.roller_angle
    ]
    rows = [("radius [mm]", radii), *([("roller angle [°]", angles)] if angles else [])]
    height = height_of(len(names), len(rows))
    figure = look.rows_figure(len(rows), height, [title for title, _ in rows], shared=False)
    for row, (title, spreads) in enumerate(rows, start=1):
        mark = {"color": look.BEFORE["color"]}
        add_spreads(figure, row, spreads, title, mark, unit=title.rpartition("[")[2].rstrip("]"))
        name_rows(figure, row, [spread.name for spread in spreads])
    figure.update_xaxes(matches=None, showticklabels=True)
    common = found.parameters["R"].value if "R" in found.parameters else None
    if common is not None:
        figure.add_vline(x=1000 * common, line_dash="dash", line_width=1.2, row=1, col=1)  # pyright: ignore[reportArgumentType]
    return Chart(
        "wheels",
        "Each wheel, with 95 % intervals; dashed: R, of all wheels together",
        figure,
        height,
    )


def _ends(factor: float, value: float, std: float) -> tuple[float, float, float]:
    return factor * value, factor * (value - BAND * std), factor * (value + BAND * std)


class Rolled(NamedTuple):
    """What the wheels say of a log: times (n,), twist (n, 3) and the tracked point's way (n, 3)."""

    time: Array
    twist: Array
    pose: Array


def _rolled(found: Kinematics, motion: Motion) -> Rolled:
    """Of the wheel speeds, with unit, lengths and delay as found, from the first pose on."""
    place = motion.pose
    assert place is not None
    factor = 1.0 / found.unit.factor if found.unit else 1.0
    motion = replace(motion, velocity=motion.velocity * factor)
    parameters = {name: length.value or 0.0 for name, length in found.parameters.items()}
    angle = angles_at(motion, parameters.get("delay", 0.0))
    speed = np.gradient(angle, motion.dt, axis=0)
    twist = found.geometry.body_twist(speed)
    first = int(np.flatnonzero(np.isfinite(place).all(axis=1))[0])
    start = place[first]
    # The pose's heading is ahead of the robot's own by the frame's angle.
    yaw = np.cumsum(np.r_[0.0, 0.5 * (twist[1:, 2] + twist[:-1, 2]) * motion.dt])
    yaw += start[2] + parameters.get("frame_yaw", 0.0) - yaw[first]
    lever = complex(parameters.get("lever_x", 0.0), parameters.get("lever_y", 0.0))
    steps = (twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * yaw) * motion.dt
    way = np.cumsum(np.r_[0.0, 0.5 * (steps[1:] + steps[:-1])]) + lever * np.exp(1j * yaw)
    way += complex(start[0], start[1]) - way[first]
    pose = np.column_stack([way.real, way.imag, yaw - parameters.get("frame_yaw", 0.0)])
    return Rolled(motion.time, twist, pose)


def way_chart(name: str, motion: Motion, rolled: Rolled) -> Chart:
    """The measured pose and the way that the wheels alone say, from above."""
    assert motion.pose is not None
    figure = look.finished(look.plotly().Figure(), look.PLAN_HEIGHT)
    step = max(1, len(motion.time) // look.PATH_POINTS)
    ways = (("pose", motion.pose, look.MEASURED), ("wheels alone", rolled.pose, look.AFTER))
    for said, way, line in ways:
        figure.add_trace(
            look.plotly().Scatter(
                x=look.compact(way[::step, 0]), y=look.compact(way[::step, 1]), mode="lines",
                name=said, line=line, customdata=look.compact(motion.time[::step]),
                hovertemplate="x %{x:.2f} m, y %{y:.2f} m at %{customdata:.1f} s",
            )
        )  # fmt: skip
    figure.update_xaxes(title_text="x [m]")
    figure.update_yaxes(title_text="y [m]", scaleanchor="x", scaleratio=1)
    title = f"Way on the floor, from the first pose on: {motion.name}"
    return Chart(name, title, figure, look.PLAN_HEIGHT)


def speeds_chart(
    name: str, motion: Motion, rolled: Rolled, shaded: Sequence[tuple[float, float]] = ()
) -> Chart:
    """Speeds of the pose and of the wheels over time; ``shaded``: stretches [s] that slip."""
    assert motion.pose is not None
    known = np.isfinite(motion.pose).all(axis=1)
    measured = _body_speeds(motion.time[known], motion.pose[known], motion.dt)
    wheels = _body_speeds(rolled.time[known], rolled.pose[known], motion.dt)
    height = 110 + 3 * 190
    figure = look.rows_figure(3, height)
    for row, (axis, unit) in enumerate((("VX", "m/s"), ("VY", "m/s"), ("W", "rad/s")), start=1):
        for said, (time, speed), line in (
            ("pose", measured, look.MEASURED), ("wheels", wheels, look.AFTER),
        ):  # fmt: skip
            look.add_line(
                figure, row, time, speed[:, row - 1], said, line, bins=600, legend=row == 1
            )
        figure.update_yaxes(title_text=f"{axis} [{unit}]", row=row, col=1)
    for start, end in shaded:
        figure.add_vrect(
            x0=start, x1=end, fillcolor="rgba(224,105,31,0.2)", line_width=0, layer="below"
        )
    figure.update_xaxes(title_text="time from the log's start [s]", row=3, col=1)
    title = f"Speeds of the tracked point; shaded: the wheels slip: {motion.name}"
    return Chart(name, title, figure, height)


def _body_speeds(time: Array, pose: Array, dt: float) -> tuple[Array, Array]:
    """Times (k,) and (k, 3) speeds of a pose in its own frame, over ``SPEED_TIME``."""
    step = max(1, round(look.SPEED_TIME / dt))
    if len(time) <= step:
        return time[:0], pose[:0]
    moved = pose[step:] - pose[:-step]
    taken = (time[step:] - time[:-step])[:, None]
    yaw = 0.5 * (pose[step:, 2] + pose[:-step, 2])
    way = (moved[:, 0] + 1j * moved[:, 1]) * np.exp(-1j * yaw)
    speeds = np.column_stack([way.real, way.imag, moved[:, 2]]) / taken
    return 0.5 * (time[step:] + time[:-step]), speeds
