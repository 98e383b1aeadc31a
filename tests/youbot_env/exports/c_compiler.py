"""Compiles exported C and C++ with the compilers of this machine, every warning an error."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

STRICT = ("-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
"""Options of every compilation; the language comes in front."""

C_COMPILERS = ("gcc", "clang")
CXX_OF = {"gcc": "g++", "clang": "clang++"}
LANGUAGE = {
    **dict.fromkeys(C_COMPILERS, "-std=c99"),
    **dict.fromkeys(CXX_OF.values(), "-std=c++17"),
}


def need(compiler: str) -> str:
    """The compiler, or the test is skipped."""
    if shutil.which(compiler) is None:
        pytest.skip(
            f"no compiler {compiler} on this machine: the exported code is not tried with it"
        )
    return compiler


def write(folder: Path, files: Mapping[str, str]) -> None:
    """Write exported files into a folder."""
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8")


def compiled(compiler: str, folder: Path, sources: Sequence[str], out: str, *more: str) -> Path:
    """The program or library ``out`` made of source files in a folder."""
    command = [need(compiler), LANGUAGE[compiler], *STRICT, *more, *sources, "-lm", "-o", out]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[:3000]
    return folder / out


def library(compiler: str, folder: Path, sources: Sequence[str]) -> Path:
    """A shared library, to be called from Python."""
    return compiled(compiler, folder, sources, "exported.so", "-shared", "-fPIC")


def run(program: Path) -> str:
    """What a program prints; it must succeed."""
    done = subprocess.run([str(program)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
