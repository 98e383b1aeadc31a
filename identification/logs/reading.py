"""Logs of a platform or of one axis: read with checks and repairs, written reproducibly.

Format: CSV, CSV compressed by gzip, or Parquet, with a header, in SI units and one row a sample:
time, velocity_*, effort_* and, where a log has them, position_*, command_*, pose_x, pose_y,
pose_yaw, gyro_z. The names follow ROS JointState.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identification.logs import checks
from identification.logs.columns import GYRO, POSE, Draft, joint_columns, select
from identification.logs.findings import Finding, LogError, fault
from identification.logs.formats import parser_for, read_bytes
from identification.logs.log import Log
from identification.logs.parsing import LogTable
from identification.logs.repair import (
    fill_missing,
    mark_absurd,
    replace_outliers,
    trim_ends,
    unwrap_yaw,
)
from identification.logs.settings import LogSettings
from identification.logs.timebase import check_time, resample
from identification.logs.writing import DECIMALS, write_table
from youbot_env.errors import InputError
from youbot_env.physics.geometry import WHEELS, Geometry

ENDINGS = (".csv.gz", ".csv", ".parquet")


def log_name(path: str | os.PathLike[str]) -> str:
    """A file's name without its folder and its ending."""
    name = Path(path).name
    ending = next((end for end in ENDINGS if name.lower().endswith(end)), "")
    return name[: len(name) - len(ending)]


def read_log(
    path: str | os.PathLike[str],
    joints: tuple[str, ...] = WHEELS,
    *,
    max_speed: float | None = None,
    max_effort: float | None = None,
    geometry: Geometry | None = None,
    settings: LogSettings = LogSettings(),
) -> Log:
    """Read a log, check it and repair what small faults it has.

    Parameters
    ----------
    path : a .csv, .csv.gz or .parquet file
    joints : names of the joints; AXIS for a one-axis mechanism
    max_speed, max_effort : what no joint can reach [rad/s, N m]; those of the settings for wheels,
        and no limit for one axis, whose units may be others
    geometry : of the platform, to compare wheels with pose and gyro; the youBot's by default
    settings : what is repaired, doubted and refused

    Returns
    -------
    Log
        Its ``findings`` tell what was repaired and what is doubtful.

    Raises
    ------
    InputError
        If the log cannot be used: one line with file, row, column and cure. It is a LogError, whose
        ``findings`` hold all that was found, wherever the fault is one of the file.
    """
    path = Path(path)
    log, found = _repaired(path, tuple(joints), settings)
    limits = checks.limits_for(log, max_speed, max_effort, geometry, settings)
    findings = (*found, *checks.check(log, limits))
    if any(finding.level == "error" for finding in findings):
        raise LogError(str(path), findings)
    # The checks need a finished log, and their findings belong into the same frozen log.
    object.__setattr__(log, "findings", findings)
    return log


def _repaired(
    path: Path, joints: tuple[str, ...], settings: LogSettings
) -> tuple[Log, list[Finding]]:
    """The log of a file, and what was found on the way.

    Of a long log each stage takes as much memory as the log itself, so none outlives its function.
    """
    draft, sha256 = _drafted(path, joints, settings)
    # Predictions are written at the times of the file, so they are kept before any repair.
    file_time = draft.time.copy()
    repair(draft, joints)
    return _assemble(draft, joints, file_time, sha256), draft.findings


def _drafted(path: Path, joints: tuple[str, ...], settings: LogSettings) -> tuple[Draft, str]:
    """The channels of a file, and its hash."""
    table, sha256 = _table(path)
    return select(str(path), table, joints, settings), sha256


def _table(path: Path) -> tuple[LogTable, str]:
    content = read_bytes(path)
    return parser_for(path, content)(str(path), content), hashlib.sha256(content).hexdigest()


def repair(draft: Draft, joints: tuple[str, ...]) -> None:
    """Bring a draft to finite channels on a uniform grid, or raise InputError.

    The order matters. Absurd numbers become missing ones before missing ones are counted. The time
    column is mended before gaps are filled, since gaps are measured in samples. Yaw is unwrapped
    before it is interpolated: between -pi and pi the mean would be a false heading. Outliers go
    before resampling, which would spread each of them over its neighbours.
    """
    mark_absurd(draft)
    trim_ends(draft)
    irregular = check_time(draft)
    unwrap_yaw(draft)
    fill_missing(draft, joints)
    replace_outliers(draft)
    if irregular:
        resample(draft)


def _assemble(
    draft: Draft, joints: tuple[str, ...], file_time: NDArray[np.float64], sha256: str
) -> Log:
    velocity, effort, position, command = (
        draft.channels(joint_columns(kind, joints))
        for kind in ("velocity", "effort", "position", "command")
    )
    assert velocity is not None and effort is not None  # select() requires them
    gyro = draft.channels(GYRO)
    # Kept once where no repair has changed it.
    unchanged = np.array_equal(draft.time, file_time)
    return Log(
        name=log_name(draft.source),
        joints=joints,
        time=draft.time,
        velocity=velocity,
        effort=effort,
        position=position,
        command=command,
        pose=draft.channels(POSE),
        gyro_z=None if gyro is None else gyro[:, 0],
        source=draft.source,
        sha256=sha256,
        valid=draft.valid,
        rows=draft.lines,
        file_time=None if unchanged else file_time,  # type: ignore[arg-type]
        noise_settings=draft.settings.noise,
    )


