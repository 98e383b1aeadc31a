"""Reading and writing files: atomic writes, and JSON that is checked against a schema.

All JSON files of users (models, gains, policies, training runs, results, motions) are read here, so
one place refuses what no file may hold: a key given twice, a number outside the range of floats,
NaN, too deep nesting.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
import select
import stat
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

from youbot_env.errors import InputError

T = TypeVar("T")
Schema = Mapping[str, Any]
"""A JSON schema (draft 7)."""

SCHEMA_VERSION = 1
"""Raised when a field changes its meaning; older files are then refused with a clear line."""

MAX_BYTES = 1 << 24
"""Size of a JSON file [bytes]: a model with the covariance of 100 parameters has a fiftieth."""

SUFFIX_KEPT = 24
"""Characters of a file's suffixes that its stand-in keeps: the longest, .safetensors, has 12."""

CHUNK = 1 << 20
"""Bytes that are read at a time."""

PATIENCE = 3
"""[s] for which a pipe waits for somebody who writes into it."""

MAX_DEPTH = 64
"""Objects and lists inside each other; the files that we write nest 8 deep."""

LARGEST = sys.float_info.max

MAX_SHOWN = 40
"""Characters of a file's own text that a message repeats."""

MAX_CAUSE = 800
"""Characters of a message after the file's name: the list of all effects has 500."""


# --- writing ---------------------------------------------------------------------------------


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
    # Of a symbolic link the file behind it is replaced: os.replace would replace the link itself.
    stand_in = None
    try:
        target = Path(os.path.realpath(path))
        if not target.parent.is_dir():
            reason = f"there is no folder {target.parent}; create it first"
            raise InputError(f"{path}: cannot be written: {reason}")
        # A device or a pipe (/dev/stdout) must not be replaced by a file.
        if not (target.is_file() or target.is_dir() or not target.exists()):
            yield target
            return
        stand_in = _stand_in(target)
        yield stand_in
        _to_disk(stand_in)
        os.replace(stand_in, target)
    except (OSError, ValueError) as error:
        if isinstance(error, ValueError) and "null" not in str(error):
            raise
        # ValueError: a name with a null byte.
        reason = (error.strerror if isinstance(error, OSError) else "") or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); check folder and disk") from None
    finally:
        if stand_in is not None:
            stand_in.unlink(missing_ok=True)


def _stand_in(target: Path) -> Path:
    """A new file beside ``target``, with its permissions where it exists."""
    # In a folder that is open to others a name that can be guessed could be a link that they made,
    # to a file that would be overwritten. "x" refuses what exists already.
    suffixes = "".join(target.suffixes[-2:])[-SUFFIX_KEPT:]
    while True:
        path = target.with_name(f".{secrets.token_hex(8)}{suffixes}")
        try:
            path.open("xb").close()
        except FileExistsError:
            continue
        if target.exists():
            path.chmod(stat.S_IMODE(target.stat().st_mode))
        return path


def _to_disk(path: Path) -> None:
    """Wait until a file's content is on the disk: after a power cut a renamed file may be empty."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def write_atomically(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Replace a file's content at once: see :func:`atomic_path`. Text is written as UTF-8; bytes of
    names that are no UTF-8 become escapes."""
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    with atomic_path(path) as stand_in:
        stand_in.write_bytes(data)


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write a JSON file: complete or not at all."""
    write_atomically(path, json_text(content))


def json_text(content: Mapping[str, Any]) -> str:
    """The text of a JSON file."""
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """What JSON can hold: errors and provenance may bring numpy values, NaN and paths."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    # numpy's arrays and scalars, without an import of numpy.
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        # JSON has no NaN and no infinity.
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


# --- kinds of file ---------------------------------------------------------------------------


