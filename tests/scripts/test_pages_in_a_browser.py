"""Pages in headless Chromium: charts are drawn, nothing complains, names of logs do nothing."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from identification.figures import chart_style as look, charts, single_charts
from identification.fitting.errors import Traces
from tests.scripts.interactive.browser import DRIVER, Browser
from youbot_scripts.shared.report_page import Charts, Formulas, Words, page
from youbot_scripts.shared.tables import Table, columns, text

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt install chromium")

EVIL = "<img src=x onerror=\"document.title='taken'\"><script>document.title='taken'</script>"


def browsed(path: Path, folder: Path) -> tuple[str, str]:
    """The document after its scripts have run, and what the browser's console says."""
    assert CHROMIUM is not None
    line = [
        *(CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu"),
        *("--disable-background-networking", f"--user-data-dir={folder}"),
        *("--enable-logging=stderr", "--window-size=1400,6000", "--virtual-time-budget=10000"),
        *("--dump-dom", path.as_uri()),
    ]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120)
    return done.stdout, "\n".join(re.findall(r".*CONSOLE.*", done.stderr))


def plan(name: str, title: str) -> look.Chart:
    """A small floor plan."""
    time = np.linspace(0.0, 5.0, 50)
    pose = np.column_stack([time, np.sin(time), 0 * time])
    traces = Traces(time, np.ones((50, 3)), np.zeros((50, 3)))
    return single_charts.plan_chart(name, title, pose, traces, 1.0)


@needs_browser
def test_charts_are_drawn_and_names_are_text(tmp_path: Path):
    errors = single_charts.errors_chart(
        [(None, 0.2, 0.3), (EVIL, 0.01, np.inf)], {"force_error": 0.01, "velocity_error": np.nan}
    )
    parts = [
        Words([EVIL], "verdict"),
        Charts([errors], EVIL),
        Charts([plan("plan_0", EVIL), plan("plan_1", "b")]),
        Formulas("Equations", ["F = \\frac{a}{b}"], [True], [EVIL]),
    ]
    path = tmp_path / "page.html"
    path.write_text(page(EVIL, parts, {"seed": 1}, command=EVIL))
    document, console = browsed(path, tmp_path / "profile")
    assert "taken" not in re.findall(r"<title>(.*?)</title>", document, re.S)[0].split("'")[0]
    assert console == ""
    assert len(re.findall(r'class="chart js-plotly-plot"', document)) == 3
    assert "<mfrac>" in document and not re.search(r"<img[^>]*onerror", document)


@needs_browser
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_anybody_can_read_it(dark: bool, tmp_path: Path):
    """No serious fault that axe-core finds, and nothing to scroll sideways to on a phone."""
    for library in ("selenium", "axe_selenium_python"):
        pytest.importorskip(library)
    if DRIVER is None:
        pytest.skip("no chromedriver: apt install chromium-driver")
    errors = single_charts.errors_chart(
        [(None, 0.2, 0.3), ("floor_tilt", 0.01, 0.02)],
        {"force_error": 0.01, "velocity_error": 0.02},
        ("uneven_forward_dry_wheel_friction", 0.01, 0.02),
    )
    headers = columns("a", *(text(f"a column with a long name {k}") for k in range(6)))
    parts = [
        Words(["It fits."], "verdict"),
        Words(["A warning."], "warning"),
        Charts([errors], "Errors"),
        Charts([plan("plan_0", "first")], folded=True),
        Table("Wide", headers, (tuple("abcdefg"),)),
        Formulas("Equations", ["F = \\frac{a}{b}"], [True], ["new"]),
    ]
    path = tmp_path / "page.html"
    path.write_text(page("A page", parts, {"seed": 1}, command="youbot compare ..."))
    shown = Browser(path.as_uri(), tmp_path / "profile", size=(400, 2000), dark=dark)
    try:
        shown.until(lambda: shown.find(".main-svg"), "charts")
        assert shown.faults() == []
        ask = shown.driver.execute_script
        width = "return document.documentElement.scrollWidth"
        assert ask(width) <= 400
        assert ask("return document.querySelectorAll('.wide.stacked td[data-label]').length") == 7
        # Printing opens and draws everything as wide as paper, and the page is as it was after it.
        ask("window.dispatchEvent(new Event('beforeprint'))")
        drawn = "return [...document.querySelectorAll('.chart .main-svg')].map(e => e.clientWidth)"
        paper = ask("return document.body.clientWidth")
        assert paper == 672 and ask("return boxes.length") == 2
        assert len(ask(drawn)) >= 2 and max(ask(drawn)) <= paper and min(ask(drawn)) > 0.9 * paper
        ask("window.dispatchEvent(new Event('afterprint'))")
        shown.until(lambda: ask(width) <= 400, "the phone's width again")
    finally:
        shown.driver.quit()


def test_a_page_of_many_logs_stays_small():
    time = np.arange(0, 3600.0, 0.001)
    values = np.random.default_rng(0).normal(size=(len(time), 3))
    bins, figure = charts.bins_of(40, 12), look.rows_figure(3, 400)
    for line in range(12):
        row, y = 1 + line % 3, values[:, line % 3]
        look.add_line(figure, row, time, y, "x", look.AFTER, bins=bins, legend=False)
    # 40 such charts: with Plotly's 2 MB below 4 MB.
    assert 40 * len(figure.to_json() or "") < 1.1e6
