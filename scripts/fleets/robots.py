"""The robots of a fleet: a folder of logs each."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from identification.logs.reading import ENDINGS
from youbot_env.errors import InputError
from youbot_scripts.fleets.settings import FleetSettings


@dataclass(frozen=True)
class Robot:
    """A robot's name, which is its folder's, and its logs."""

    name: str
    logs: tuple[Path, ...]


@dataclass(frozen=True)
class Task:
    """A robot to be diagnosed.

    Attributes
    ----------
    model : file, or the name of one that ships with the package
    folder : of the fleet's results
    fingerprint : of what the result rests on
    in_full : diagnose it even if the screen passes it
    """

    robot: Robot
    model: str
    folder: Path
    fingerprint: str
    in_full: bool
    seed: int
    settings: FleetSettings = FleetSettings()


def robots_of(folders: Sequence[Path]) -> list[Robot]:
    """The robots of folders, by name; a folder without logs may hold a folder for each robot.

    A robot without any log stays one: it is told of among those that could not be read.

    Raises
    ------
    InputError
        If a folder cannot be read, or two robots have one name.
    """
    found: dict[str, tuple[Path, Robot]] = {}
    for given in folders:
        for folder in _robot_folders(given):
            name = folder.resolve().name
            if name in found:
                raise InputError(
                    f"{folder}: robot {name!r} is in {found[name][0]} too; a result goes by its "
                    "folder's name: rename one"
                )
            found[name] = (folder, Robot(name, tuple(logs_in(folder))))
    return [found[name][1] for name in sorted(found)]


def _robot_folders(given: Path) -> list[Path]:
    if not given.is_dir():
        raise InputError(f"{given}: no such folder; name a folder of logs for each robot")
    try:
        inside = sorted(path for path in given.iterdir() if path.is_dir())
    except OSError as error:
        raise InputError(f"{given}: cannot be read: {error.strerror}") from None
    return inside if inside and not logs_in(given) else [given]


def logs_in(folder: Path) -> list[Path]:
    """Log files directly in a folder, in the order of their names."""
    try:
        return sorted(
            path
            for path in folder.iterdir()
            if path.name.lower().endswith(ENDINGS) and path.is_file()
        )
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None


def fingerprint(robot: Robot, given: str) -> str:
    """What a result rests on: the robot's logs, their names included, and ``given`` for all.

    A log that cannot be read counts as empty; its reason is told when it is diagnosed.
    """
    seal = hashlib.sha256(given.encode())
    for path in robot.logs:
        try:
            content = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError:
            content = ""
        seal.update(f"\n{path.name} {content}".encode("utf-8", "surrogateescape"))
    return seal.hexdigest()
