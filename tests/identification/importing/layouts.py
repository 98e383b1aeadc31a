"""One healthy log as other programs would write it: text of many layouts."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable

import numpy as np

from identification.logs.log import Log
from tests.identification.healthy import healthy_log
from youbot_env.physics.geometry import WHEELS

LOG = healthy_log(duration=6.0)
DECIMALS = 5


def names(pattern: str, wheels: tuple[str, ...] = WHEELS) -> list[str]:
    """Four names of a pattern with one `{}`."""
    return [pattern.format(wheel) for wheel in wheels]


def rows(log: Log, scale: float = 1.0) -> list[list[str]]:
    """Times, speeds (times a scale) and efforts as texts."""
    values = np.column_stack([log.time, scale * log.velocity, log.effort])
    return [[f"{number:.{DECIMALS}f}" for number in row] for row in values]


def joined(header: list[str], body: list[list[str]], delimiter: str = ",") -> str:
    """A text file."""
    return "\n".join([delimiter.join(header), *(delimiter.join(row) for row in body), ""])


def plain() -> str:
    return joined(["time", *names("velocity_{}"), *names("effort_{}")], rows(LOG))


def semicolons_and_decimal_commas() -> str:
    header = ["Zeit [s]", *names("Drehzahl {} [1/min]", ("VL", "VR", "HL", "HR"))]
    header += names("Drehmoment {} [Nm]", ("VL", "VR", "HL", "HR"))
    body = rows(LOG, 30 / np.pi)
    return joined(header, [[cell.replace(".", ",") for cell in row] for row in body], ";")


def tabs_and_a_row_of_units() -> str:
    header = ["t", *names("omega_{}"), *names("torque_{}")]
    units = ["s", *["rad/s"] * 4, *["N m"] * 4]
    return joined(header, [units, *rows(LOG)], "\t")


def remarks_and_the_header_again() -> str:
    lines = plain().split("\n")
    middle = len(lines) // 2
    top = ["Recorder 3.1, robot 7", "# operator: nobody", ""]
    return "\n".join([*top, *lines[:middle], lines[0], *lines[middle:-1], "Total: 600 rows"])


def milliseconds_in_the_header() -> str:
    body = [[f"{1e3 * LOG.time[k]:.2f}", *row[1:]] for k, row in enumerate(rows(LOG))]
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    header = ["t_ms", *names("{}_wheel_speed", wheels), *names("{}_wheel_torque", wheels)]
    return joined(header, body)


def epoch(unit: float) -> Callable[[], str]:
    def write() -> str:
        body = [
            [str(round((1_700_000_000 + LOG.time[k]) / unit)), *row[1:]]
            for k, row in enumerate(rows(LOG))
        ]
        return joined(["timestamp", *names("velocity_{}"), *names("effort_{}")], body)

    return write


def dates() -> str:
    start = datetime.datetime(2025, 3, 4, 10, 59, 58, tzinfo=datetime.UTC)
    stamps = [(start + datetime.timedelta(seconds=t)).isoformat() for t in LOG.time]
    body = [[stamp, *row[1:]] for stamp, row in zip(stamps, rows(LOG), strict=True)]
    return joined(["date", *names("velocity_{}"), *names("effort_{}")], body)


def plotjuggler_half_empty() -> str:
    """Two topics side by side: each row holds one of them."""
    header = ["__time"]
    header += names("/joint_states/wheel_joint_{}/velocity")
    header += names("/torques/wheel_joint_{}/effort")
    body = []
    for k, row in enumerate(rows(LOG)):
        body.append([row[0], *row[1:5], *[""] * 4])
        body.append([f"{LOG.time[k] + 0.004:.5f}", *[""] * 4, *row[5:]])
    return joined(header, body)


def rostopic_echo() -> str:
    parts = [f"field.{part}{k}" for part in ("name", "velocity", "effort") for k in range(4)]
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *parts]
    body = []
    for k, row in enumerate(rows(LOG)):
        stamp = f"{1_700_000_000_000_000_000 + round(1e9 * LOG.time[k])}"
        body.append([stamp, str(k), stamp, "", *names("wheel_joint_{}"), *row[1:]])
    return joined(header, body)


def ros2_topic_echo() -> str:
    """No header: stamp, frame, names, positions, velocities, efforts."""
    position = np.cumsum(LOG.velocity, axis=0) / LOG.rate
    lines = []
    for k, row in enumerate(rows(LOG)):
        nanoseconds = round(1e9 * LOG.time[k])
        stamp = [str(1_700_000_000 + nanoseconds // 10**9), str(nanoseconds % 10**9)]
        where = [f"{angle:.5f}" for angle in position[k]]
        lines.append(",".join([*stamp, "base", *names("wheel_joint_{}"), *where, *row[1:]]))
    return "\n".join([*lines, ""])


def quoted_text_columns() -> str:
    header = ["time", "mode", *names("velocity_{}"), *names("effort_{}"), "remark"]
    body = [[row[0], '"auto, slow"', *row[1:], '"a; b"'] for row in rows(LOG)]
    return joined(header, body)


def lists_in_cells() -> str:
    body = [
        [row[0], f'"[{", ".join(row[1:5])}]"', f'"[{", ".join(row[5:])}]"'] for row in rows(LOG)
    ]
    return joined(["time", "wheel_velocities", "wheel_torques"], body)


def shuffled_rows() -> str:
    lines = plain().split("\n")
    order = np.random.default_rng(4).permutation(len(lines) - 2) + 1
    return "\n".join([lines[0], *(lines[k] for k in order), ""])


def camel_case() -> str:
    wheels = ("FrontLeft", "FrontRight", "RearLeft", "RearRight")
    return joined(["Time", *names("wheelSpeed{}", wheels), *names("torque{}", wheels)], rows(LOG))


def missing_values() -> str:
    body = rows(LOG)
    for k in range(30, len(body), 97):
        body[k][3] = ("NaN", "", "null", "inf")[k % 4]
    return joined(["time", *names("velocity_{}"), *names("effort_{}")], body)


def milli_newton_metres() -> str:
    values = np.column_stack([LOG.time, LOG.velocity, 1e3 * LOG.effort])
    body = [[f"{number:.4f}" for number in row] for row in values]
    return joined(["time", *names("vel_{}_rad_s"), *names("{}_torque_mNm")], body)


def two_lines_of_header() -> str:
    above = ["time", *["velocity"] * 4, *["torque"] * 4]
    return joined(above, [["s", "FL", "FR", "RL", "RR", "FL", "FR", "RL", "RR"], *rows(LOG)])


def a_row_for_each_joint() -> str:
    body = [
        [row[0], f"wheel_joint_{wheel}", row[1 + k], row[5 + k]]
        for row in rows(LOG)
        for k, wheel in enumerate(WHEELS)
    ]
    return joined(["time", "joint", "velocity", "effort"], body)


def json_lines() -> str:
    lines = []
    for time, speeds, torques in zip(LOG.time, LOG.velocity, LOG.effort, strict=True):
        wheels = {"speed": speeds.tolist(), "torque": torques.tolist()}
        lines.append(json.dumps({"t": round(float(time), 4), "mode": "auto", "wheels": wheels}))
    return "\n".join(lines)


def days_of_a_spreadsheet() -> str:
    body = [[f"{45000 + LOG.time[k] / 86400:.10f}", *row[1:]] for k, row in enumerate(rows(LOG))]
    return joined(["time", *names("velocity_{}"), *names("effort_{}")], body)


def whole_seconds() -> str:
    body = [[f"{1_700_000_000 + int(row_time)}", *row[1:]] for row_time, row in timed()]
    return joined(["stamp", *names("velocity_{}"), *names("effort_{}")], body)


def timed() -> list[tuple[float, list[str]]]:
    return [(float(time) + 1e-6, row) for time, row in zip(LOG.time, rows(LOG), strict=True)]


def minutes_and_seconds() -> str:
    body = [[f"00:{time:06.3f}", *row[1:]] for time, row in timed()]
    return joined(["clock", *names("velocity_{}"), *names("effort_{}")], body)


def german_dates() -> str:
    body = [[f"04.03.2025 10:00:{time:06.3f}", *row[1:]] for time, row in timed()]
    body = [[cell.replace(".", ",") if k else cell for k, cell in enumerate(row)] for row in body]
    header = ["Datum", *names("Geschwindigkeit {}", ("VL", "VR", "HL", "HR"))]
    return joined([*header, *names("Moment {}", ("VL", "VR", "HL", "HR"))], body, ";")


def blanks_and_a_commented_header() -> str:
    lines = ["  ".join(f"{cell:>12}" for cell in row) for row in rows(LOG)]
    return "\n".join(["# log of robot 7", "# t w1 w2 w3 w4 tau1 tau2 tau3 tau4", *lines, ""])


LAYOUTS: dict[str, Callable[[], str]] = {
    "plain": plain,
    "semicolons": semicolons_and_decimal_commas,
    "tabs": tabs_and_a_row_of_units,
    "remarks": remarks_and_the_header_again,
    "milliseconds": milliseconds_in_the_header,
    "epoch_ms": epoch(1e-3),
    "epoch_us": epoch(1e-6),
    "epoch_ns": epoch(1e-9),
    "dates": dates,
    "plotjuggler": plotjuggler_half_empty,
    "rostopic": rostopic_echo,
    "ros2_topic": ros2_topic_echo,
    "quoted": quoted_text_columns,
    "lists": lists_in_cells,
    "shuffled": shuffled_rows,
    "camel_case": camel_case,
    "missing": missing_values,
    "milli": milli_newton_metres,
    "two_lines": two_lines_of_header,
    "a_joint_a_row": a_row_for_each_joint,
    "json_lines": json_lines,
    "days": days_of_a_spreadsheet,
    "whole_seconds": whole_seconds,
    "minutes": minutes_and_seconds,
    "german_dates": german_dates,
    "blanks": blanks_and_a_commented_header,
}
"""Layouts whose meaning is plain."""