@dataclass(frozen=True)
class FileKind(Generic[T]):
    """A kind of JSON file: what it is called, what it may hold, what it becomes.

    Attributes
    ----------
    noun : for messages, "a model file"
    schema : what the content must look like, beyond its version; a name must be in ``required``
        to be demanded, and ``additionalProperties: False`` refuses unknown ones
    build : makes the object of content that fits the schema; takes the file's name for messages
    version : the ``schema_version`` that is read; None for a kind that has none
    max_bytes : of a file
    may_hold_nan : whether NaN and Infinity are values, as in the results of diverged loops
    """

    noun: str
    schema: Schema
    build: Callable[[dict[str, Any], str], T]
    version: int | None = SCHEMA_VERSION
    max_bytes: int = MAX_BYTES
    may_hold_nan: bool = False

    def from_text(self, text: str | bytes, source: str) -> T:
        """The object that a file's text describes; ``source`` names the file in messages."""
        return self.from_content(parse_json(text, source, self), source)

    def from_content(self, content: Any, source: str) -> T:
        """The object that parsed content describes.

        Raises
        ------
        InputError
            If the content does not fit the schema or cannot be built: source, path and cause.
        """
        found = self.checked(content, source)
        try:
            return self.build(found, source)
        except InputError as error:
            raise named(source, error) from None
        except (ArithmeticError, ValueError) as error:
            # Numbers that are each possible, 1e308 kg say, may overflow together; numpy's
            # LinAlgError is a ValueError.
            cause = InputError(f"its numbers cannot be used together: {error}")
            raise named(source, cause) from None

    def checked(self, content: Any, source: str) -> dict[str, Any]:
        """The content, if it is an object of this version that fits the schema."""
        self.check_version(content, source)
        # Imported late: commands that read no file start without it.
        from fastjsonschema import JsonSchemaValueException

        found = dict(content)  # any mapping may come; the validator accepts dictionaries only
        try:
            self._validate(found)
        except JsonSchemaValueException as error:
            raise named(source, InputError(_misfit(error, self.noun))) from None
        return found

    def check_version(self, content: Any, source: str) -> None:
        """Refuse what is no object, and files of other versions."""
        if not isinstance(content, Mapping):
            raise InputError(f"{source}: the file must be a JSON object")
        version = content.get("schema_version")
        # true == 1 in Python, and true is no version.
        if self.version is None or (version == self.version and not isinstance(version, bool)):
            return
        raise InputError(
            f"{source}: schema_version is {_short(repr(version))}, this version of youbot reads "
            f"{self.version}: not {self.noun}, or written by another version"
        )

    @cached_property
    def _validate(self) -> Callable[[Any], Any]:
        """The schema's validator. Compiled at first use, because compiling takes 5 ms."""
        import fastjsonschema

        return fastjsonschema.compile(dict(self.schema), use_default=False)


def read_json(
    path: str | os.PathLike[str], kind: FileKind[T], missing: Callable[[], str] | None = None
) -> T:
    """The object that a JSON file of a kind describes.

    Parameters
    ----------
    missing : makes advice where there is no such file

    Raises
    ------
    InputError
        If the file cannot be read or is not valid: one line with file, path in it and cause.
    """
    source = os.fspath(path)
    return kind.from_text(read_bytes(source, kind.max_bytes, missing), source)


def read_bytes(
    path: str | os.PathLike[str], max_bytes: int, missing: Callable[[], str] | None = None
) -> bytes:
    """A file's bytes, never more than ``max_bytes``; ``missing`` advises where there is none.

    A pipe, as the shell's ``<(...)`` makes one, is read to its end.

    Raises
    ------
    InputError
        If it cannot be read or is larger.
    """
    source = os.fspath(path)
    try:
        return read_bounded(source, max_bytes)
    except FileNotFoundError as error:
        reason = f"no such file; {missing()}" if missing else f"cannot be read: {error.strerror}"
        raise InputError(f"{source}: {reason}") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        # ValueError: a name with a null byte.
        reason = (error.strerror if isinstance(error, OSError) else "") or "not a file's name"
        raise InputError(f"{source}: cannot be read: {reason}") from None


