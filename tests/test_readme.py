"""README is run: its commands and code in order; its tables are held against the code.

What stands below a command (or below a Python block, in a block of text) must be printed, in this
order; numbers may differ by 5 %, since they depend a little on the libraries' versions.
"""

from __future__ import annotations

import ast
import inspect
import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.identification.fitting.test_observability import seen_by
from tests.youbot_env.tracking import test_own_environment
from youbot_env.model.model import BASE_UNITS
from youbot_env.model.model_file import load_model, model_to_dict
from youbot_env.motions.calibration import CALIBRATION
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_scripts import cli

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text("utf-8")
DEFINITIONS = (ROOT / "docs" / "definitions.md").read_text("utf-8")
CLOSE = 0.05

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Step:
    """Something to run, what it must print, and the section that it stands in."""

    section: str
    kind: str
    source: str
    printed: tuple[str, ...]


def sections(text: str = README) -> dict[str, str]:
    """Text of each section of a document by its title."""
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def steps(document: str = README) -> Iterator[Step]:
    """A document's commands and Python blocks, in order."""
    for section, text in sections(document).items():
        blocks = _BLOCK.findall(text)
        for (kind, source), (after, output) in zip(blocks, [*blocks, ("", "")][1:], strict=True):
            if kind == "console":
                yield from _commands(section, source)
            elif kind == "python":
                printed = output.splitlines() if after == "text" else []
                yield Step(section, kind, source, tuple(printed))


def _commands(section: str, source: str) -> Iterator[Step]:
    for part in re.split(r"^\$ ", source, flags=re.MULTILINE)[1:]:
        command, *printed = part.splitlines()
        yield Step(section, "command", command, tuple(line for line in printed if line != "..."))


def table(section: str, header: str) -> list[list[str]]:
    """Cells of the table whose first column has this header."""
    lines = sections(README + DEFINITIONS)[section].splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"| {header} |"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def names(cell: str) -> list[str]:
    """What stands in backticks."""
    return re.findall(r"`([^`]+)`", cell)


def alike(shown: str, printed: str) -> bool:
    """Whether two lines agree up to spacing and 5 % in their numbers."""
    shown, printed = " ".join(shown.split()), " ".join(printed.split())
    if _NUMBER.sub("#", shown) != _NUMBER.sub("#", printed):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= CLOSE * abs(float(a)) + 1e-3 for a, b in pairs)


def first_missing(shown: tuple[str, ...], printed: str) -> str | None:
    """The first line of ``shown`` that is not printed after those before it."""
    lines = iter(printed.splitlines())
    return next((line for line in shown if not any(alike(line, other) for other in lines)), None)


def test_lines_are_compared_as_promised():
    assert alike(" m0   35.41 ± 0.18 ", "m0 35.40 ± 0.18")
    assert not alike("m0 35.4", "m0 38.4")
    assert not alike("m0 35.4 kg", "m0 35.4")
    assert first_missing(("a", "c"), "a\nb\nc") is None
    assert first_missing(("c", "a"), "a\nb\nc") == "a"


