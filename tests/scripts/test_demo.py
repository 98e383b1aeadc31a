"""The demo: the whole story from any folder, within its time, and honest when a step fails."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from identification.references import recorded_motion
from youbot_env.model_file import load_model
from youbot_scripts import cli, demo
from youbot_scripts.cli import main

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """A folder in which `youbot demo` ran with cold kernels, and what it printed."""
    folder = tmp_path_factory.mktemp("elsewhere")
    before = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "youbot_scripts.cli", "demo"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "YOUBOT_CACHE_DIR": str(folder / "cache")},
    )
    seconds = time.perf_counter() - before
    assert (done.returncode, done.stderr) == (0, "")
    assert seconds < 90, "16 s on two idle cores; others may be at work"
    yield folder / "demo_output", done.stdout


def test_tells_the_story_in_order(shown: tuple[Path, str]):
    _, out = shown
    chapters = [out.index(f"{k}. {title}") for k, title in enumerate(demo.STEPS, 1)]
    commands = [out.index(f"$ youbot {name}") for name in ("doctor", "identify", "compare")]
    assert chapters == sorted(chapters)
    assert commands == sorted(commands)
    assert "Nothing is missing from it." in out


def test_finds_the_truth(shown: tuple[Path, str]):
    folder, out = shown
    found, true = load_model(folder / "model.json"), load_model("paper")
    for name, estimate in found.parameters.items():
        assert estimate.std is not None
        assert abs(estimate.value - true.parameters[name].value) < 3 * estimate.std, name
    compared = json.loads((folder / "compare.json").read_text())
    assert compared["logs"]["multisine_b"]["seen_in_fit"] is False
    assert compared["total"]["velocity_error"] < 1.1 * compared["noise_floor"]["velocity_error"]
    assert "of 7 true values lie within" in out


def test_lists_what_it_wrote_and_nothing_else(shown: tuple[Path, str]):
    folder, out = shown
    written = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    listed = out[out.index("What there is now") : out.index("What to type next")]
    assert {line.strip() for line in listed.splitlines()[2:] if line} == written
    plots = {"forces_calibration", "motion_calibration", "estimates"}
    plots |= {f"{kind}_multisine_b" for kind in ("free_run", "where", "tracking")}
    assert {name for name in written if name.startswith("plots/")} == {
        f"plots/{name}.png" for name in plots
    }


def test_what_to_type_next_can_be_typed(shown: tuple[Path, str], monkeypatch):
    """Each line parses as a command of this version; those on the demo's own files run."""
    folder, out = shown
    monkeypatch.chdir(folder.parent)
    monkeypatch.setenv("YOUBOT_CACHE_DIR", str(folder.parent / "cache"))
    tail = out[out.index("What to type next") :]
    lines = [line.strip() for line in tail.splitlines() if line.strip().startswith("youbot ")]
    assert len(lines) >= 4
    for line in lines:
        arguments = shlex.split(line)[1:]
        assert arguments[0] in cli.available()
        if all(not argument.startswith(("runs/", "my_log")) for argument in arguments):
            assert main(arguments) == 0, line


def test_without_matplotlib_the_story_is_told_without_plots(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["demo", "--output", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert 'pip install "youbot[plots]"' in printed and "--plots" not in printed
    assert not (tmp_path / "out" / "plots").exists()


def test_the_readme_s_picture_is_what_the_demo_draws(shown: tuple[Path, str]):
    """`make figures` renews it; other releases of matplotlib may move a letter."""
    name = "free_run_multisine_b.png"
    committed = ROOT / "docs" / "figures" / name
    assert committed.stat().st_size < 200_000
    pictures = []
    for path in (committed, shown[0] / "plots" / name):
        with Image.open(path) as picture:
            pictures.append(np.asarray(picture.convert("L"), float))
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() < 6, "a stale picture: run `make figures`"


def test_every_shipped_log_knows_its_motion(tmp_path: Path):
    from identification.logs import read_log

    folder = resources.files("youbot_scripts").joinpath("data")
    for name in demo.LOGS:
        (tmp_path / name).write_bytes(folder.joinpath(name).read_bytes())
    for name in demo.LOGS[:-1]:
        assert recorded_motion(read_log(tmp_path / name)) is not None, name


def test_a_folder_with_a_blank_is_quoted(tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "STEPS", {"Look": demo.check})
    assert main(["demo", "--output", str(tmp_path / "my demo")]) == 0
    out = capsys.readouterr().out
    typed = next(line for line in out.splitlines() if line.startswith("$ youbot doctor"))
    assert Path(shlex.split(typed)[3]).is_file()


def test_an_output_that_cannot_be_is_one_line(tmp_path: Path, capsys):
    (tmp_path / "taken").write_text("mine")
    assert main(["demo", "--output", str(tmp_path / "taken")]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and "taken" in printed.err
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize("status", [2, 130])
def test_a_step_that_fails_ends_the_story_with_its_status(
    tmp_path: Path, capsys, monkeypatch, status: int
):
    run = cli.main

    def stub(arguments: list[str]) -> int:
        return run(arguments) if arguments[0] == "demo" else status

    monkeypatch.setattr(cli, "main", stub)
    assert cli.main(["demo", "--output", str(tmp_path / "out")]) == status
    assert "What to type next" not in capsys.readouterr().out
