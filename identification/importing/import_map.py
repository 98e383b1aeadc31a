"""The map of an import: which column or field becomes which channel, and in which unit.

A map is a TOML file that is proposed, edited and given back. It holds names and numbers alone:
nothing in it is run.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identification.importing.vocabulary import (
    COUNTS,
    CURRENTS,
    OVER_GROUND,
    POSITION,
    UNITS,
    VELOCITY,
)
from identification.logs.findings import fault
from youbot_env.errors import InputError
from youbot_env.files import FileKind
from youbot_env.physics.hardware import WHEELS

UNKNOWN = "?"
"""The unit of a channel whose unit nobody knows yet: its numbers are kept as they stand."""

QUANTITIES = ("velocity", "effort", "position", "command")
ROW = "row"
"""As the time's column: rows are counted, at the map's rate."""

MAX_BYTES = 1 << 20


@dataclass(frozen=True)
class Channels:
    """Four columns of one quantity, in the order of WHEELS.

    Attributes
    ----------
    columns : references of the columns; see `tables.reference`
    unit : of the numbers in the file, as `vocabulary.UNITS` names it
    gear : turns of the motor per turn of the wheel; 1 where numbers are of the wheel
    sign : +1 or -1, of each wheel
    torque_constant : of the motor [N m/A], for currents
    counts_per_turn : of the encoder, for counts; of the motor where ``gear`` is not 1
    wheel_radius : for speeds over ground [m]
    delay : by which the channel comes late [s]; it is undone
    """

    columns: tuple[str, ...]
    unit: str
    gear: float = 1.0
    sign: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    torque_constant: float | None = None
    counts_per_turn: float | None = None
    wheel_radius: float | None = None
    delay: float = 0.0

    def lacks(self) -> str:
        """What the unit needs besides and the map does not say; "" if nothing."""
        if self.unit in CURRENTS and self.torque_constant is None:
            return "torque_constant"
        if self.unit in COUNTS and self.counts_per_turn is None:
            return "counts_per_turn"
        if self.unit in OVER_GROUND and self.wheel_radius is None:
            return "wheel_radius"
        return ""

    def factor(self) -> float:
        """What makes rad/s, N m or rad at the wheel of the file's numbers."""
        if self.unit == UNKNOWN:
            return 1.0
        quantity, factor = UNITS[self.unit]
        # A motor turns faster than the wheel by the gear, and its torque is less by the same.
        factor *= 1 / self.gear if quantity in (VELOCITY, POSITION) else self.gear
        factor *= self.torque_constant if self.unit in CURRENTS and self.torque_constant else 1.0
        factor /= self.counts_per_turn if self.unit in COUNTS and self.counts_per_turn else 1.0
        factor /= self.wheel_radius if self.unit in OVER_GROUND and self.wheel_radius else 1.0
        return factor


@dataclass(frozen=True)
class Pose:
    """Where the pose is.

    Attributes
    ----------
    x, y : references of the columns
    yaw : of the heading; "" where it is in the quaternion
    quaternion : references of x, y, z, w; () where there is none
    unit, yaw_unit : of the place and of the heading
    sign : +1 or -1 of x, y and yaw
    frame_yaw : what is added to the file's heading to have the robot's [rad], as
        `youbot kinematics` finds it
    lever : place of the tracked point in the robot's frame [m, m]; the pose becomes that of O
    delay : by which the pose comes late [s]; it is undone
    """

    x: str
    y: str
    yaw: str = ""
    quaternion: tuple[str, ...] = ()
    unit: str = "m"
    yaw_unit: str = "rad"
    sign: tuple[float, ...] = (1.0, 1.0, 1.0)
    frame_yaw: float = 0.0
    lever: tuple[float, ...] = (0.0, 0.0)
    delay: float = 0.0


@dataclass(frozen=True)
class Gyro:
    """Where the yaw rate is: reference, unit, sign and delay [s]."""

    z: str
    unit: str = "rad/s"
    sign: float = 1.0
    delay: float = 0.0


