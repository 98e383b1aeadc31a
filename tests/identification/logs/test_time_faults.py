"""Times that jitter, arrive late, are rounded or out of order, against rows that are lost."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from identification.logs.findings import LogError
from identification.logs.log import Log
from identification.logs.reading import read_log
from identification.logs.timebase import ordinal
from identification.logs.writing import write_table
from tests.identification.healthy import healthy_log
from youbot_env.physics.geometry import WHEELS

NAMES = ("time", *(f"{kind}_{w}" for kind in ("velocity", "effort") for w in WHEELS))
FINE = healthy_log(rate=500.0, duration=40.0)


def values_at(instants: np.ndarray) -> np.ndarray:
    """Speeds and efforts (n, 8) of a motion at some instants."""
    channels = np.hstack([FINE.velocity, FINE.effort])
    return np.column_stack([np.interp(instants, FINE.time, c) for c in channels.T])


def logged(path: Path, stamps: np.ndarray, instants: np.ndarray, decimals: int = 6) -> Log:
    """The log of values taken at instants and stamped as given."""
    write_table(path, NAMES, np.column_stack([stamps, values_at(instants)]), decimals)
    return read_log(path)


def repairs(log: Log) -> str:
    return " ".join(str(finding) for finding in log.findings if finding.level == "repaired")


def rising(times: np.ndarray) -> np.ndarray:
    """Messages come in order, however late."""
    return np.maximum.accumulate(times) + 2e-6 * np.arange(len(times))


@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0])
@pytest.mark.parametrize("jitter", [0.001, 0.003, 0.005])
def test_stamps_that_jitter_are_evened(tmp_path: Path, rate: float, jitter: float):
    rng = np.random.default_rng(1)
    even = np.arange(1.0, 35.0, 1 / rate)
    late = rising(even + jitter * rng.standard_normal(len(even)))
    log = logged(tmp_path / "log.csv", late, even)
    assert "taken as evenly sampled" in repairs(log)
    assert log.rate == pytest.approx(rate, rel=1e-3) and len(log) == len(even)
    np.testing.assert_allclose(log.velocity, values_at(even)[:, :4], atol=1e-5)


@pytest.mark.parametrize("jitter", [0.001, 0.003, 0.005])
def test_values_that_were_taken_at_jittering_times_are_resampled(tmp_path: Path, jitter: float):
    rng = np.random.default_rng(2)
    even = np.arange(1.0, 35.0, 0.02)
    at = rising(even + jitter * rng.standard_normal(len(even)))
    log = logged(tmp_path / "log.csv", at, at)
    assert re.search(r"interpolated to (50|49\.9)", repairs(log))
    smooth = values_at(log.time)[:, :4]
    assert np.sqrt(np.mean((log.velocity - smooth) ** 2)) < 0.03


def test_late_messages_are_no_missing_rows(tmp_path: Path):
    rng = np.random.default_rng(3)
    even = np.arange(1.0, 35.0, 0.01)
    for late in (rng.exponential(0.004, len(even)), 0.05 * (rng.random(len(even)) < 0.02)):
        log = logged(tmp_path / "log.csv", rising(even + late), even)
        assert "taken as evenly sampled" in repairs(log)
        assert len(log) == len(even)


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_lost_rows_are_inserted(tmp_path: Path, share: float):
    rng = np.random.default_rng(4)
    even = np.arange(1.0, 35.0, 0.01)
    kept = even[rng.random(len(even)) > share]
    log = logged(tmp_path / "log.csv", kept, kept)
    assert "missing row(s)" in repairs(log)
    assert log.rate == pytest.approx(100.0, rel=1e-6)


def test_bursts_are_refused_as_times_of_arrival(tmp_path: Path):
    even = np.arange(1.0, 35.0, 0.01)
    number = np.arange(len(even))
    for rows in (2, 4, 10):
        arrival = 1.0 + 0.01 * rows * (1 + number // rows) + 3e-4 * (number % rows)
        with pytest.raises(LogError, match=r"times of arrival.*header\.stamp"):
            logged(tmp_path / "log.csv", arrival, even)


def test_rounded_epochs_are_told(tmp_path: Path):
    even = np.arange(1.0, 35.0, 0.01)
    for stamps in (np.full(len(even), 1.7e9), 1.7e9 + np.floor(even / 8) * 8):
        with pytest.raises(LogError, match="an epoch in float32, or rounded by a spreadsheet"):
            logged(tmp_path / "log.csv", stamps, even)


def test_rows_out_of_order_are_sorted(tmp_path: Path):
    even = np.arange(1.0, 35.0, 0.01)
    moved = even.copy()
    for k in range(50, 3000, 100):
        moved[[k, k + 1]] = moved[[k + 1, k]]
    log = logged(tmp_path / "log.csv", moved, moved)
    assert "stand in another order than their times: sorted" in repairs(log)
    np.testing.assert_allclose(log.velocity, values_at(even)[:, :4], atol=1e-5)


def test_glued_nanoseconds_are_told(tmp_path: Path):
    even = np.arange(0.01, 30.0, 0.01)
    glued = np.array([float(f"{int(t)}.{round((t % 1) * 1e9)}") for t in even])
    with pytest.raises(LogError, match="glued without leading zeros"):
        logged(tmp_path / "log.csv", glued, even, 9)


def test_ordinals():
    numbers = (1, 2, 3, 4, 11, 12, 13, 21, 22, 103, 111)
    words = "1st 2nd 3rd 4th 11th 12th 13th 21st 22nd 103rd 111th"
    assert [ordinal(n) for n in numbers] == words.split()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("far", ["1e308", "-1e308", "1e17"])
def test_a_time_beyond_all_others_is_one_line(tmp_path: Path, far: str):
    stamps, path = np.arange(1.0, 13.0, 0.04), tmp_path / "log.csv"
    write_table(path, NAMES, np.column_stack([stamps, values_at(stamps)]))
    path.write_text(path.read_text().replace(f"{stamps[-1]:.6f},", f"{far},"))
    with pytest.raises(LogError, match="time"):
        read_log(path)
