"""What a user gets who installs the package, not a checkout: built as a wheel, tried on its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "youbot_env": "youbot_env",
    "identification": "identification",
    "controllers": "controllers",
    "scripts": "youbot_scripts",
}
"""Folder in the repository and name after installation."""

SHIPPED = (
    ".py",
    ".pyi",
    ".json",
    ".safetensors",
    ".csv.gz",
    ".html",
    ".css",
    ".js",
    "py.typed",
    ".c",
    ".h",
    ".hpp",
    ".cpp",
)


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that leftovers of earlier builds cannot creep in."""
    source = tmp_path_factory.mktemp("source")
    for file in ROOT.iterdir():
        if file.suffix in (".toml", ".md") or file.name == "LICENSE":
            shutil.copy(file, source)
    for folder in PACKAGES:
        shutil.copytree(
            ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__")
        )
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", cwd=source)
    (built,) = (source / "dist").glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` folder of a new environment that holds the wheel; libraries come from ours."""
    folder = tmp_path_factory.mktemp("installed")
    run(sys.executable, "-m", "venv", folder / "venv", cwd=folder)
    programs = folder / "venv" / "bin"
    python = programs / "python"
    run(python, "-m", "pip", "install", "--no-deps", "--no-index", wheel, cwd=folder)
    # Appended to sys.path as a plain path: .pth files in it, such as that of an editable
    # installation of this project, are not read.
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder)
    libraries = sysconfig.get_path("purelib")
    (Path(site.strip()) / "libraries.pth").write_text(libraries + "\n")
    return programs


def test_the_wheel_holds_every_file_of_the_packages(wheel: Path):
    expected = {
        f"{name}/{file.relative_to(ROOT / folder).as_posix()}"
        for folder, name in PACKAGES.items()
        for file in (ROOT / folder).rglob("*")
        if file.name.endswith(SHIPPED)
    }
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == expected


def test_no_package_of_the_users_own_is_hidden(installed: Path, tmp_path: Path):
    """Neither `scripts` nor `tests` is a top-level name after installation."""
    code = (
        "import importlib.util as u, youbot_env, youbot_scripts;"
        "print(u.find_spec('scripts'), u.find_spec('tests'), youbot_env.__file__)"
    )
    out = run(installed / "python", "-c", code, cwd=tmp_path)
    scripts, tests, path = out.split()
    assert (scripts, tests) == ("None", "None")
    assert not Path(path).is_relative_to(ROOT)


def test_the_command_works(installed: Path, tmp_path: Path):
    from youbot_scripts import cli

    out = run(installed / "youbot", "--help", cwd=tmp_path)
    for name, summary in cli.available().items():
        assert name in out
        assert summary in out


def test_the_core_imports_from_the_wheel(installed: Path, tmp_path: Path):
    run(
        installed / "python",
        "-c",
        "import youbot_env, identification, controllers",
        cwd=tmp_path,
    )
