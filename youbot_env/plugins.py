"""Effects from outside the package: a user's own file, or an installed package's entry points.

Both run foreign code, so both happen only where a user asks for it. A model file never runs code:
it names effects, and a name that is not registered is an error.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import youbot_env.physics.catalogue  # noqa: F401 - a user's effect must not come before the shipped ones
import youbot_env.physics.kinematic_effects  # noqa: F401 - the same
from youbot_env.errors import InputError
from youbot_env.physics.effect import OPEN, Effect, Registry

GROUP = "youbot.effects"
"""Entry point group: each entry names a module that registers effects when imported."""


_loaded: list[str] = []


def loaded_files() -> tuple[str, ...]:
    """Files whose effects were loaded in this process, for the processes that it starts."""
    return tuple(_loaded)


def run_file(path: str | Path) -> ModuleType:
    """Run a user's Python file and return the module that it makes.

    Raises
    ------
    InputError
        If it cannot be read or run: one line with file and row.
    """
    _check_file(Path(path), "give a Python file")
    name = _module_name(Path(path))
    try:
        return _run(name, Path(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (Exception, SystemExit) as error:
        raise fault_in_file(path, error) from None


def fault_in_file(path: str | Path, error: BaseException) -> InputError:
    """The error to raise for an exception in a user's file: file, row, kind and words."""
    return InputError(f"{path}: {_where(error, str(path))}{_what(error)}")


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """Run a user's Python file and return the effects that it registers (see ``effect``).

    The effects are in the catalogue from then on, under their names. Loading the same file again is
    harmless. If anything is wrong, the catalogue stays as it was.

    Raises
    ------
    InputError
        If the file cannot be read or run, registers nothing, takes a name that is in use, or holds
        an effect that does not work on numbers and symbols: one line with file and row.
    """
    path = Path(path)
    _check_file(path, "give a Python file that registers effects")
    found = _registered(str(path), lambda: _run(_module_name(path), path))
    if str(path.absolute()) not in _loaded:
        _loaded.append(str(path.absolute()))
    return found


def _check_file(path: Path, cure: str) -> None:
    if not path.is_file():
        raise InputError(f"{path}: no such file; {cure}")
    if path.suffix != ".py":
        raise InputError(f"{path}: not a Python file (its name must end in .py)")


def _module_name(path: Path) -> str:
    # A name made of the path: two files with one name must not be one module.
    return f"youbot_user_{sha256(str(path.resolve()).encode()).hexdigest()[:12]}"


def load_installed_effects() -> tuple[Effect, ...]:
    """Import what installed packages offer under the entry point group ``youbot.effects``.

    Raises
    ------
    InputError
        If one of them fails: one line with the package's and the entry's name.
    """
    found: list[Effect] = []
    for entry in metadata.entry_points(group=GROUP):
        package = entry.dist.name if entry.dist else "an installed package"
        found += _registered(f"{package}: {GROUP}: {entry.name}", entry.load)
    return tuple(found)


def _registered(source: str, run: Callable[[], Any]) -> tuple[Effect, ...]:
    before = {id(registry): {item.name: item for item in registry} for registry in OPEN}
    with _undone_on_error(source):
        run()
        # By identity: a file that is loaded again registers new objects under the old names. A
        # catalogue that is imported by the file comes with effects of its own.
        new = [
            (registry, item)
            for registry in OPEN
            for item in registry
            if before.get(id(registry), {}).get(item.name) is not item and not _ships(item)
        ]
        if not new and source.endswith(".py"):
            raise InputError("registers no effect; decorate a function with @effect(...)")
        for registry, item in new:
            _try_out(registry, item)
    return tuple(item for _, item in new)


def _ships(item: Effect) -> bool:
    """Whether an effect is of these packages' own."""
    package = getattr(item.function, "__module__", "").partition(".")[0]
    return package in ("youbot_env", "identification")


@contextmanager
def _undone_on_error(source: str) -> Iterator[None]:
    with ExitStack() as stack:
        for registry in OPEN:
            stack.enter_context(registry.restored_on_error())
        try:
            yield
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        # SystemExit too: a user's file that calls exit() must not end the program silently.
        except (Exception, SystemExit) as error:
            raise InputError(f"{source}: {_where(error, source)}{_what(error)}") from None


def _where(error: BaseException, source: str) -> str:
    """Row of the user's file in which an exception arose."""
    if isinstance(error, SyntaxError):
        return f"row {error.lineno}: "
    # The last frame in the user's file: frames after it belong to libraries that it called.
    rows = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename) == Path(source).absolute() or frame.filename == source
    ]
    return f"row {rows[-1]}: " if rows else ""


def _what(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _run(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path.absolute())
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Before the module runs: dataclasses and pickle look for a class's module there.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _try_out(registry: Registry, item: Effect) -> None:
    """Evaluate a new effect as a simulation will: on numbers, and on symbols for the compiler."""
    # Imported late: sympy is slow to load, and most runs need no plugin.
    module, _, name = registry.trial.partition(":")
    try_out = getattr(importlib.import_module(module), name)
    for parameter in {*item.parameters, *item.public_parameters}:
        size = parameter.size if parameter.default is None else parameter.default
        if not parameter.lower <= size <= parameter.upper:
            raise InputError(
                f"effect {item.name}: {parameter.name} = {size:g} is outside its own bounds "
                f"[{parameter.lower:g}, {parameter.upper:g}]"
            )
    try_out(item)
