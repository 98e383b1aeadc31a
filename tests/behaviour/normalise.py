"""What a record leaves out: paths of this machine, how long a run took, versions of libraries.

Everything else that a command prints or writes is behaviour, and stays as it is.
"""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

DURATION, VERSION = "<duration>", "<version>"

DURATION_KEYS = {"wall_time", "cpu_time", "seconds", "seconds_median", "seconds_longest"}
"""JSON keys that hold how long a computation took. A log's `duration` is none of them."""

VERSION_KEYS = {"version", "versions"}

DURATIONS = (
    (re.compile(r"(\d steps,? +)\d+ s\b"), r"\1" + DURATION),  # train: each line, and the last one
    (re.compile(r"\(\d+ s of one core\)"), f"({DURATION} of one core)"),
    (re.compile(r"(seconds a case, (?:median|longest)) +[\d.e+-]+"), r"\1 " + DURATION),  # bench
)

VERSIONS = re.compile(
    r"\b(youbot|version|python|numpy|scipy|numba|torch|stable-baselines3) \d+\.\d+\.\d[\w.+]*"
)

# Where in the source a crash or a warning arose is no behaviour; that it arose is.
TRACEBACK = re.compile(r"(Traceback \(most recent call last\):\n)(?:(?: .*)?\n)*?(?=\S)")
WARNING = re.compile(r"^\S+\.py:\d+: (\w*Warning: .*)(?:\n  .*)?$", re.MULTILINE)

PICTURE = re.compile(r"data:[\w/+.-]+;base64,([A-Za-z0-9+/=]+)")

ROWS_KEPT = 25
"""Rows of a table that are kept as numbers; of the others the hash tells whether they changed."""

Paths = Mapping[str, str]
"""Word to write by the path that it stands for."""


def text(raw: str, paths: Paths) -> list[str]:
    """Lines of what was printed, without paths, durations and versions."""
    for path in sorted(paths, key=len, reverse=True):
        raw = raw.replace(path, paths[path])
    raw = WARNING.sub(r"\1", TRACEBACK.sub(r"\1", raw))
    for pattern, replacement in DURATIONS:
        raw = pattern.sub(replacement, raw)
    return VERSIONS.sub(rf"\1 {VERSION}", raw).splitlines()


def value(found: Any, paths: Paths) -> Any:
    """A JSON value without paths, durations and versions."""
    if isinstance(found, dict):
        return {key: _entry(key, item, paths) for key, item in found.items()}
    if isinstance(found, list):
        return [value(item, paths) for item in found]
    return "\n".join(text(found, paths)) if isinstance(found, str) else found


def _entry(key: str, item: Any, paths: Paths) -> Any:
    if key in VERSION_KEYS:
        return VERSION
    if key in DURATION_KEYS and isinstance(item, (int, float)):
        return DURATION
    return value(item, paths)


def file(path: Path, paths: Paths) -> Any:
    """What a file holds, in a form that can be compared: numbers where they can be read."""
    content = path.read_bytes()
    name = path.name.removesuffix(".gz")
    if name != path.name:
        content = gzip.decompress(content)
    if name.endswith(".json"):
        return value(json.loads(content), paths)
    if name.endswith(".csv"):
        return _table(content)
    if name.endswith((".html", ".txt", ".md", ".py")):
        return text(PICTURE.sub(_picture, content.decode()), paths)
    if name.endswith(".npz"):
        with zipfile.ZipFile(io.BytesIO(content)) as parts:  # an archive's own bytes hold times
            return {part: digest(parts.read(part)) for part in sorted(parts.namelist())}
    if name.endswith((".pt", ".zip")):
        return "present"  # a checkpoint holds how long the training took
    return digest(content)


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _picture(found: re.Match[str]) -> str:
    return f"<picture {digest(found[1].encode())}>"


def _table(content: bytes) -> dict[str, Any]:
    header, *rows = csv.reader(io.StringIO(content.decode()))
    kept = rows[:: max(1, len(rows) // ROWS_KEPT)]
    return {
        "sha256": digest(content),
        "columns": header,
        "rows": len(rows),
        "some": {
            name: [_number(row[k]) for row in kept if k < len(row)] for k, name in enumerate(header)
        },
    }


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell
