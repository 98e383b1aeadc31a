"""The workbench in headless Chromium, from a log to a better model, and back."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from identification.logs.reading import write_log
from tests.identification.recordings import recording
from tests.scripts.interactive.browser import CHROMIUM, DRIVER, serve, workbench

pytest.importorskip("dash")
pytest.importorskip("selenium.webdriver")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no chromium: apt install chromium chromium-driver",
)

TILT = (("floor_tilt", (("tilt_x", 0.018), ("tilt_y", 0.0))),)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """The address of a workbench over a folder with one log of a sloped floor."""
    folder = tmp_path_factory.mktemp("runs")
    write_log(folder / "drive.csv", recording("calibration", TILT, rate=50.0))
    with serve(folder) as address:
        yield address, folder


@pytest.mark.slow
def test_from_a_log_to_a_better_model_and_back(served: tuple[str, Path], tmp_path: Path):
    address, folder = served
    page = workbench(address, tmp_path / "one")
    try:
        page.driver.execute_script("document.querySelector('#logs input').click()")
        page.until(lambda: "Next: check the logs" in page.text(".verdict")[0], "the log is chosen")
        page.press("Identify")
        assert page.ended(1) == ["done"]
        page.press("Diagnose")
        assert page.ended(2) == ["done", "done"]
        titles = page.until(lambda: page.text(".card h3"), "cards")
        assert "floor tilt" in titles
        script = """for (const card of document.querySelectorAll('.card'))
            if (card.querySelector('h3').textContent === 'floor tilt')
                card.querySelector('button').click();"""
        page.driver.execute_script(script)
        assert page.ended(3)[0] == "done"
        page.until(lambda: "worth it" in page.text(".verdict")[0], "the error fell")
        page.until(lambda: page.find("#signals .main-svg"), "signals are drawn")
        page.until(lambda: page.find("#plan .main-svg"), "the floor plan is drawn")
        # A second browser sees the same, and so does a reload.
        other = workbench(address, tmp_path / "two")
        try:
            assert other.text(".versions code") == page.text(".versions code")
            page.driver.refresh()
            page.until(lambda: len(page.text(".versions code")) == 3, "a reload loses nothing")
            page.press("Undo")
            other.until(lambda: len(other.text(".versions code")) == 2, "undo is seen by both")
        finally:
            other.driver.quit()
        # A worker that is killed leaves a line, and the next command runs.
        page.press("Diagnose")
        page.until(lambda: page.text(".steps .state")[0] == "running", "it runs")
        subprocess.run(
            ["pkill", "-9", "-f", f"youbot_scripts.cli diagnose .*{_SECOND}"], check=False
        )
        assert page.ended(4)[0] in ("failed", "done")
        page.press("Compare")
        assert page.ended(5)[0] == "done"
        assert page.complaints() == []
    finally:
        page.driver.quit()
    _repeats(folder, tmp_path / "again")


_SECOND = "04_diagnose_result"


def _repeats(folder: Path, again: Path) -> None:
    """The exported commands make the same model, to the bit."""
    from youbot_scripts.interactive.project import Project

    project = Project.open(folder, "", [])
    again.mkdir()
    shutil.copy(folder / "drive.csv", again / "drive.csv")
    path = Path(sys.executable).parent
    subprocess.run(
        ["sh"], input=project.script(), text=True, cwd=again, check=True,
        env={**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}, capture_output=True,
    )  # fmt: skip
    made = [json.loads((place / project.model).read_text()) for place in (folder, again)]
    assert made[0]["parameters"] == made[1]["parameters"]
