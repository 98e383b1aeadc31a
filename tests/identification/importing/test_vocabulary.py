"""Names are understood whatever the order and the signs between their words."""

from __future__ import annotations

import pytest

from identification.importing.vocabulary import UNITS, meaning


@pytest.mark.parametrize(
    ("name", "quantity", "wheel", "unit"),
    [
        ("velocity_fl", "velocity", "fl", ""),
        ("Velocity_FR", "velocity", "fr", ""),
        ("/joint_states/wheel_joint_bl/velocity", "velocity", "bl", ""),
        ("velocity[rear_left]", "velocity", "bl", ""),
        ("rear_right_wheel_joint.effort", "effort", "br", ""),
        ("wheelSpeedFrontLeft", "velocity", "fl", ""),
        ("Drehzahl HL [1/min]", "velocity", "bl", "rpm"),
        ("omega_vr (rad/s)", "velocity", "fr", "rad/s"),
        ("speed_fl_rad_s", "velocity", "fl", "rad/s"),
        ("Left Front Speed [deg/s]", "velocity", "fl", "deg/s"),
        ("motor_current_rr [A]", "current", "br", "A"),
        ("i_fl_mA", "current", "fl", "mA"),
        ("torque_lr_mNm", "effort", "bl", "mN m"),
        ("posFL_ticks", "position", "fl", "count"),
        ("enc_rb", "position", "br", ""),
        ("time [s]", "time", "", "s"),
        ("t_us", "time", "", "us"),
        ("timestamp (ns)", "time", "", "ns"),
    ],
)
def test_names_say_quantity_wheel_and_unit(name: str, quantity: str, wheel: str, unit: str) -> None:
    found = meaning(name)
    assert (found.quantity, found.wheel, found.unit) == (quantity, wheel, unit)


@pytest.mark.parametrize("name", ["cmd_vel_fl", "velocity_fl_desired", "speed_setpoint_rr"])
def test_set_points_are_no_measurements(name: str) -> None:
    assert meaning(name).wanted


@pytest.mark.parametrize("name", ["x", "battery", "motor_a", "mode", "pose.position.z"])
def test_other_names_are_no_wheels(name: str) -> None:
    assert not meaning(name).wheel


def test_every_unit_has_a_size() -> None:
    assert all(factor > 0 for _, factor in UNITS.values())
