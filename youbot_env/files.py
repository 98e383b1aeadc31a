"""Files that are written as a whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from youbot_env.errors import InputError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path to write to instead of ``path``, which is replaced when the block succeeds.

    The stand-in lies in the same folder and keeps the suffixes, so that writers which look at them
    behave. If the block fails or is interrupted, it is removed and ``path`` is as it was. A link
    is followed; a device or a pipe is written to, not replaced.

    Raises
    ------
    InputError
        If the folder is missing or the file cannot be written.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        reason = f"there is no folder {target.parent}; create it first"
        raise InputError(f"{path}: cannot be written: {reason}")
    replaced = target.is_file() or target.is_dir() or not target.exists()
    stand_in = target.with_name(f".{os.getpid()}-{target.name}") if replaced else target
    try:
        yield stand_in
        if replaced:
            os.replace(stand_in, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); check folder and disk") from None
    finally:
        if replaced:
            stand_in.unlink(missing_ok=True)


def write_atomically(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Replace a file's content at once: see :func:`atomic_path`. Text is written as UTF-8."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    with atomic_path(path) as stand_in:
        stand_in.write_bytes(data)
