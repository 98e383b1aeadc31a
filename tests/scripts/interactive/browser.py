"""A page in headless Chromium, driven by selenium, and a workbench to look at."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")


class Browser:
    """A page of the workbench, and what a person does on it."""

    def __init__(
        self,
        address: str,
        profile: Path,
        *,
        size: tuple[int, int] = (1400, 2400),
        dark: bool = False,
    ) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        for word in (
            *("--headless=new", "--no-sandbox", "--disable-gpu"),
            *("--disable-background-networking", f"--user-data-dir={profile}"),
            f"--window-size={size[0]},{size[1]}",
            # Scroll bars would be in the pictures, and differ from system to system.
            "--hide-scrollbars",
        ):
            options.add_argument(word)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.resize(*size)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": scheme})
        self.driver.get(address)

    def resize(self, width: int, height: int) -> None:
        """Another size of what is seen; a window is never narrower than 500 px, a phone is."""
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)

    def find(self, selector: str) -> list[Any]:
        return self.driver.find_elements("css selector", selector)

    def text(self, selector: str) -> list[str]:
        """Texts as they are now; elements may be drawn anew at any time."""
        script = "return [...document.querySelectorAll(arguments[0])].map(e => e.textContent)"
        return self.driver.execute_script(script, selector)

    def until(self, holds: Callable[[], Any], what: str, limit: float = 180.0) -> Any:
        end = time.monotonic() + limit
        while time.monotonic() < end:
            if found := holds():
                return found
            time.sleep(0.3)
        raise AssertionError(f"{what}: not within {limit:.0f} s; {self.text('#panel')}")

    def press(self, label: str) -> None:
        script = """for (const b of document.querySelectorAll('button'))
            if (b.textContent.startsWith(arguments[0]) && !b.disabled) { b.click(); return true; }
            return false;"""
        self.until(lambda: self.driver.execute_script(script, label), f"button {label}")

    def ended(self, count: int) -> list[str]:
        """States of the commands, the newest first, when so many have ended."""

        def states() -> list[str]:
            found = self.text(".steps .state")
            is_open = any(state in ("waiting", "running") for state in found)
            return found if len(found) >= count and not is_open else []

        return self.until(states, f"{count} commands")

    def complaints(self) -> list[str]:
        return [line["message"] for line in self.driver.get_log("browser")]

    def picture(self) -> bytes:
        """What is seen now, as PNG."""
        return self.driver.get_screenshot_as_png()

    def faults(self) -> list[str]:
        """Serious faults of accessibility that axe-core finds, a line each."""
        from axe_selenium_python import Axe

        axe = Axe(self.driver)
        axe.inject()
        return [
            f"{fault['impact']}: {fault['id']}: {node['html'][:120]} {node['target']}"
            for fault in axe.run()["violations"]
            if fault["impact"] in ("serious", "critical")
            for node in fault["nodes"]
        ]


def workbench(address: str, profile: Path, **look: Any) -> Browser:
    """A browser that shows the workbench at an address."""
    page = Browser(address, profile, **look)
    page.until(lambda: page.find("#panel .verdict"), "the panel")
    return page


@contextmanager
def serve(folder: Path) -> Iterator[str]:
    """A workbench over a folder; its address."""
    with server_of(folder) as (address, _):
        yield address


@contextmanager
def server_of(folder: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A workbench over a folder: its address and its process."""
    line = [sys.executable, "-m", "youbot_scripts.cli", "workbench", "--folder", str(folder)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().split()[-1], server
        server.terminate()
