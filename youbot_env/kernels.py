"""Compiled steppers: generated source, compiled by numba, cached on disk per set of effects."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import platformdirs

import youbot_env
from youbot_env import codegen, dynamics
from youbot_env.dynamics import Structure


@dataclass(frozen=True)
class Kernel:
    """Compiled functions for one set of effects.

    advance(state, torque, lengths, theta, duration, substeps)
        ``state`` (n, S) moves on in place by ``duration`` [s] under the interface torques
        ``torque`` (n, 4) [N m], held constant. ``lengths`` (4,): l, h, R, r [m];
        ``theta`` (n, P) in the order of ``structure.parameter_names``. One platform is a batch of
        one: the same code.
    rollout(start, torque, duration, lengths, theta, substeps, out)
        Free run from ``start`` (S,) under ``torque`` (N, 4), linear between samples that lie
        ``duration`` (N - 1,) [s] apart; fills ``out`` (N, S).
    """

    structure: Structure
    advance: Any
    rollout: Any
    derivative: Any


@lru_cache(maxsize=64)
def kernel(structure: Structure) -> Kernel:
    """The compiled kernel of a structure; compiles at the first use on a machine."""
    module = _load(_cached_source(structure))
    return Kernel(structure, module.advance, module.rollout, module.derivative)


def cache_folder() -> Path:
    """Where generated kernels live; the environment variable YOUBOT_CACHE_DIR moves it."""
    chosen = os.environ.get("YOUBOT_CACHE_DIR")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("youbot")) / "kernels"


def _cached_source(structure: Structure) -> Path:
    folder = cache_folder()
    path = folder / f"kernel_{_key(structure)}.py"
    if path.exists():
        return path
    source = codegen.kernel_source(structure)
    try:
        return _write(path, source)
    except OSError:
        # A read-only home must not keep anybody from simulating: compile for this process alone.
        return _write(Path(tempfile.mkdtemp(prefix="youbot-")) / path.name, source)


def _write(path: Path, source: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        stream.write(source)
    os.replace(temporary, path)
    return path


def _key(structure: Structure) -> str:
    digest = hashlib.sha256(youbot_env.__version__.encode())
    for module in (codegen, dynamics):
        digest.update(Path(str(module.__file__)).read_bytes())
    for item in structure.components:
        digest.update(repr((item.name, item.acts_at.name, item.parameter_names)).encode())
        _digest_code(digest, item.function)
    return digest.hexdigest()[:24]


def _digest_code(digest: Any, function: Any) -> None:
    """An effect's bytecode with its constants and globals: what it computes, not its comments."""
    code = function.__code__
    digest.update(code.co_code)
    digest.update(repr([c for c in code.co_consts if not isinstance(c, CodeType)]).encode())
    digest.update(repr(code.co_names).encode())
    for name in code.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, (int, float)):
            digest.update(repr((name, value)).encode())


def _load(path: Path) -> ModuleType:
    name = f"_youbot_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
