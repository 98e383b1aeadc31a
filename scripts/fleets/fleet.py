"""A fleet: which robots are to be diagnosed, by which workers, and what comes of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from identification.mechanisms.registry import load_any_model
from youbot_env.errors import InputError
from youbot_env.files import json_text
from youbot_env.model.model_file import read_content
from youbot_scripts.fleets.records import LINES, Record, RobotFiles, make_folders, write_lines
from youbot_scripts.fleets.robots import Robot, Task, fingerprint
from youbot_scripts.fleets.settings import FleetSettings
from youbot_scripts.fleets.summary import Cost, FleetSummary, summary_of
from youbot_scripts.shared.workers import spread


@dataclass(frozen=True)
class FleetResult:
    """Results of a fleet, in the order of the robots' names; ``lines``: their file."""

    records: tuple[Record, ...]
    summary: FleetSummary
    cost: Cost
    lines: Path


def diagnose_fleet(
    diagnose_robot: Callable[[Task], str],
    model: str,
    robots: Sequence[Robot],
    folder: Path,
    *,
    jobs: int = 1,
    audit: float = 0.05,
    effects: Path | None = None,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
    settings: FleetSettings = FleetSettings(),
) -> FleetResult:
    """Diagnose robots, those whose results are in the folder not again.

    Workers are those of joblib's backend that is in force, as for :func:`spread`.

    Parameters
    ----------
    diagnose_robot : writes a robot's files; a module's function, which workers find by its name
    model : file, or the name of one that ships with the package
    folder : for results and models; made if it is missing
    jobs : workers
    audit : share of the robots that are diagnosed even if the screen passes them
    effects : the user's file of effects, which is loaded already: results rest on it
    progress : called once for each robot

    Raises
    ------
    InputError
        If the model or the folder cannot be used, or there are no robots.
    """
    if not robots:
        raise InputError("no robots: name a folder of logs for each")
    load_any_model(model)  # refused here, once, and not by each worker
    make_folders(folder)
    given = _given(model, effects, seed, settings)
    source = str(Path(model).absolute()) if Path(model).exists() else model
    tasks = [
        Task(
            *(robot, source, folder, fingerprint(robot, f"{given} {in_full}")),
            in_full=in_full, seed=seed, settings=settings,
        )
        for robot in robots
        for in_full in [_is_audited(robot.name, audit)]
    ]  # fmt: skip
    waiting = [task for task in tasks if _kept(task) is None]
    for _ in range(len(tasks) - len(waiting)):
        progress()
    for _ in spread(diagnose_robot, waiting, jobs):
        progress()
    return _result(folder, tasks, settings)


def _kept(task: Task) -> tuple[Record, dict[str, float]] | None:
    return RobotFiles(task.folder, task.robot.name).read(task.fingerprint)


def _result(folder: Path, tasks: Sequence[Task], settings: FleetSettings) -> FleetResult:
    found = [
        RobotFiles(folder, task.robot.name).read(task.fingerprint, failed=True) for task in tasks
    ]
    for task, one in zip(tasks, found, strict=True):
        if one is None:
            raise InputError(
                f"{folder}: the result of robot {task.robot.name} is gone: is the folder seen by "
                "all workers, and does nobody else write to it? run the command again"
            )
    records = [one[0] for one in found if one is not None]
    costs = [one[1] for one in found if one is not None]
    write_lines(folder, records)
    cost = Cost.of(records, costs)
    return FleetResult(tuple(records), summary_of(records, settings), cost, folder / LINES)


def _given(model: str, effects: Path | None, seed: int, settings: FleetSettings) -> str:
    """All that the results of all robots rest on, beside their logs."""
    own = "" if effects is None else hashlib.sha256(effects.read_bytes()).hexdigest()
    content = json_text(read_content(model))
    return f"{version('youbot')} {seed} {settings} {own} {content}"


def _is_audited(name: str, share: float) -> bool:
    """Whether a robot belongs to a random share, the same at each run."""
    drawn = int.from_bytes(hashlib.sha256(name.encode("utf-8", "surrogateescape")).digest()[:8])
    return drawn < share * 2.0**64
