"""What differs between logs, or changes over all of them, is told beside the other variables."""

from collections.abc import Callable

import numpy as np
import pytest

from identification.residual_map.held_out_gain import FoldRows
from identification.residual_map.log_shares import log_shares
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import Share
from identification.residual_map.variables import MotionVariables
from identification.signals.filters import RowFilter

SETTINGS = ResidualMapSettings()
ROWS, STEP = 1500, 0.02


def shares(missing: Callable[[int, np.ndarray], np.ndarray], seed: int = 0) -> dict[str, Share]:
    """Of three logs of white noise, whose second column has the strength missing(log, share)."""
    rng = np.random.default_rng(seed)
    folds, variables, reductions = [], [], []
    for log in range(3):
        columns = rng.standard_normal((ROWS, 3, 2))
        over_all = (log + np.arange(ROWS) / ROWS) / 3
        residual = rng.standard_normal((ROWS, 3))
        residual += columns[..., 1] * missing(log, over_all)[:, None]
        folds.append(FoldRows(np.zeros((ROWS, 0)), columns, residual, 100))
        none = np.zeros((ROWS, 3))
        time = STEP * np.arange(ROWS, dtype=float)
        of_motion = (none, none, none, none, none, none, none, none, none, none)
        variables.append(MotionVariables((), (), (), time, *of_motion))
        reductions.append(RowFilter(10.0, 0.0, STEP, 1))
    found = log_shares(folds, variables, reductions, SETTINGS)
    return {item.variable: item for item in found}


def test_a_strength_of_one_log():
    found = shares(lambda log, time: np.full(ROWS, 1.0 if log == 1 else 0.0))
    assert found["log"].share == pytest.approx(0.18, abs=0.06)
    assert found["log"].share > 2 * found["shared_time"].share


def test_a_strength_that_falls_over_all_logs():
    found = shares(lambda log, time: 2.0 - 2.0 * time)
    assert found["shared_time"].share > found["log"].share > 0


def test_what_is_alike_in_all_logs_has_no_share():
    found = shares(lambda log, time: np.full(ROWS, 1.0))
    assert [item.share for item in found.values()] == [0.0, 0.0]


def test_a_log_alone_has_none():
    assert log_shares([], [], [], SETTINGS) == ()