@dataclass(frozen=True)
class Time:
    """Which clock is read, and at which rate the log is written.

    Attributes
    ----------
    clock : name of the clock: "header.stamp", "received", or a column of a text file; "row" counts
        rows; "" takes the best one
    unit : of that column; "" for what it shows
    rate : of the log [Hz]; None for that of the wheels' channels
    """

    clock: str = ""
    unit: str = ""
    rate: float | None = None


@dataclass(frozen=True)
class ImportMap:
    """Which column becomes which channel; a part that the source does not have is None."""

    velocity: Channels
    effort: Channels | None = None
    position: Channels | None = None
    command: Channels | None = None
    pose: Pose | None = None
    gyro: Gyro | None = None
    time: Time = field(default_factory=Time)

    def references(self) -> list[str]:
        """Names of all columns that it reads, those of time aside."""
        found = [name for q in QUANTITIES if (c := self.of(q)) is not None for name in c.columns]
        if self.pose is not None:
            found += [self.pose.x, self.pose.y, self.pose.yaw, *self.pose.quaternion]
        if self.gyro is not None:
            found.append(self.gyro.z)
        return [name for name in found if name]

    def of(self, quantity: str) -> Channels | None:
        """The four channels of a quantity."""
        return getattr(self, quantity)


# --- reading ---------------------------------------------------------------------------------

_NUMBER = {"type": "number"}
_POSITIVE = {"type": "number", "exclusiveMinimum": 0}
_TEXT = {"type": "string", "maxLength": 500}
_COLUMNS = {"type": "array", "items": _TEXT, "minItems": 4, "maxItems": 4}


def _signs(count: int) -> dict[str, Any]:
    return {"type": "array", "items": _NUMBER, "minItems": count, "maxItems": count}


def _channels(quantity: str, units: Sequence[str]) -> dict[str, Any]:
    more: dict[str, Any] = {
        "effort": {"torque_constant": _POSITIVE},
        "position": {"counts_per_turn": _POSITIVE},
        "velocity": {"counts_per_turn": _POSITIVE, "wheel_radius": _POSITIVE},
    }.get("effort" if quantity == "command" else quantity, {})
    return {
        "type": "object",
        "properties": {
            **dict.fromkeys(WHEELS, _TEXT),
            "unit": {"enum": [*units, UNKNOWN]},
            "gear": _POSITIVE,
            "sign": _signs(4),
            "delay": _NUMBER,
            **more,
        },
        "required": list(WHEELS),
        "additionalProperties": False,
    }


def _of(*quantities: str) -> list[str]:
    return [unit for unit, (quantity, _) in UNITS.items() if quantity in quantities]


_SCHEMA = {
    "type": "object",
    "properties": {
        "version": {"enum": [1]},
        "time": {
            "type": "object",
            "properties": {
                "clock": _TEXT,
                "unit": {"enum": ["", *_of("time")]},
                "rate": {"type": "number", "minimum": 1, "maximum": 1e4},
            },
            "additionalProperties": False,
        },
        # Positions too: they are differenced.
        "velocity": _channels("velocity", _of("velocity", "position")),
        "effort": _channels("effort", _of("effort")),
        "command": _channels("command", _of("effort")),
        "position": _channels("position", _of("position")),
        "pose": {
            "type": "object",
            "properties": {
                "x": _TEXT,
                "y": _TEXT,
                "yaw": _TEXT,
                "quaternion": _COLUMNS,
                "unit": {"enum": _of("length")},
                "yaw_unit": {"enum": ["rad", "deg", "turn", "mrad"]},
                "sign": _signs(3),
                "frame_yaw": _NUMBER,
                "lever": {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2},
                "delay": _NUMBER,
            },
            "required": ["x", "y"],
            "additionalProperties": False,
        },
        "gyro": {
            "type": "object",
            "properties": {
                "z": _TEXT,
                "unit": {"enum": ["rad/s", "deg/s", "mrad/s", "turn/s", "rpm"]},
                "sign": _NUMBER,
                "delay": _NUMBER,
            },
            "required": ["z"],
            "additionalProperties": False,
        },
    },
    "required": ["velocity"],
    "additionalProperties": False,
}


