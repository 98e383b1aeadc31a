"""Settings of a fit: each has a unit and a reason, is checked once, and is obeyed."""

from __future__ import annotations

from dataclasses import Field, fields, is_dataclass, replace

import numpy as np
import pytest

from identification.fitting.identify import identify
from identification.fitting.settings import (
    FitSettings,
)
from identification.signals.filters import FilterSettings
from tests.identification.recordings import recording
from youbot_env.errors import InputError


def numbers_of(settings: object) -> list[Field]:
    """All numbers that somebody chose, those of nested settings among them."""
    assert is_dataclass(settings)
    found = []
    for item in fields(settings):
        value = getattr(settings, item.name)
        found += numbers_of(value) if is_dataclass(value) else [item]
    return found


FIELDS = numbers_of(FitSettings())


@pytest.mark.parametrize("item", FIELDS, ids=lambda item: item.name)
def test_a_setting_has_a_unit_and_a_reason(item):
    assert item.metadata["unit"] and item.metadata["reason"]


@pytest.mark.parametrize(
    "changes",
    [
        {"row_rate": 0.0},
        {"row_rate": np.nan},
        {"max_steps": 2.5},
        {"max_steps": 0},
        {"max_residual_memory": 1.0},
        {"recursive_forgetting": 1.1},
        {"output_error_step_shares": (1.0, -0.5)},
    ],
)
def test_impossible_settings_are_refused(changes):
    with pytest.raises(InputError, match=next(iter(changes))):
        FitSettings(**changes)


def test_settings_are_obeyed_and_printed():
    log = recording()
    settings = FitSettings(row_rate=10.0, rows_per_filter_rate=1.0, interval_deviations=3.0)
    found = identify([log], settings=settings, recursive=False)
    usual = identify([log], recursive=False)
    assert len(found.fit.rows[0].residual) == len(usual.fit.rows[0].residual) // 2
    written = found.to_dict()
    assert written["settings"] == settings.to_dict()
    assert written["settings"]["filter"]["rate"] == 10.0
    low, high = written["parameters"]["m0"]["interval"]
    assert high - low == pytest.approx(6 * written["parameters"]["m0"]["std"])
    slower = replace(settings, filter=FilterSettings(rate=5.0))
    other = identify([log], settings=slower, recursive=False).model.errors
    assert other["force_error"] != found.model.errors["force_error"]
