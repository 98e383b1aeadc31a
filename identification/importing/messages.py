"""From the messages of a topic to a table: nested fields become columns named by their paths."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from identification.importing.settings import ImportSettings
from identification.importing.tables import RECEIVED, Array, Table
from identification.logs.findings import Finding, fault
from youbot_env.errors import optional_library

_BULKY = re.compile(
    r"Image|PointCloud|LaserScan|OccupancyGrid|Costmap|CameraInfo|Marker|Diagnostic|Log$|"
    r"ParameterEvent|MultiEchoLaserScan|Mesh|Octomap|Path$|RawAudio|CompressedVideo|SceneUpdate"
)
_SKIPPED = ("covariance", "__msgtype__")
STAMP = "header.stamp"
_ALIAS = re.compile(r"(^|[\s\[{,:-])[&*]\w")
_JOINT_LISTS = ("position", "velocity", "effort")


def is_bulky(kind: str) -> bool:
    """Whether messages of a type are pictures, scans, texts: nothing that a log is made of."""
    return bool(_BULKY.search(kind))


class TopicReader:
    """Gathers the messages of one topic.

    Transforms (tf) become a table for each pair of frames, other messages one table in all.
    """

    def __init__(self, source: str, topic: str, kind: str, settings: ImportSettings) -> None:
        self._source, self._topic, self._kind = source, topic, kind
        self._settings = settings
        self._rows: dict[str, _Rows] = {}
        self._notes: list[str] = []
        self._count = 0

    def add(self, received: int, message: Any) -> None:
        """Takes a message that arrived at a time [ns].

        Raises
        ------
        InputError
            If the topic has more messages than are read.
        """
        self._count += 1
        if self._count > self._settings.max_messages:
            cure = "cut the recording into pieces"
            raise fault(self._source, f"{self._topic} has too many messages", cure)
        # SQLite keeps values of any type in a column of numbers.
        if not isinstance(cast(object, received), int):
            cure = "it is damaged: record again, or repair it (ros2 bag reindex)"
            raise fault(self._source, f"{self._topic}: the time of a message is no number", cure)
        transforms = _field(message, "transforms")
        if transforms is None:
            self._of("").add(received, message, self._settings)
            return
        for transform in transforms:
            parent = str(_field(_field(transform, "header"), "frame_id") or "")
            child = str(_field(transform, "child_frame_id") or "")
            pair = f"[{parent.lstrip('/')}>{child.lstrip('/')}]"
            if len(self._rows) < self._settings.max_array or pair in self._rows:
                self._of(pair).add(received, transform, self._settings)

    def note(self, message: str) -> None:
        """Adds a remark on how the topic was read."""
        self._notes.append(message)

    def tables(self) -> list[Table]:
        """What was gathered."""
        found = []
        for pair, rows in self._rows.items():
            table = rows.table(self._source, self._topic + pair, self._kind)
            if table is not None:
                table.findings += [Finding("warning", message) for message in self._notes]
                found.append(table)
        return found

    def _of(self, pair: str) -> _Rows:
        return self._rows.setdefault(pair, _Rows())


class _Rows:
    """Numbers by field path, and the index of the message that each came from."""

    def __init__(self) -> None:
        self.received: list[int] = []
        self.stamps: list[float] = []
        self.numbers: dict[str, tuple[list[int], list[float]]] = {}
        self.texts: dict[str, str] = {}
        self.changing: set[str] = set()

    def add(self, received: int, message: Any, settings: ImportSettings) -> None:
        row = len(self.received)
        self.received.append(received)
        self.stamps.append(_stamp_of(message))
        for path, value in islice(_leaves(message, settings), settings.max_fields):
            if isinstance(value, str):
                if self.texts.setdefault(path, value) != value:
                    self.changing.add(path)
                continue
            rows, values = self.numbers.setdefault(path, ([], []))
            rows.append(row)
            values.append(value)

    def table(self, source: str, topic: str, kind: str) -> Table | None:
        if not self.numbers:
            return None
        columns: dict[str, Array] = {}
        for path, (rows, values) in self.numbers.items():
            column = np.full(len(self.received), np.nan)
            column[rows] = values
            column[~np.isfinite(column)] = np.nan
            columns[path] = column
        texts = {path: text for path, text in self.texts.items() if path not in self.changing}
        table = Table(source, topic, kind, columns, texts=texts)
        stamps = np.array(self.stamps)
        # A driver that leaves the stamp at zero, or at one value, has none.
        distinct = len(np.unique(stamps)) / max(len(stamps), 1)
        if np.isfinite(stamps).all() and distinct > ImportSettings.min_distinct_share:
            table.clocks[STAMP] = stamps
        elif len(stamps) > 1 and kind:
            table.note("no stamps of measurement: the times of arrival are taken")
        table.clocks[RECEIVED] = np.array(self.received, float) * 1e-9
        return table


def read_json_table(source: str, content: bytes, settings: ImportSettings) -> Table:
    """The table of a text of JSON objects, one a line or all in one list.

    Raises
    ------
    InputError
        If it is no JSON, or holds no objects with numbers.
    """
    try:
        text = content.decode("utf-8-sig")
        found = [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError):
        try:
            found = json.loads(content)
        except (ValueError, RecursionError) as error:
            cure = "write an object a line, or a list of objects"
            raise fault(source, f"begins as JSON and is none ({error})", cure) from None
    if len(found) == 1 and isinstance(found[0], list):
        found = found[0]
    return _table_of(source, "json", found if isinstance(found, list) else [], settings)


def looks_like_echo(content: bytes) -> bool:
    """Whether a text is what ``rostopic echo`` or ``ros2 topic echo`` prints: YAML documents."""
    start = content[: 1 << 14]
    fields = re.findall(rb"^ *[A-Za-z_]+:(?: .*)?$", start, re.MULTILINE)
    return b"\n---" in start and len(fields) > 3


def read_echo_table(source: str, content: bytes, settings: ImportSettings) -> Table:
    """The table of messages that were printed as YAML, with ``---`` between them.

    Raises
    ------
    InputError
        If ruamel.yaml is not installed (rosbags brings it), or no message can be read.
    """
    need = "the text of `ros2 topic echo` needs rosbags' YAML reader"
    reader = optional_library("ruamel.yaml", "import", need).YAML(typ="safe")
    found, damaged = [], 0
    texts = re.split(r"^---\s*$", content.decode("utf-8", errors="replace"), flags=re.MULTILINE)
    for text in texts:
        # No echo has aliases, and a few lines of them would stand for any number of lists.
        if _ALIAS.search(text):
            damaged += 1
        elif text.strip():
            try:
                found.append(reader.load(text))
            except Exception:  # its own kinds, and those of what it builds
                damaged += 1
    if damaged > len(found):
        cure = "record a bag: ros2 bag record, or echo with --csv"
        raise fault(source, "looks like echoed messages and is no YAML", cure)
    table = _table_of(source, "echo", found, settings)
    if damaged:
        table.note(f"{damaged} message(s) that are cut or damaged are left out")
    return table


def _table_of(source: str, kind: str, found: Sequence[Any], settings: ImportSettings) -> Table:
    """The table of messages of a text; nothing tells when they arrived."""
    rows = _Rows()
    for row, message in enumerate(found):
        if isinstance(message, Mapping):
            rows.add(row, message, settings)
    table = rows.table(source, "", "")
    if table is None:
        raise fault(source, "holds no objects with numbers", "write an object a line")
    table.kind = kind
    del table.clocks[RECEIVED]
    return table


def _field(message: Any, name: str) -> Any:
    """A field of a message, which is an object or, of JSON, a mapping; None if it has none."""
    if isinstance(message, Mapping):
        return message.get(name)
    return getattr(message, name, None)


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, Mapping):
        yield from ((str(name), value) for name, value in message.items())
    else:
        names = getattr(message, "__dataclass_fields__", ())
        yield from ((name, getattr(message, name)) for name in names)


def _stamp_of(message: Any) -> float:
    """The stamp of measurement [s], NaN where a message has none."""
    header = _field(message, "header")
    for stamp in (_field(header, "stamp"), _field(message, "stamp"), _field(message, "timestamp")):
        seconds = _seconds(stamp)
        if seconds > 0:
            return seconds
    return np.nan


def _seconds(stamp: Any) -> float:
    if stamp is None or isinstance(stamp, (str, bool)):
        return np.nan
    if isinstance(stamp, (int, float)):
        # Foxglove's and others' plain numbers: seconds, or nanoseconds since 1970.
        return _number(stamp) * (1e-9 if stamp > ImportSettings.max_epoch * 1e6 else 1.0)
    whole = next((v for n in ("sec", "secs") if (v := _field(stamp, n)) is not None), None)
    rest = next((v for n in ("nanosec", "nsec", "nsecs") if (v := _field(stamp, n)) is not None), 0)
    return np.nan if whole is None else _number(whole) + _number(rest) * 1e-9


def _leaves(message: Any, settings: ImportSettings, path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values of all numbers and texts in a message."""
    if not path and _is_joint_state(message):
        yield from _joints(message)
        return
    if not path and _field(message, "joint_names") is not None:
        yield from _interfaces(message)
    for name, value in _fields(message):
        if name.endswith(_SKIPPED) or (not path and name == "header"):
            continue
        yield from _values(f"{path}.{name}" if path else name, value, settings)