def _build(content: dict[str, Any], source: str) -> ImportMap:
    for part in ("velocity", "effort", "position", "command", "pose", "gyro"):
        signs = content.get(part, {}).get("sign", 1)
        if any(abs(sign) != 1 for sign in (signs if isinstance(signs, list) else [signs])):
            raise InputError(f"[{part}] sign: {signs} holds others than 1 and -1")
    parts: dict[str, Any] = {}
    for quantity in QUANTITIES:
        if quantity in content:
            parts[quantity] = _channels_of(content[quantity], quantity)
    if "pose" in content:
        parts["pose"] = _pose_of(content["pose"])
    if "gyro" in content:
        parts["gyro"] = Gyro(**content["gyro"])
    return ImportMap(**parts, time=Time(**content.get("time", {})))


def _channels_of(given: Mapping[str, Any], quantity: str) -> Channels:
    default = {"effort": "N m", "command": "N m", "velocity": "rad/s", "position": "rad"}
    rest: dict[str, Any] = {"unit": default[quantity]}
    rest |= {name: value for name, value in given.items() if name not in WHEELS}
    if "sign" in rest:
        rest["sign"] = tuple(float(sign) for sign in rest["sign"])
    columns = tuple(given[wheel] for wheel in WHEELS)
    twice = next((column for column in columns if columns.count(column) > 1), None)
    if twice is not None:
        raise InputError(f"{quantity}: {twice!r} is given for two wheels")
    return Channels(columns, **rest)


def _pose_of(given: Mapping[str, Any]) -> Pose:
    found = dict(given)
    if ("yaw" in found) == ("quaternion" in found):
        raise InputError("pose: give yaw, or quaternion (x, y, z, w), and not both")
    for name in ("sign", "quaternion", "lever"):
        if name in found:
            found[name] = tuple(found[name])
    return Pose(**found)


MAP_FILE: FileKind[ImportMap] = FileKind("a map of an import", _SCHEMA, _build, version=None)
"""What a map may hold."""

_PARTS: dict[str, Any] = _SCHEMA["properties"]


def read_map(path: Path) -> ImportMap:
    """The map that a TOML file holds.

    Raises
    ------
    InputError
        If it cannot be read, is no TOML, or holds what no map has: names the key and the cure.
    """
    source = str(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise fault(source, "is too large for a map", "name the .toml file of the map")
        parsed = tomllib.loads(content.decode("utf-8"))
    except FileNotFoundError:
        cure = "`youbot import SOURCE... --show -o MAP.toml` writes a proposal"
        raise fault(source, "no such file", cure) from None
    except OSError as error:
        raise fault(source, error.strerror or str(error), "check the path") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise fault(source, f"is no TOML ({error})", "mend it there") from None
    _check_names(parsed, source)
    return MAP_FILE.from_content(parsed, source)


def _check_names(content: Mapping[str, Any], source: str) -> None:
    """Refuses keys that a map does not have, with those that are meant: the schema names none."""
    _check_known(content, list(_PARTS), source, "")
    for part, given in content.items():
        if isinstance(given, Mapping):
            _check_known(given, list(_PARTS[part].get("properties", {})), source, f"[{part}] ")
            _check_unit(given, part, source)


def _check_known(given: Mapping[str, Any], known: list[str], source: str, where: str) -> None:
    for name in given:
        if name not in known:
            close = difflib.get_close_matches(name, known, 1)
            cure = f"{close[0]} is meant?" if close else f"it has {', '.join(known)}"
            raise fault(source, f"{where}{name}: a map has no such key", cure)


def _check_unit(given: Mapping[str, Any], part: str, source: str) -> None:
    for name in ("unit", "yaw_unit"):
        allowed = _PARTS[part]["properties"].get(name, {}).get("enum", [])
        if name in given and given[name] not in allowed:
            cure = f"one of {', '.join(filter(None, allowed))}"
            raise fault(source, f"[{part}] {name}: {given[name]!r} is no unit of it", cure)
