"""The pages in docs/: their code runs, their commands exist, their links lead somewhere.

Blocks of ``console`` and ``python`` are run, page by page, and print what the page shows; see
``tests/test_readme.py``. Every other block that somebody might type says in a comment above it why
it is not run. Blocks of other languages are no code to be typed: output, files, formulas.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.test_readme import catalogue, run_document, steps  # noqa: F401 - a fixture
from youbot_scripts import cli

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))
ELSEWHERE = (DOCS / "elsewhere.md").read_text("utf-8")

LONGEST = 19
"""Lines of an example of docs/elsewhere.md, blank ones apart."""

NEEDS = {
    "elsewhere.md": ("control", "mujoco", "torch"),
    "contact.md": ("mujoco",),
    "misfit.md": ("matplotlib",),
}
"""Optional libraries of a page's examples."""

SLOW = {"contact.md", "misfit.md"}
"""Pages that take more than about ten seconds of one core."""

RUN, TYPED, SHOWN = {"console", "python"}, {"bash", "py", "cpp"}, {"text", "toml", "json", "math"}

_FENCE = re.compile(
    r"(?:^<!-- not run: (.+) -->\n)?^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)


def document(page: Path) -> str:
    """A page as ``run_document`` takes it: what stands above its first section is one too."""
    return f"## {page.stem}\n{page.read_text('utf-8')}"


def has_code(page: Path) -> bool:
    return next(steps(document(page)), None) is not None


def pages_with_code() -> Iterator[object]:
    for page in filter(has_code, PAGES):
        marks = [pytest.mark.slow] if page.name in SLOW else []
        yield pytest.param(page, id=page.name, marks=marks)


@pytest.mark.parametrize("page", list(pages_with_code()))
def test_every_block_runs_and_prints_what_it_shows(
    page: Path,
    catalogue: None,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    for library in NEEDS.get(page.name, ()):
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    count = run_document(document(page), capsys)
    assert sum(count.values()) >= 1


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_is_not_run_says_why(page: Path):
    for why, kind, block in _FENCE.findall(page.read_text("utf-8")):
        first = block.split("\n")[0]
        assert kind in RUN | TYPED | SHOWN, f"{first}: a block of {kind or 'no language'}"
        assert bool(why) == (kind in TYPED), f"{first}: needs `<!-- not run: WHY -->`, or none"


def options_of(command: str) -> set[str]:
    """Names of a command's options."""
    from typer.main import get_command

    group = get_command(cli.build_app(command))
    found = group.commands[command]  # pyright: ignore[reportAttributeAccessIssue]
    return {name for part in found.params for name in (*part.opts, *part.secondary_opts)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_options_exist(page: Path):
    """Those that are run and those that are not: nobody types an option that is gone."""
    text = page.read_text("utf-8").replace("\\\n", " ")
    for command, rest in re.findall(r"(?:^|[`$ ])youbot ([a-z]+)([^\n`#|]*)", text, re.MULTILINE):
        if command in cli.available():
            given = re.findall(r"(?<![\w-])(--?[a-z][\w-]*)", rest)
            assert set(given) <= options_of(command) | {"--help"}, f"youbot {command}{rest}"
    for command in re.findall(r"`youbot (\w+)", text.replace("youbot COMMAND", "")):
        assert command in cli.available(), f"youbot {command}"


@pytest.mark.parametrize("step", [s for s in steps(ELSEWHERE) if s.kind == "python"])
def test_an_example_is_short(step):
    assert len([line for line in step.source.splitlines() if line.strip()]) <= LONGEST


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_paths_lead_somewhere(page: Path):
    text = page.read_text("utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        made = {"commands.md", "changelog.md"}
        assert target in made or (DOCS / target).exists(), target
    for path in re.findall(
        r"\b(?:tests|youbot_env|identification|controllers|scripts)/[\w./]+\.py\b", text
    ):
        assert (DOCS.parent / path).exists(), path