@pytest.fixture
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """README's own effect is gone afterwards."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def run_document(document: str, capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    """Run all blocks and hold their output against what is shown; how many of each kind ran.

    Python blocks of one section share their names.
    """
    count = {"command": 0, "python": 0}
    scope: dict[str, Any] = {}
    previous = None
    for step in steps(document):
        if step.section != previous:
            scope, previous = {"__name__": "__main__"}, step.section
        where = f"{step.section}: {step.source.splitlines()[0]}"
        if step.kind == "python":
            exec(compile(step.source, step.section, "exec"), scope)
        else:
            program, *arguments = shlex.split(step.source)
            assert program == "youbot", where
            assert cli.main(arguments) == 0, f"{where}\n{capsys.readouterr().err}"
        printed = capsys.readouterr().out
        missing = first_missing(step.printed, printed)
        assert missing is None, f"{where}\ndoes not print\n{missing}\nbut\n{printed}"
        count[step.kind] += 1
    return count


def test_every_block_runs_and_prints_what_it_shows(catalogue, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    count = run_document(README, capsys)
    assert count["command"] >= 5 and count["python"] >= 3


class TestTables:
    def test_commands(self):
        listed = [names(row[0])[0] for row in table("Quick start", "command")]
        assert listed == [f"youbot {name}" for name in cli.available()]

    def test_commands_in_the_text_exist(self):
        for command in re.findall(r"`youbot (\w+)", README.replace("youbot COMMAND", "")):
            assert command in cli.available()

    def test_extras(self):
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        listed = [name for row in table("Install", "extra") for name in names(row[0])]
        assert sorted(listed) == sorted(project["optional-dependencies"])

    def test_make_targets(self):
        targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert set(re.findall(r"\bmake (\w+)", "\n".join(_code()))) <= set(targets)

    def test_log_columns(self):
        from identification.logs.columns import optional_groups, required_columns

        rows = table("Log files", "column")
        found = {row[2] == "yes": set() for row in rows}
        for row in rows:
            for name in names(row[0]):
                found[row[2] == "yes"] |= {name.replace("*", wheel) for wheel in WHEELS}
        assert found[True] == {"time", *required_columns(WHEELS)}
        assert found[False] == {name for group in optional_groups(WHEELS) for name in group}

    def test_model_file(self):
        listed = [name for row in table("Model file", "key") for name in names(row[0])]
        assert sorted(listed) == sorted(model_to_dict(load_model("paper")))
        for name in BASE_UNITS:
            assert re.search(rf"\b{name}\b", table("Model file", "key")[2][1])

    def test_paper_values(self):
        paper, geometry = load_model("paper").values, Geometry()
        known = paper | {key: getattr(geometry, key) for key in ("l", "h", "R", "r", "m1")}
        seen = {}
        for symbols, _, _, values in table("Equations", "symbol"):
            symbols = [name.strip() for name in symbols.split(",")]
            listed = [float(value) for value in values.split(",") if value.strip()]
            seen |= dict(zip(symbols, listed, strict=False))
        assert seen == known

    @pytest.mark.parametrize("row", table("Observability", "motion"), ids=lambda row: row[0][:3])
    def test_observability(self, row: list[str]):
        motion, rank, blind, blocks = row
        found = seen_by(CALIBRATION[motion.split(":")[0]](Geometry()))
        order = {name: f"x{k + 1}" for k, name in enumerate(found.names)}
        assert int(rank) == found.rank
        assert sorted(found.describe_blind()) == sorted(blind.split(", "))
        if blocks:
            named = {frozenset(block.split(", ")) for block in re.findall(r"{(.*?)}", blocks)}
            assert named == {frozenset(order[name] for name in block) for block in found.blocks}

    def test_environment(self):
        rows = {row[0]: row[1] for row in table("Environment", "part")}
        options = inspect.signature(YouBotTrackingEnv.__init__).parameters
        assert set(rows["options"].removesuffix(", ...").split(", ")) <= set(options)
        env = YouBotTrackingEnv()
        assert f"Box(-5, 5, {env.observation_space.shape})" in rows["observation"]
        assert f"Box(-1, 1, {env.action_space.shape})" in rows["action"]
        assert f"{env.torque_limit:.3f} N m" in rows["action"]

    def test_effects(self):
        rows = table("Write your own effect", "acts at")
        listed = {place: set(cell.split(", ")) for place, cell in rows}
        found: dict[str, set[str]] = {}
        for item in CATALOGUE:
            found.setdefault(item.acts_at.name, set()).add(item.name)
        assert listed == found


def _code() -> Iterator[str]:
    """Blocks and quoted words: what a reader may type."""
    yield from (source for _, source in _BLOCK.findall(README))
    yield from names(README)


def test_own_environment_is_the_one_that_is_tested():
    """To 1e-12 equal to ours: tests/youbot_env/tracking/test_own_environment.py."""

    def example(source: str) -> str:
        classes = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)]
        return next(ast.dump(node) for node in classes if node.name == "HoldSpeed")

    block = next(s.source for s in steps() if "class HoldSpeed" in s.source)
    assert example(block) == example(inspect.getsource(test_own_environment))


def test_links_lead_somewhere():
    for document in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", (ROOT / document).read_text("utf-8")):
            assert (ROOT / target).exists(), f"{document}: {target}"


def test_paths_named_in_the_documents_exist():
    for document in ("README.md", "CONTRIBUTING.md"):
        for path in re.findall(r"[\w./]+/[\w]+\.py\b", (ROOT / document).read_text("utf-8")):
            assert "NAME" in path or (ROOT / path).exists(), f"{document}: {path}"


def test_the_documents_are_short():
    assert len(README.splitlines()) <= 465
    assert len((ROOT / "CONTRIBUTING.md").read_text("utf-8").splitlines()) < 50
