"""Identify, compare and diagnose in a browser on this machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import EffectsOption

EXAMPLES = (
    "youbot workbench",
    "youbot workbench paper runs/calibration.csv runs/multisine_a.csv",
    "youbot workbench --folder runs --port 8051",
)


def main(
    things: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MODEL] [LOG]...", help="A model to start from, and logs."),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            metavar="DIR", help="No file outside it is read; `workbench/` in it holds the results."
        ),
    ] = Path("."),
    effects: EffectsOption = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 0,
) -> None:
    """Serve the workbench on loopback and print its address; Ctrl-C ends it.

    Drop or choose logs, check them, identify, diagnose; press a candidate to add it and watch the
    error fall; undo; drive controllers. Every click is a `youbot` command, which the page shows and
    gives away as a script and as a notebook. The address holds a token: without it nothing answers.
    """
    # Imported here: `youbot workbench --help` does without them.
    from youbot_env.errors import optional_library

    for name in ("dash", "plotly"):
        optional_library(name, "workbench", f"the workbench needs {name}")
    from youbot_scripts.interactive.app import build
    from youbot_scripts.interactive.serving import serve

    serve(folder, things or [], port, build, effects)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
