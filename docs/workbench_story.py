"""Draws the workbench's story: `python -m docs.workbench_story docs/figures/workbench.gif`.

A log of a robot on a slope, from a model that does not fit to one that does, as a person would do
it: choose, identify, diagnose, add what is missing. Needs Chromium and its driver.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from identification.logs.reading import write_log
from tests.identification.recordings import recording
from tests.scripts.interactive.browser import Browser, serve, workbench
from youbot_scripts.evaluation.animation import gif

SIZE = (1000, 640)
"""[px] Of the window."""

HOLD = 2600
"""[ms] for which a picture with something to read is shown."""

TILT = (("floor_tilt", (("tilt_x", 0.018), ("tilt_y", 0.0))),)


class Story:
    """Pictures of a page with the time that each is shown."""

    def __init__(self, page: Browser) -> None:
        self.page = page
        self.pictures: list[Image.Image] = []
        self.milliseconds: list[float] = []

    def show(self, milliseconds: float, selector: str = "header") -> None:
        """Scroll so that an element is at the top, and keep what is seen."""
        script = "document.querySelector(arguments[0]).scrollIntoView()"
        self.page.driver.execute_script(script, selector)
        time.sleep(0.5)
        picture = Image.open(io.BytesIO(self.page.picture())).convert("RGB")
        self.pictures.append(picture)
        self.milliseconds.append(milliseconds)


def drawn(page: Browser, model: str) -> None:
    """Wait until the signals show a model."""
    page.until(lambda: model in page.text("#signals .legendtext"), f"signals of {model}")
    time.sleep(1.0)  # the floor plan follows


def tell(story: Story) -> None:
    """From a log to a better model."""
    page = story.page
    story.show(1200)
    page.until(lambda: page.find("#logs input"), "the log's name")
    time.sleep(1.0)  # a click before the page listens would be lost
    page.driver.execute_script("document.querySelector('#logs input').click()")
    page.until(lambda: "Next: check the logs" in page.text(".verdict")[0], "the log is chosen")
    story.show(1200)
    page.press("Identify")
    page.ended(1)
    drawn(page, "01_identified")
    story.show(HOLD)
    story.show(HOLD, ".pictures")
    page.press("Diagnose")
    page.until(lambda: page.text(".steps .state")[0] == "running", "it runs")
    story.show(900)
    page.ended(2)
    page.until(lambda: page.text(".card h3"), "cards")
    story.show(HOLD)
    script = """for (const card of document.querySelectorAll('.card'))
        if (card.querySelector('h3').textContent === 'floor tilt')
            card.querySelector('button').click();"""
    page.driver.execute_script(script)
    page.ended(3)
    page.until(lambda: "worth it" in page.text(".verdict")[0], "the error fell")
    drawn(page, "03_with_floor_tilt")
    story.show(HOLD)
    story.show(HOLD, ".pictures")


def main(path: Path) -> None:
    """Write the GIF."""
    with tempfile.TemporaryDirectory() as place:
        runs = Path(place) / "runs"
        runs.mkdir()
        write_log(runs / "drive.csv", recording("calibration", TILT, rate=50.0))
        with serve(runs) as address:
            page = workbench(address, Path(place) / "profile", size=SIZE)
            try:
                story = Story(page)
                tell(story)
            finally:
                page.driver.quit()
    path.write_bytes(gif(story.pictures, story.milliseconds))
    print(f"{path}: {len(story.pictures)} pictures, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