@dataclass(frozen=True)
class SetAside:
    """A log that cannot be used, while others can: its path and why."""

    log: str
    reason: str

    def __str__(self) -> str:
        return f"{self.log} set aside: {self.reason}"

    def to_dict(self) -> dict[str, str]:
        """JSON form."""
        return asdict(self)


def read_usable_logs(
    paths: Iterable[str | os.PathLike[str]],
    joints: tuple[str, ...] = WHEELS,
    *,
    strict: bool = False,
    **options: object,
) -> tuple[list[Log], list[SetAside]]:
    """Read several logs, whose names must differ; those that cannot be used are set aside.

    Parameters
    ----------
    strict : refuse all where one cannot be used
    options : those of `read_log`

    Raises
    ------
    InputError
        If two files have one stem, no file is given, or none can be used: with the first reason.
    """
    read: list[Log] = []
    aside: list[SetAside] = []
    first: InputError | None = None
    for path in _differing(paths):
        try:
            read.append(read_log(path, joints, **options))  # type: ignore[arg-type]
        except InputError as error:
            if strict:
                raise
            first = first or error
            aside.append(SetAside(str(path), str(error).removeprefix(f"{path}: ")))
    if first and not read:
        raise first
    return _without_copies(read, aside, strict), aside


def _without_copies(read: list[Log], aside: list[SetAside], strict: bool) -> list[Log]:
    """The logs of which no earlier one holds the same measurements; copies are set aside."""
    kept: list[Log] = []
    for log in read:
        twin = next((other for other in kept if _holds_the_same(log, other)), None)
        if twin is None:
            kept.append(log)
            continue
        reason = f"holds the same measurements as {twin.source}, which must not count twice"
        if strict:
            raise fault(log.source, reason, "give each log once")
        aside.append(SetAside(log.source, reason))
    return kept


def _holds_the_same(log: Log, other: Log) -> bool:
    """Whether a log's speeds are those of another one, or of a part of it."""
    if log.sha256 == other.sha256:
        return True
    short, long = sorted((log.velocity, other.velocity), key=len)
    # Noise never repeats: one row that is equal tells where the shorter one lies in the longer.
    row = len(short) // 2
    if not short[row].any():
        row = int(np.argmax(np.abs(short).max(axis=1)))
    for at in np.flatnonzero((long == short[row]).all(axis=1)).tolist():
        first = at - row
        inside = 0 <= first and first + len(short) <= len(long)
        if inside and np.array_equal(long[first : first + len(short)], short):
            return True
    return False


def read_logs(
    paths: Iterable[str | os.PathLike[str]], joints: tuple[str, ...] = WHEELS, **options: object
) -> list[Log]:
    """Read several logs, whose names must differ. Options are those of `read_log`.

    Raises
    ------
    InputError
        If two files have one stem, no file is given, or one of them cannot be used.
    """
    return read_usable_logs(paths, joints, strict=True, **options)[0]


def _differing(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """The paths, of which there is one at least and no two with one stem."""
    found = [Path(path) for path in paths]
    if not found:
        raise InputError("no log given; name at least one .csv, .csv.gz or .parquet file")
    seen: dict[str, Path] = {}
    for path in found:
        if log_name(path) in seen:
            other = seen[log_name(path)]
            if other == path:
                raise fault(str(path), "is given twice", "give each log once")
            raise fault(str(path), f"has the name of {other}", "rename one; results go by name")
        seen[log_name(path)] = path
    return found


def log_table(log: Log) -> tuple[list[str], NDArray[np.float64]]:
    """Names (c,) and values (n, c) of the columns that a log has, in the order of the format."""
    names, blocks = ["time"], [log.time[:, None]]
    for kind in ("velocity", "effort", "position", "command"):
        block = getattr(log, kind)
        if block is not None:
            names += joint_columns(kind, log.joints)
            blocks.append(block)
    if log.pose is not None:
        names += POSE
        blocks.append(log.pose)
    if log.gyro_z is not None:
        names += GYRO
        blocks.append(log.gyro_z[:, None])
    return names, np.hstack(blocks)


def write_log(path: str | os.PathLike[str], log: Log, *, decimals: int = DECIMALS) -> None:
    """Write a log as .csv, .csv.gz or .parquet, atomically and the same bytes every time.

    CSV rounds to `decimals`; Parquet keeps all digits and needs the extra youbot[parquet].

    Raises
    ------
    InputError
        If the file cannot be written, or its ending is none of the three.
    """
    write_table(path, *log_table(log), decimals)
