"""A run as the command line asks for it: options, training, final test, record."""

from __future__ import annotations

import platform
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_scripts.shared import options as common
from youbot_scripts.training.conditions import Conditions
from youbot_scripts.training.settings import LEARNERS, TEST_SEED, Choice, changed

SHARE = 0.3
"""Of the torque limit, for a policy on top of a controller that does most of the work."""


def chosen(algorithm: str, given: dict[str, Any]) -> tuple[Choice, Model]:
    """Settings and model that the options of the command line ask for.

    Raises
    ------
    InputError
        If one cannot be.
    """
    if "share" in given and "residual" not in given:
        raise InputError("share: belongs to --residual; a policy alone may use all the torque")
    learner = LEARNERS[algorithm]
    choice = Choice(
        algorithm,
        learner,
        Conditions(**learner.conditions),
        randomise=given.get("randomise", "auto"),
        effects=tuple(given.get("effect", ())),
        base=given.get("residual"),
        share=given.get("share", SHARE) if "residual" in given else 1.0,
        seed=given.get("seed", 0),
    )
    short = ("steps", "envs", "delay", "lag")
    assignments = [f"{name}={given[name]}" for name in short if name in given]
    return changed(choice, [*given.get("set", ()), *assignments]), load_model(
        given.get("model", "paper")
    )


def train(
    algorithm: str,
    path: Path,
    given: dict[str, Any],
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    report: Callable[[dict[str, Any]], None] = lambda row: None,
) -> dict[str, Any]:
    """Train as the command does and return its result: the policy's path and its record.

    Parameters
    ----------
    path : folder of the run
    given : options by the command's names, those that were given
    resume : go on with the run in the folder
    tensorboard, device : as the command's
    report : is told each evaluation, see ``learning.Report``

    Raises
    ------
    InputError
        If an option cannot be, or the folder holds another run.
    """
    from youbot_scripts.training import learning
    from youbot_scripts.training.run_folder import RunFolder

    folder = RunFolder(path)
    if resume:
        choice, model, command = _resumed(folder, algorithm, given)
    else:
        choice, model = chosen(algorithm, given)
        command = shlex.join(["youbot", "train", algorithm, *_words(given)])
        learning.prepare(choice, model)  # what cannot be shows before a folder is made
        folder.begin(choice, model, command)
    with common.progress(choice.learner.steps, f"training {algorithm}") as advance:
        trainee, record = learning.train(
            choice,
            model,
            folder,
            device=device,
            tensorboard=tensorboard,
            progress=advance,
            report=report,
        )
    record = {
        "command": command,
        "seed": choice.seed,
        "choice": choice.to_dict(),
        "model": model.name,
        **_versions(),
        **record,
    }
    network = learning.finish(trainee, folder, record)
    tests = {"kinematic": trainee.judge_other("kinematic", model, TEST_SEED)}
    if choice.base not in (None, "kinematic"):
        tests[choice.base] = trainee.judge_other(choice.base, model, TEST_SEED)
    tests[trainee.description.name] = trainee.judge(network, TEST_SEED)
    record["test"] = {name: found.to_dict() for name, found in tests.items()}
    learning.finish(trainee, folder, record)
    return {"policy": str(folder.policy), "training": record}


def import_policy(algorithm: str, path: Path, folder: Path, given: dict[str, Any]) -> Path:
    """Turn a Stable-Baselines3 zip into a policy file as the command does, and return its path.

    Parameters
    ----------
    path, folder : the zip, and where the policy goes
    given : options by the command's names, those that were given: what it was trained under

    Raises
    ------
    InputError
        If an option cannot be, the file is no such zip, or its policy cannot be written.
    """
    from youbot_scripts.training.exporting import import_zip, write_imported

    choice, model = chosen(algorithm, {**given, "seed": 0})
    if choice.base is not None:
        raise InputError("import: a policy on top of a controller cannot be imported, only trained")
    print(
        f"youbot: warning: {path} holds pickles: loading it runs whatever code its author put "
        "there",
        file=sys.stderr,
    )
    found = import_zip(algorithm, path)
    return write_imported(found, path.name, folder, choice.conditions, model)


def _resumed(folder: Any, algorithm: str, given: dict[str, Any]) -> tuple[Choice, Model, str]:
    choice, model, command = folder.asked()
    if given:
        raise InputError(
            f"resume: the run keeps its own settings; leave out --{next(iter(given))}, or begin "
            "another run"
        )
    if choice.algorithm != algorithm:
        raise InputError(f"{folder.path}: was begun as `{command}`; resume {choice.algorithm}")
    return choice, model, command


def _words(given: dict[str, Any]) -> list[str]:
    words = []
    for name, value in given.items():
        for item in value if isinstance(value, list) else [value]:
            words += [f"--{name}", str(item)]
    return words


def _versions() -> dict[str, Any]:
    from importlib.metadata import version

    names = ("youbot", "numpy", "torch", "stable-baselines3")
    found = {name: version(name).partition("+")[0] for name in names}
    return {"versions": {"python": platform.python_version(), **found}}
