"""Rows that are built while driving are those that the identification makes of the whole log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.computed_torque.online_regression import BASE_COUNT, OnlineRows, RowSettings
from controllers.interface import Loop
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.samples import Samples
from identification.signals.filters import FilterSettings, block_mean, first_order, settled
from tests.youbot_env.structures import model as structure
from youbot_env.model.model import Model
from youbot_env.motions.multisine import multisine

DT = 0.01


def samples(found: Model, seconds: float = 6.0) -> Samples:
    """A smooth motion at its samples, and torques that are held up to each of them."""
    time = np.arange(round(seconds / DT)) * np.float64(DT)
    motion = multisine(np.random.default_rng(3), duration=seconds + 3.0, ramp=1.0)
    twist = motion.twist(time + 1.0)
    yaw = DT * np.cumsum(twist[:, 2])
    pose = np.column_stack([0.1 * time, -0.2 * time, yaw])
    speed = found.geometry.wheel_speeds(twist)
    torque = np.random.default_rng(4).normal(size=(len(time), 4))
    angle = DT * np.cumsum(speed, axis=0)
    return Samples("drive", time, DT, twist, pose, angle, speed, torque)


def gather(rows: OnlineRows, drive: Samples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    found = []
    for k in range(len(drive)):
        place = np.concatenate([[drive.time[k]], drive.pose[k], drive.wheel_angle[k]])
        if rows.take(drive.twist[k], place, drive.torque[k], DT):
            found.append((rows.columns, rows.measured, rows.demand))
    columns, measured, demand = zip(*found, strict=True)
    return np.array(columns), np.array(measured), np.array(demand)


@pytest.mark.parametrize("case", ["base", "floor_tilt", "wheel_coulomb_friction"])
def test_columns_and_demand_are_the_identifications(case: str) -> None:
    found = structure(case)
    drive = samples(found)
    columns, measured, force = gather(OnlineRows(found, Loop(DT)), drive)
    mechanism = Mecanum(found.geometry, found.structure)
    demand = mechanism.demand(found.theta, drive)
    ends = demand.columns(range(BASE_COUNT))
    first = settled(FilterSettings.rate, DT) - 1
    size = round(RowSettings.row_time / DT)
    for i in range(BASE_COUNT):
        whole = block_mean(
            first_order(ends[i, 0], ends[i, 1], FilterSettings.rate, DT)[first:], size
        )
        scale = np.abs(whole).max()
        np.testing.assert_allclose(columns[:, :, i], whole[: len(columns)], atol=0.003 * scale)
    whole = block_mean(
        first_order(demand.force[0], demand.force[1], FilterSettings.rate, DT)[first:], size
    )[: len(columns)]
    believed = np.einsum("kai,i->ka", columns, found.theta[:BASE_COUNT]) + force - measured
    np.testing.assert_allclose(believed, whole, atol=0.003 * np.abs(whole).max())


@pytest.mark.parametrize("age", [0.0, 0.005, 0.013])
def test_the_force_is_filtered_as_held_and_taken_at_the_speeds_instant(age: float) -> None:
    found = structure("base")
    drive = samples(found, 3.0)
    _, measured, demand = gather(OnlineRows(found, Loop(DT, 0.0, age)), drive)
    np.testing.assert_allclose(measured, demand, atol=1e-9)
    mechanism = Mecanum(found.geometry, found.structure)
    held = mechanism.measured_force(drive)[1:]
    exact = first_order(held, held, FilterSettings.rate, DT)
    late = np.stack([np.interp(drive.time - age, drive.time, part) for part in exact.T], axis=1)
    whole = block_mean(
        late[settled(FilterSettings.rate, DT) - 1 :], round(RowSettings.row_time / DT)
    )
    np.testing.assert_allclose(demand, whole[: len(demand)], atol=1e-9)


def test_a_missing_speed_starts_the_filters_anew() -> None:
    found = structure("base")
    drive = samples(found, 3.0)
    twist = drive.twist.copy()
    twist[150] = np.nan
    broken = replace(drive, twist=twist)
    whole, _, _ = gather(OnlineRows(found, Loop(DT)), drive)
    some, _, _ = gather(OnlineRows(found, Loop(DT)), broken)
    assert np.isfinite(some).all()
    assert 8 <= len(whole) - len(some) <= 12, "half a second of rows is missing"
