"""Options, progress and file output that the commands share."""

from __future__ import annotations

import json
import math
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

PROGRESS_FILE = "YOUBOT_PROGRESS_FILE"
"""Environment variable: the file into which a command writes the share that it has done."""

STDOUT = Path("-")
"""The file name that means standard output."""


# --- options ---------------------------------------------------------------------------------


def check_output(path: Path | None) -> Path | None:
    """Typer callback: refuse an output file that cannot be made before anything is computed.

    Raises
    ------
    InputError
        If `path` is a folder, or its folder is missing or not writable.
    """
    if path is None or path == STDOUT:
        return path
    if path.is_dir():
        raise _input_error(f"{path}: is a folder; name a file in it")
    if not path.parent.is_dir():
        raise _input_error(f"{path}: folder {path.parent} does not exist; create it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise _input_error(f"{path}: no permission to write there")
    return path


LogsArgument = Annotated[
    list[Path],
    typer.Argument(metavar="LOG...", help="Logs: .csv, .csv.gz or .parquet, 20 Hz to 1 kHz."),
]
ModelArgument = Annotated[
    str,
    typer.Argument(metavar="MODEL", help="Model file (JSON), or 'paper' for the published one."),
]
OutputModelOption = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="MODEL", callback=check_output, help="Write the model file here."
    ),
]
GeometryOption = Annotated[
    str | None,
    typer.Option(
        "--geometry",
        metavar="FILE",
        help="Another platform's l, h, R, r (m) and m1 (kg): a JSON file or a model.",
    ),
]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="F",
        callback=check_output,
        help="Write the result as JSON to F; '-' is standard output (tables then go to stderr).",
    ),
]
PlotsOption = Annotated[
    Path | None,
    typer.Option(
        "--plots", metavar="DIR", help="Draw plots into this folder, PNG and SVG (extra: plots)."
    ),
]
ReportOption = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="F.html",
        callback=check_output,
        help="Write tables and charts as one web page (extra: plots).",
    ),
]
MechanismOption = Annotated[
    str | None,
    typer.Option(
        "--mechanism", metavar="NAME", help="mecanum or axis; only checked: the model says it."
    ),
]


def load_user_effects(path: Path | None) -> Path | None:
    """Typer callback: register a user's effects before any model is read, which may name them.

    Raises
    ------
    InputError
        If the file cannot be run or registers nothing.
    """
    if path is not None:
        from youbot_env.plugins import load_effects

        load_effects(path)
    return path


EffectsOption = Annotated[
    Path | None,
    typer.Option(
        "--effects",
        metavar="FILE.py",
        callback=load_user_effects,
        help="Your own effects; runs this file.",
    ),
]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, max=256, metavar="N", help="Processes.")]
LogsOfOption = Annotated[
    str,
    typer.Option("--mechanism", metavar="NAME", help="What the logs are of: mecanum, axis."),
]
UnitOption = Annotated[
    str,
    typer.Option("--unit", help="Of an axis' position: rad (rad/s, N m) or m (m/s, N)."),
]
StrictOption = Annotated[
    bool,
    typer.Option(
        "--strict", help="Refuse all logs where one cannot be used; else it is set aside."
    ),
]
SeedOption = Annotated[
    int, typer.Option("--seed", metavar="N", min=0, help="Seed of all random numbers.")
]


def check_pictures(folder: Path | None, report: Path | None) -> None:
    """Refuse pictures (``--plots``, ``--report``) that cannot be drawn, before anything is done.

    Raises
    ------
    InputError
        If a library that they need is not installed, or there is something else where the
        folder should be.
    """
    if folder is None and report is None:
        return
    from identification.figures.style import matplotlib

    matplotlib()
    if report is not None:
        from youbot_env.errors import optional_library

        for name in ("plotly", "jinja2", "latex2mathml"):
            optional_library(name, "plots", f"pages need {name}", "leave --report out")
    if folder is not None and not folder.is_dir():
        # The nearest folder that exists: mkdir makes those between, and needs permission there.
        there = next(part for part in (folder, *folder.absolute().parents) if part.exists())
        if not there.is_dir():
            raise _input_error(f"{folder}: cannot be made a folder: {there} is a file")
        if not os.access(there, os.W_OK):
            raise _input_error(f"{folder}: cannot be made a folder: no permission to write there")