def read_bounded(source: str, max_bytes: int) -> bytes:
    """The bytes of a file, a pipe or a device, of which some never end.

    Raises
    ------
    InputError
        If there are more than ``max_bytes``.
    OSError
        If it cannot be read, or nobody writes into a pipe.
    ValueError
        If the name holds a null byte.
    """
    # O_NONBLOCK: otherwise the opening of a pipe would wait for ever for somebody who writes.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    handle = os.open(source, flags)
    try:
        found = os.fstat(handle)
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        # A size of 0 says nothing: files of /proc have it.
        size = found.st_size if stat.S_ISREG(found.st_mode) else 0
        content = (
            b"" if size > max_bytes else _read(handle, max_bytes, stat.S_ISFIFO(found.st_mode))
        )
    finally:
        os.close(handle)
    if max(size, len(content)) > max_bytes:
        raise InputError(f"{source}: is larger than {max_bytes >> 20} MiB: too large to be read")
    return content


def _read(handle: int, max_bytes: int, is_pipe: bool) -> bytes:
    """At most ``max_bytes`` + 1 bytes: one more than allowed, so that more of them shows."""
    pieces: list[bytes] = []
    size = 0
    while size <= max_bytes:
        try:
            piece = os.read(handle, min(CHUNK, max_bytes + 1 - size))
        except BlockingIOError:
            select.select([handle], [], [])  # somebody has opened the pipe and will write
            continue
        if piece:
            pieces.append(piece)
            size += len(piece)
        elif not is_pipe or pieces or not _somebody_writes(handle):
            break
    return b"".join(pieces)


def _somebody_writes(handle: int) -> bool:
    """Whether something comes out of a pipe that seems to be at its end.

    Raises
    ------
    OSError
        If nobody opens it to write.
    """
    waiting = select.poll()
    waiting.register(handle, select.POLLIN)
    found = waiting.poll(1000 * PATIENCE)
    if not found:
        raise OSError(errno.ETIMEDOUT, "nobody writes into this pipe")
    return bool(found[0][1] & select.POLLIN)


def named(source: str, error: InputError) -> InputError:
    """The same error, with the file's name in front, cut to ``MAX_CAUSE`` characters."""
    cause = str(error).removeprefix(f"{source}: ")
    # The message may repeat names and values of the file, which can be megabytes long.
    return InputError(
        f"{source}: {cause if len(cause) <= MAX_CAUSE else cause[:MAX_CAUSE] + '...'}"
    )


# --- JSON ------------------------------------------------------------------------------------


def parse_json(text: str | bytes, source: str, kind: FileKind[Any]) -> Any:
    """The content of a JSON text, refused where JSON readers could understand it differently.

    Raises
    ------
    InputError
        If it is no UTF-8 or no JSON, gives a key twice, nests too deep, or holds a number that is
        not finite: one line with row and column, or with the path in the file.
    """
    if isinstance(text, bytes):
        if text.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise InputError(f"{source}: cannot be read: is UTF-16 text; save it as UTF-8")
        try:
            text = text.decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(f"{source}: cannot be read: not a text file") from None
    # Editors on Windows begin a file with a byte-order mark.
    text = text.removeprefix("\ufeff")
    try:
        content = json.loads(text, object_pairs_hook=_object)
    except (ValueError, RecursionError) as error:
        # A ValueError that is no JSONDecodeError comes from an integer of thousands of digits, a
        # RecursionError from deep nesting.
        is_syntax = isinstance(error, json.JSONDecodeError)
        where = f"row {error.lineno}, column {error.colno}: " if is_syntax else ""
        raise InputError(f"{source}: {where}not valid JSON; is it {kind.noun}?") from None
    if fault := _fault(content, kind.may_hold_nan, MAX_DEPTH):
        raise InputError(f"{source}: {_at(fault[0])}{fault[1]}")
    return content


class _Repeated(dict[str, Any]):
    """Marks an object that gives ``key`` twice.

    The parser does not know the path of an object; ``_fault`` does, and reports the key.
    """

    def __init__(self, key: str) -> None:
        super().__init__()
        self.key = key


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) == len(pairs):
        return found
    # One pass: a search for each key would take too long for a file with a million keys.
    seen: set[str] = set()
    return _Repeated(next(key for key, _ in pairs if key in seen or seen.add(key)))


