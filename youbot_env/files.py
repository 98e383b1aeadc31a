"""Files that are written as a whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from youbot_env.errors import InputError


def write_atomically(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Replace a file's content at once, by way of a temporary file beside it.

    A link is followed; a device or a pipe is written to, not replaced. Text is written as UTF-8.

    Raises
    ------
    InputError
        If the folder is missing or the file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        reason = f"there is no folder {target.parent}; create it first"
        raise InputError(f"{path}: cannot be written: {reason}")
    temporary = ""
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(data)
            return
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, 0o666 & ~_umask())  # mkstemp's own mode shuts others out
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); check folder and disk") from None
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
