"""Columns that belong together: four wheels of one quantity, a pose, a yaw rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identification.importing.tables import Array, Table, reference
from identification.importing.vocabulary import (
    EFFORT,
    VELOCITY,
    Meaning,
    is_rough,
    meaning,
    unit_in_name,
    words_of,
)
from youbot_env.physics.hardware import WHEELS

_LETTERS = {
    "w": VELOCITY,
    "v": VELOCITY,
    "n": VELOCITY,
    "i": "current",
    "m": EFFORT,
    "u": "voltage",
}
"""Symbols that people write for a quantity; weaker than a word."""

_NO_PLACE = frozenset(
    [
        "velocity",
        "vel",
        "speed",
        "linear",
        "angular",
        "twist",
        "force",
        "torque",
        "acceleration",
        "accel",
        "covariance",
        "orientation",
        "rotation",
        "quaternion",
        "quat",
        "magnetic",
        "gravity",
        "scale",
        "normal",
        "std",
        "goal",
        "target",
        "cmd",
        "command",
        "desired",
        "setpoint",
        "reference",
        "plan",
    ]
)
_YAW = frozenset(["yaw", "heading", "theta", "psi"])
_ROTATION = frozenset(["orientation", "rotation", "quaternion", "quat", "q", "rot"])
_TRUE_POSE = frozenset(
    [
        "mocap",
        "vicon",
        "optitrack",
        "natnet",
        "qualisys",
        "truth",
        "gt",
        "tracker",
        "vrpn",
        "capture",
        "motive",
        "world",
    ]
)
_FROM_WHEELS = frozenset(["odom", "odometry"])
_NO_GYRO = frozenset(
    ["odom", "odometry", "cmd", "twist", "desired", "command", "setpoint", "covariance", "mag"]
)


@dataclass(frozen=True)
class WheelGroup:
    """Four columns of one quantity, one a wheel.

    Attributes
    ----------
    quantity : "velocity", "effort", "current", "position", "voltage", or "" if no name says it
    columns : references (4,), in the order of WHEELS
    tables : their tables (4,)
    names : of the columns (4,)
    by_number : whether they are numbered, so that their order is assumed
    wanted : whether they are set points
    unit : as the header states it, "" if it does not
    """

    quantity: str
    columns: tuple[str, ...]
    tables: tuple[Table, ...]
    names: tuple[str, ...]
    by_number: bool
    wanted: bool
    unit: str

    @property
    def values(self) -> list[Array]:
        """Their numbers, an array a wheel: of topics of their own they differ in length."""
        return [t.columns[name] for t, name in zip(self.tables, self.names, strict=True)]

    @property
    def peak(self) -> float:
        """Largest magnitude of any of them, outliers aside."""
        known = [np.abs(v[np.isfinite(v)]) for v in self.values]
        return max((float(np.quantile(v, 0.995)) for v in known if len(v)), default=0.0)

    @property
    def is_joint_state(self) -> bool:
        """Whether the type of the message says what the numbers are."""
        return "JointState" in self.tables[0].kind


def column_meaning(table: Table, column: str) -> Meaning:
    """What column and topic say together; the column goes first."""
    own, of_topic = meaning(column), meaning(table.topic)
    found = replace(
        own,
        quantity=own.quantity or of_topic.quantity,
        wheel=own.wheel or of_topic.wheel,
        number=own.number if own.number is not None else of_topic.number,
        wanted=own.wanted or of_topic.wanted,
        unit=table.units.get(column, "") or own.unit or of_topic.unit,
        rest=own.rest if own.wheel or own.number is not None else of_topic.rest + own.rest,
    )
    if not found.quantity:
        letters = [word for word in found.rest if word in _LETTERS]
        if letters:
            rest = tuple(word for word in found.rest if word != letters[0])
            found = replace(found, quantity=_LETTERS[letters[0]], rest=rest)
    return found


def wheel_groups(tables: list[Table]) -> list[WheelGroup]:
    """All complete groups of four wheels, the most likely ones first."""
    named: dict[tuple, dict[str, tuple[Table, str]]] = {}
    numbered: dict[tuple, dict[int, tuple[Table, str]]] = {}
    for table in tables:
        # Four topics, one a wheel, are one group; else a group lies within one table.
        split = bool(meaning(table.topic).wheel) or meaning(table.topic).number is not None
        home = "" if split else (table.source, table.topic)
        for column in table.columns:
            found = column_meaning(table, column)
            if found.quantity in ("time", "temperature", "acceleration", "yaw"):
                continue
            key = (home, found.quantity, found.wanted, found.rest, found.unit)
            if found.wheel:
                named.setdefault(key, {}).setdefault(found.wheel, (table, column))
            elif found.number is not None and not _ROTATION & set(found.rest):
                numbered.setdefault(key, {}).setdefault(found.number, (table, column))
    groups = [
        _group(key, [members[wheel] for wheel in WHEELS], by_number=False)
        for key, members in named.items()
        if set(members) == set(WHEELS)
    ]
    groups += [
        _group(key, [members[k] for k in sorted(members)], by_number=True)
        for key, members in numbered.items()
        if sorted(members) in ([0, 1, 2, 3], [1, 2, 3, 4])
    ]
    return sorted(groups, key=_score, reverse=True)


def _group(key: tuple, members: list[tuple[Table, str]], by_number: bool) -> WheelGroup:
    _, quantity, wanted, _, unit = key
    tables, names = zip(*members, strict=True)
    columns = tuple(reference(table, name) for table, name in members)
    return WheelGroup(quantity, columns, tables, names, by_number, wanted, unit)


def _score(group: WheelGroup) -> tuple[bool, int]:
    words = set(words_of(group.names[0])) | set(words_of(group.tables[0].topic))
    score = 2 * group.is_joint_state + 2 * (not group.by_number) - 3 * is_rough(group.names[0])
    score += "wheel" in words or "wheels" in words
    score -= bool(_FROM_WHEELS & words)
    return group.peak > 0, score


@dataclass(frozen=True)
class PoseGroup:
    """Columns of a pose: references of x, y, and of yaw or of a quaternion x, y, z, w."""

    table: Table
    x: str
    y: str
    yaw: str = ""
    quaternion: tuple[str, ...] = ()
    score: int = 0

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all its columns."""
        return (self.x, self.y, *([self.yaw] if self.yaw else self.quaternion))


