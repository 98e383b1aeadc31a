"""Numbers that somebody chose are settings: fields of frozen dataclasses, each with its reason."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path

import pytest

from tests.structure.settings_page import SETTINGS, page

ROOT = Path(__file__).parents[2]

FILES = sorted((ROOT / "identification").rglob("*.py"))

HOMES = ("settings.py", "style.py", "chart_style.py")
"""Files that may hold numbers: settings, and what figures look like."""

NO_SETTING = {
    "diagnosis": {
        "SHOWN_VARIABLES": "variables that a sentence names",
        "SHOWN_STRETCHES": "stretches that a sentence names",
    },
    "proposal": {
        "LINE": "longest line of a written file",
        "DIGITS": "of a number in a written file",
        "ROUNDING": "rounding: directions that are not seen",
        "RIDGE": "rounding: so that columns which are alike have a solution",
        "MIN_LEFT": "rounding: of a column that the structure absorbs",
        "MOST_CELLS": "bound on memory",
        "MOST_CELLS_A_SIDE": "bound on memory",
        "SHOWN_LOGS": "logs that a file names",
        "CIRCLE": "bounds of a direction",
        "UNITS": "units of a force over powers of a variable",
    },
    "fitting": {"TIMES": "place of features in a row"},
    "threads": {"MAX_THREADS": "threads by default; no result depends on it"},
    "kinematics": {
        "PARAMETERS": "places of parameters in a vector",
        "_A": "place",
        "_B": "place",
        "_U": "place",
        "_V": "place",
        "_G": "place",
        "_DELAY": "place",
        "TWIST": "geometry: what a twist makes of equal wheels",
        "NO_SLIP": "geometry: wheel speeds that no rigid motion makes",
        "UNITS": "units of wheel speeds",
        "GEARS": "gears that are on sale",
        "ROUND_GEARS": "of them the round ones",
        "YOUBOT_GEAR": "the youBot's",
    },
    "importing": {
        "TIME_UNITS": "units of time",
        "UNITS": "units of speeds, torques, angles and lengths",
        "_PAIRS": "geometry: wheel speeds that no rigid motion makes",
        "_LEFT_NEGATED": "signs of the wheels on the left",
        "_TRUTH": "true and false as numbers",
        "_POSITIVE": "of a schema",
        "_SCHEMA": "of a map: what it may hold",
        "_TEXT": "of a schema",
        "_COLUMNS": "of a schema",
        "MAX_BYTES": "of a map's file",
        "MAP_FILE": "of a map: its version",
    },
    "logs": {
        "_UNITS": "units that a time column is recognised in",
        "UNIT_FACTORS": "units of wheel speeds",
        "EFFORT_NUMBERS": "units of efforts",
        "ROLLING": "geometry: signs of the wheels' rates",
        "NO_SLIP": "geometry: wheel speeds that no rigid motion makes",
        "_DEGREES": "degrees in a radian",
        "_LOOKED_AT": "rows that tell whether a column is text",
        "DECIMALS": "of a written file",
        **dict.fromkeys(
            ("MAX_BYTES", "MAX_STREAM", "MAX_CELLS", "MAX_HEADER", "MAX_COLUMNS", "MAX_ROWS"),
            "bound on time and memory: of what is read of a file",
        ),
        "MAX_LINE": "bound on time and memory: of a line",
        "CHUNK": "bytes that are decompressed at a time",
    },
    "mechanisms": {
        "_MOTION": "names of a formula's arguments",
        "PAPER_ORDER": "the paper's order of parameters",
        "DT": "sample time of simulated motions, of which one is proposed",
        "AXIS": "a kind of mechanism, made once",
        "LOAD_TOLERANCE": "rounding: where torques under load count as found",
        "LOAD_STEP": "of a central difference: far above rounding, far below a torque",
    },
}
"""Numbers by room that are no settings, and why: units, formats, geometry, bounds on resources."""

DEFAULTS = {
    "seed": "of random numbers: any is as good",
    "cycles": "one curve over a whole turn",
    "dt": "sample time of ideal motions",
    **dict.fromkeys(("panels", "series"), "of a chart: one"),
    "beside": "of a mark: not moved",
    "cutoff": "of words that describe a direction",
}
"""Arguments whose default may be a number, and why."""


def room_of(path: Path) -> str:
    """The folder below ``identification``, or the file's name for what stands beside them."""
    parts = path.relative_to(ROOT / "identification").parts
    return parts[0] if len(parts) > 1 else path.stem