# --- files -----------------------------------------------------------------------------------


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, unless it is there.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _input_error(f"{path}: cannot be made a folder: {error.strerror or error}") from None


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to the file `path` as a whole or not at all; "-" is standard output.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if Path(path) == STDOUT:
        sys.stdout.write(text)
        return
    from youbot_env.files import write_atomically  # as in `_input_error`

    write_atomically(path, text)


def write_json(path: Path | str, data: Any) -> None:
    """Write `data` as JSON, like `write_text`.

    NumPy arrays and numbers and paths become their plain counterparts; NaN and infinities, which
    JSON lacks, become null.
    """
    write_text(path, json.dumps(_plain(data), indent=2, allow_nan=False) + "\n")


def write_result(path: Path | None, result: Mapping[str, Any], seed: int | None = None) -> None:
    """Write a command's result with its `provenance`, where the user asked for it (`--json`)."""
    if path is not None:
        write_json(path, {**result, **provenance(seed)})


def provenance(seed: int | None = None) -> dict[str, Any]:
    """What is needed to repeat a result: version, seed, and versions of Python and libraries."""
    from importlib.metadata import version  # its import takes 35 ms and only a result file needs it

    versions = {name: version(name) for name in ("numpy", "scipy", "numba")}
    return {
        "version": version("youbot"),
        "seed": seed,
        "versions": {"python": platform.python_version(), **versions},
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, os.PathLike) else value


def _input_error(message: str) -> ValueError:
    # Imported here because loading the package would slow `youbot --help` down.
    from youbot_env.errors import InputError

    return InputError(message)


# --- the terminal ----------------------------------------------------------------------------


NO_BREAK = "\ue000"
"""Stands for a space at which no line may end: a sign of nobody's, as wide as a space."""


def console(json: Path | None = None) -> Console:
    """Where a command prints: standard output, or standard error if that is for the JSON."""
    from rich.console import Console
    from rich.segment import Segment
    from rich.text import Text

    from youbot_env.errors import visible  # as in `_input_error`

    class PlainConsole(Console):
        def render_str(self, text: str, **options: Any) -> Text:
            # Names of files and models, and messages of libraries, may hold a terminal's commands.
            lines = (visible(line.replace("\t", "    ")) for line in text.split("\n"))
            return super().render_str("\n".join(lines), **options)

        def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
            if not isinstance(renderable, Text) or " %" not in renderable.plain:
                yield from super().render(renderable, options)
                return
            # Rich ends a line at any kind of space; a per cent sign must not begin one.
            kept = renderable.copy()
            kept.plain = re.sub(r"(?<=\d) (?=%)", NO_BREAK, kept.plain)
            for segment in super().render(kept, options):
                yield segment._replace(text=segment.text.replace(NO_BREAK, " "))

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # Rich would exit with status 1; `cli.main` returns 141

    # No markup and emoji codes: names of files and units may hold brackets and colons.
    return PlainConsole(stderr=json == STDOUT, highlight=False, markup=False, emoji=False)


@contextmanager
def progress(total: float, description: str) -> Iterator[Callable[..., None]]:
    """A progress bar on standard error; yields `advance(steps=1)`.

    No bar if standard error is no terminal. It disappears at the end, also after Ctrl-C. Another
    program learns the share done from the file that ``PROGRESS_FILE`` names.
    """
    told = os.environ.get(PROGRESS_FILE)
    if told:
        yield _told_in_a_file(Path(told), total)
        return
    if not sys.stderr.isatty():
        yield lambda steps=1: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    bar = Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True)
    with bar:
        task = bar.add_task(description, total=total)
        yield lambda steps=1: bar.advance(task, steps)


def _told_in_a_file(path: Path, total: float) -> Callable[..., None]:
    """An ``advance`` that keeps the share done, 0 to 1, in a file."""
    done = 0.0

    def advance(steps: float = 1) -> None:
        nonlocal done
        done += steps
        # The reader may look at any time; a torn number is read as none.
        with suppress(OSError):
            path.write_text(f"{done / max(total, 1e-9):.4f}", encoding="utf-8")

    return advance
