"""Maps: what is proposed can be written, read again and edited; mistakes are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.importing.import_map import Channels, Gyro, ImportMap, Pose, Time, read_map
from identification.importing.importing import import_source, open_source
from identification.importing.map_file import map_text
from tests.identification.importing.layouts import LOG, joined, names, plain, rows
from youbot_env.errors import InputError

WHOLE = ImportMap(
    Channels(tuple(names("/a:v[{}]")), "rpm", 25.84, (-1.0, 1.0, -1.0, 1.0), delay=0.05),
    Channels(tuple(names("/a:i[{}]")), "mA", 25.84, torque_constant=0.0335),
    Channels(tuple(names('/a:"odd\\ {}')), "count", 5.0, counts_per_turn=42.0),
    Channels(tuple(names("/c:µ[{}]")), "N m"),
    Pose(
        "/p:x",
        "/p:y",
        quaternion=tuple(f"/p:q.{axis}" for axis in "xyzw"),
        unit="mm",
        lever=(0.1, -0.2),
    ),
    Gyro("/i:z", "deg/s", -1.0, 0.01),
    Time("header.stamp", "", 100.0),
)


def test_a_map_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "robot.map.toml"
    remarks = {"velocity": ["why\nso"], "gyro": ["why not"]}
    path.write_text(map_text(WHOLE, remarks, ["head"]), encoding="utf-8")
    assert read_map(path) == WHOLE


def test_units_gear_and_constant_make_si_units() -> None:
    speed, current, counts = WHOLE.velocity, WHOLE.effort, WHOLE.position
    assert current is not None and counts is not None
    assert speed.factor() == pytest.approx(2 * np.pi / 60 / 25.84)
    assert current.factor() == pytest.approx(1e-3 * 0.0335 * 25.84)
    assert counts.factor() == pytest.approx(2 * np.pi / 42 / 5)


def edited(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "edited.toml"
    path.write_text(text, encoding="utf-8")
    return path


VELOCITY = '[velocity]\nfl = "a"\nfr = "b"\nbl = "c"\nbr = "d"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[velocity\n", "is no TOML"),
        ("version = 1\n", "velocity"),
        (VELOCITY + "gaer = 5\n", r"gaer: a map has no such key; gear is meant\?"),
        (VELOCITY + 'unit = "furlong"\n', "'furlong' is no unit of it; one of rad/s, "),
        (VELOCITY + "gear = -1.0\n", "gear"),
        (VELOCITY + "sign = [1, 1, 1]\n", "sign"),
        (VELOCITY + "sign = [1, 1, 1, 2]\n", "sign"),
        (VELOCITY.replace('"d"', '"a"'), "'a' is given for two wheels"),
        (VELOCITY + '[pose]\nx = "x"\ny = "y"\n', "give yaw, or quaternion"),
        (VELOCITY + "[time]\nrate = 1e9\n", "rate"),
        (VELOCITY + "[wheels]\n", "wheels: a map has no such key"),
        ("x = " + "[" * 5000, "is no TOML"),
    ],
)
def test_mistakes_in_a_map_are_named(text: str, message: str, tmp_path: Path) -> None:
    path = edited(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        read_map(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_map_that_names_a_missing_column(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(plain())
    chosen = read_map(edited(tmp_path, VELOCITY))
    with pytest.raises(InputError, match="has no column 'a'; the map must name one of time, "):
        import_source(open_source([log], chosen))


def test_currents_and_a_motors_speeds_become_torques_and_wheel_speeds(tmp_path: Path) -> None:
    """What `diagnose` needs is all in the map: unit, gear, constant, order, sign."""
    gear, constant = 25.84, 0.0335
    order = [3, 2, 1, 0]
    speeds = -LOG.velocity[:, order] * gear * 30 / np.pi
    currents = -LOG.effort[:, order] / gear / constant
    values = np.column_stack([LOG.time, speeds, currents])
    header = ["time", *(f"n{k}" for k in range(1, 5)), *(f"i{k}" for k in range(1, 5))]
    log = tmp_path / "motors.csv"
    log.write_text(joined(header, [[f"{number:.5f}" for number in row] for row in values]))
    of = {w: k for k, w in enumerate(("br", "bl", "fr", "fl"), 1)}
    text = "[velocity]\n" + "".join(f'{w} = "n{k}"\n' for w, k in of.items())
    text += f'unit = "rpm"\ngear = {gear}\nsign = [-1, -1, -1, -1]\n'
    text += "[effort]\n" + "".join(f'{w} = "i{k}"\n' for w, k in of.items())
    text += f'unit = "A"\ngear = {gear}\ntorque_constant = {constant}\nsign = [-1, -1, -1, -1]\n'
    made = import_source(open_source([log], read_map(edited(tmp_path, text)))).made
    assert np.allclose(made.channels["velocity"], LOG.velocity, atol=1e-4)
    assert np.allclose(made.channels["effort"], LOG.effort, atol=1e-4)


def test_a_rate_makes_a_uniform_log_without_aliases(tmp_path: Path) -> None:
    """A tone above half the new rate must not come back as a slower one."""
    time = np.arange(0, 20, 0.002)
    slow, fast = np.sin(2 * np.pi * time), np.sin(2 * np.pi * 90 * time)
    speeds = np.column_stack([slow + fast] * 4)
    body = [[f"{number:.5f}" for number in row] for row in np.column_stack([time, speeds])]
    log = tmp_path / "fast.csv"
    log.write_text(joined(["time", *names("velocity_{}")], body))
    text = "[velocity]\n" + "".join(f'{w} = "velocity_{w}"\n' for w in ("fl", "fr", "bl", "br"))
    chosen = read_map(edited(tmp_path, text + "[time]\nrate = 50\n"))
    made = import_source(open_source([log], chosen)).made
    inner = (made.time > 1) & (made.time < 19)
    assert np.allclose(np.diff(made.time), 0.02)
    left = made.channels["velocity"][inner] - np.sin(2 * np.pi * made.time[inner])[:, None]
    assert np.abs(left).max() < 0.01


def test_a_delay_of_the_map_is_undone(tmp_path: Path) -> None:
    header = ["time", *names("velocity_{}"), *names("effort_{}")]
    log = tmp_path / "late.csv"
    log.write_text(joined(header, rows(LOG)))
    source = open_source([log])
    text = source.map_text
    velocity = text.index("[velocity]")
    late = text[:velocity] + text[velocity:].replace("delay = 0.0", "delay = 0.03", 1)
    made = import_source(open_source([log], read_map(edited(tmp_path, late)))).made
    # The speed that was logged at t is that of t - 30 ms: three rows earlier.
    assert np.allclose(made.channels["velocity"], LOG.velocity[3:], atol=1e-4)
    assert np.allclose(made.channels["effort"], LOG.effort[:-3], atol=1e-4)


def test_a_map_of_another_version_is_one_line(tmp_path: Path):
    (tmp_path / "m.toml").write_text("version = 0\n[velocity]\nfl = 'a'\n")
    with pytest.raises(InputError, match="version 0 is none of 1"):
        read_map(tmp_path / "m.toml")