def _values(path: str, value: Any, settings: ImportSettings) -> Iterator[tuple[str, Any]]:
    if value is None:
        return
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        yield path, _number(value)
    elif isinstance(value, str):
        yield path, value
    elif isinstance(value, (np.ndarray, Sequence)):
        if isinstance(value, (bytes, bytearray)) or len(value) > settings.max_array:
            return
        for k, element in enumerate(value):
            yield from _values(f"{path}[{k}]", element, settings)
    elif path.count(".") < settings.max_array:
        yield from _leaves(value, settings, path)


def _is_joint_state(message: Any) -> bool:
    names = _field(message, "name")
    return len(_listed(names)) > 0 and any(
        _field(message, part) is not None for part in _JOINT_LISTS
    )


def _interfaces(message: Any) -> Iterator[tuple[str, Any]]:
    """Numbers by joint of messages that list their names beside: ros2_control's joint states."""
    names = [str(name) for name in _listed(_field(message, "joint_names"))]
    for part, value in _fields(message):
        if part == "interface_values":
            for name, one in zip(names, _listed(value), strict=False):
                said, values = (_listed(_field(one, n)) for n in ("interface_names", "values"))
                for interface, number in zip(said, values, strict=False):
                    yield f"{interface}[{name}]", _number(number)
            continue
        # Of a controller's state: one point of positions, velocities, efforts in the same order.
        for quantity in ("positions", "velocities", "effort"):
            values = _listed(_field(value, quantity))
            if len(values) == len(names):
                for name, number in zip(names, values, strict=True):
                    yield f"{part}.{quantity}[{name}]", _number(number)


def _listed(value: Any) -> Sequence[Any] | NDArray[Any]:
    """A list of a message; an empty one for what a damaged text has in its place."""
    known = isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, (str, bytes))
    return value if known else ()


def _number(value: Any) -> float:
    """A number of a message; NaN, as of one that is missing, for what a damaged text has there."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def _joints(message: Any) -> Iterator[tuple[str, Any]]:
    """Numbers of a JointState by the names of the joints, whose order may change."""
    names = [str(name) for name in _field(message, "name")]
    for part in _JOINT_LISTS:
        values = _listed(_field(message, part))
        # Lists that a driver leaves empty, or fills for some of the joints only, are not read.
        if len(values) != len(names):
            continue
        for name, value in zip(names, values, strict=True):
            yield f"{part}[{name}]", _number(value)
