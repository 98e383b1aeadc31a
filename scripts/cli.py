"""The `youbot` command.

To add a command, write `scripts/NAME.py` and add its name to `COMMANDS`: one file, one line.
The file holds

- a module docstring whose first line is the summary in `youbot --help`;
- `main`, a plain function with Typer annotations whose docstring is the text of
  `youbot NAME --help`. It raises `youbot_env.errors.InputError` for input that cannot be used;
- `EXAMPLES`, a tuple of command lines that the help shows;
- a last line `if __name__ == "__main__": sys.exit(run_script(__file__))`, so that
  `python scripts/NAME.py ...` and `youbot NAME ...` are the same program.

Options that several commands take are defined once, in `shared/options.py`; the tables of results
in `shared/result_tables.py`.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import shlex
import sys
from collections.abc import Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated

import typer

PACKAGE = "youbot_scripts"

COMMANDS = (
    "record",
    "motions",
    "import",
    "doctor",
    "kinematics",
    "identify",
    "compare",
    "diagnose",
    "add",
    "evaluate",
    "watch",
    "train",
    "tune",
    "bench",
    "benchmark",
    "fleet",
    "effects",
    "export",
    "workbench",
    "demo",
)
"""Names of the commands, in the order of the help; a module of `PACKAGE` each."""

COMPLETE = "_YOUBOT_COMPLETE"
"""Environment variable by which a shell asks for completions: `youbot --install-completion`."""

OK, USAGE, INTERRUPTED, BROKEN_PIPE = 0, 2, 130, 141
"""Exit statuses; the last two are what a shell reports for SIGINT and SIGPIPE."""


# Not sys.argv: a command such as demo runs other commands in this process.
_running: ContextVar[tuple[str, ...]] = ContextVar("running", default=())


def command_line() -> str:
    """The command that runs now, as a shell takes it."""
    return shlex.join(["youbot", *(_running.get() or sys.argv[1:])])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line `arguments` (default: the process's own) and return the exit status.

    Errors that a user can cause end in one line on standard error. Any other exception is a bug
    and keeps its traceback.
    """
    if COMPLETE in os.environ:
        return _complete()
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    # The matrices here are tall and thin: a second BLAS thread costs more than it brings, and
    # results would differ in the last bit from one number of cores to another.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal that cannot show a sign such as ± must not end the command.
            stream.reconfigure(errors="replace")  # pyright: ignore[reportAttributeAccessIssue]
    try:
        status = _invoke(arguments)
        print(end="", flush=True)  # a full disk or a closed pipe raises here, not at exit
        return status
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except ValueError as error:
        from youbot_env.errors import InputError  # slow: not at the top

        if not isinstance(error, InputError):
            raise
        return _complain(f"error: {error}", USAGE)
    except BrokenPipeError:
        _abandon_stdout()
        return BROKEN_PIPE
    except OSError as error:
        _abandon_stdout()
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"error: {where}{error.strerror or error}", USAGE)


def run_script(path: str) -> int:
    """Run the command whose script is the file `path`, with the process's arguments."""
    return main([Path(path).stem, *sys.argv[1:]])


def available() -> dict[str, str]:
    """Name and one-line summary of each command, read without importing its module."""
    found = ((name, importlib.util.find_spec(f"{PACKAGE}.{name}")) for name in COMMANDS)
    return {name: _summary(spec.origin) for name, spec in found if spec and spec.origin}


def build_app(wanted: str | None = None) -> typer.Typer:
    """The Typer application, with only the command `wanted` imported.

    Of the other commands only names and summaries are read: importing them all would load numpy,
    scipy and numba at each start.
    """
    # With Rich, units such as [m/s] in a help text would be read as markup.
    app = typer.Typer(name="youbot", rich_markup_mode=None, help=_HELP, epilog=_EPILOG)
    app.callback()(_global_options)
    for name, summary in available().items():
        if name == wanted:
            module = importlib.import_module(f"{PACKAGE}.{name}")
            epilog = _examples(module.EXAMPLES)
            app.command(name, short_help=summary, epilog=epilog)(module.main)
        else:
            app.command(name, help=summary)(_not_imported)
    return app


_HELP = """Identify, extend and use the dynamic model of a mecanum platform (KUKA youBot).

Units are SI throughout: m, s, rad, kg, N m. Exit status: 0 success, 2 input that cannot be
used (one line says what and where), 130 interrupted."""

_EPILOG = "`youbot COMMAND --help` shows a command's options and examples."


def _invoke(arguments: list[str]) -> int:
    # The command is the first word; options before it take no values.
    wanted = next((argument for argument in arguments if not argument.startswith("-")), None)
    command = typer.main.get_command(build_app(wanted))
    before = _running.set(tuple(arguments))
    try:
        with command.make_context("youbot", list(arguments) or ["--help"]) as context:
            command.invoke(context)
    except typer.Exit as stop:
        # `youbot` alone shows the help, but is no complete command.
        return stop.exit_code if arguments else USAGE
    except typer.Abort:
        return _complain("interrupted", INTERRUPTED)
    except Exception as error:
        # Typer's releases hold the class of usage errors in different modules: it is recognised by
        # its method.
        if not hasattr(error, "format_message"):
            raise
        context = getattr(error, "ctx", None)
        path = context.command_path if context else "youbot"
        return _complain(f"error: {error.format_message()} (see `{path} --help`)", USAGE)  # pyright: ignore[reportAttributeAccessIssue]
    finally:
        _running.reset(before)
    return OK


def _complete() -> int:
    """Print what a shell may offer after the words typed so far, which stand in its variables."""
    typed = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS", "")
    wanted = next((word for word in typed.split()[1:] if word in COMMANDS), None)
    command = typer.main.get_command(build_app(wanted))
    try:
        command.main(args=[], prog_name="youbot")
    except SystemExit as done:  # Click ends the process itself
        return int(done.code or OK)
    return OK


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"youbot {version('youbot')}")
        raise typer.Exit


def _global_options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Options before the command's name; each acts in its own callback."""


def _not_imported() -> None:
    raise AssertionError("a command that was not asked for has no body")


def _summary(path: str) -> str:
    """First line of the module docstring of the file `path`."""
    with open(path, encoding="utf-8") as file:
        return file.readline().strip().strip('"')


def _examples(lines: Sequence[str]) -> str:
    """An epilog that Typer does not rewrap: after a backspace Click keeps a paragraph's lines."""
    return "\n".join(("\b", "Examples:", *(f"  {line}" for line in lines)))


def _abandon_stdout() -> None:
    """Discard the rest of standard output if it cannot be written any more.

    Otherwise the interpreter would try to write it at exit and print a second error.
    """
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(message: str, status: int) -> int:
    from youbot_env.errors import shortened, visible  # slow: not at the top

    print(f"youbot: {visible(shortened(' '.join(message.split())))}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
