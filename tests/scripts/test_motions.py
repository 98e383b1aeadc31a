"""`youbot motions`: files for a real robot."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from youbot_env.motions.multisine import multisine
from youbot_env.motions.set_points import COLUMNS
from youbot_scripts import cli


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_set_points_for_another_robot(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lengths = {"l": 0.169, "h": 0.2, "R": 0.07, "r": 0.02, "m1": 1.0}
    (here / "robot.json").write_text(json.dumps(lengths))
    arguments = ["--geometry", "robot.json", "--rate", "20", "--motions", "I,multisine_a"]
    assert cli.main(["motions", "drive", *arguments, "--wheel-speed", "6"]) == 0
    shown = capsys.readouterr().out
    assert "multisine_a" in shown and "slowed to" in shown and "floor" in shown
    names = (here / "drive" / "I.csv").read_text().split("\n", 1)[0]
    assert names == ",".join(COLUMNS)
    values = np.loadtxt(here / "drive" / "I.csv", delimiter=",", skiprows=1)
    assert np.abs(values[:, 4:]).max() == pytest.approx(6.0, abs=0.01)
    told = json.loads((here / "drive" / "motions.json").read_text())["motions"]
    assert told["I"]["floor"]["size"][0] > 0.8


def test_pictures_are_drawn(here: Path) -> None:
    pytest.importorskip("matplotlib")
    assert cli.main(["motions", "drive", "--motions", "III", "--rate", "20"]) == 0
    assert (here / "drive" / "III.png").read_bytes().startswith(b"\x89PNG")


def test_the_motion_that_a_diagnosis_proposes(here: Path) -> None:
    motion = multisine(np.random.default_rng(3), duration=20.0, name="next")
    (here / "next.json").write_text(json.dumps(motion.to_dict()))
    assert cli.main(["motions", "drive", "--next-motion", "next.json", "--rate", "50"]) == 0
    values = np.loadtxt(here / "drive" / "next.csv", delimiter=",", skiprows=1)
    assert values[400, 1:4] == pytest.approx(motion.twist(values[400, 0] - 2.0), abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--motions", "V"], "'V': not known"),
        (["--rate", "0"], "--rate"),
        (["--wheel-speed", "-1"], "wheel_speed"),
        (["--geometry", "no.json"], "no.json"),
        (["--next-motion", "no.json"], "no.json"),
    ],
)
def test_mistakes_write_nothing(
    arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["motions", "drive", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (here / "drive").exists()