def pose_groups(tables: list[Table]) -> list[PoseGroup]:
    """All poses, the most likely one first: capture systems before odometry."""
    found = [group for table in tables for group in _poses_of(table)]
    return sorted(found, key=lambda group: group.score, reverse=True)


def _poses_of(table: Table) -> Iterator[PoseGroup]:
    axes: dict[tuple[str, ...], dict[str, str]] = {}
    for column in table.columns:
        stem, axis = _axis(column)
        if axis:
            axes.setdefault(stem, {}).setdefault(axis, column)
    headings = [column for column in table.columns if _is_heading(column)]
    rotations = [
        (stem, tuple(members[a] for a in "xyzw"))
        for stem, members in axes.items()
        if set("xyzw") <= set(members)
    ]
    for stem, members in axes.items():
        words = set(stem)
        if not {"x", "y"} <= set(members) or words & _NO_PLACE or "w" in members:
            continue
        topic = set(words_of(table.topic))
        if (words | topic) & frozenset(["goal", "target", "cmd", "plan", "desired", "setpoint"]):
            continue
        score = _pose_score(table, words | topic)
        heading = max(headings, key=lambda name: _common(stem, words_of(name)), default="")
        turned = max(rotations, key=lambda one: _common(stem, one[0]), default=None)
        if turned is not None:
            yield PoseGroup(table, members["x"], members["y"], "", turned[1], score)
        elif heading:
            yield PoseGroup(table, members["x"], members["y"], heading, (), score)


def _axis(column: str) -> tuple[tuple[str, ...], str]:
    """The words before the axis that a name ends in, and that axis; "" if it ends in none."""
    words = _words(column)
    last = words[-1] if words else ""
    if last in ("x", "y", "z", "w"):
        return words[:-1], last
    if len(last) == 2 and last[0] in "pqrt" and last[1] in "xyzw":
        return (*words[:-1], last[0]), last[1]
    return (), ""


def _words(column: str) -> tuple[str, ...]:
    """Words of a column's name without the unit that it states."""
    return words_of(unit_in_name(column)[0])


def _is_heading(column: str) -> bool:
    words = _words(column)
    return bool(words and _YAW & set(words)) and not set(words) & frozenset(
        ["rate", "velocity", "vel", "dot", "speed", "omega", "cmd", "desired"]
    )


def _common(one: tuple[str, ...], other: tuple[str, ...]) -> int:
    """Number of words that two names begin with alike."""
    count = 0
    for a, b in zip(one, other, strict=False):
        if a != b:
            break
        count += 1
    return count


def _pose_score(table: Table, words: set[str]) -> int:
    score = 3 * bool(_TRUE_POSE & words)
    score += 2 * any(kind in table.kind for kind in ("PoseStamped", "PoseWithCov", "PoseInFrame"))
    score -= 3 * (bool(_FROM_WHEELS & words) or "Odometry" in table.kind)
    moves = any(
        np.ptp(values[np.isfinite(values)]) > 0
        for name, values in table.columns.items()
        if _axis(name)[1] in ("x", "y") and np.isfinite(values).any()
    )
    return score + 10 * moves


def gyro_columns(tables: list[Table]) -> list[tuple[Table, str]]:
    """Columns that look like a gyro's yaw rate, the most likely one first."""
    found = []
    for table in tables:
        topic = set(words_of(table.topic))
        for column in table.columns:
            words = _words(column)
            score = _gyro_score(table, words, topic)
            if score:
                found.append((score, table, column))
    found.sort(key=lambda one: -one[0])
    return [(table, column) for _, table, column in found]


def _gyro_score(table: Table, words: tuple[str, ...], topic: set[str]) -> int:
    said = set(words)
    if (said | topic) & _NO_GYRO or "Odometry" in table.kind or "Twist" in table.kind:
        return 0
    of_imu = "Imu" in table.kind or bool((said | topic) & {"imu", "gyro", "gyroscope"})
    about_z = words[-1:] == ("z",) or bool(said & {"gz", "wz", "gyroz"})
    turns = bool(said & {"angular", "gyro", "gyroscope", "omega", "gz", "wz", "gyroz", "gyr"})
    yaw_rate = bool({"yaw", "heading"} & said) and bool(
        {"rate", "velocity", "vel", "dot", "speed"} & said
    )
    if of_imu and about_z and turns:
        return 3
    if yaw_rate or "yawrate" in said:
        return 2
    return 1 if about_z and turns and not topic else 0
