"""Names of a log's columns, and their choice from a table."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding, Level, LogError, fault
from identification.logs.parsing import LogTable
from identification.logs.settings import LogSettings
from youbot_env.errors import InputError

POSE = ("pose_x", "pose_y", "pose_yaw")
GYRO = ("gyro_z",)
REQUIRED_KINDS = ("velocity", "effort")
OPTIONAL_KINDS = ("position", "command")


def joint_columns(kind: str, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of one kind of channel: velocity_fl, ...; one axis, of joint "", has no suffix."""
    return tuple(f"{kind}_{joint}" if joint else kind for joint in joints)


def required_columns(
    joints: tuple[str, ...], kinds: tuple[str, ...] = REQUIRED_KINDS
) -> tuple[str, ...]:
    """Columns besides time without which a log is of no use."""
    return tuple(name for kind in kinds for name in joint_columns(kind, joints))


def optional_groups(
    joints: tuple[str, ...], required: tuple[str, ...] = REQUIRED_KINDS
) -> tuple[tuple[str, ...], ...]:
    """Groups of columns that a log may have, each only as a whole."""
    kinds = (*(kind for kind in REQUIRED_KINDS if kind not in required), *OPTIONAL_KINDS)
    return (*(joint_columns(kind, joints) for kind in kinds), POSE, GYRO)


@dataclass
class Draft:
    """A log between the file's table and the finished `Log`; the repairs change it in place.

    ``data`` is (n, channels) with NaN for what is missing, ``lines`` (n,) the line of the file that
    each row came from, ``valid`` (n,) whether every required channel of the row was measured.
    """

    source: str
    names: tuple[str, ...]
    time: NDArray[np.float64]
    data: NDArray[np.float64]
    lines: NDArray[np.int32]
    valid: NDArray[np.bool_]
    findings: list[Finding]
    required: tuple[str, ...]
    settings: LogSettings

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop all rows but these, a mask (n,)."""
        self.time, self.data = self.time[rows], self.data[rows]
        self.lines, self.valid = self.lines[rows], self.valid[rows]

    def channel(self, name: str) -> NDArray[np.float64]:
        """A view (n,) of one channel."""
        return self.data[:, self.names.index(name)]

    def channels(self, names: tuple[str, ...]) -> NDArray[np.float64] | None:
        """Some channels (n, k), a view where they are neighbours; None if the log lacks them."""
        if not set(names) <= set(self.names):
            return None
        places = [self.names.index(name) for name in names]
        first = places[0]
        if places == list(range(first, first + len(places))):
            return self.data[:, first : first + len(places)]
        return self.data[:, places]

    def drop_group_of(self, name: str, joints: tuple[str, ...]) -> None:
        """Drop the optional group of columns to which one belongs."""
        groups = optional_groups(joints, ())
        group = next(group for group in groups if name in group)
        kept = [i for i, other in enumerate(self.names) if other not in group]
        self.names = tuple(self.names[i] for i in kept)
        self.data = self.data[:, kept]

    def report(
        self,
        level: Level,
        message: str,
        cure: str,
        at: int | None = None,
        column: str | None = None,
    ) -> None:
        """Note a finding at one of the rows (an index, not a line of the file)."""
        row = None if at is None else int(self.lines[at])
        self.findings.append(Finding(level, message, row, column, cure))

    def fault(
        self, message: str, cure: str, at: int | None = None, column: str | None = None
    ) -> InputError:
        """The error to raise for a fault that cannot be repaired."""
        self.report("error", message, cure, at, column)
        return LogError(self.source, self.findings)


def select(
    source: str,
    table: LogTable,
    joints: tuple[str, ...],
    settings: LogSettings = LogSettings(),
    kinds: tuple[str, ...] = REQUIRED_KINDS,
) -> Draft:
    """The channels of a log, chosen from a file's table; of joints those of ``kinds`` at least.

    Raises
    ------
    InputError
        If a required column is missing or there is no row.
    """
    required, groups = required_columns(joints, kinds), optional_groups(joints, kinds)
    known = {"time", *required, *sum(groups, ())}
    for name in ("time", *required):
        if name not in table.names:
            raise _missing(source, table, name, known, joints)
    if len(table.values) == 0:
        raise fault(source, "has a header but no rows", "record it again")
    names, findings = list(required), list(table.findings)
    for group in groups:
        present = [name for name in group if name in table.names]
        if len(present) == len(group):
            names += group
        elif present:
            lacking = ", ".join(name for name in group if name not in present)
            message = f"{lacking} missing, so {', '.join(present)} is not used"
            findings.append(Finding("warning", message, cure="log the whole group"))
    for name in table.names:
        if name not in known:
            findings.append(Finding("info", "unknown column, not used", table.header_row, name))
    data = table.values[:, [table.names.index(name) for name in names]]
    # A copy, since repairs write into it; the choice of columns above copies already.
    time = table.values[:, table.names.index("time")].copy()
    valid = np.ones(len(data), bool)
    return Draft(
        *(source, tuple(names), time, data, table.lines, valid, findings, required, settings)
    )


def _missing(
    source: str, table: LogTable, name: str, known: set[str], joints: tuple[str, ...]
) -> InputError:
    strangers = {other.lower(): other for other in table.names if other not in known}
    # 0.75: similar enough for a spelling such as velocity_FL or velocities_fl.
    near = difflib.get_close_matches(name.lower(), strangers, 1, 0.75)
    cure = f"a log needs it; this one has {', '.join(table.names[:12])}"
    velocities = set(joint_columns("velocity", joints))
    efforts = set(joint_columns("effort", joints))
    wheels = [other for other in table.names if other.startswith("velocity_")]
    # With the three others as they should be, and one that is nearly this: a slip of the pen.
    misspelt = near and set(wheels) <= velocities and len(wheels) == 3
    if name in velocities and len(joints) == 4 and len(wheels) in (2, 3) and not misspelt:
        drive = {2: "a differential drive", 3: "a platform with three wheels"}[len(wheels)]
        cure = (
            f"{', '.join(wheels)} are those of {drive}: not this tool, which is for four mecanum "
            "wheels (fl, fr, bl, br); of one axis: --mechanism axis"
        )
    elif name in efforts and velocities <= set(table.names) and not efforts & set(table.names):
        cure = (
            "without efforts youbot kinematics alone reads a log (radius, arm, delay, slip); "
            "log the wheels' torques, or their currents and import them with a torque constant"
        )
    elif "velocity" in table.names and name.startswith("velocity_"):
        cure = "if it is the log of one axis, read it with --mechanism axis"
    elif near:
        cure = f"rename {strangers[near[0]]!r} to {name!r}, if that is meant"
    row = table.header_row
    return fault(source, "the column is missing", cure, row=row, column=name)
