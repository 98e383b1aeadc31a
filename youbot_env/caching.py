"""Compiled functions that are cached on disk, and the folders that caches may lie in.

Cached machine code is loaded as pickles, so whoever can write into the folder can run code as the
user: a folder is used only if it is the user's own and nobody else can write to it. Everything
works without a cache, too: then functions are compiled again in each process.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

CACHE_VARIABLE = "YOUBOT_CACHE_DIR"
"""Environment variable that moves the caches."""


def njit(
    *, cache: bool = False, inner: bool = False, **options: Any
) -> Callable[[Callable[..., Any]], Any]:
    """``numba.njit``, whose cache can neither stop a program nor be a stranger's.

    A function that is ``inner`` is called by compiled code alone: what Python calls it by is not
    compiled, which is a quarter of the work for a short one. Calling it from Python is an error.

    numba raises where it finds no folder to write to (an installed package without a home folder),
    and where a file of the cache is damaged or the disk is full. Here the function is compiled
    instead.
    """
    import numba

    if inner:
        options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    def decorate(function: Callable[..., Any]) -> Any:
        compiled: Any = numba.njit(**options)(function)
        if cache and (found := _function_cache(function)) is not None:
            compiled._cache = found  # what its method enable_caching does
        return compiled

    return decorate


def _function_cache(function: Callable[..., Any]) -> Any:
    """The cache of a function: beside its file, or in the cache folder; None where neither is."""
    import numba

    kind = _cache_kind()
    try:
        return kind(function)
    except RuntimeError:  # numba found no folder that it can write to
        pass
    folder = cache_folder()
    if folder is None:
        return None
    # numba takes its folder from this setting when a cache is made; it is for other code, too.
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder.parent / "functions")  # pyright: ignore
    try:
        return kind(function)
    except (RuntimeError, OSError):
        return None
    finally:
        numba.config.CACHE_DIR = before  # pyright: ignore


@cache
def _cache_kind() -> Any:
    from numba.core.caching import FunctionCache, IndexDataCacheFile
    from numba.core.runtime.nrt import rtsys

    class SafeCache(FunctionCache):
        """A cache that is passed over where it cannot be read or written, or is of older code."""

        def __init__(self, py_func: Any) -> None:
            super().__init__(py_func)
            # numba looks at the function's own file alone. Constants of other modules and functions
            # that it calls are in its machine code too: an old one would read wrong memory.
            self._cache_file = IndexDataCacheFile(
                cache_path=self._cache_path,
                filename_base=self._impl.filename_base,
                source_stamp=(self._impl.locator.get_source_stamp(), code_stamp()),
            )

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            # numba's own method first registers all that can be compiled and imports SciPy's linear
            # algebra: 0.3 s of a process that only runs what is compiled already. The compiler
            # registers it by itself; to run a function takes the memory manager alone.
            quick = getattr(self, "_load_overload", None)
            try:
                if quick is None:  # another version of numba
                    return super().load_overload(sig, target_context)
                rtsys.initialize(target_context)
                with self._guard_against_spurious_io_errors():
                    return quick(sig, target_context)
            except Exception:
                # A torn file, or pickles of another version, raise anything.
                self._passed_over(self.flush)
                return None

        def save_overload(self, sig: Any, data: Any) -> None:
            self._passed_over(lambda: super(SafeCache, self).save_overload(sig, data))

        def _passed_over(self, action: Callable[[], None]) -> None:
            try:
                action()
            except Exception:  # a full disk, a folder that has gone
                self.disable()

    return SafeCache


@cache
def code_stamp() -> str:
    """A digest of the sources that compiled functions take constants and other functions from."""
    found, package = hashlib.sha256(), Path(__file__).parent
    for folder in ("simulation", "tracking", "motions"):
        for path in sorted((package / folder).glob("*.py")):
            found.update(f"{folder}/{path.name}\n".encode() + path.read_bytes())
    return found.hexdigest()


# --- folders ---------------------------------------------------------------------------------


def cache_folder() -> Path | None:
    """Where generated kernels lie, made if it is missing; None where no folder is safe.

    The environment variable YOUBOT_CACHE_DIR moves it.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen) if _is_ours(Path(chosen)) else None
    try:
        folder = Path(platformdirs.user_cache_dir("youbot")) / "kernels"
    except RuntimeError:  # a user without a home, as in a container
        return None
    # Some versions of platformdirs leave "~" as it is: it would be made in the working folder.
    return folder if folder.is_absolute() and _is_ours(folder) else None


@cache
def _is_ours(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if is_safe(folder):
            return os.access(folder, os.W_OK)
        if _owned(folder.stat()):
            # An older version made it with the user's umask.
            folder.chmod(0o700)
            return is_safe(folder)
    except OSError:
        return False
    warnings.warn(
        f"cache folder {folder}: other users can write to it, so nothing is loaded from there and "
        f"each run compiles anew; set {CACHE_VARIABLE} to a folder of your own",
        stacklevel=2,
    )
    return False


def is_safe(path: Path) -> bool:
    """Whether a file or folder is the user's own and nobody else can write to it."""
    try:
        found = path.stat()
    except OSError:
        return False
    others = stat.S_IWGRP | stat.S_IWOTH
    return _owned(found) and not (os.name == "posix" and found.st_mode & others)


def _owned(found: os.stat_result) -> bool:
    # Windows has no such numbers; its caches lie in the user's profile. Root may do all anyway.
    return not hasattr(os, "geteuid") or found.st_uid in (os.geteuid(), 0)


@cache
def private_folder() -> Path:
    """A folder of this process alone, removed at its end."""
    folder = tempfile.TemporaryDirectory(prefix="youbot-", ignore_cleanup_errors=True)
    atexit.register(folder.cleanup)
    return Path(folder.name)
