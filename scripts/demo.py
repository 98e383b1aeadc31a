"""Show the whole story on shipped logs."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts import cli
from youbot_scripts.demonstration.chapters import CHAPTERS
from youbot_scripts.demonstration.files import LOGS, Demonstration, unpack
from youbot_scripts.shared.options import console

if TYPE_CHECKING:
    from rich.console import Console

EXAMPLES = ("youbot demo", "youbot demo --output /tmp/demo")


def main(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for what it writes.")
    ] = Path("demo_output"),
) -> None:
    """From logs to a model, from where it fails to what it lacks, and to a controller built on it.

    Each step is a youbot command, shown as you would type it. The logs (50 Hz) come from a
    simulated platform with the paper's parameters, so the truth is known. A minute on an idle
    core; twice that where the simulations have to be compiled first.
    """
    demo = Demonstration(console(), output)
    unpack(demo)
    for number, (title, chapter) in enumerate(CHAPTERS.items(), 1):
        _heading(demo.out, f"{number}. {title}")
        chapter(demo)
    _finish(demo)


def _heading(out: Console, title: str) -> None:
    out.print()
    out.rule(title, align="left", style="default")


def _finish(demo: Demonstration) -> None:
    """Print the files and the next commands to try."""
    out, folder = demo.out, demo.folder
    _heading(out, "What there is now")
    _show_files(out, folder)
    if not demo.plots:
        out.print('No plots without matplotlib: pip install "youbot[plots]"')
    out.print("\nWhat to type next:")
    for line, why in _next(demo):
        out.print(f"  {why}:")
        out.print(f"    {line}", style="bold", soft_wrap=True)


def _show_files(out: Console, folder: Path) -> None:
    out.print(f"{folder.resolve()}", soft_wrap=True)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            out.print(f"  {path.relative_to(folder)}", soft_wrap=True)


def _next(demo: Demonstration) -> Sequence[tuple[str, str]]:
    logs, model = demo.calibration.parent, shlex.quote(str(demo.model))
    both = f"{shlex.quote(str(demo.calibration))} {shlex.quote(str(logs / LOGS[1]))}"
    return (
        (f"youbot identify {both} -o better.json", "Fit to two logs at once"),
        ("youbot record runs/ --effect floor_tilt", "Record a platform on a slope"),
        (f"youbot compare {model} runs/multisine_b.csv", "... and see the model fail on it"),
        ("youbot evaluate", 'Compare more controllers, band by band; needs "youbot[control]"'),
        (f"youbot train ppo --model {model}", 'Train a policy on the model; needs "youbot[rl]"'),
        ("youbot doctor my_log.csv", "Check a log of your own"),
    )


if __name__ == "__main__":
    sys.exit(cli.run_script(__file__))
