"""docs/elsewhere.md is run as README is, and its examples stay short."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_readme import run_document, steps

DOCS = Path(__file__).parents[1] / "docs"
ELSEWHERE = (DOCS / "elsewhere.md").read_text("utf-8")

LONGEST = 19
"""Lines of an example, blank ones apart."""


def test_every_block_runs_and_prints_what_it_shows(tmp_path, monkeypatch, capsys):
    for library in ("control", "mujoco", "torch"):
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    count = run_document(ELSEWHERE, capsys)
    assert count["command"] == 1 and count["python"] >= 7


@pytest.mark.parametrize("step", [s for s in steps(ELSEWHERE) if s.kind == "python"])
def test_an_example_is_short(step):
    assert len([line for line in step.source.splitlines() if line.strip()]) <= LONGEST


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.name)
def test_links_and_paths_lead_somewhere(page: Path):
    text = page.read_text("utf-8")
    for target in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (DOCS / target).exists(), target
    for path in re.findall(r"\btests/[\w./]+\.py\b", text):
        assert (DOCS.parent / path).exists(), path
