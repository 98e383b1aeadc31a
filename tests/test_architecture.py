"""The arrows between the packages, and what importing them must not cost."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ARROWS = {
    "youbot_env": set(),
    "identification": {"youbot_env"},
    "controllers": {"youbot_env", "identification"},
    "scripts": {"youbot_env", "identification", "controllers", "youbot_scripts"},
}
"""What each package may import of the others."""

OURS = {*ARROWS, "youbot_scripts", "tests"}

OPTIONAL = ("torch", "stable_baselines3", "matplotlib", "mujoco", "pygame", "control", "pyarrow")
"""Libraries of the extras, which the core must do without."""

CODE_RUNNERS = {"eval", "exec", "compile", "__import__"}
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "joblib"}
SENDS_ITS_OWN_CALLS = {"scripts/shared/workers.py": {"joblib"}}
"""A file that starts this package's own functions in other processes, and reads no file by it."""


def modules(package: str) -> list[Path]:
    found = sorted((ROOT / package).rglob("*.py"))
    assert found, f"{package} has no modules"
    return found


def imported(tree: ast.AST) -> set[str]:
    """Top-level names that a module imports anywhere, functions included."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


def called_names(tree: ast.AST) -> set[str]:
    calls = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
    return {function.id for function in calls if isinstance(function, ast.Name)}


def attributes(tree: ast.AST) -> set[str]:
    """Names of all attributes and imported names that a module reads."""
    read = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    froms = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    return read.union(*({alias.name for alias in node.names} for node in froms))


def test_imported_sees_imports_inside_functions():
    source = "import a.b\ndef f():\n    from c.d import e\n    from . import g\n"
    assert imported(ast.parse(source)) == {"a", "c"}


@pytest.mark.parametrize("package", ARROWS)
def test_imports_follow_the_arrows(package: str):
    for path in modules(package):
        strangers = (imported(ast.parse(path.read_text())) & OURS) - ARROWS[package] - {package}
        assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"


@pytest.mark.parametrize("package", ARROWS)
def test_no_package_can_run_code_from_a_file(package: str):
    for path in modules(package):
        tree = ast.parse(path.read_text())
        place = path.relative_to(ROOT).as_posix()
        known = SENDS_ITS_OWN_CALLS.get(place, set())
        unsafe = (imported(tree) & UNSAFE_MODULES - known) | (called_names(tree) & CODE_RUNNERS)
        if known:
            unsafe |= {"load", "dump"} & attributes(tree)
        assert not unsafe, f"{path.relative_to(ROOT)} uses {sorted(unsafe)}"


def test_the_core_loads_no_optional_library():
    code = (
        "import sys, youbot_env, identification, controllers;"
        f"print(*[name for name in {OPTIONAL!r} if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_every_package_folder_is_installed():
    import tomllib

    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {
        str(path.parent.relative_to(ROOT)).replace("/", ".")
        for package in ARROWS
        for path in (ROOT / package).rglob("__init__.py")
    }
    renamed = {folder.replace("scripts", "youbot_scripts", 1) for folder in folders}
    assert renamed == set(settings["packages"])
