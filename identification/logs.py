"""Logs of a platform or of one axis: read with checks and repairs, written reproducibly.

Format: CSV, CSV compressed by gzip, or Parquet, with a header, in SI units and one row a sample:
time, velocity_*, effort_* and, where a log has them, position_*, command_*, pose_x, pose_y,
pose_yaw, gyro_z. The names follow ROS JointState.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification import checks
from identification.columns import GYRO, POSE, Draft, joint_columns, select
from identification.findings import Finding, LogError, fault
from identification.formats import parser_for, read_bytes
from identification.noise import white_noise
from identification.repair import (
    fill_missing,
    mark_absurd,
    replace_outliers,
    trim_ends,
    unwrap_yaw,
)
from identification.timebase import check_time, resample
from identification.writing import DECIMALS, write_table
from youbot_env.errors import InputError
from youbot_env.geometry import WHEELS, Geometry

ENDINGS = (".csv.gz", ".csv", ".parquet")
AXIS = ("",)
"""The joints of a one-axis mechanism: one, whose columns have no suffix."""


@dataclass(frozen=True, eq=False)
class Log:
    """Uniformly sampled measurements of n instants and k joints.

    Attributes
    ----------
    name : stem of the file
    joints : (k,) names, in the order of the columns; WHEELS, or AXIS for a one-axis mechanism
    time : (n,) [s], increasing; its origin is arbitrary, and its steps carry the rounding of the
        file, so computations take `dt`
    velocity : (n, k) [rad/s]; of one axis also [m/s]
    effort : (n, k) [N m]; of one axis also [N]
    position : (n, k) [rad] or [m], command : (n, k) commanded effort, or None
    pose : (n, 3) x, y [m] and yaw [rad] in the world, yaw unwrapped; or None
    gyro_z : (n,) yaw rate [rad/s], or None
    source : path of the file, "" if made in memory
    sha256 : hash of the file's bytes, "" if made in memory
    findings : what the checks found
    valid : (n,) False where velocity or effort was interpolated by a repair
    rows : (n,) line of the file that each sample comes from
    file_time : (rows of the file,) time column as it stands, repairs or not

    All arrays are read-only.

    Raises
    ------
    InputError
        If a shape does not fit, a value is not finite or time does not increase.
    """

    name: str
    joints: tuple[str, ...]
    time: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    position: NDArray[np.float64] | None = None
    command: NDArray[np.float64] | None = None
    pose: NDArray[np.float64] | None = None
    gyro_z: NDArray[np.float64] | None = None
    source: str = ""
    sha256: str = ""
    findings: tuple[Finding, ...] = ()
    valid: NDArray[np.bool_] = None  # type: ignore[assignment] - all True
    rows: NDArray[np.int64] = None  # type: ignore[assignment] - from 2 on
    file_time: NDArray[np.float64] = None  # type: ignore[assignment] - time

    def __post_init__(self) -> None:
        n, k = np.size(self.time), len(self.joints)
        shapes = {"time": (n,), "gyro_z": (n,), "pose": (n, 3)}
        shapes |= dict.fromkeys(("velocity", "effort", "position", "command"), (n, k))
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, self._checked(name, value, shape))
        if n < 2 or not (np.diff(self.time) > 0).all():
            raise InputError(f"log {self.name}: time does not increase; sort the samples")
        defaults = {
            "valid": np.ones(n, bool),
            "rows": np.arange(2, n + 2),
            "file_time": self.time,
        }
        for name, default in defaults.items():
            value = getattr(self, name)
            object.__setattr__(self, name, _frozen(default if value is None else value))

    def _checked(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
        array = np.array(value, dtype=float)
        if array.shape != shape:
            raise InputError(f"log {self.name}: {name} has shape {array.shape}, not {shape}")
        if not np.isfinite(array).all():
            raise InputError(f"log {self.name}: {name} holds NaN or infinity; cut it out")
        return _frozen(array)

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def speed_noise(self) -> NDArray[np.float64]:
        """White noise (k,) of the speeds, as `identification.checks.noise_estimate` gives it."""
        return white_noise(self.velocity, self.valid)

    @property
    def warnings(self) -> list[str]:
        """What was repaired or looks wrong, a sentence each."""
        told = (f for f in self.findings if f.level in ("warning", "repaired"))
        return [f"{self.name}: {finding.message}" for finding in told]

    @property
    def reference(self) -> dict[str, str]:
        """How a model names the log that it was fitted on."""
        return {"name": self.name, "sha256": self.sha256}

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def rate(self) -> float:
        """Sample rate [Hz]."""
        return 1.0 / self.dt

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])


def _frozen(array: NDArray) -> NDArray:
    array = np.asarray(array)
    array.setflags(write=False)
    return array


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
) -> Log:
    """Read a log, check it and repair what small faults it has.

    Parameters
    ----------
    path : a .csv, .csv.gz or .parquet file
    joints : names of the joints; AXIS for a one-axis mechanism
    max_speed, max_effort : what no joint can reach [rad/s, N m]; 50 and 100 for wheels, and no
        limit for one axis, whose units may be others
    geometry : of the platform, to compare wheels with pose and gyro; the youBot's by default

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
    content = read_bytes(path)
    table = parser_for(path)(str(path), content)
    draft = select(str(path), table, tuple(joints))
    file_time = draft.time.copy()
    repair(draft, tuple(joints))
    log = _assemble(draft, tuple(joints), file_time, hashlib.sha256(content).hexdigest())
    limits = checks.limits_for(log, max_speed, max_effort, geometry)
    findings = (*draft.findings, *checks.check(log, limits))
    if any(finding.level == "error" for finding in findings):
        raise LogError(str(path), findings)
    object.__setattr__(log, "findings", findings)
    return log


def repair(draft: Draft, joints: tuple[str, ...]) -> None:
    """Bring a draft to finite channels on a uniform grid, or raise InputError."""
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
        file_time=file_time,
    )


def read_logs(
    paths: Iterable[str | os.PathLike[str]], joints: tuple[str, ...] = WHEELS, **options: object
) -> list[Log]:
    """Read several logs, whose names must differ. Options are those of `read_log`.

    Raises
    ------
    InputError
        If two files have one stem, no file is given, or one of them cannot be used.
    """
    paths = [Path(path) for path in paths]
    if not paths:
        raise InputError("no log given; name at least one .csv, .csv.gz or .parquet file")
    seen: dict[str, Path] = {}
    for path in paths:
        if log_name(path) in seen:
            other = seen[log_name(path)]
            raise fault(str(path), f"has the name of {other}", "rename one; results go by name")
        seen[log_name(path)] = path
    return [read_log(path, joints, **options) for path in paths]  # type: ignore[arg-type]


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
