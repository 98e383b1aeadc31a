"""Settings of the log checks: each has a unit and a reason, is checked once, and is obeyed."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from identification.logs.findings import LogError
from identification.logs.reading import read_log, write_log
from identification.logs.settings import LogSettings
from identification.signals.noise import NoiseSettings
from tests.identification.healthy import healthy_log
from youbot_env.errors import InputError

FIELDS = [item for item in fields(LogSettings) if item.name not in ("noise", "held", "kinematics")]


@pytest.mark.parametrize("item", FIELDS, ids=lambda item: item.name)
def test_a_setting_has_a_unit_and_a_reason(item):
    assert item.metadata["unit"] and item.metadata["reason"]


@pytest.mark.parametrize(
    "changes",
    [{"max_slip": 0.0}, {"min_rows": 2.5}, {"usual_speed_quantile": 1.0}, {"min_step": 1.0}],
)
def test_impossible_settings_are_refused(changes):
    with pytest.raises(InputError, match=next(iter(changes))):
        LogSettings(**changes)


def test_settings_are_obeyed(tmp_path: Path):
    path = tmp_path / "log.csv"
    write_log(path, healthy_log())
    usual = read_log(path)
    fewer = LogSettings(noise=NoiseSettings(max_samples=500))
    assert (read_log(path, settings=fewer).speed_noise != usual.speed_noise).any()
    with pytest.raises(LogError, match="record at least 1000 s of motion"):
        read_log(path, settings=LogSettings(min_motion_time=1000.0))
    slow = LogSettings(min_step=0.5, max_step=1.0)
    with pytest.raises(LogError, match="is above 0.002 kHz"):
        read_log(path, settings=slow)