def holds_number(node: ast.expr) -> bool:
    """Whether an expression has a number in it; code inside of a function does not count."""
    if isinstance(node, ast.Lambda):
        return False
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    return any(holds_number(child) for child in _children(node))


def _children(node: ast.AST) -> Iterator[ast.expr]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield child
        elif isinstance(child, ast.keyword):
            yield child.value


def named_numbers(tree: ast.Module) -> Iterator[str]:
    """Names at the top of a file that stand for numbers, alone or in a table."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and holds_number(node.value):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and node.value and holds_number(node.value):
            assert isinstance(node.target, ast.Name)
            yield node.target.id


def numbers_by_default(tree: ast.Module) -> Iterator[str]:
    """Arguments of functions whose default holds a number."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            given, named = node.args.posonlyargs + node.args.args, node.args.kwonlyargs
            defaults = node.args.defaults
            pairs = [*zip(given[len(given) - len(defaults) :], defaults, strict=True)]
            pairs += [(a, d) for a, d in zip(named, node.args.kw_defaults, strict=True) if d]
            yield from (argument.arg for argument, default in pairs if holds_number(default))


def test_numbers_are_seen_where_they_stand():
    tree = ast.parse("A = 3\nB: float = -0.5\nC = f(x=(1, 2))\nD = 'x'\nE = lambda: 3\n")
    assert list(named_numbers(tree)) == ["A", "B", "C"]
    tree = ast.parse("def f(a, b=2, *, c=None, d=-1.0, e='x'): pass")
    assert list(numbers_by_default(tree)) == ["b", "d"]


def test_numbers_that_somebody_chose_are_settings():
    for path in FILES:
        if path.name in HOMES:
            continue
        room, tree = room_of(path), ast.parse(path.read_text("utf-8"))
        strangers = set(named_numbers(tree)) - {*NO_SETTING.get(room, {})}
        assert not strangers, f"{path.relative_to(ROOT)}: {sorted(strangers)} belong in settings"


def test_nor_do_they_hide_in_default_arguments():
    for path in FILES:
        strangers = set(numbers_by_default(ast.parse(path.read_text("utf-8")))) - {*DEFAULTS}
        assert not strangers, f"{path.relative_to(ROOT)}: {sorted(strangers)} belong in settings"


def test_every_class_of_settings_is_on_the_page():
    names = ("youbot_env", "identification", "controllers", "scripts/fleets")
    packages = [ROOT / name for name in names]
    found = {
        node.name
        for package in packages
        for path in package.rglob("*.py")
        for node in ast.parse(path.read_text("utf-8")).body
        if isinstance(node, ast.ClassDef) and node.name.endswith("Settings")
    }
    found.remove("Settings")  # the base of some
    assert found == {made.__name__ for made in SETTINGS if made.__name__.endswith("Settings")}


@pytest.mark.parametrize("made", SETTINGS)
def test_every_setting_has_a_unit_and_a_reason(made: type):
    assert made.__dataclass_params__.frozen  # type: ignore[attr-defined]
    for item in fields(made):
        if item.default is MISSING:
            value = getattr(made(), item.name)
            assert is_dataclass(value) or isinstance(value, Mapping), item.name
        else:
            assert item.metadata["unit"] and len(item.metadata["reason"]) > 5, item.name


def test_the_page_is_what_the_command_prints():
    written = (ROOT / "docs" / "settings.md").read_text("utf-8")
    assert written == page(), "run python -m tests.structure.settings_page docs/settings.md"
