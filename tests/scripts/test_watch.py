"""`youbot watch`: what is seen is what was driven."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from youbot_env.physics.geometry import Geometry
from youbot_scripts import cli
from youbot_scripts.evaluation.animation import LABEL, frames
from youbot_scripts.evaluation.conditions import LoopSettings, PlantSource, ReferenceMotion
from youbot_scripts.evaluation.watching import drive

pytest.importorskip("pygame")
Image = pytest.importorskip("PIL.Image")

SHORT = ["--seconds", "1", "--fps", "4", "--height", "160"]


def test_a_gif_shows_each_controller_beside_the_other(tmp_path: Path, capsys):
    path = tmp_path / "drive.gif"
    names = "kinematic,computed_torque"
    assert cli.main(["watch", "--controllers", names, *SHORT, "-o", str(path)]) == 0
    out = capsys.readouterr().out
    assert "kinematic" in out and f"animation: {path}" in out.replace("\n", "")
    with Image.open(path) as picture:
        assert picture.size == (2 * 240, 160 + LABEL)
        assert picture.n_frames == 10  # 2.5 s, the start included, at 4 a second
        assert picture.info["loop"] == 0 and picture.info["duration"] == 250
        picture.seek(9)
        last = np.asarray(picture.convert("RGB"), float)
    # The views differ: one lags behind its reference.
    assert np.abs(last[:, :240] - last[:, 240:]).mean() > 1.0


def test_an_mp4(tmp_path: Path):
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "drive.mp4"
    assert cli.main(["watch", "--controllers", "kinematic", *SHORT, "-o", str(path)]) == 0
    assert path.read_bytes()[4:8] == b"ftyp"
    assert list(tmp_path.iterdir()) == [path]


def test_same_seed_same_drive_and_the_plant_is_not_the_model():
    plant = PlantSource("paper", ("floor_tilt:tilt_x=0.05",))
    reference = ReferenceMotion((0.5, 3.0), duration=1.0)
    first, again = (
        drive(plant, "paper", ["computed_torque"], LoopSettings(), reference)["computed_torque"]
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.states, again.states)
    level = drive(plant, "known", ["computed_torque"], LoopSettings(), reference)
    assert (
        np.abs(first.twist - first.reference).max()
        > 2 * np.abs(level["computed_torque"].twist - level["computed_torque"].reference).max()
    )


def test_a_loop_that_diverged_stays_where_it_was():
    reference = ReferenceMotion((0.5, 3.0), duration=1.0)
    (trace,) = drive(PlantSource(), "known", ["kinematic"], LoopSettings(), reference).values()
    from dataclasses import replace

    short = replace(trace, states=trace.states[:30], diverged=0.3)
    pictures = list(frames({"a": short, "b": trace}, Geometry(), 10.0, 160))
    left = [np.asarray(picture)[LABEL:, :240] for picture in pictures]
    np.testing.assert_array_equal(left[-1], left[-2])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-o", "drive.avi"], "an animation is .gif or .mp4"),
        (["-o", "drive.gif", "--controllers", "kinematik"], "did you mean"),
        (["-o", "drive.gif", "--controllers", "a,b,c,d,e"], "4 are the most"),
        (["-o", "drive.gif", "--band", "0.5-1,1-2"], "one band"),
        (["-o", "drive.gif", "--model", "none.json"], "none.json"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["watch", *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