def _fault(value: Any, may_hold_nan: bool, depth: int) -> tuple[str, str] | None:
    """Path and description of the first thing in a JSON value that no file may hold."""
    if isinstance(value, (float, int)):
        # A JSON integer may be larger than any float; NaN compares false with everything.
        is_number = -LARGEST <= value <= LARGEST or (may_hold_nan and isinstance(value, float))
        return None if is_number else ("", f"{_short(value)} is not a finite number")
    if not isinstance(value, (dict, list)):
        return None
    if depth == 0:
        return "", f"nested more than {MAX_DEPTH} deep; no file of youbot is"
    if isinstance(value, _Repeated):
        return "", f"key {_short(repr(value.key))} is given twice; remove one"
    is_object = isinstance(value, dict)
    for key, item in value.items() if is_object else enumerate(value):
        # Nearly all values are texts or finite numbers; a recursive call for each would be slow.
        kind = type(item)
        if kind is str or (kind is float and -LARGEST <= item <= LARGEST):
            continue
        if found := _fault(item, may_hold_nan, depth - 1):
            return (f".{_short(key)}" if is_object else f"[{key}]") + found[0], found[1]
    return None


def _at(path: str) -> str:
    """A path as the beginning of a message: "path: ", or "" at the top."""
    path = path.removeprefix(".")
    return f"{path}: " if path else ""


def _short(value: Any) -> str:
    """Text of a file as a message may repeat it: at most ``MAX_SHOWN`` characters."""
    try:
        text = str(value)
    except ValueError:  # an integer of thousands of digits
        return "a huge value"
    if len(text) <= MAX_SHOWN:
        return text
    return f"{text[:MAX_SHOWN]}..." if isinstance(value, str) else "a huge value"


# --- what does not fit a schema, in words ----------------------------------------------------

TYPES = {
    "object": "must be a JSON object",
    "array": "must be a JSON list",
    "string": "must be a text",
    "boolean": "must be true or false",
    "integer": "must be a whole number",
}
"""What each JSON type is called; a number that is none is shown."""

BOUNDS = {
    "minimum": "at least",
    "maximum": "at most",
    "exclusiveMinimum": "more than",
    "exclusiveMaximum": "less than",
}


def _misfit(error: Any, noun: str) -> str:
    """A validator's error as `path: cause`, in the words that all our messages use."""
    # The validator calls the whole content "data".
    path = error.name.removeprefix("data").removeprefix(".")
    what, rule, value, node = path or "the file", error.rule, error.value, error.definition
    if rule == "required":
        key = next(name for name in error.rule_definition if name not in value)
        if path:
            return f"{path} lacks {key!r} (it needs {', '.join(error.rule_definition)})"
        wanted = _type_of(node.get("properties", {}).get(key, {}))
        demand = f"{key} {TYPES[wanted]}; " if wanted in TYPES else ""
        return f"{key!r} is missing: {demand}is it {noun}?"
    if rule == "additionalProperties":
        key = next(name for name in value if name not in node["properties"])
        known = ", ".join(node["properties"])
        return f"{_at(path)}unknown key {_short(repr(key))}; known are {known}"
    if rule == "enum":
        return (
            f"{what} {_short(repr(value))} is none of {', '.join(map(str, error.rule_definition))}"
        )
    if rule in BOUNDS:
        return f"{what}: {_short(value)} must be {BOUNDS[rule]} {error.rule_definition:.10g}"
    if rule in ("minItems", "maxItems"):
        bound = "at least" if rule == "minItems" else "at most"
        return f"{what} must have {bound} {error.rule_definition} entries, not {len(value)}"
    wanted = _type_of(node)
    if rule == "type" and wanted in TYPES:
        return f"{what} {TYPES[wanted]}"
    if rule == "type":
        return f"{what}: {_short(value)} is not a finite number"
    return f"{what}: does not fit {rule} {error.rule_definition}"


def _type_of(node: Schema) -> str:
    """The first type that a schema's node allows, "" if any."""
    types: str | Sequence[str] = node.get("type", "")
    return types if isinstance(types, str) else types[0]
