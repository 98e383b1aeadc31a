"""Mutilated logs: each is refused in one line that helps, or repaired and reported.

Never another exception, never silently other data.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from identification.logs.findings import LogError
from identification.logs.log import Log
from identification.logs.reading import read_log
from tests.identification.logs.mutilations import (  # noqa: F401 - each registers its cases
    of_channels,
    of_file,
    of_optional_columns,
    of_table,
    of_time,
)
from tests.identification.logs.mutilations.cases import (
    CASES,
    HEALTHY,
    RICH,
    Case,
    Read,
    Refused,
    cells,
    text,
)
from youbot_env.errors import InputError


@pytest.mark.parametrize("mutilation", CASES, ids=lambda case: case.name)
def test_mutilated_log_is_refused_or_repaired_openly(mutilation: Case, tmp_path: Path) -> None:
    path = tmp_path / mutilation.file
    path.write_bytes(mutilation.content())
    expected = mutilation.expected
    if isinstance(expected, Refused):
        with pytest.raises(InputError) as caught:
            read_log(path)
        _check_refusal(caught.value, path, expected)
    else:
        _check_reading(read_log(path), expected, RICH if mutilation.rich else HEALTHY)


def _check_refusal(error: InputError, path: Path, expected: Refused) -> None:
    line = str(error)
    assert "\n" not in line and line.startswith(f"{path}: ")
    assert expected.words in line
    assert isinstance(error, LogError)
    finding = next(finding for finding in error.findings if finding.level == "error")
    assert finding.cure and finding.cure in line
    if expected.row is not None:
        assert finding.row == expected.row and f"row {expected.row}" in line
    if expected.column is not None:
        assert finding.column == expected.column and f"column {expected.column}" in line


def _check_reading(log: Log, expected: Read, undamaged: Log) -> None:
    if expected.level:
        found = [f for f in log.findings if expected.words in str(f) and f.level == expected.level]
        assert found, [str(finding) for finding in log.findings]
        assert expected.row is None or found[0].row == expected.row
    if expected.level in ("", "info"):
        assert {finding.level for finding in log.findings} <= {"info"}
    assert len(log) == expected.rows
    offset = len(undamaged) - len(log) if log.rows[0] == 2 + len(undamaged) - len(log) else 0
    twin = slice(offset, offset + len(log))
    for kind, rounding in (("velocity", 6e-5), ("effort", 6e-5)):
        error = np.abs(getattr(log, kind) - getattr(undamaged, kind)[twin]).max(axis=1)
        assert (error > rounding).sum() <= expected.changed
        assert error.max() < max(expected.tolerance, rounding)
        if expected.level == "repaired":
            assert (error[log.valid] < rounding).all() or expected.changed == len(HEALTHY)
    assert np.allclose(np.diff(log.time), undamaged.dt, atol=6e-4)
    if log.pose is not None and undamaged.pose is not None and expected.level != "repaired":
        turned = log.pose[:, 2] - undamaged.pose[:, 2]
        assert np.abs(turned - turned[0]).max() < 1e-3


def test_there_are_at_least_fifty_kinds() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 50


def test_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").mkdir()
    with pytest.raises(InputError, match="is a directory; name the logs in it"):
        read_log(tmp_path / "log.csv")


def test_no_such_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"log\.csv: no such file; check the path"):
        read_log(tmp_path / "log.csv")


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_log("a\0b.csv")


def test_no_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(text(cells(HEALTHY)))
    path.chmod(0)
    if os.access(path, os.R_OK):  # root reads all

        def forbid(*arguments: object) -> int:
            raise PermissionError(13, "Permission denied", str(path))

        monkeypatch.setattr(os, "open", forbid)
    with pytest.raises(InputError, match="no permission to read it; chmod"):
        read_log(path)


def test_dropped_zero_is_an_outlier_only_away_from_zero(tmp_path: Path) -> None:
    rows = cells(HEALTHY)
    at = 1 + int(np.argmax(np.abs(HEALTHY.velocity[:, 0])))
    rows[at][1] = "0.0000"
    (tmp_path / "log.csv").write_bytes(text(rows))
    log = read_log(tmp_path / "log.csv")
    assert [f.row for f in log.findings if f.level == "repaired"] == [at + 1]
    assert abs(log.velocity[at - 1, 0] - HEALTHY.velocity[at - 1, 0]) < 0.1
