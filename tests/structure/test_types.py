"""The physics and the protocols say what their numbers are: no ``Any``, checked strictly."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

PHYSICS = sorted(
    str(path.relative_to(ROOT))
    for path in (ROOT / "youbot_env/physics").glob("*.py")
    if path.name != "__init__.py"
)

MECHANISMS = [
    f"identification/mechanisms/{name}.py" for name in ("axis", "mecanum", "mechanism", "samples")
]


@pytest.mark.parametrize("name", PHYSICS + MECHANISMS)
def test_no_type_is_left_open(name: str):
    tree = ast.parse((ROOT / name).read_text())
    used = [
        node.lineno for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == "Any"
    ]
    assert not used, f"{name}: Any in lines {used}"


def test_these_files_are_checked_strictly():
    strict = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pyright"]["strict"]
    assert set(PHYSICS + MECHANISMS) <= set(strict)
