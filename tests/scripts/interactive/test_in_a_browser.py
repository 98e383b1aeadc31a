"""The workbench in headless Chromium, from a log to a better model, and back."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from identification.logs.reading import write_log
from tests.identification.recordings import recording
from tests.scripts.interactive.browser import CHROMIUM, DRIVER, Browser, serve, server_of, workbench

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
        # A region of the floor that is brushed is shaded in every signal.
        drag_over(page, "#plan .nsewdrag")
        page.until(lambda: page.find("#signals .shapelayer path"), "the brushed stretches")
        page.driver.execute_script("document.querySelector('#unmark').click()")
        page.until(lambda: not page.find("#signals .shapelayer path"), "no stretch is marked")
        # A second browser sees the same, and so does a reload.
        other = workbench(address, tmp_path / "two")
        try:
            assert other.text(".versions code") == page.text(".versions code")
            page.driver.refresh()
            page.until(lambda: len(page.text(".versions code")) == 3, "a reload loses nothing")
            page.press("Undo")
            other.until(lambda: len(other.text(".versions code")) == 2, "undo is seen by both")
            other.until(lambda: "lacks floor tilt" in other.text(".verdict")[0], "its own verdict")
            other.until(
                lambda: "03_with_floor_tilt" not in other.text("#signals .legendtext"), "its charts"
            )
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
        assert page.ended(6)[0] == "done", "the published model too, which came before"
        assert len(page.text("#panel .wide-table tbody tr")) == 2
        page.until(lambda: "paper" in page.text("#signals .legendtext"), "two models are compared")
        assert "01_identified" in page.text("#signals .legendtext")
        page.press("Drive")
        assert page.ended(7)[0] == "done"
        page.until(lambda: page.find("#drive .main-svg"), "the tracking is drawn")
        assert {"kinematic", "computed_torque"} <= set(page.text("#driven td"))
        script = "return document.documentElement.scrollWidth <= innerWidth"
        for width in (1400, 400):  # with all charts and tables on it
            page.resize(width, 1400)
            page.until(lambda: page.driver.execute_script(script), f"{width} px are enough")
        assert page.faults() == []
        assert page.complaints() == []
    finally:
        page.driver.quit()
    _repeats(folder, tmp_path / "again")


_SECOND = "04_diagnose_result"


def drag_over(page: Browser, selector: str) -> None:
    """Drag the mouse over the middle of an element."""
    from selenium.webdriver.common.action_chains import ActionChains

    (box,) = page.find(selector)
    page.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", box)
    reach = box.rect["width"] // 3, box.rect["height"] // 3
    chain = ActionChains(page.driver).move_to_element_with_offset(box, -reach[0], -reach[1])
    chain.click_and_hold().move_by_offset(*reach).move_by_offset(*reach).release().perform()


def _repeats(folder: Path, again: Path) -> None:
    """Exported commands make the same model, to the bit: a script's and a notebook's."""
    from youbot_scripts.interactive.project import Project

    project = Project.open(folder, "", [])
    cells = json.loads(project.notebook())["cells"]
    shell = [cell["source"][1:] for cell in cells if cell["source"].startswith("!")]
    path = Path(sys.executable).parent
    for name, script in (("script", project.script()), ("notebook", "\n".join(shell))):
        place = again / name
        place.mkdir(parents=True)
        shutil.copy(folder / "drive.csv", place / "drive.csv")
        subprocess.run(
            ["sh", "-e"], input=script, text=True, cwd=place, check=True,
            env={**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}, capture_output=True,
        )  # fmt: skip
        made = [json.loads((there / project.model).read_text()) for there in (folder, place)]
        assert made[0]["parameters"] == made[1]["parameters"], name


@pytest.mark.parametrize("width", [1400, 400])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_anybody_can_use_it(width: int, dark: bool, served: tuple[str, Path], tmp_path: Path):
    """No serious fault that axe-core finds, and nothing to scroll sideways to, on a phone too."""
    pytest.importorskip("axe_selenium_python")
    page = workbench(served[0], tmp_path / "profile", size=(width, 1400), dark=dark)
    try:
        page.until(lambda: page.find("#upload input[aria-label]"), "names of parts")
        assert page.faults() == []
        assert page.driver.execute_script("return document.documentElement.scrollWidth") <= width
        assert page.complaints() == []
    finally:
        page.driver.quit()


@pytest.fixture
def own(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A workbench of one test alone: its address and its process."""
    folder = tmp_path / "runs"
    folder.mkdir()
    write_log(folder / "drive.csv", recording("calibration", TILT, rate=50.0))
    with server_of(folder) as found:
        yield found


def test_the_keyboard_alone_works_and_a_server_that_ends_is_said(
    own: tuple[str, subprocess.Popen[str]], tmp_path: Path
):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    address, server = own
    page = workbench(address, tmp_path / "profile")

    def go_to(wanted: str) -> None:
        for _ in range(40):
            ActionChains(page.driver).send_keys(Keys.TAB).perform()
            if page.driver.execute_script(f"return {wanted}(document.activeElement)"):
                return
        raise AssertionError(f"Tab never reaches {wanted}")

    try:
        page.until(lambda: page.find("#logs input"), "the log's name")
        go_to("(e => e.closest('#logs') !== null)")
        ActionChains(page.driver).send_keys(Keys.SPACE).perform()
        page.until(lambda: "Next: check the logs" in page.text(".verdict")[0], "it is chosen")
        go_to("(e => e.textContent.startsWith('Check the logs'))")
        ActionChains(page.driver).send_keys(Keys.ENTER).perform()
        assert page.ended(1)[0] == "done"
        page.until(lambda: "drive.csv" in " ".join(page.text("details li")), "what was found")
        assert page.find(".gone") == []
        server.terminate()
        server.wait()
        page.press("Identify")
        page.until(lambda: page.find(".gone"), "the page says that nobody answers", 10.0)
        (said,) = page.text(".gone")
        assert f"youbot workbench --folder {tmp_path / 'runs'}" in said and "is lost" in said
        page.complaints()  # of requests that nobody answered
        time.sleep(1.5)
        asked = [line for line in page.complaints() if "/alive" not in line]
        assert asked == [], "the page has stopped looking at the project"
    finally:
        page.driver.quit()
