"""Starts the workbench's server: on loopback only, with a new token for each run."""

from __future__ import annotations

import logging
import secrets
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from youbot_env.errors import InputError
from youbot_scripts.interactive.project import Project
from youbot_scripts.interactive.worker import Worker

HOST = "127.0.0.1"


Build = Callable[[Project, Worker, str, int], Any]
"""Makes the application of a project, its worker, a token and a port."""


def serve(
    folder: Path, things: Sequence[str], port: int, build: Build, effects: Path | None = None
) -> None:
    """Print the address and serve until Ctrl-C.

    Parameters
    ----------
    things : a model first, if one is named; then logs inside the folder
    port : 0 for any that is free
    effects : the user's file of effects, which this process has loaded

    Raises
    ------
    InputError
        If a file lies outside the folder, or the port is taken.
    """
    from werkzeug.serving import make_server

    folder = folder.resolve()
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder")
    model, logs = _sorted(folder, things)
    project = Project.open(folder, model, logs)
    project.effects = _effects_file(folder, effects) if effects else ""
    # A line for each request would hide the address.
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    listening = _listening(port)
    port, token = listening.getsockname()[1], secrets.token_urlsafe(24)
    worker = Worker(project)
    app = build(project, worker, token, port)
    server = make_server(HOST, port, app.server, threaded=True, fd=listening.fileno())
    print(f"workbench: http://{HOST}:{port}/?token={token}", flush=True)
    print("Ctrl-C ends it; what was done stays in", project.home, flush=True)
    try:
        server.serve_forever()
    finally:
        worker.close()
        server.server_close()


def _listening(port: int) -> socket.socket:
    """A socket on loopback."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((HOST, port))
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror}; choose another, or 0") from None
    found.listen()
    return found


def _sorted(folder: Path, things: Sequence[str]) -> tuple[str, list[str]]:
    """The model ("" if none is named) and the logs, named from the folder."""
    model, logs = "", []
    for k, thing in enumerate(things):
        is_model = thing == "paper" or thing.endswith(".json")
        if is_model and k > 0:
            raise InputError(f"{thing}: one model only, before the logs")
        if thing == "paper":
            model = thing
            continue
        name = _inside(folder, Path(thing))
        if is_model:
            model = name
        else:
            logs.append(name)
    return model, logs


def _effects_file(folder: Path, path: Path) -> str:
    """A file of effects as commands in the folder name it; one outside of it by its whole path."""
    whole = path.resolve()
    return str(whole.relative_to(folder) if whole.is_relative_to(folder) else whole)


def _inside(folder: Path, path: Path) -> str:
    """A file's name from the folder."""
    whole = path.resolve()
    if not whole.is_file():
        raise InputError(f"{path}: no such file")
    if not whole.is_relative_to(folder):
        raise InputError(f"{path}: lies outside {folder}; give --folder one that holds it")
    return str(whole.relative_to(folder))
