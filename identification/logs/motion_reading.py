"""Logs read for their motion alone: wheel speeds with a pose or a gyro, whether or not efforts."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from identification.kinematics.motion import Motion
from identification.logs.columns import GYRO, POSE, Draft, joint_columns, select
from identification.logs.findings import Finding, fault
from identification.logs.formats import parser_for, read_bytes
from identification.logs.log import Log
from identification.logs.reading import log_name
from identification.logs.repair import (
    fill_missing,
    mark_absurd,
    replace_outliers,
    trim_ends,
    unwrap_yaw,
)
from identification.logs.settings import LogSettings
from identification.logs.timebase import check_time, resample
from youbot_env.physics.geometry import WHEELS

_AS_MEASURED = (*POSE, *GYRO)
"""A pose may be slower than the log, or be lost for a while: what is missing stays missing."""


def read_motion(
    path: str | os.PathLike[str], settings: LogSettings = LogSettings()
) -> tuple[Motion, list[Finding]]:
    """Wheel speeds, and positions, pose and gyro where a log has them; and what was repaired.

    Units and signs are not judged: `kinematics.estimate_kinematics` finds them.

    Raises
    ------
    InputError
        If the file cannot be read, lacks time or a wheel's speed, or its time cannot be mended.
    """
    source = Path(path)
    table = parser_for(source)(str(source), read_bytes(source))
    draft = select(str(source), table, WHEELS, settings, ("velocity",))
    mark_absurd(draft)
    trim_ends(draft)
    irregular = check_time(draft)
    unwrap_yaw(draft)
    fill_missing(draft, WHEELS, _AS_MEASURED)
    replace_outliers(draft, _AS_MEASURED)
    if irregular:
        resample(draft)
    return _motion(draft), draft.findings


def read_motions(
    paths: Iterable[str | os.PathLike[str]], settings: LogSettings = LogSettings()
) -> list[tuple[Motion, list[Finding]]]:
    """Several logs, whose names must differ.

    Raises
    ------
    InputError
        If two have one name, none is given or one cannot be read.
    """
    found = [read_motion(path, settings) for path in paths]
    names = [motion.name for motion, _ in found]
    for name in names:
        if names.count(name) > 1:
            raise fault(name, "two logs have this name", "rename one; results go by name")
    return found


def motion_of(log: Log) -> Motion:
    """The motion of a log of wheels."""
    return Motion(log.name, log.time, log.velocity, log.pose, log.gyro_z, log.position, log.rows)


def _motion(draft: Draft) -> Motion:
    velocity = draft.channels(joint_columns("velocity", WHEELS))
    assert velocity is not None  # select() requires it
    gyro = draft.channels(GYRO)
    return Motion(
        log_name(draft.source),
        draft.time,
        velocity,
        draft.channels(POSE),
        None if gyro is None else gyro[:, 0],
        draft.channels(joint_columns("position", WHEELS)),
        draft.lines,
    )
