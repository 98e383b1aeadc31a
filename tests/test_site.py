"""The documentation site builds without a warning, fetches nothing, shows all that is public."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import controllers
import identification
import youbot_env
from youbot_scripts import cli

ROOT = Path(__file__).parents[1]

for library in ("mkdocs", "material", "mkdocstrings", "nbformat", "latex2mathml"):
    pytest.importorskip(library)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as `make docs` does, but for the outputs of notebooks (tests/test_notebooks.py)."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "YOUBOT_DOCS_RUN_NOTEBOOKS": "0", "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0 and not done.stderr.strip(), done.stdout + done.stderr
    return folder


class Loaded(HTMLParser):
    """Addresses that a browser fetches by itself when it opens a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "link" and given.get("rel") in ("stylesheet", "preload", "preconnect", "icon"):
            self.found.append(given.get("href") or "")
        elif tag in ("script", "img", "iframe", "source", "video"):
            self.found.append(given.get("src") or "")


def test_no_page_fetches_anything(site: Path):
    pages = list(site.rglob("*.html"))
    assert len(pages) >= 25
    for page in pages:
        loaded = Loaded()
        loaded.feed(page.read_text("utf-8"))
        outside = [address for address in loaded.found if re.match(r"(\w+:)?//", address)]
        assert not outside, f"{page.name}: {outside}"
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(\s*['\"]?(https?:)?//", sheet.read_text("utf-8")), sheet.name


@pytest.mark.parametrize("package", [youbot_env, identification, controllers])
def test_every_public_name_is_on_its_page(site: Path, package):
    page = (site / "api" / f"{package.__name__}.html").read_text("utf-8")
    shown = set(re.findall(r'<h2 id="[\w.]+\.(\w+)"', page))
    assert set(package.__all__) <= shown | {"__version__"}


def test_every_command_is_explained(site: Path):
    page = (site / "commands.html").read_text("utf-8")
    assert re.findall(r"<h2[^>]*>youbot (\w+)", page) == list(cli.available())
    assert "--next-motion" in page and "Write the proposed motion here" in page


def test_formulas_are_drawn(site: Path):
    page = (site / "model.html").read_text("utf-8")
    assert page.count("<math") >= 7 and "\\dot" not in page


def test_sections_of_readme_and_links_to_them(site: Path):
    assert "payload_change" not in (site / "limits.html").read_text("utf-8")
    assert "torque constant" in (site / "limits.html").read_text("utf-8")
    assert 'href="log_files.html"' in (site / "importing.html").read_text("utf-8")
    assert "velocity_*" in (site / "log_files.html").read_text("utf-8")


def test_no_line_begins_with_a_per_cent_sign(site: Path):
    text = (site / "proposal.html").read_text("utf-8")
    plain = re.sub(r"(?s)<(pre|code)\b.*?</\1>", "", text)
    assert not re.search(r"\d[ \n]%", plain) and "\u00a0%" in plain


def test_the_site_is_small(site: Path):
    assert sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) < 20e6
